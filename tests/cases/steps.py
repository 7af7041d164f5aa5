"""The time steps of a scene, without building it."""

from __future__ import annotations

from jaxdem.scene import Scene
from jaxdem.setup import time_steps as steps
from jaxdem.setup.fluid import fluid_setup
from jaxdem.setup.particles import particle_setup
from jaxdem.structure import TimeSteps


def time_steps(scene: Scene) -> TimeSteps:
    """See `jaxdem.setup.time_steps`."""
    return steps.time_steps(scene, fluid_setup(scene), particle_setup(scene))
