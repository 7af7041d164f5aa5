"""Warnings of numbers that look as if they were in another unit."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from jaxdem.cli import terminal
from jaxdem.errors import InputError

if TYPE_CHECKING:
    from jaxdem.scene import Scene


def warn_of_units(description: Scene) -> None:
    """What of a scene looks like another unit."""
    from jaxdem.check.unit_warnings import unit_warnings

    for warning in unit_warnings(description):
        terminal.warn(warning)


@contextmanager
def units_beside_a_refusal(description: Scene) -> Iterator[None]:
    """Where a scene is refused, what of it looks like another unit: the refusal itself names a consequence."""
    try:
        yield
    except InputError:
        warn_of_units(description)
        raise
