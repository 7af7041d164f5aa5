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
    wrong,
)


class Material(Section):
    """A material. Values that are not given are those of `[contact]`.

    Attributes:
        name: name that particles, walls and pairs refer to.
        young_modulus: Young's modulus [Pa].
        poisson_ratio: Poisson's ratio [-].
        restitution: coefficient of restitution of two bodies of this material [-].
        friction: coefficient of sliding (Coulomb) friction of two bodies of this material [-].
        rolling_friction: coefficient of rolling friction of two bodies of this material [-].
    """

    name: Name
    young_modulus: Positive | None = None
    poisson_ratio: Poisson | None = None
    restitution: Fraction | None = None
    friction: NonNegative | None = None
    rolling_friction: NonNegative | None = None


class MaterialPair(Section):
    """Constants of a contact between two different materials.

    Attributes:
        materials: names of the two materials; "wall" for walls without a material.
        restitution: coefficient of restitution of this pair. Default: geometric mean of the values of the two
            materials [-].
        friction: coefficient of sliding friction of this pair. Default: geometric mean [-].
        rolling_friction: coefficient of rolling friction of this pair. Default: geometric mean [-].
    """

    materials: tuple[WallMaterialName, WallMaterialName]
    restitution: Fraction | None = None
    friction: NonNegative | None = None
    rolling_friction: NonNegative | None = None

    @model_validator(mode="after")
    def _says_something(self) -> MaterialPair:
        if len(set(self.materials)) < 2:
            limit = (
                "a pair needs two different materials; the constants of a material against itself are in its own table"
            )
            raise wrong("materials", self.materials, limit, "set them in [[materials]]")
        if (self.restitution, self.friction, self.rolling_friction) == (None, None, None):
            raise wrong("", self.materials, "has no constants", "set restitution, friction or rolling_friction")
        return self


class Species(Section):
    """A part of the particles. Values that are not given are those of `[particles]`.

    Attributes:
        share: share in the number of particles; the shares of all species add up to 1 [-].
        radius: radius of these particles [m].
        density: density of these particles [kg/m3].
        material: name of one of `[[materials]]`.
    """

    share: Annotated[float, Field(gt=0.0, le=1.0, strict=True)]
    radius: Positive | None = None
    density: Positive | None = None
    material: MaterialName | None = None


def _named_once(materials: tuple[Material, ...]) -> tuple[Material, ...]:
    names = [material.name for material in materials]
    for k, name in enumerate(names):
        if name == WALL or name in names[:k]:
            limit = "is reserved for walls without a material" if name == WALL else "is used twice"
            raise wrong(f"{k}.name", name, limit, "give another name")
    return materials


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
Materials = Annotated[Tables[Material], AfterValidator(_named_once)]
MaterialPairs = Annotated[Tables[MaterialPair], AfterValidator(_paired_once)]
