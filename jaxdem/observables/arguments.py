"""What the functions of this room are given: numbers that stand for nothing are refused.

An index beyond an array is the last one to JAX, and an axis that is not there matches none.
"""

from __future__ import annotations

from collections.abc import Iterable

from jaxdem.errors import InputError, is_whole, require_kinds
from jaxdem.particles.neighbors import Neighbors
from jaxdem.state import Diagnostics, Parameters, State
from jaxdem.structure import Structure

KINDS: dict[str, type] = {
    "structure": Structure,
    "parameters": Parameters,
    "state": State,
    "before": State,
    "after": State,
    "neighbors": Neighbors,
    "diagnostics": Diagnostics,
}
"""What arguments must be, by their names."""


def require_arguments(**given: object) -> None:
    """Refuses arguments that are not of `KINDS`, such as two in the wrong order.

    Raises:
        InputError: naming the first.
    """
    remedy = "give it as jaxdem.build, jaxdem.initial_state or a step makes it, in the order of the arguments"
    require_kinds(remedy, **{name: (value, KINDS[name]) for name, value in given.items()})


def require_numbers(name: str, numbers: Iterable[object], count: int, of: str) -> None:
    """Refuses what is no number from 0 to less than a count.

    Args:
        name: of the argument.
        numbers: given.
        count: how many there are.
        of: what they are, in words.

    Raises:
        InputError: naming the first.
    """
    for number in numbers:
        if not is_whole(number) or not 0 <= number < count:  # type: ignore[operator]
            there = f"there are {count}, numbered from 0" if count else "there are none"
            raise InputError(name, number, f"is the number of none of the {of}: {there}", "correct it")
