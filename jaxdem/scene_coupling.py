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
    if coupling.deconvolution > 0.0:
        raise InputError(
            "coupling.deconvolution",
            coupling.deconvolution,
            "would sharpen a particle's own wake, which coupling.self_disturbance takes away",
            "set one of the two to 0 or false",
        )
    if coupling.void_fraction != "kernel":
        raise InputError(
            "coupling.self_disturbance",
            True,
            f'is known for coupling.void_fraction = "kernel", not for "{coupling.void_fraction}"',
            "change one of the two",
        )


def check_coarse_inputs(coupling: Any, cells: tuple[int, ...], samples: float) -> None:
    """Refuse coarsened inputs of the drag law where nothing would be left of them, or they would be mistaken."""
    factor = coupling.drag_inputs_coarsened
    if factor == 1:
        return
    key = "coupling.drag_inputs_coarsened"
    if factor > max(cells):
        raise InputError(key, factor, f"leaves one cell of {cells}", f"lower it, to {max(cells)} at most")
    if coupling.self_disturbance:
        raise InputError(
            key, factor, "a particle's own wake is not known on averaged fields", "set coupling.self_disturbance = false"
        )  # fmt: skip
    if samples > 0.0:
        raise InputError(
            key, factor, "samples are of a law that sees the fluid's own mesh", "set output.samples = 0"
        )
