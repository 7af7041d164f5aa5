"""Checks of the keys of `[coupling]` that take more than a line."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, Field

from jaxdem.errors import InputError


def _window(value: int) -> int:
    if value == 1:
        raise ValueError(
            "a window of the Basset force has 2 intervals at least, and 20 for its tail to be small"
        )
    return value


BassetWindow = Annotated[int, Field(ge=0, le=1000, strict=True), AfterValidator(_window)]
"""Number of coupling intervals, 0 for no Basset force."""


def check_self_disturbance(coupling: Any, dimension: int) -> None:
    """Refuse the correction where nothing is known to correct by."""
    if not coupling.self_disturbance:
        return
    if dimension == 2:
        raise InputError(
            "coupling.self_disturbance",
            True,
            "needs three dimensions: in a plane a steady wake grows with the box (Stokes' paradox)",
            "set it to false, or make the scene 3-D",
        )
    if coupling.void_fraction != "kernel":
        raise InputError(
            "coupling.self_disturbance",
            True,
            f'is known for coupling.void_fraction = "kernel", not for "{coupling.void_fraction}"',
            "change one of the two",
        )
