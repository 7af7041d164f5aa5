"""The tables `[[materials]]`, `[[material_pairs]]` and `[[particles.species]]` of a scene."""

from __future__ import annotations

import difflib
from typing import Annotated, Any

from pydantic import Field

from jaxdem.errors import InputError
from jaxdem.scene.base import NonNegative, Positive, Section

WALL = "wall"
"""Name of the material of walls that have no other: the `contact.wall_*` keys."""

Poisson = Annotated[float, Field(gt=-1.0, le=0.5, strict=True)]
Restitution = Annotated[float, Field(ge=0.0, le=1.0, strict=True)]
Name = Annotated[str, Field(min_length=1)]


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
    restitution: Restitution | None = None
    friction: NonNegative | None = None
    rolling_friction: NonNegative | None = None


class MaterialPair(Section):
    """Constants of a contact between two different materials.

    Attributes:
        materials: names of the two materials; "wall" for walls without a material.
        restitution: coefficient of restitution of this pair. Default: geometric mean of the values of the two materials [-].
        friction: coefficient of sliding friction of this pair. Default: geometric mean [-].
        rolling_friction: coefficient of rolling friction of this pair. Default: geometric mean [-].
    """

    materials: tuple[Name, Name]
    restitution: Restitution | None = None
    friction: NonNegative | None = None
    rolling_friction: NonNegative | None = None


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
    material: Name | None = None


def check_materials(materials: tuple[Material, ...], pairs: tuple[MaterialPair, ...]) -> None:
    """Refuses names that are taken twice or unknown, and pairs that say nothing."""
    names: list[str] = []
    for k, material in enumerate(materials):
        if material.name == WALL or material.name in names:
            limit = "is reserved for walls without a material" if material.name == WALL else "is used twice"
            raise InputError(f"materials.{k}.name", material.name, limit, "give another name")
        names.append(material.name)
    seen: set[frozenset[str]] = set()
    for k, pair in enumerate(pairs):
        key = f"material_pairs.{k}"
        for name in pair.materials:
            check_material(f"{key}.materials", name, (*names, WALL))
        if len(set(pair.materials)) < 2:
            raise InputError(
                f"{key}.materials", pair.materials, "a pair needs two different materials; the constants of a "
                "material against itself are in its own table", "set them in [[materials]]",
            )  # fmt: skip
        if frozenset(pair.materials) in seen:
            raise InputError(f"{key}.materials", pair.materials, "is given twice", "remove one of the two tables")
        seen.add(frozenset(pair.materials))
        if (pair.restitution, pair.friction, pair.rolling_friction) == (None, None, None):
            raise InputError(key, pair.materials, "has no constants", "set restitution, friction or rolling_friction")


def check_material(key: str, name: str | None, known: tuple[str, ...]) -> None:
    """Refuses a name that no material has."""
    if name is None or name in known:
        return
    near = difflib.get_close_matches(name, known, n=1)
    remedy = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known) or 'none'}"
    raise InputError(key, name, "there is no such material in [[materials]]", remedy)


def check_species(key: str, species: tuple[Species, ...], particles: Any, names: tuple[str, ...]) -> None:
    """Refuses species without a size or density, of unknown material, or with shares that do not add up to 1.

    Args:
        key: of the list of tables, for the messages.
        species: to check.
        particles: that have what a species has not.
        names: of the materials.
    """
    for k, one in enumerate(species):
        for name in ("radius", "density"):
            if getattr(one, name) is None and not isinstance(getattr(particles, name), float):
                raise InputError(
                    f"{key}.{k}.{name}", None, f"is missing, and particles.{name} is not a single number",
                    f"give it here, or give particles.{name} for all particles",
                )  # fmt: skip
        given = one.material if one.material is not None else particles.material
        if names and not isinstance(given, str):
            raise InputError(f"{key}.{k}.material", None, "is missing", f"known: {', '.join(names)}")
        check_material(f"{key}.{k}.material", one.material, names)
    total = sum(one.share for one in species)
    if species and abs(total - 1.0) > 1e-6:
        raise InputError(f"{key}.share", total, "the shares must add up to 1", "correct the shares")


def check_particle_materials(particles: Any, walls: tuple[Any, ...], contact: Any, names: tuple[str, ...]) -> None:  # fmt: skip
    """Refuses names that no material has, and particles without one where there are materials."""
    given = (particles.material,) if isinstance(particles.material, str) else particles.material or ()
    for name in given:
        check_material("particles.material", name, names)
    starts = particles.pack is not None or particles.position is not None
    if names and not particles.species and not given and starts:
        raise InputError(
            "particles.material", None, "is missing, but the scene has [[materials]]", f"known: {', '.join(names)}"
        )  # fmt: skip
    for k, wall in enumerate(walls):
        check_material(f"walls.{k}.material", wall.material, (*names, WALL))
    check_material("contact.wall_material", contact.wall_material, (*names, WALL))
    if particles.species:
        for name, kind in (("radius", float), ("density", float), ("material", str)):
            if getattr(particles, name) is not None and not isinstance(getattr(particles, name), kind):
                raise InputError(
                    f"particles.{name}", "one per particle", "cannot be given per particle in a scene with [[particles.species]]",
                    "give one value for all particles or none, or remove [[particles.species]]",
                )  # fmt: skip
        check_species("particles.species", particles.species, particles, names)
