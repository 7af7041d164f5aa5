"""Constants of the materials of a scene and of every pair of them. Host, numpy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jaxdem.particles.mixing import Mixing, of_materials, of_pairs
from jaxdem.scene import Contact, Scene
from jaxdem.scene.cohesion import STRENGTH, Cohesion
from jaxdem.scene.materials import WALL
from jaxdem.setup.walls import surfaces_of

OF_ONE = ("young_modulus", "poisson_ratio")
"""Constants that a material has and a pair has not."""

OF_PAIRS = ("restitution", "friction", "rolling_friction")
"""Constants that a pair of materials may have of its own."""


class MaterialTable(NamedTuple):
    """Constants of M materials and of their P = M (M + 1) / 2 pairs, walls without a material last.

    Attributes:
        names: of the materials.
        young_modulus: (M,) infinite for rigid walls [Pa].
        poisson_ratio: (M,) [-].
        restitution, friction, rolling_friction: (P,) [-].
        pair: (M, M) number of the pair that two materials make.
        given: by constant, the (G,) numbers that the scene gives, and how these are made of them.
        cohesion: (P,) strength of the cohesion of each pair; None without. In `given` it is "cohesion".
        sides: material of the sides of the box, and of walls given as functions.
        surfaces: material of the walls of the scene beside the box that are no meshes, a wedge counting twice.
        meshes: of those that are.
    """

    names: tuple[str, ...]
    young_modulus: np.ndarray
    poisson_ratio: np.ndarray
    restitution: np.ndarray
    friction: np.ndarray
    rolling_friction: np.ndarray
    pair: np.ndarray
    given: dict[str, tuple[np.ndarray, Mixing]]
    sides: int
    surfaces: tuple[int, ...]
    cohesion: np.ndarray | None = None
    meshes: tuple[int, ...] = ()

    def of_walls(self, sides: int, surfaces: int, meshes: int = 0) -> np.ndarray:
        """(S,) material of so many sides of the box, then of so many walls beside it, those given as functions last,
        then of so many meshes."""
        functions = surfaces - len(self.surfaces)
        flat = [self.sides] * sides + [*self.surfaces] + [self.sides] * functions
        return np.asarray([*flat, *self.meshes[:meshes]], np.int32)

    @property
    def wall_materials(self) -> list[int]:
        """The materials that a wall may have, each once."""
        return sorted({self.sides, *self.surfaces, *self.meshes})


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
    given = {name: _given_numbers(scene, contact, name, pair) for name in (*OF_ONE, *OF_PAIRS)}
    own = {name: of_materials(*given[name]) for name in OF_ONE}
    mixed = {name: of_pairs(*given[name], np) for name in OF_PAIRS}
    if contact.cohesion is not None:
        name = STRENGTH[contact.cohesion.kind]
        given["cohesion"] = _given_numbers(scene, contact.cohesion, name, pair, "contact.cohesion")
        mixed["cohesion"] = of_pairs(*given["cohesion"], np)
    sides = names.index(contact.wall_material or WALL)
    surfaces: list[int] = []
    meshes: list[int] = []
    for wall in scene.walls:
        number = sides if wall.material is None else names.index(wall.material)
        surfaces += [number] * len(surfaces_of(wall))
        if wall.kind == "mesh":
            meshes.append(number)
    found = MaterialTable(names, **own, **mixed, pair=pair, given=given, sides=sides, surfaces=tuple(surfaces))
    return found._replace(meshes=tuple(meshes))


def _given_numbers(
    scene: Scene, contact: Contact | Cohesion, name: str, pair: np.ndarray, table: str = "contact"
) -> tuple[np.ndarray, Mixing]:
    """What a scene gives of a constant: that of a table, which the others follow, then of materials and pairs."""
    keys, values, own = [f"{table}.{name}"], [getattr(contact, name)], []

    def number(key: str, value: float | str | None, without: int) -> int:
        if value is None:
            return without
        keys.append(key)
        values.append(np.inf if value == "rigid" else value)
        return len(keys) - 1

    for k, material in enumerate(scene.materials):
        own.append(number(f"materials.{k}.{name}", getattr(material, name), 0))
    own.append(number(f"{table}.wall_{name}", getattr(contact, f"wall_{name}", None), 0))
    of_pair: list[int] = []
    if name not in OF_ONE:
        names = [*(material.name for material in scene.materials), WALL]
        of_pair = [-1] * (int(pair.max()) + 1)
        for k, one in enumerate(scene.material_pairs):
            first, second = (names.index(material) for material in one.materials)
            of_pair[pair[first, second]] = number(f"material_pairs.{k}.{name}", getattr(one, name), -1)
    return np.asarray(values, float), Mixing(tuple(keys), tuple(own), tuple(of_pair))
