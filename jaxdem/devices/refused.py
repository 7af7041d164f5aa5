"""What does not work on several devices, refused by name before work starts; what cannot be cut is in `cut`."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from jaxdem.errors import InputError
from jaxdem.fluid.two_fluids import TwoFluidSolver
from jaxdem.simulation import Simulation


class Refused(NamedTuple):
    """What does not work on several devices.

    Attributes:
        key, value: of the scene.
        what: in words.
        there: whether a simulation has it.
    """

    key: str
    value: str
    what: str
    there: Callable[[Simulation], bool]


REFUSED = (
    Refused(
        "surface",
        "...",
        "two fluids",
        lambda simulation: simulation.fluid is not None and isinstance(simulation.fluid.solver, TwoFluidSolver),
    ),
)
"""The first one that a scene has is named."""


def require_divisible(simulation: Simulation) -> None:
    """Refuses a simulation with something that does not work on several devices.

    Raises:
        InputError: naming it.
    """
    for one in REFUSED:
        if one.there(simulation):
            limit = f"several devices do not work with {one.what}"
            raise InputError(one.key, one.value, limit, "run it on one device")
