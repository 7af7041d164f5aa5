"""Size, density and material of every particle, and the constants of every pair of materials. Host, numpy."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from jaxdem.errors import InputError
from jaxdem.particles.mixing import Mixing, of_materials, of_pairs
from jaxdem.scene import Particles, Scene
from jaxdem.scene.materials import WALL, Species
from jaxdem.scene.sizes import column

OF_PAIRS = ("restitution", "friction", "rolling_friction")
"""Constants that a pair of materials may have of its own."""


class Bodies(NamedTuple):
    """What the particles are; () where all are alike, else (N,).

    Attributes:
        radius: [m].
        density: [kg/m3].
        material: number in the table of materials; 0 in a scene without.
    """

    radius: np.ndarray
    density: np.ndarray
    material: np.ndarray


class MaterialTable(NamedTuple):
    """Constants of M materials and of their P = M (M + 1) / 2 pairs, walls without a material last.

    Attributes:
        names: of the materials.
        young_modulus: (M,) infinite for rigid walls [Pa].
        poisson_ratio: (M,) [-].
        restitution, friction, rolling_friction: (P,) [-].
        pair: (M, M) number of the pair that two materials make.
        given: by constant, the (G,) numbers that the scene gives, and how these are made of them.
    """

    names: tuple[str, ...]
    young_modulus: np.ndarray
    poisson_ratio: np.ndarray
    restitution: np.ndarray
    friction: np.ndarray
    rolling_friction: np.ndarray
    pair: np.ndarray
    given: dict[str, tuple[np.ndarray, Mixing]]

    def number(self, name: str | None) -> int:
        """Number of a material; that of walls for None."""
        return self.names.index(WALL if name is None else name)


def material_table(scene: Scene) -> MaterialTable | None:
    """The materials of a scene and what their pairs have; None for a scene with one material only.

    A pair that the scene says nothing about has the geometric mean of what the two have against themselves:
    between the two, and zero if one of them is.
    """
    contact = scene.contact
    if not scene.materials or contact is None:
        return None
    names = (*(m.name for m in scene.materials), WALL)
    count = len(names)
    first, second = np.triu_indices(count)
    pair = np.zeros((count, count), np.int32)
    pair[first, second] = pair[second, first] = np.arange(len(first))
    given = {name: _given_numbers(scene, name, names, pair) for name in ("young_modulus", "poisson_ratio", *OF_PAIRS)}
    own = {name: of_materials(*given[name]) for name in ("young_modulus", "poisson_ratio")}
    mixed = {name: of_pairs(*given[name], np) for name in OF_PAIRS}
    return MaterialTable(names, **own, **mixed, pair=pair, given=given)


def _given_numbers(scene: Scene, name: str, names: tuple[str, ...], pair: np.ndarray) -> tuple[np.ndarray, Mixing]:
    """What a scene gives of a constant: that of `[contact]`, which the others follow, then those of materials and pairs."""
    contact = scene.contact
    tables = [(f"materials.{k}.{name}", getattr(material, name)) for k, material in enumerate(scene.materials)]
    tables.append((f"contact.wall_{name}", getattr(contact, f"wall_{name}", None)))
    keys, values, own = [f"contact.{name}"], [getattr(contact, name)], []

    def number(key: str, value: Any, without: int) -> int:
        if value is None:
            return without
        keys.append(key)
        values.append(np.inf if value == "rigid" else value)
        return len(keys) - 1

    for key, value in tables:
        own.append(number(key, value, 0))
    of_pair = np.full(len(names) * (len(names) + 1) // 2 if name in OF_PAIRS else 0, -1)
    if name in OF_PAIRS:
        for k, one in enumerate(scene.material_pairs):
            place = pair[tuple(names.index(material) for material in one.materials)]
            of_pair[place] = number(f"material_pairs.{k}.{name}", getattr(one, name), -1)
    return np.asarray(values, float), Mixing(tuple(keys), tuple(own), tuple(of_pair.tolist()))


def wall_materials(scene: Scene, table: MaterialTable, sides: int, surfaces: int) -> np.ndarray:
    """(S,) material of the sides of the box, then of the walls beside it, a wedge counting twice.

    Args:
        scene: with materials.
        table: of it.
        sides: number of walls of the box.
        surfaces: number of walls beside it; those given as functions have the material of the sides.
    """
    assert scene.contact is not None
    common = table.number(scene.contact.wall_material)
    numbers = [common] * sides
    for wall in scene.walls:
        own = common if wall.material is None else table.number(wall.material)
        numbers += [own] * (2 if wall.kind == "wedge" else 1)
    return np.asarray(numbers + [common] * (sides + surfaces - len(numbers)), np.int32)


def particle_bodies(scene: Scene, count: int) -> Bodies:
    """Size, density and material of `count` particles of a scene.

    Raises:
        InputError: a list or a file has another number of entries, or a number in a file is not positive.
    """
    assert scene.particles is not None
    names = tuple(material.name for material in scene.materials)
    return _particle_bodies(scene.particles, names, count, scene.seed)


def species_bodies(
    species: tuple[Species, ...], particles: Particles, names: tuple[str, ...], kind: np.ndarray
) -> Bodies:
    """What particles are whose species are `kind` (N,), with what a species has not from `particles`."""

    def of(name: str) -> np.ndarray:
        values = [getattr(particles, name) if getattr(one, name) is None else getattr(one, name) for one in species]
        return np.asarray(values, float)[kind]

    material = [names.index(one.material or str(particles.material)) for one in species] if names else [0]
    return Bodies(of("radius"), of("density"), np.resize(np.asarray(material, np.int32), len(species))[kind])


def collapsed(bodies: Bodies) -> Bodies:
    """() for what all particles share: per particle it would cost memory and time."""
    return Bodies(*(a.flat[0].reshape(()) if a.size and (a == a.flat[0]).all() else a for a in bodies))


def shares_of(species: tuple[Species, ...], count: int) -> np.ndarray:
    """How many of `count` particles each species gets: its share, rounded so that the numbers add up."""
    exact = np.asarray([one.share for one in species]) * count
    numbers = np.floor(exact + 1e-9).astype(int)
    left = np.argsort(numbers - exact, kind="stable")[: count - int(numbers.sum())]
    numbers[left] += 1
    return numbers


def _particle_bodies(particles: Particles, names: tuple[str, ...], count: int, seed: int) -> Bodies:
    if particles.species:
        kind = np.repeat(np.arange(len(particles.species)), shares_of(particles.species, count))
        np.random.default_rng([seed, 1]).shuffle(kind)
        kind = kind if count else np.zeros(1, int)  # no particle at all: the numbers of any species
        return collapsed(species_bodies(particles.species, particles, names, kind))
    material: Any = particles.material
    if isinstance(material, tuple):
        if len(material) != count:
            raise InputError(
                "particles.material", f"{len(material)} names", f"there are {count} particles",
                f"give one name or {count}",
            )  # fmt: skip
        numbers = np.asarray([names.index(name) for name in material], np.int32)
    else:
        numbers = np.asarray(names.index(material) if names and material else 0, np.int32)
    radius = column("particles.radius", particles.radius, count)
    density = column("particles.density", particles.density, count)
    return Bodies(radius, density, numbers)
