"""Derivatives of a pack's mean velocity with respect to drag scale, inlet velocity and the weights of a closure.

A small pack in a jet, 30 coupling intervals, differentiated through contacts, exchange and pressure solve. Prints the
derivatives with respect to drag scale and inlet velocity beside central differences, and the norms of the others.

Run: python examples/gradient.py
"""

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp  # noqa: E402

import jaxdem  # noqa: E402
from jaxdem.closures import InvariantClosure, KochHill  # noqa: E402

SCENE = {
    "precision": "float64",
    "domain": {"size": [0.4, 0.2], "depth": 0.04},
    "particles": {
        "radius": 0.01,
        "density": 2650.0,
        "position": [[0.10, 0.0105], [0.1205, 0.0105], [0.141, 0.0105], [0.111, 0.05], [0.131, 0.05]],
    },
    "contact": {"young_modulus": 1e6, "friction": 0.3},
    "fluid": {"cells": [10, 5], "viscosity": 1e-6, "time_step": 0.005},
    "boundary": {
        "left": {"kind": "inlet", "velocity": 0.5, "from": 0.0, "to": 0.12},
        "right": {"kind": "outlet"},
    },
    "time": {"end": 1.0, "output_interval": 0.5},
}
STEPS = 30


def main() -> None:
    """Print the derivatives."""
    scene = jaxdem.load_scene(SCENE)
    closure = InvariantClosure.initial(base=KochHill(), hidden=(4,), seed=0)
    simulation, parameters = jaxdem.build(scene, closure)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)

    def mean_velocity(drag_scale: jax.Array, inlet: jax.Array, weights: InvariantClosure) -> jax.Array:
        left = parameters.fluid.side_velocity[0].at[0].set(inlet)
        fluid = parameters.fluid._replace(side_velocity=(left, *parameters.fluid.side_velocity[1:]))
        changed = parameters._replace(drag_scale=drag_scale, fluid=fluid, closure=weights)
        end = jaxdem.rollout(simulation, changed, state, neighbors, STEPS)
        return jnp.where(end.failures == 0, end.state.particles.velocity[:, 0].mean(), jnp.nan)

    point = (parameters.drag_scale, jnp.asarray(0.5), closure)
    value = jax.jit(mean_velocity)
    slopes = jax.jit(jax.grad(mean_velocity, argnums=(0, 1, 2)))(*point)
    print(f"mean velocity of the pack after {STEPS * simulation.interval:g} s: {value(*point):.6f} m/s")
    for number, name in ((0, "drag scale"), (1, "inlet velocity")):
        step = 1e-5 * float(point[number])
        ends = [value(*(p + s * step * (i == number) if i < 2 else p for i, p in enumerate(point))) for s in (1, -1)]
        print(f"d/d({name}): {slopes[number]:.8f}, central difference {(ends[0] - ends[1]) / (2 * step):.8f}")
    for path, slope in jax.tree_util.tree_leaves_with_path(slopes[2]):
        print(f"d/d(weights{jax.tree_util.keystr(path)}): norm {jnp.linalg.norm(slope.ravel()):.3e}")


if __name__ == "__main__":
    main()
