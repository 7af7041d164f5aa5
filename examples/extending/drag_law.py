"""Your own drag law: Clift and Gauvin's law of a single sphere, with the void fraction function of Wen and Yu.

One sphere falls through still water. Its speed is compared with the balance of drag and weight.

Run: python examples/extending/drag_law.py
"""

import math

import jax
import jax.numpy as jnp
from jax import Array
from scipy.optimize import brentq

import jaxdem
from jaxdem.closures import Correlation


class CliftGauvin(Correlation):
    """F = (1 + 0.15 Re^0.687 + 0.0175 Re / (1 + 42500 Re^-1.16)) g^-2.65, g the void fraction.

    Valid for Re up to 3e5. Source: R. Clift & W. H. Gauvin (1971), Can. J. Chem. Eng. 49, 439-448.
    """

    def stokes_multiple(self, solid_fraction: Array, reynolds: Array) -> Array:
        """F(s, Re) [-]."""
        # The slope of Re^0.687 at Re = 0 is infinite. It must not enter a gradient, not even multiplied by zero.
        moving = reynolds > 0
        re = jnp.where(moving, reynolds, 1.0)
        inertia = 0.15 * re**0.687 + 0.0175 * re / (1.0 + 42500.0 * re**-1.16)
        return (1.0 + jnp.where(moving, inertia, 0.0)) * (1.0 - solid_fraction) ** -2.65


RADIUS, SOLID, FLUID, VISCOSITY, GRAVITY = 1e-3, 1200.0, 1000.0, 1e-5, 9.81
SCENE = {
    "domain": {"size": [0.4, 0.4], "depth": 0.4},
    "particles": {"radius": RADIUS, "density": SOLID, "position": [[0.2, 0.3]]},
    "contact": {"young_modulus": 1e6, "speed": 0.2},
    "fluid": {"cells": [8, 8], "density": FLUID, "viscosity": VISCOSITY, "time_step": 0.005},
    "time": {"end": 1.0, "output_interval": 0.5},
}


def terminal_speed() -> float:
    """Speed at which the drag equals the submerged weight [m/s]."""
    weight = 4.0 / 3.0 * math.pi * RADIUS**3 * (SOLID - FLUID) * GRAVITY
    stokes = 6.0 * math.pi * FLUID * VISCOSITY * RADIUS

    def surplus(speed: float) -> float:
        reynolds = jnp.asarray(2.0 * RADIUS * speed / VISCOSITY)
        return stokes * speed * float(CliftGauvin().stokes_multiple(jnp.zeros(()), reynolds)) - weight

    return float(brentq(surplus, 1e-6, 1.0))


def main() -> tuple[float, float]:
    """Speed of the sphere, and the expected speed [m/s]."""
    scene = jaxdem.load_scene(SCENE)
    simulation, parameters = jaxdem.build(scene, closure=CliftGauvin())
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    end = jax.jit(lambda p, s, n: jaxdem.rollout(simulation, p, s, n, steps=100))(parameters, state, neighbors)
    found, expected = -float(end.state.particles.velocity[0, 1]), terminal_speed()
    print(f"the sphere falls at {found:.4f} m/s, expected {expected:.4f} m/s")
    return found, expected


if __name__ == "__main__":
    main()
