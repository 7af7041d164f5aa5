"""The time steps of a scene, without building it; and its program, which equal scenes share."""

from __future__ import annotations

import functools
from typing import Any

import jax

from jaxdem.scene import Scene
from jaxdem.setup import time_steps as steps
from jaxdem.setup.fluid import fluid_setup
from jaxdem.setup.particles import particle_setup
from jaxdem.simulation import Simulation
from jaxdem.structure import TimeSteps


def time_steps(scene: Scene) -> TimeSteps:
    """See `jaxdem.setup.time_steps`."""
    return steps.time_steps(scene, fluid_setup(scene), particle_setup(scene))


@functools.lru_cache(maxsize=16)
def compiled_step(simulation: Simulation) -> Any:
    """`simulation.step` under `jit`, the same function for equal simulations: it is traced once for all of them.

    A test that replaces code which it has run before calls `compiled_step.cache_clear()`.
    """
    return jax.jit(simulation.step)
