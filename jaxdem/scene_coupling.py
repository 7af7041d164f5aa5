"""Checks of the keys of `[coupling]` that take more than a line."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, Field

from jaxdem.errors import InputError


def _window(value: int) -> int:
    if value == 1:
        raise ValueError(
            "the window of the Basset force must have at least 2 intervals; with 20 the error of the remaining history is small"
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
            "needs three dimensions: in 2-D a steady wake grows with the box (Stokes' paradox)",
            "set it to false, or make the scene 3-D",
        )
    if coupling.deconvolution > 0.0:
        raise InputError(
            "coupling.deconvolution",
            coupling.deconvolution,
            "would amplify a particle's own wake, which coupling.self_disturbance removes",
            "set coupling.deconvolution = 0 or coupling.self_disturbance = false",
        )
    if coupling.void_fraction != "kernel":
        raise InputError(
            "coupling.self_disturbance",
            True,
            f'is only possible with coupling.void_fraction = "kernel", here it is "{coupling.void_fraction}"',
            "change one of the two keys",
        )


def check_coarse_inputs(coupling: Any, cells: tuple[int, ...], samples: float) -> None:
    """Refuse coarsened inputs of the drag law where nothing would be left of them, or they would be mistaken."""
    factor = coupling.drag_inputs_coarsened
    if factor == 1:
        return
    key = "coupling.drag_inputs_coarsened"
    if factor > max(cells):
        raise InputError(
            key, factor, f"would leave a single cell of the mesh {cells}", f"lower it to at most {max(cells)}"
        )
    if coupling.self_disturbance:
        raise InputError(
            key, factor, "the wake of a particle is not known on averaged fields", "set coupling.self_disturbance = false"
        )  # fmt: skip
    if samples > 0.0:
        raise InputError(
            key,
            factor,
            "training samples are only written for a drag law that uses the mesh of the fluid",
            "set output.samples = 0",
        )
