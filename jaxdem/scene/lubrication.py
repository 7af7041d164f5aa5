"""The table `[contact.lubrication]`."""

from __future__ import annotations

from collections.abc import Mapping

from pydantic import model_validator

from jaxdem.errors import InputError
from jaxdem.scene.base import NonNegative, Positive, Section, wrong


class Lubrication(Section):
    """Resistance of the liquid in the gap between particles, and between particles and walls.

    Attributes:
        cutoff: gap beyond which nothing acts; at most half of the smallest radius, of clumps that of a member [m].
        roughness: gap below which the resistance grows no more: the height of the bumps that touch first [m].
        viscosity: dynamic viscosity of the liquid. Default: that of the scene's fluid [Pa s].
        shear: whether the liquid in the gap also resists sliding and rolling; without it approach and parting alone.
        wet_friction: coefficient of friction of particles that a film keeps apart. Default: that of dry ones [-].
        sommerfeld_number: viscosity times speed of slip times effective radius over the normal force, at which friction
            has gone two thirds (1 - 1/e) of the way from dry to wet; needed by `wet_friction` [-].
    """

    cutoff: Positive
    roughness: Positive
    viscosity: Positive | None = None
    shear: bool = True
    wet_friction: NonNegative | None = None
    sommerfeld_number: Positive | None = None

    @model_validator(mode="after")
    def _goes_together(self) -> Lubrication:
        if self.cutoff <= self.roughness:
            limit = f"must be larger than roughness = {self.roughness:g}"
            raise wrong("cutoff", self.cutoff, limit, "set it to a tenth of a radius or less")
        for name, other in (("wet_friction", "sommerfeld_number"), ("sommerfeld_number", "wet_friction")):
            if getattr(self, name) is None and getattr(self, other) is not None:
                raise wrong(name, None, f"is needed by contact.lubrication.{other}", "set both, or neither")
        return self


def check_lubrication(table: Lubrication, has_fluid: bool, others: Mapping[str, bool]) -> None:
    """Refuses a lubrication that does not fit the rest of a scene.

    Args:
        table: `[contact.lubrication]`.
        has_fluid: whether the scene has a fluid.
        others: what it does not work with, and whether it is there.
    """
    if table.viscosity is None and not has_fluid:
        limit = "is needed in a scene without [fluid]"
        raise InputError("contact.lubrication.viscosity", None, limit, "set the dynamic viscosity of the liquid [Pa s]")
    for what, there in others.items():
        if there:
            raise InputError("contact.lubrication", "...", f"does not work with {what}", "remove one of the two")
