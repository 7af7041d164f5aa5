"""Your own wall for particles: a corrugated floor as a signed-distance function.

Two grains are dropped on both sides of the trough of a wave. They roll into it and come to rest on the floor.

Run: python examples/extending/wall.py
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import jaxdem

LEVEL, AMPLITUDE, WAVELENGTH, RADIUS = 0.1, 0.02, 0.2, 0.01


def corrugated(x: Array) -> Array:
    """Distance from z = h(x) = level + amplitude cos(2 pi x / wavelength), to first order (z - h) / sqrt(1 + h'^2).

    The sign must be right everywhere, and the gradient of length one at the wall. Elsewhere the value need not be
    exact.
    """
    phase = 2.0 * jnp.pi * x[0] / WAVELENGTH
    height = LEVEL + AMPLITUDE * jnp.cos(phase)
    slope = -AMPLITUDE * 2.0 * jnp.pi / WAVELENGTH * jnp.sin(phase)
    return (x[1] - height) / jnp.sqrt(1.0 + slope**2)


SCENE = {
    "domain": {"size": [0.2, 0.2]},
    "particles": {"radius": RADIUS, "density": 2500.0, "position": [[0.06, 0.13], [0.14, 0.13]]},
    "contact": {"young_modulus": 1e6, "restitution": 0.3, "rolling_friction": 0.05, "speed": 1.0},
    "time": {"end": 1.5, "output_interval": 0.5},
}


def main() -> tuple[np.ndarray, np.ndarray]:
    """Positions (2, 2) of the grains at the end, and their gaps to the floor [m]."""
    scene = jaxdem.load_scene(SCENE)
    simulation, parameters = jaxdem.build(scene, walls=[corrugated])
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    steps = simulation.steps.outputs * simulation.steps.intervals_per_output
    end = jax.jit(lambda p, s, n: jaxdem.rollout(simulation, p, s, n, steps))(parameters, state, neighbors)
    position = end.state.particles.position
    gap = np.asarray(jax.vmap(corrugated)(position) - RADIUS)
    for (x, z), distance in zip(np.asarray(position), gap, strict=True):
        print(f"a grain at x = {x:.4f} m, z = {z:.4f} m, gap to the floor {1e6 * distance:.1f} micrometres")
    return np.asarray(position), gap


if __name__ == "__main__":
    main()
