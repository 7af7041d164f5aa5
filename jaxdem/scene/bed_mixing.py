"""The table `[fluid.bed_mixing]`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from pydantic import Field

from jaxdem.errors import InputError
from jaxdem.scene.base import Positive, Section
from jaxdem.scene.boundary import BoundarySide


class BedMixing(Section):
    """Mixing length of a turbulent stream over a bed: kappa int_0^z max(1 - phi/phi_m, 0) dz, phi the solid fraction.

    The heights z are over the lower side of the box.

    Attributes:
        von_karman: kappa [-].
        packed_solid_fraction: phi_m, solid fraction of the bed at rest, at which the length stops growing [-].
    """

    von_karman: Positive = 0.41
    packed_solid_fraction: Annotated[float, Field(gt=0.0, le=1.0, strict=True)] = 0.61


def check_bed_mixing(boundary: Mapping[str, BoundarySide]) -> None:
    """Refuses a box without a floor, or with a wall above: the length is that over the lower side alone.

    Raises:
        InputError: see above.
    """
    for name, allowed in (("bottom", ("no_slip", "moving_wall")), ("top", ("free_slip", "outlet"))):
        kind = boundary[name].kind
        if kind not in allowed:
            limit = "is not possible with fluid.bed_mixing, the length over a floor and below a free surface"
            raise InputError(f"boundary.{name}.kind", kind, limit, f"use one of {', '.join(allowed)}")
