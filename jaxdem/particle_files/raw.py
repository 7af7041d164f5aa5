"""What a reader of one format hands on: columns under the names that the file gives them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from jaxdem.errors import InputError, cut

KEY = "particles.file"
"""The scene key that all messages name."""

Values = Sequence[str] | np.ndarray
"""Of one column: texts as they stand in the file, or numbers."""


class Raw(NamedTuple):
    """The particles of a file before their columns are known.

    Attributes:
        names: of the columns, in the order of the file; a name may stand twice.
        values: of each column, one for each particle.
        header: where the names stand, for messages.
        place: where the values of particle i stand, for messages.
        strict: whether a column that is not known is a mistake; a file that a program has written as its result holds
            forces and other things beside the state.
        units: system of units that the file states; empty if it states none.
        dropped: names of arrays that hold no quantity of particles.
        lower: lower corner of the box of the file along axes whose ends are fixed or periodic, by name of the axis.
    """

    names: list[str]
    values: list[Values]
    header: str
    place: Callable[[int], str]
    strict: bool
    units: str = ""
    dropped: tuple[str, ...] = ()
    lower: dict[str, float] = {}


def refusal(place: str, limit: str, remedy: str) -> InputError:
    """The error for something in a file of particles."""
    return InputError(KEY, cut(place, 280), limit, remedy)


def chosen(frame: int | None, count: int, name: str) -> int:
    """Number of the frame that is asked for, from 0; the last one if none is.

    Raises:
        InputError: there is no such frame.
    """
    index = -1 if frame is None else frame
    if not -count <= index < count:
        limit = f"{cut(name, 200)} has {count} frame(s), numbered from 0, or from -1 backwards"
        raise InputError(f"{KEY}.frame", frame, limit, "give the number of one of them")
    return index % count


def at_time(time: float, times: Sequence[float], name: str) -> int:
    """Number of the frame of a time [s], within a millionth of it.

    Raises:
        InputError: there is none; the nearest times are named.
    """
    found = np.asarray(times, float)
    index = int(np.argmin(np.abs(found - time)))
    if abs(found[index] - time) > 1e-6 * max(abs(time), abs(float(found[-1]))):
        near = ", ".join(f"{value:.9g}" for value in found[max(index - 1, 0) : index + 2])
        limit = f"{cut(name, 200)} has no frame at that time; near it are {near} s"
        raise InputError(f"{KEY}.time", time, limit, "give the time of a frame, or its number as frame")
    return index
