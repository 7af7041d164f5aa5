"""What the functions of this room are given: numbers that stand for nothing are refused.

An index beyond an array is the last one to JAX, and an axis that is not there matches none.
"""

from __future__ import annotations

from collections.abc import Iterable

from jaxdem.errors import InputError, is_whole


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
