"""Many scenes at once with vmap: two parameters are varied over an ensemble of packs, in one compiled program.

Each member is a bed of grains that settles in water, with its own drag scale, friction and random arrangement. The same
members are also run one after another, with a program that is compiled once. Results and times of both ways are
compared.

Members of a batch may differ in everything that is traced: the numbers in `Parameters` (material constants, drag scale,
fluid density and viscosity, gravity, inlet velocities, weights of a closure) and in the state (positions, velocities).
They must have the same numbers of particles and cells, time steps and models. To vary those use `jaxdem sweep`.

Run: python examples/batch.py [members]
"""

import sys
import time

import jax
import jax.numpy as jnp

import jaxdem
from jaxdem.ensemble import stack, stack_states

SCENE = {
    "domain": {"size": [0.2, 0.2], "depth": 0.04},
    "particles": {
        "count": 20,
        "radius": 0.008,
        "density": 2650.0,
        "pack": {"kind": "random", "start": [0.0, 0.0], "stop": [0.2, 0.2]},
    },
    "contact": {"young_modulus": 1e6, "friction": 0.3},
    "fluid": {"cells": [5, 5], "viscosity": 1e-6, "time_step": 0.005},
    "time": {"end": 0.5, "output_interval": 0.5},
}
STEPS = 40
"""Coupling intervals: 0.2 s."""


def members(number: int) -> tuple:
    """The simulation that all members share, and the stacked parameters, states and neighbour lists."""
    scene = jaxdem.load_scene(SCENE)
    simulation, parameters = jaxdem.build(scene)
    drag = jnp.linspace(0.5, 2.0, number)
    friction = jnp.linspace(0.0, 0.6, number)
    varied = [
        parameters._replace(drag_scale=drag[i], contact=parameters.contact._replace(friction=friction[i]))
        for i in range(number)
    ]
    scenes = [jaxdem.load_scene(SCENE, {"seed": seed}) for seed in range(number)]
    starts = [jaxdem.initial_state(one, simulation, parameters) for one in scenes]
    return simulation, stack(varied), *stack_states(simulation, starts)


def member(number: int, batch: tuple) -> tuple:
    """One member of a batch."""
    return jax.tree.map(lambda array: array[number], batch)


def timed(function, *arguments):
    """Result of a function and its wall time [s]."""
    begin = time.perf_counter()
    result = jax.block_until_ready(function(*arguments))
    return result, time.perf_counter() - begin


def main(number: int) -> None:
    """Print the results of the members, the difference between the two ways, and their times."""
    simulation, parameters, states, neighbors = members(number)

    def fall(parameters, state, neighbors):
        """Mean height of the grains over time [m], and the failure flags."""
        end = jaxdem.rollout(
            simulation, parameters, state, neighbors, STEPS, reversible=False,
            observe=lambda state: state.particles.position[:, -1].mean(),
        )  # fmt: skip
        return end.observations, end.failures

    one, many = jax.jit(fall), jax.jit(jax.vmap(fall))
    alone = [member(i, (parameters, states, neighbors)) for i in range(number)]
    _, first_one = timed(one, *alone[0])
    results, loop = timed(lambda: [one(*arguments) for arguments in alone])
    _, first_many = timed(many, parameters, states, neighbors)
    (heights, failures), batch = timed(many, parameters, states, neighbors)
    if failures.any():
        raise SystemExit(f"members failed: {jnp.flatnonzero(failures)}; see jaxdem.failures for the flags")

    print(f"{number} beds of {SCENE['particles']['count']} grains, {STEPS * simulation.interval:g} s of simulated time")
    print(f"drag scale {parameters.drag_scale[0]:g} to {parameters.drag_scale[-1]:g}: mean height at the end "
          f"{heights[0, -1]:.4f} to {heights[-1, -1]:.4f} m")  # fmt: skip
    difference = jnp.abs(heights - jnp.stack([result[0] for result in results])).max()
    print(f"largest difference between batch and loop: {difference:.2g} m")
    print(f"one after another {loop:.3f} s, as a batch {batch:.3f} s: gain {loop / batch:.2f}")
    with_loop, with_batch = loop + first_one - loop / number, first_many
    print(f"compilation included {with_loop:.2f} s and {with_batch:.2f} s: gain {with_loop / with_batch:.2f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 16)
