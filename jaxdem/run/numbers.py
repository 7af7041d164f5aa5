"""Numbers of a time loop as arguments of its program and not as constants in it, so that other numbers need no other
program."""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple, cast

import numpy as np
from jax import Array
from jax.typing import DTypeLike

from jaxdem.numerics.host import on_device
from jaxdem.simulation import Simulation
from jaxdem.structure import TimeSteps


class LoopNumbers(NamedTuple):
    """Steps and limits of a simulation, all (); None for a part that the scene has not.

    Attributes:
        interval: coupling interval [s].
        contact_step: contact step [s].
        contact_steps: int32, their number in an interval.
        fluid_steps: int32, smallest number of fluid steps in an interval.
        cutoff, skin: of the neighbour list [m].
        gap: at meshes, see `NeighborGeometry`; None where bodies touch them [m].
        arm: of clumps, see `NeighborSearch`; None of spheres [m].
        courant_limit: Courant number at which a fluid step is cut [-].
        speed_limit: of particles, at which a run stops [m/s].
    """

    interval: Array | None
    contact_step: Array | None
    contact_steps: Array | None
    fluid_steps: Array | None
    cutoff: Array | None
    skin: Array | None
    courant_limit: Array | None
    speed_limit: Array | None
    arm: Array | None
    gap: Array | None


def loop_numbers(simulation: Simulation, dtype: DTypeLike) -> LoopNumbers:
    """The numbers of a simulation, those with a unit in a dtype."""
    steps, contact, fluid = simulation.steps, simulation.contact, simulation.fluid

    def real(value: float | None) -> Array | None:
        return None if value is None else on_device(value, dtype)

    def whole(value: int) -> Array:
        return on_device(value, np.int32)

    listed = None if contact is None or contact.search is None else contact.search.geometry
    return LoopNumbers(
        real(simulation.interval),
        real(steps.contact),
        None if contact is None else whole(contact.steps),
        None if fluid is None else whole(fluid.substeps),
        None if listed is None else real(listed.cutoff),
        None if listed is None else real(listed.skin),
        None if fluid is None else real(fluid.courant_limit),
        real(steps.speed_limit),
        None if listed is None or simulation.search.members == 1 else real(simulation.search.arm),
        None if listed is None else real(listed.gap),
    )


NO_NUMBERS = LoopNumbers(*[None] * len(LoopNumbers._fields))
"""For what is left of a simulation without them."""


def with_numbers(simulation: Simulation, numbers: LoopNumbers) -> Simulation:
    """The simulation with these numbers in place of its own, and without what only the host looks at.

    What is traced with it depends on its own numbers in no way. It must not be hashed or compared while they are
    traced.
    """
    steps: dict[str, Any] = {"contact": numbers.contact_step, "speed_limit": numbers.speed_limit}
    of_host = {"intervals_per_output": 0, "outputs": 0, "contacts_per_interval": 0, "fluid_substeps": 0}
    changed: dict[str, Any] = {"interval": numbers.interval}
    changed["steps"] = TimeSteps(**changed, **steps, **of_host, limits={}, expected_speed=None, expected_overlap=None)
    if simulation.contact is not None:
        search, number = simulation.contact.search, cast(Any, numbers.contact_steps)
        if search is not None:
            reach: dict[str, Any] = {"cutoff": numbers.cutoff, "skin": numbers.skin, "gap": numbers.gap}
            geometry = dataclasses.replace(search.geometry, cells=search.cells, **reach)
            arm: Any = 0.0 if numbers.arm is None else numbers.arm
            search = dataclasses.replace(search, geometry=geometry, typical_radius=0.0, arm=arm)
        changed["contact"] = dataclasses.replace(simulation.contact, search=search, steps=number)
    if simulation.fluid is not None:
        own: dict[str, Any] = {"substeps": numbers.fluid_steps, "courant_limit": numbers.courant_limit}
        changed["fluid"] = dataclasses.replace(simulation.fluid, duration=changed["interval"], **own)
    if simulation.coupling is not None:
        changed["coupling"] = dataclasses.replace(simulation.coupling, interval=changed["fluid"])
    return dataclasses.replace(simulation, **changed)
