"""The table `[contact.cohesion]`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

from pydantic import Field, model_validator

from jaxdem.errors import InputError
from jaxdem.scene.base import NonNegative, Positive, Section, wrong

Hamaker = Annotated[float, Field(ge=0.0, le=1.0, strict=True)]
Kind = Literal["jkr", "dmt", "van_der_waals", "capillary", "sjkr"]

STRENGTH: dict[str, str] = {
    "jkr": "work_of_adhesion",
    "dmt": "work_of_adhesion",
    "van_der_waals": "hamaker_constant",
    "capillary": "surface_tension",
    "sjkr": "energy_density",
}
"""The number that says how strong a kind is, which each pair of materials has one of."""

NEEDED: dict[str, tuple[str, ...]] = {
    "van_der_waals": ("minimum_gap", "cutoff"),
    "capillary": ("contact_angle", "liquid_content", "bridge_share"),
}
"""Further numbers of a kind."""


class Cohesion(Section):
    """What pulls particles together, and to walls.

    Attributes:
        kind: "jkr" (soft adhesive spheres), "dmt" (stiff ones), "van_der_waals", "capillary" (liquid bridges) or "sjkr"
            (energy density times contact area, as in LIGGGHTS).
        work_of_adhesion: of "jkr" and "dmt": work of adhesion of the two surfaces together, twice the surface energy of
            one [J/m2].
        hamaker_constant: of "van_der_waals" [J].
        surface_tension: of "capillary": surface tension of the liquid [N/m].
        energy_density: of "sjkr": cohesion energy density [J/m3].
        wall_factor: strength at walls over that between particles; with `[[materials]]` walls have constants of their
            own [-].
        minimum_gap: smallest gap of "van_der_waals", which holds in contact too, and of the viscous force of
            "capillary" [m].
        cutoff: gap beyond which "van_der_waals" does not act [m].
        contact_angle: of "capillary": contact angle of the liquid [rad].
        liquid_content: of "capillary": liquid on each particle at the start over the volume of the particle [-].
        bridge_share: of "capillary": part of the liquid of a particle that a new bridge takes [-].
        liquid_viscosity: of "capillary": dynamic viscosity of the liquid; 0 for no viscous force [Pa s].
    """

    kind: Kind
    work_of_adhesion: NonNegative | None = None
    hamaker_constant: Hamaker | None = None
    surface_tension: NonNegative | None = None
    energy_density: NonNegative | None = None
    wall_factor: NonNegative = 1.0
    minimum_gap: Positive | None = None
    cutoff: Positive | None = None
    contact_angle: Annotated[float, Field(ge=0.0, lt=0.5 * math.pi, strict=True)] | None = None
    liquid_content: Annotated[float, Field(ge=0.0, le=0.1, strict=True)] | None = None
    bridge_share: Annotated[float, Field(gt=0.0, le=0.2, strict=True)] | None = None
    liquid_viscosity: NonNegative = 0.0

    @model_validator(mode="before")
    @classmethod
    def _completed(cls, table: object) -> object:
        """Defaults of a kind."""
        if isinstance(table, dict) and table.get("kind") == "capillary":
            return {"contact_angle": 0.0, "bridge_share": 0.05} | table
        return table

    @model_validator(mode="after")
    def _of_its_kind(self) -> Cohesion:
        own = (STRENGTH[self.kind], *NEEDED.get(self.kind, ()))
        if self.kind == "capillary" and (self.liquid_viscosity > 0.0 or self.minimum_gap is not None):
            own = (*own, "minimum_gap")
        for name in own:
            if getattr(self, name) is None:
                limit = f"is needed by contact.cohesion.kind = {self.kind}"
                if name == "minimum_gap" and self.kind == "capillary":
                    limit = "is needed by contact.cohesion.liquid_viscosity"
                raise wrong(name, None, limit, "set it")
        for name in {*STRENGTH.values(), "minimum_gap", *(key for keys in NEEDED.values() for key in keys)} - {*own}:
            if getattr(self, name) is not None:
                limit = f"is not used by contact.cohesion.kind = {self.kind}"
                raise wrong(name, getattr(self, name), limit, "remove it, or take another kind")
        if self.liquid_viscosity > 0.0 and self.kind != "capillary":
            limit = f"is not used by contact.cohesion.kind = {self.kind}"
            raise wrong("liquid_viscosity", self.liquid_viscosity, limit, "remove it, or take kind = capillary")
        if self.cutoff is not None and self.minimum_gap is not None and self.cutoff <= self.minimum_gap:
            limit = f"must be larger than minimum_gap = {self.minimum_gap:g}"
            raise wrong("cutoff", self.cutoff, limit, "set it to some 100 minimum gaps")
        return self

    @property
    def strength(self) -> float:
        """The number of `STRENGTH`."""
        value: float = getattr(self, STRENGTH[self.kind])
        return value


def check_strengths(table: Cohesion | None, tables: Mapping[str, Sequence[Section]]) -> None:
    """Refuses constants of materials, or of pairs of them, that the kind of cohesion does not use.

    Args:
        table: `[contact.cohesion]`, None without.
        tables: by name, `materials` and `material_pairs`.
    """
    own = None if table is None else STRENGTH[table.kind]
    for name, rows in tables.items():
        for k, one in enumerate(rows):
            for key in sorted({*STRENGTH.values()} - {own}):
                if getattr(one, key) is not None:
                    kind = (
                        "there is no [contact.cohesion]" if table is None else f"contact.cohesion.kind is {table.kind}"
                    )
                    raise InputError(f"{name}.{k}.{key}", getattr(one, key), f"is not used: {kind}", "remove it")


def check_together(table: Cohesion, materials: bool, coarse_grain: float, others: Mapping[str, bool]) -> None:
    """Refuses a cohesion that cannot work together with other parts of a scene.

    Args:
        table: `[contact.cohesion]`.
        materials: whether the scene has several materials.
        coarse_grain: radius of a particle over that of its grains [-].
        others: what liquid bridges do not work with, and whether it is there.
    """
    key = "contact.cohesion.kind"
    if coarse_grain != 1.0:
        limit = f"has no rule for parcels (particles.coarse_grain = {coarse_grain:g})"
        raise InputError(key, table.kind, limit, "remove [contact.cohesion], or set particles.coarse_grain = 1")
    if materials and table.wall_factor != 1.0:
        limit = "is for scenes with one material; with [[materials]] every pair has constants of its own"
        remedy = f'set {STRENGTH[table.kind]} in [[material_pairs]] with materials = ["...", "wall"]'
        raise InputError("contact.cohesion.wall_factor", table.wall_factor, limit, remedy)
    for what, there in others.items():
        if there and table.kind == "capillary":
            limit = f"does not work with {what}: the liquid of their bridges would be lost"
            raise InputError(key, table.kind, limit, "remove one of the two, or take another kind")
