"""The walls of a scene that are meshes: read, checked, placed, and made into what the contacts need. Host, numpy."""

from __future__ import annotations

import dataclasses
import hashlib
import math
from functools import cached_property
from typing import Any

import jax
import numpy as np

from jaxdem.numerics.host import on_device
from jaxdem.particles.mesh_near import near_corners, near_edges, near_faces
from jaxdem.particles.mesh_room import CONTACTS, with_margin
from jaxdem.particles.mesh_search import MeshSearch, needed
from jaxdem.particles.mesh_surface import MeshSurface, Places
from jaxdem.scene import Contact, Scene
from jaxdem.scene.walls import Wall
from jaxdem.setup.mesh_sources import sound_mesh
from jaxdem.setup.mesh_tables import hull_of, tables_of_features, traced_tables, with_cells
from jaxdem.setup.size_levels import list_skin
from jaxdem.solids.defects import Defects
from jaxdem.solids.features import Features, features_of
from jaxdem.solids.inside import inside
from jaxdem.solids.owners import owners
from jaxdem.solids.simultaneous_contacts import Piece, SimultaneousContacts, pieces_of, simultaneous_contacts_of
from jaxdem.solids.surface_mesh import SurfaceMesh

SAMPLES = 4096
"""Points of a mesh at which the room for its list is estimated."""


LAYER = 1.15
"""Grains of diameter d on a surface of size d^2, in 2-D of length d, in a dense layer [-]."""


@dataclasses.dataclass(frozen=True)
class WallMesh:
    """A wall that is a mesh.

    Attributes:
        key: of its table, such as walls.0.
        wall: the table.
        mesh: placed in the box and sound [m].
        defects: what it is like, after repair.
        search: how grains find it.
        largest: radius of the largest grain [m].
        typical: radius of the mean volume [m].
    """

    key: str
    wall: Wall
    mesh: SurfaceMesh
    defects: Defects
    search: MeshSearch
    largest: float
    typical: float

    @property
    def both(self) -> bool:
        """Whether it is touched from both sides."""
        return self.wall.touch != "front"

    @property
    def moves(self) -> bool:
        """Whether it moves."""
        return self.wall.moves

    @cached_property
    def content(self) -> str:
        """A fingerprint of its corners and cells, as they are placed."""
        return hashlib.sha256(self.mesh.points.tobytes() + self.mesh.cells.tobytes()).hexdigest()

    @cached_property
    def _whole(self) -> SurfaceMesh:
        """The mesh with its images across periodic sides."""
        return self.mesh.repeated(self.search.box, self.search.periodic, self.largest + self.search.reach)

    @cached_property
    def features(self) -> Features:
        """What grains can touch of it."""
        return features_of(self._whole, self.both, math.radians(self.wall.smooth_angle or 0.0))

    @cached_property
    def at_once(self) -> SimultaneousContacts | None:
        """The most faces that a grain touches at once; None where they are at right angles."""
        return simultaneous_contacts_of(self._whole, self.features.faces.normal, self.features.faces.patch)

    @cached_property
    def pieces(self) -> tuple[Piece, ...]:
        """Its faces, and the edges and corners at which several meet."""
        return pieces_of(self._whole, self.features.faces.normal, self.features.faces.patch)

    @cached_property
    def hull(self) -> np.ndarray:
        """(H, D) points that enclose it and its images across periodic sides [m]."""
        return hull_of(self._whole)

    @cached_property
    def surface(self) -> MeshSurface:
        """The same as arrays of NumPy in float64."""
        found = tables_of_features(
            self.features, self.both, 1.001 * (self.largest + (self.search.gap or 0.0)), 0.501 * self.search.skin
        )
        if self.wall.wear is None:
            return found
        cells = owners(self.mesh, self._whole, self.features, self.search.box, self.search.periodic)
        return with_cells(found, *cells)

    def traced(self, dtype: np.dtype[np.floating]) -> MeshSurface:
        """The same as arrays of JAX."""
        found = traced_tables(self.surface, dtype)
        return found._replace(hull=on_device(hull_of(self.mesh), dtype)) if self.moves else found

    @cached_property
    def usual(self) -> tuple[int, ...]:
        """Room that its list should have from the start; see `MeshRoom`.

        Of a layer of grains on all of it, each of which meets what a grain at one of many points of the mesh does.
        """
        dimension, sides = self.mesh.dimension, 2 if self.both and not self.defects.is_closed else 1
        points, normal = sampled(self.mesh)
        rng = np.random.default_rng(0)
        apart = self.largest + self.search.skin * (rng.uniform(size=len(points)) - 0.5)
        places = tuple((points + apart[:, None] * normal).T)
        found = needed(self.search, self.surface, places, np.asarray(self.largest))
        layer = math.ceil(LAYER * sides * self.mesh.area / (2.0 * self.typical) ** (dimension - 1))
        # Of one grain 64 looks more, for a single one may stand where there are most.
        looks = [with_margin(1.5 * number / len(points) * layer, 64 * (layer + 16)) for number in found[1:4]]
        slots = [with_margin(number, 1) for number in found[4:7]]
        there = [table is not None for table in (self.surface.faces, self.surface.edges, self.surface.corners)]
        shown = [number if has else 0 for number, has in zip([*looks, *slots], 2 * there, strict=True)]
        return (layer + 16, CONTACTS[dimension], *shown)

    def depth(self, position: np.ndarray, radius: np.ndarray) -> np.ndarray:
        """(N,) how far grains reach into it, as far as it can be told; minus infinity for those that do not [m].

        Args:
            position: (N, D) [m].
            radius: (N,) [m].
        """
        found = np.full(len(position), -np.inf)
        places, surface = Places(tuple(position.T), (None,) * position.shape[1]), self.surface
        kinds: list[tuple[Any, Any]] = [(surface.faces, near_faces), (surface.edges, near_edges)]
        for table, near_of in [*kinds, (surface.corners, near_corners)]:
            for bins in () if table is None else table.bins:
                start, count = bins.entries(tuple(position.T))
                grain: Any = np.repeat(np.arange(len(position)), count)
                entry = np.repeat(start, count) + np.arange(len(grain))
                entry -= np.repeat(np.cumsum(count) - count, count)
                near = near_of(table, bins.entry[entry], places.of(grain), radius[grain])
                touches = np.asarray(near.is_near(0.0, radius[grain]))
                np.maximum.at(found, grain[touches], np.asarray(near.overlap)[touches])
        if not self.both and self.defects.is_closed:
            found = np.where(inside(self.mesh, position), np.maximum(found, 2.0 * radius), found)
        return found

    @property
    def memory(self) -> int:
        """Bytes of its arrays, in float32."""
        leaves = jax.tree.leaves(self.surface)
        return int(sum(leaf.size * (8 if leaf.dtype == np.float64 else 4) for leaf in leaves))


def wall_meshes(
    scene: Scene, contact: Contact, radius: np.ndarray, members: int, gap: float | None
) -> tuple[WallMesh, ...]:
    """The walls of a scene that are meshes.

    Args:
        scene: the scene.
        contact: its table `[contact]`.
        radius: () or (N,) of all spheres that there ever are [m].
        members: of a body.
        gap: see `NeighborGeometry` [m].

    Raises:
        InputError: a file cannot be read, or a mesh is broken or lies where it cannot be meant to.
    """
    largest = float(np.max(radius))
    search = MeshSearch(scene.domain.size, scene.periodic, list_skin(contact, radius, scene.dimension, members), gap)
    typical = float(np.mean(np.power(radius, scene.dimension))) ** (1.0 / scene.dimension)
    found = []
    for number, wall in enumerate(scene.walls):
        if wall.kind == "mesh":
            key = f"walls.{number}"
            mesh, defects = sound_mesh(key, wall, scene, float(np.min(radius)))
            found.append(WallMesh(key, wall, mesh, defects, search, largest, typical))
    return tuple(found)


def sampled(mesh: SurfaceMesh) -> tuple[np.ndarray, np.ndarray]:
    """(P, D) points of a mesh, the first half of them even over its size and half over its cells, and normals there."""
    rng = np.random.default_rng(0)
    area = np.linalg.norm(mesh.area_vectors, axis=1)
    even = rng.choice(len(area), SAMPLES // 2, p=area / area.sum())
    cell = np.concatenate([even, rng.integers(0, len(area), SAMPLES // 2)])
    weights = rng.exponential(size=(len(cell), mesh.dimension))
    weights /= weights.sum(axis=1, keepdims=True)
    points = np.einsum("pk,pkd->pd", weights, mesh.corners[cell])
    return points, mesh.area_vectors[cell] / area[cell, None] * rng.choice([-1.0, 1.0], len(cell))[:, None]
