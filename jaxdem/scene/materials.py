"""The tables `[[materials]]`, `[[material_pairs]]` and `[[particles.species]]` of a scene."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from jaxdem.scene.base import (
    WALL,
    Fraction,
    MaterialName,
    Name,
    NonNegative,
    Poisson,
    Positive,
    Section,
    Tables,
    WallMaterialName,
    named_once,
    wrong,
)
from jaxdem.scene.cohesion import Hamaker
from jaxdem.scene.unread import ReadWith

HERTZ = ReadWith("contact.law = hertz_mindlin")
"""Of moduli: what reads them."""


class Material(Section):
    """A material. Values that are not given are those of `[contact]`.

    Attributes:
        name: name that particles, walls and pairs refer to.
        young_modulus: Young's modulus [Pa].
        poisson_ratio: Poisson's ratio [-].
        restitution: coefficient of restitution of two bodies of this material [-].
        friction: coefficient of sliding (Coulomb) friction of two bodies of this material [-].
        rolling_friction: coefficient of rolling friction of two bodies of this material [-].
        work_of_adhesion: of two bodies of this material, for `contact.cohesion.kind` jkr or dmt [J/m2].
        hamaker_constant: of two bodies of this material, for van_der_waals [J].
        surface_tension: of the liquid between two bodies of this material, for capillary [N/m].
        energy_density: cohesion energy density of two bodies of this material, for sjkr [J/m3].
    """

    name: Name
    young_modulus: Annotated[Positive | None, HERTZ] = None
    poisson_ratio: Annotated[Poisson | None, HERTZ] = None
    restitution: Fraction | None = None
    friction: NonNegative | None = None
    rolling_friction: NonNegative | None = None
    work_of_adhesion: NonNegative | None = None
    hamaker_constant: Hamaker | None = None
    surface_tension: NonNegative | None = None
    energy_density: NonNegative | None = None


class MaterialPair(Section):
    """Constants of a contact between two different materials.

    Attributes:
        materials: names of the two materials; "wall" for walls without a material.
        restitution: coefficient of restitution of this pair. Default: geometric mean of the values of the two
            materials [-].
        friction: coefficient of sliding friction of this pair. Default: geometric mean [-].
        rolling_friction: coefficient of rolling friction of this pair. Default: geometric mean [-].
        work_of_adhesion: of this pair, for `contact.cohesion.kind` jkr or dmt. Default: geometric mean [J/m2].
        hamaker_constant: of this pair, for van_der_waals. Default: geometric mean [J].
        surface_tension: of the liquid between this pair, for capillary. Default: geometric mean [N/m].
        energy_density: cohesion energy density of this pair, for sjkr. Default: geometric mean [J/m3].
    """

    materials: tuple[WallMaterialName, WallMaterialName]
    restitution: Fraction | None = None
    friction: NonNegative | None = None
    rolling_friction: NonNegative | None = None
    work_of_adhesion: NonNegative | None = None
    hamaker_constant: Hamaker | None = None
    surface_tension: NonNegative | None = None
    energy_density: NonNegative | None = None

    @model_validator(mode="after")
    def _says_something(self) -> MaterialPair:
        if len(set(self.materials)) < 2:
            limit = (
                "a pair needs two different materials; the constants of a material against itself are in its own table"
            )
            raise wrong("materials", self.materials, limit, "set them in [[materials]]")
        if all(value is None for name, value in self if name != "materials"):
            remedy = "set restitution, friction, rolling_friction or a constant of cohesion"
            raise wrong("", self.materials, "has no constants", remedy)
        return self


class Species(Section):
    """A part of the particles. Values that are not given are those of `[particles]`.

    Attributes:
        share: share in the number of particles; the shares of all species add up to 1 [-].
        radius: radius of these particles [m].
        density: density of these particles [kg/m3].
        material: name of one of `[[materials]]`.
        shape: name of one of `[[particles.shapes]]`, or "sphere".
    """

    share: Annotated[float, Field(gt=0.0, le=1.0, strict=True)]
    radius: Positive | None = None
    density: Positive | None = None
    material: MaterialName | None = None
    shape: Name | None = None


def _paired_once(pairs: tuple[MaterialPair, ...]) -> tuple[MaterialPair, ...]:
    sets = [frozenset(pair.materials) for pair in pairs]
    for k, pair in enumerate(sets):
        if pair in sets[:k]:
            raise wrong(f"{k}.materials", pairs[k].materials, "is given twice", "remove one of the two tables")
    return pairs


def _whole(species: tuple[Species, ...]) -> tuple[Species, ...]:
    total = sum(one.share for one in species)
    if species and abs(total - 1.0) > 1e-6:
        raise wrong("share", total, "the shares must add up to 1", "correct the shares")
    return species


Mixture = Annotated[Tables[Species], AfterValidator(_whole)]
Materials = Annotated[Tables[Material], AfterValidator(named_once(WALL, "is reserved for walls without a material"))]
MaterialPairs = Annotated[Tables[MaterialPair], AfterValidator(_paired_once)]
