"""What grains can touch of a mesh as tables: in float64 for the host, traced for the contacts. Host."""

from __future__ import annotations

from typing import Any, cast

import jax
import numpy as np
from jax import Array
from scipy.spatial import ConvexHull, QhullError

from jaxdem.numerics.host import on_device
from jaxdem.particles.mesh_surface import Bins, CornerTable, Distance, EdgeTable, FaceTable, MeshSurface, Places
from jaxdem.solids.bins import LARGE, Level, levels_of
from jaxdem.solids.features import Features
from jaxdem.solids.slivers import pieces_of_long
from jaxdem.solids.surface_mesh import SurfaceMesh

MOST_OF_HULL = 512
"""Points of a hull that are followed; of more the box around it is."""


def tables_of_features(features: Features, both: bool, radius: float, slack: float) -> MeshSurface:
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
    found = _levels(ends, reach, above, (faces.anchor, faces.normal))
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
        found = _levels(np.stack([lines.anchor, other], axis=1), reach, reach)
        edges = EdgeTable(
            places(lines.anchor), places(lines.along), distance(lines.length),
            directions(lines.beyond), patch(lines.patch), _bins(found),
        )  # fmt: skip
    if len(corners.anchor):
        found = levels_of(corners.anchor, corners.anchor, reach, reach)
        of_corners = CornerTable(places(corners.anchor), directions(corners.beyond), patch(corners.patch), _bins(found))
    return MeshSurface(table, edges, of_corners)


def _levels(
    corners: np.ndarray, reach: float, margin: np.ndarray | float, planes: tuple[np.ndarray, np.ndarray] | None = None
) -> tuple[Level, ...]:
    """Bins of triangles or edges (P, K, D), the long and thin ones in pieces; see `levels_of`."""
    if corners.shape[2] == 2:
        return levels_of(corners.min(axis=1), corners.max(axis=1), reach, margin, planes)
    pieces, part = pieces_of_long(corners, LARGE * reach)
    wide = margin if isinstance(margin, float) else margin[part]
    flat = None if planes is None else (planes[0][part], planes[1][part])
    return levels_of(pieces.min(axis=1), pieces.max(axis=1), reach, wide, flat, part)


def with_cells(surface: MeshSurface, *cells: np.ndarray) -> MeshSurface:
    """The same with the triangle of the file that each face, edge and corner belongs to."""
    kinds: Any = zip((surface.faces, surface.edges, surface.corners), cells, strict=True)
    found: Any = [None if kind is None else kind._replace(cell=own.astype(np.int32)) for kind, own in kinds]
    return MeshSurface(*found)


def _corner(faces: Any, k: int) -> np.ndarray:
    """(F, D) corner k of every face, where the borders opposite to the others meet."""
    dimension = faces.anchor.shape[1]
    others = [j for j in range(dimension) if j != k]
    rows = np.concatenate([faces.inward[:, others], faces.normal[:, None]], axis=1)
    right = np.concatenate([faces.offset[:, others], np.zeros((len(faces.anchor), 1))], axis=1)
    return faces.anchor + np.linalg.solve(rows, right[..., None])[..., 0]


def hull_of(mesh: SurfaceMesh) -> np.ndarray:
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


def traced_tables(surface: MeshSurface, dtype: np.dtype[np.floating]) -> MeshSurface:
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
