"""The walls of a scene that are meshes: read, checked, placed, and made into what the contacts need. Host, numpy."""

from __future__ import annotations

import dataclasses
import math
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import jax
import numpy as np
from jax import Array
from scipy.spatial import ConvexHull, QhullError

from jaxdem.errors import InputError
from jaxdem.numerics.host import on_device
from jaxdem.particles.mesh_list import CONTACTS, MeshSearch, needed, with_margin
from jaxdem.particles.mesh_surface import (
    Bins,
    CornerTable,
    Distance,
    EdgeTable,
    FaceTable,
    MeshSurface,
    Places,
    near_corners,
    near_edges,
    near_faces,
)
from jaxdem.scene import Contact, Scene
from jaxdem.scene.walls import Wall
from jaxdem.solids.bins import Level, levels_of
from jaxdem.solids.defects import Defects, defects_of, mended
from jaxdem.solids.features import Features, features_of
from jaxdem.solids.inside import inside
from jaxdem.solids.mesh_files import DRAWINGS, HEIGHTS, MESHES, drawing, polyline, surface_of_heights, triangles_of
from jaxdem.solids.surface_mesh import SurfaceMesh

SAMPLES = 4096
"""Points of a mesh at which the room for its list is estimated."""

LARGEST, SMALLEST = 100.0, 0.001
"""Extents over that of the box at which a mesh is taken to have another unit [-]."""

MOST_OF_HULL = 512
"""Points of a hull that are followed; of more the box around it is."""

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
    def features(self) -> Features:
        """What grains can touch of it."""
        reach = self.largest + self.search.skin
        mesh = self.mesh.repeated(self.search.box, self.search.periodic, reach)
        return features_of(mesh, self.both, math.radians(self.wall.smooth_angle or 0.0))

    @cached_property
    def surface(self) -> MeshSurface:
        """The same as arrays of NumPy in float64."""
        return _surface(self.features, self.both, 1.001 * self.largest, 0.501 * self.search.skin)

    def traced(self, dtype: np.dtype[np.floating]) -> MeshSurface:
        """The same as arrays of JAX."""
        found = _traced(self.surface, dtype)
        return found._replace(hull=on_device(_hull(self.mesh), dtype)) if self.moves else found

    @cached_property
    def usual(self) -> tuple[int, ...]:
        """Room that its list should have from the start; see `MeshRoom`.

        Of a layer of grains on all of it, each of which meets what a grain at one of many points of the mesh does.
        """
        dimension, sides = self.mesh.dimension, 2 if self.both and not self.defects.is_closed else 1
        points, normal = _sampled(self.mesh)
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


def wall_meshes(scene: Scene, contact: Contact, radius: np.ndarray) -> tuple[WallMesh, ...]:
    """The walls of a scene that are meshes.

    Args:
        scene: the scene.
        contact: its table `[contact]`.
        radius: () or (N,) of all grains that there ever are [m].

    Raises:
        InputError: a file cannot be read, or a mesh is broken or lies where it cannot be meant to.
    """
    largest = float(np.max(radius))
    search = MeshSearch(scene.domain.size, scene.periodic, list_skin(contact, 2.0 * largest))
    typical = float(np.mean(np.power(radius, scene.dimension))) ** (1.0 / scene.dimension)
    found = []
    for number, wall in enumerate(scene.walls):
        if wall.kind == "mesh":
            key = f"walls.{number}"
            mesh, defects = _checked(key, wall, _read(key, wall, scene.dimension))
            _check_place(key, wall, mesh, scene, float(np.min(radius)))
            found.append(WallMesh(key, wall, mesh, defects, search, largest, typical))
    return tuple(found)


def list_skin(contact: Contact, largest_diameter: float) -> float:
    """Skin of the neighbour list [m]; see `neighbor_geometry`."""
    return (0.4 if contact.skin == "auto" else contact.skin) * largest_diameter


def _read(key: str, wall: Wall, dimension: int) -> SurfaceMesh:
    """The mesh of a wall, in the box [m]."""
    if wall.points is not None:
        mesh = polyline(wall.points, bool(wall.closed))
    else:
        mesh = _from_file(key, str(wall.file), wall, dimension)
    return mesh.placed(wall.scale or 1.0, _rotation(wall.rotate, dimension), wall.translate or (0.0,) * dimension)


def _from_file(key: str, file: str, wall: Wall, dimension: int) -> SurfaceMesh:
    kind = Path(file).suffix.lower()
    known = (*(MESHES if dimension == 3 else DRAWINGS), *HEIGHTS)
    if kind not in known:
        limit = f"in {dimension}-D a mesh is read from files that end in {', '.join(known)}"
        raise InputError(f"{key}.file", file, limit, "give a file of one of these kinds")
    if wall.spacing is not None and kind not in HEIGHTS:
        raise InputError(f"{key}.spacing", wall.spacing, "is for maps of heights", "remove this key")
    try:
        if kind in MESHES:
            return triangles_of(file)
        return drawing(file) if kind in DRAWINGS else surface_of_heights(file, wall.spacing)
    except OSError as error:
        limit = f"cannot be read ({error.strerror or error})"
        raise InputError(f"{key}.file", file, limit, "correct the name; it is relative to the scene") from None
    except ValueError as error:
        remedy = "give a sound file, or correct the keys of this wall"
        raise InputError(f"{key}.file", file, str(error), remedy) from None


def _rotation(angles: tuple[float, ...] | None, dimension: int) -> np.ndarray:
    """(D, D) of angles about x, y and z in this order, in 2-D of one angle [degrees]."""
    found = np.eye(dimension)
    for axis, angle in enumerate(angles or ()):
        c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
        first, second = (0, 1) if dimension == 2 else [(1, 2), (2, 0), (0, 1)][axis]
        turn = np.eye(dimension)
        turn[[first, second, first, second], [first, second, second, first]] = c, c, -s, s
        found = turn @ found
    return found


def _checked(key: str, wall: Wall, mesh: SurfaceMesh) -> tuple[SurfaceMesh, Defects]:
    """The mesh with its corners welded, mended if the wall asks for it, and what it is like.

    Raises:
        InputError: it is broken.
    """
    mesh = mesh.welded()
    if wall.repair:
        mesh = mended(mesh)
        if not len(mesh.cells):
            raise InputError(f"{key}.file", wall.file, "nothing is left of it after repair", "give another mesh")
    defects = defects_of(mesh)
    one, many = ("triangle", "triangles") if mesh.dimension == 3 else ("line", "lines")
    found = [
        f"{count} {one if count == 1 else many} {words}"
        for count, words in (
            (defects.degenerate, "without size"),
            (defects.duplicate, "that are there already"),
            (defects.flipped if wall.touch == "front" else 0, "turned over against their neighbours"),
        )
        if count
    ]
    if found:
        limit = f"has {', '.join(found)}, of {len(mesh.cells)}"
        raise InputError(f"{key}.file", wall.file, limit, "mend the file, or set repair = true")
    if wall.closed and not defects.is_closed:
        limit = f"has holes: {defects.open_edges} edges that belong to one triangle alone"
        raise InputError(f"{key}.closed", True, limit, "mend the file, or set closed = false")
    if wall.touch == "front" and defects.crowded_edges:
        limit = f"has {defects.crowded_edges} edges of more than two triangles, which have no front"
        raise InputError(f"{key}.touch", "front", limit, 'set touch = "both", or mend the file')
    return mesh, defects


def _check_place(key: str, wall: Wall, mesh: SurfaceMesh, scene: Scene, smallest: float) -> None:
    """Refuses a mesh at rest that is nowhere in the box, and one with a size as if in another unit."""
    lower, upper = mesh.bounds
    size, name = np.asarray(scene.domain.size), "file" if wall.points is None else "points"
    words = " x ".join(f"{length:.4g}" for length in upper - lower)
    box = " x ".join(f"{length:.4g}" for length in size)
    ratio = mesh.extent / float(size.max())
    unit = "are its coordinates in millimetres? Then set scale = 0.001"
    if ratio > LARGEST or ratio < SMALLEST or mesh.extent < smallest:
        limit = f"is {words} m large with scale = {wall.scale:g}, and the box {box} m"
        raise InputError(f"{key}.{name}", wall.file, limit, unit if ratio > 1.0 else "correct scale")
    moves = wall.motion is not None or wall.piston is not None
    if not moves and (np.any(upper < 0.0) or np.any(lower > size)):
        ends = " to ".join("(" + ", ".join(f"{x:.4g}" for x in corner) + ")" for corner in (lower, upper))
        limit = f"lies outside of the box: from {ends} m, and the box is {box} m"
        raise InputError(
            f"{key}.{name}", wall.file, limit, f"correct translate; or {unit}" if ratio > 5.0 else "correct translate"
        )


def _sampled(mesh: SurfaceMesh) -> tuple[np.ndarray, np.ndarray]:
    """(P, D) points of a mesh, half of them even over its size and half over its cells, and normals there."""
    rng = np.random.default_rng(0)
    area = np.linalg.norm(mesh.area_vectors, axis=1)
    even = rng.choice(len(area), SAMPLES // 2, p=area / area.sum())
    cell = np.concatenate([even, rng.integers(0, len(area), SAMPLES // 2)])
    weights = rng.exponential(size=(len(cell), mesh.dimension))
    weights /= weights.sum(axis=1, keepdims=True)
    points = np.einsum("pk,pkd->pd", weights, mesh.corners[cell])
    return points, mesh.area_vectors[cell] / area[cell, None] * rng.choice([-1.0, 1.0], len(cell))[:, None]


def _surface(features: Features, both: bool, radius: float, slack: float) -> MeshSurface:
    """Tables in float64 of what grains up to a radius can touch after a motion of `slack` [m]."""
    faces, lines, corners = features

    def places(rows: Any) -> Places:
        return Places(tuple(np.ascontiguousarray(rows.T)), (None,) * rows.shape[1])

    def directions(rows: np.ndarray) -> tuple[Any, ...]:
        return tuple(tuple(np.ascontiguousarray(rows[:, k].T)) for k in range(rows.shape[1]))

    def patch(numbers: np.ndarray) -> Any:
        return numbers.astype(np.int32)

    def distance(values: Any) -> Distance:
        return Distance(values, None)

    dimension, either = faces.anchor.shape[1], cast(Array, np.asarray(both))
    ends = np.stack([_corner(faces, k) for k in range(dimension)], axis=1)
    # A grain is above a face that it touches.
    reach, above = radius + slack, radius * np.abs(faces.normal) + slack
    found = levels_of(ends.min(axis=1), ends.max(axis=1), reach, above, (faces.anchor, faces.normal))
    table = FaceTable(
        places(faces.anchor),
        places(faces.normal),
        either,
        tuple(places(faces.inward[:, k]) for k in range(dimension)),
        tuple(distance(faces.offset[:, k]) for k in range(dimension)),
        patch(faces.patch),
        _bins(found),
    )
    edges = of_corners = None
    if len(lines.anchor):
        other = lines.anchor + lines.length[:, None] * lines.along
        found = levels_of(np.minimum(lines.anchor, other), np.maximum(lines.anchor, other), reach, reach)
        edges = EdgeTable(
            places(lines.anchor), places(lines.along), distance(lines.length),
            directions(lines.beyond), patch(lines.patch), _bins(found),
        )  # fmt: skip
    if len(corners.anchor):
        found = levels_of(corners.anchor, corners.anchor, reach, reach)
        of_corners = CornerTable(places(corners.anchor), directions(corners.beyond), patch(corners.patch), _bins(found))
    return MeshSurface(table, edges, of_corners)


def _corner(faces: Any, k: int) -> np.ndarray:
    """(F, D) corner k of every face, where the borders opposite to the others meet."""
    dimension = faces.anchor.shape[1]
    others = [j for j in range(dimension) if j != k]
    rows = np.concatenate([faces.inward[:, others], faces.normal[:, None]], axis=1)
    right = np.concatenate([faces.offset[:, others], np.zeros((len(faces.anchor), 1))], axis=1)
    return faces.anchor + np.linalg.solve(rows, right[..., None])[..., 0]


def _hull(mesh: SurfaceMesh) -> np.ndarray:
    """(H, D) points that enclose a mesh: those of its convex hull, or the corners of the box around it [m]."""
    points = mesh.points[np.unique(mesh.cells)]
    try:
        found = points[ConvexHull(points).vertices]
    except QhullError:  # it is flat
        found = points
    if len(found) <= MOST_OF_HULL:
        return np.asarray(found)
    lower, upper = mesh.bounds
    return np.stack(np.meshgrid(*zip(lower, upper, strict=True)), axis=-1).reshape(-1, mesh.dimension)


def _bins(levels: tuple[Level, ...]) -> tuple[Bins, ...]:
    rows: Any = [(np.asarray(level.width), level.start, level.entry) for level in levels]
    return tuple(Bins(*row) for row in rows)


def _traced(surface: MeshSurface, dtype: np.dtype[np.floating]) -> MeshSurface:
    """Tables as arrays of JAX, in float32 as pairs."""

    def pair(values: Any) -> tuple[Array, Array | None]:
        leading = values.astype(dtype)
        low = None if dtype == np.float64 else on_device(values - leading.astype(float), dtype)
        return on_device(leading, dtype), low

    def one(node: Any) -> Any:
        if isinstance(node, Places):
            pairs = [pair(values) for values in node.high]
            return Places(tuple(high for high, _ in pairs), tuple(low for _, low in pairs))
        if isinstance(node, Distance):
            return Distance(*pair(node.high))
        return on_device(node, dtype if node.dtype == np.float64 else node.dtype)

    found: MeshSurface = jax.tree.map(one, surface, is_leaf=lambda node: isinstance(node, Places | Distance))
    return found
