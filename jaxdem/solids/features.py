"""What a sphere can touch of a surface: its faces, edges and corners, each with the region that it is nearest in.

A sphere touches a surface where the distance from its centre has a minimum on the surface. That is the foot of the
perpendicular on a cell, if it lies within the cell; the nearest point of an edge, if the centre is beyond the edge as
seen from every cell that meets there; or a corner, if the centre is beyond it as seen along every edge. So an edge or a
corner of several cells counts once, an edge that is flat or concave not at all, and the direction of the contact is
continuous over convex edges and corners. Host, numpy, float64.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from jaxdem.solids.edges import Edges, edges_of
from jaxdem.solids.surface_mesh import SurfaceMesh

FLAT = 1e-5
"""Edges that bend by less are no edges: the regions of the faces overlap by as much of a radius [rad]."""


class Faces(NamedTuple):
    """Cells, F of them.

    Attributes:
        anchor: (F, D) a corner [m].
        normal: (F, D) unit vector towards the front.
        inward: (F, D, D) for each of D borders the unit vector in the plane of the cell, across the border and inwards.
        offset: (F, D) of each border: inward . (x - anchor) - offset is the distance from it, positive inside [m].
        patch: (F,) int, number of the smooth patch.
    """

    anchor: np.ndarray
    normal: np.ndarray
    inward: np.ndarray
    offset: np.ndarray
    patch: np.ndarray


class EdgeLines(NamedTuple):
    """Edges that stick out, E of them; none in 2-D.

    Attributes:
        anchor: (E, 3) an end [m].
        along: (E, 3) unit vector to the other end.
        length: (E,) [m].
        beyond: (E, B, 3) unit vectors; a centre at v from the edge is in its region where v . beyond <= 0 for all.
        patch: (E,) int, see `Faces`; a number of its own where the edge is sharp.
    """

    anchor: np.ndarray
    along: np.ndarray
    length: np.ndarray
    beyond: np.ndarray
    patch: np.ndarray


class Corners(NamedTuple):
    """Corners that stick out, C of them.

    Attributes:
        anchor: (C, D) [m].
        beyond: (C, B, D) as in `EdgeLines`, for v from the corner; zero where there are fewer.
        patch: (C,) int, see `EdgeLines`.
    """

    anchor: np.ndarray
    beyond: np.ndarray
    patch: np.ndarray


class Features(NamedTuple):
    """All that a sphere can touch of a surface."""

    faces: Faces
    edges: EdgeLines
    corners: Corners


def features_of(mesh: SurfaceMesh, both: bool, smooth_angle: float) -> Features:
    """What a sphere can touch of a surface.

    Args:
        mesh: welded and without degenerate or duplicate cells.
        both: whether it is touched from both sides, or from the front alone; then all cells of a surface look the same
            way.
        smooth_angle: up to which two cells bend to be of one smooth patch [rad].
    """
    edges = edges_of(mesh)
    normal = _unit(mesh.area_vectors)
    inward, offset = _borders(mesh, normal)
    smooth = _smooth_sides(edges, inward, smooth_angle)
    label = _patches(len(mesh.cells), edges, smooth)
    faces = Faces(mesh.points[mesh.cells[:, 0]], normal, inward, offset, label)
    flat = _flat_edges(edges, inward)
    patch = _patch_of_edges(edges, smooth, label)
    if mesh.dimension == 2:
        none = np.zeros((0, 2))
        lines = EdgeLines(none, none, np.zeros(0), np.zeros((0, 2, 2)), np.zeros(0, int))
        return Features(faces, lines, _ends(mesh, edges, faces, both, flat, patch))
    lines, kept = _lines(mesh, edges, faces, both, flat, patch)
    return Features(faces, lines, _corners(mesh, edges, faces, both, kept, patch))


def _borders(mesh: SurfaceMesh, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`inward` and `offset` of `Faces`; border k is opposite to corner k."""
    corners = mesh.corners
    anchor = corners[:, 0]
    inward, offset = [], []
    for k in range(mesh.dimension):
        first = corners[:, (k + 1) % mesh.dimension]
        if mesh.dimension == 2:
            across = _unit(corners[:, k] - first)
        else:
            across = _unit(np.cross(normal, corners[:, (k + 2) % 3] - first))
        inward.append(across)
        offset.append(np.einsum("fd,fd->f", across, first - anchor))
    return np.stack(inward, axis=1), np.stack(offset, axis=1)


def _of_sides(edges: Edges, inward: np.ndarray) -> np.ndarray:
    """(S, D) of every side of an edge the unit vector into its cell."""
    found: np.ndarray = inward[edges.cell, edges.opposite]
    return found


def _bend(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(I,) angle by which a surface bends at an edge, of the unit vectors into its two cells [rad]."""
    found: np.ndarray = 2.0 * np.arcsin(np.minimum(0.5 * np.linalg.norm(one + other, axis=1), 1.0))
    return found


def _smooth_sides(edges: Edges, inward: np.ndarray, smooth_angle: float) -> np.ndarray:
    """(E,) bool, edges of two cells that bend by no more than the angle."""
    edge, one, other = edges.between_two
    into = _of_sides(edges, inward)
    found = np.zeros(len(edges.ends), bool)
    found[edge] = _bend(into[one], into[other]) <= max(smooth_angle, FLAT)
    return found


def _flat_edges(edges: Edges, inward: np.ndarray) -> np.ndarray:
    """(E,) bool, edges of two cells that do not bend."""
    return _smooth_sides(edges, inward, FLAT)


def _patches(count: int, edges: Edges, smooth: np.ndarray) -> np.ndarray:
    """(F,) number of the smooth patch of every cell."""
    edge, one, other = edges.between_two
    joined = smooth[edge]
    a, b = edges.cell[one][joined], edges.cell[other][joined]
    graph = coo_matrix((np.ones(len(a)), (a, b)), shape=(count, count))
    label: np.ndarray = connected_components(graph, directed=False)[1]
    return label


def _patch_of_edges(edges: Edges, smooth: np.ndarray, label: np.ndarray) -> np.ndarray:
    """(E,) patch of a smooth edge; numbers of their own for the others, above those of the cells."""
    own = label.max(initial=-1) + 1 + np.arange(len(edges.ends))
    return np.where(smooth, label[edges.cell[edges.start[:-1]]], own)


def _lines(
    mesh: SurfaceMesh, edges: Edges, faces: Faces, both: bool, flat: np.ndarray, patch: np.ndarray
) -> tuple[EdgeLines, np.ndarray]:
    """The edges that stick out, and (E,) bool which these are."""
    into, count = _of_sides(edges, faces.inward), edges.cells
    beyond = np.zeros((len(edges.ends), 2, 3))
    first = edges.start[:-1]
    beyond[:, 0] = beyond[:, 1] = into[first]
    edge, one, other = edges.between_two
    beyond[edge, 1] = into[other]
    kept = ~flat
    if not both:
        rim = count == 1
        beyond[rim, 1] = -faces.normal[edges.cell[first[rim]]]
        # Seen from the front of its first cell the second one bends away.
        kept[edge] &= np.einsum("ed,ed->e", into[other], faces.normal[edges.cell[one]]) < 0.0
    for crowded in np.flatnonzero(count > 2):
        sides = into[edges.start[crowded] : edges.start[crowded + 1]]
        extremes = _extremes(sides)
        kept[crowded] = extremes is not None
        if extremes is not None:
            beyond[crowded] = sides[list(extremes)]
    ends = mesh.points[edges.ends]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    along = (ends[:, 1] - ends[:, 0]) / length[:, None]
    chosen = (array[kept] for array in (ends[:, 0], along, length, beyond, patch))
    return EdgeLines(*chosen), kept


def _extremes(sides: np.ndarray) -> tuple[int, int] | None:
    """The two of several unit vectors across one edge that enclose the others; None if they enclose half a turn."""
    cosines = sides @ sides.T
    first = sides[0]
    across = sides - np.outer(sides @ first, first)
    size = np.linalg.norm(across, axis=1)
    if size.max() < FLAT:
        return (0, 0) if cosines.min() > 0.0 else None
    unit = across[np.argmax(size)] / size.max()
    angle = np.arctan2(sides @ unit, sides @ first)
    order = np.argsort(angle)
    gaps = np.diff(np.append(angle[order], angle[order[0]] + 2.0 * np.pi))
    widest = int(np.argmax(gaps))
    if gaps[widest] <= np.pi + FLAT:
        return None
    return int(order[(widest + 1) % len(order)]), int(order[widest])


def _ends(mesh: SurfaceMesh, edges: Edges, faces: Faces, both: bool, flat: np.ndarray, patch: np.ndarray) -> Corners:
    """The corners of a surface in 2-D that stick out."""
    into, first = _of_sides(edges, faces.inward), edges.start[:-1]
    width = max(2, int(edges.cells.max(initial=2)))
    beyond = np.zeros((len(edges.ends), width, 2))
    number = np.arange(len(edges.cell)) - np.repeat(first, edges.cells)
    beyond[np.repeat(np.arange(len(edges.ends)), edges.cells), number] = into
    kept = ~flat
    if not both:
        rim = edges.cells == 1
        beyond[rim, 1] = -faces.normal[edges.cell[first[rim]]]
        edge, one, other = edges.between_two
        kept[edge] &= np.einsum("ed,ed->e", into[other], faces.normal[edges.cell[one]]) < 0.0
    return Corners(mesh.points[edges.ends[:, 0]][kept], beyond[kept], patch[kept])


def _corners(mesh: SurfaceMesh, edges: Edges, faces: Faces, both: bool, kept: np.ndarray, patch: np.ndarray) -> Corners:
    """The corners of a surface in 3-D that stick out, of those at which an edge does."""
    touched = np.zeros(len(mesh.points), bool)
    touched[edges.ends[kept]] = True
    own = int(patch.max(initial=-1)) + 1
    around: dict[int, list[np.ndarray]] = {}
    patches: dict[int, set[int]] = {}
    for number in np.flatnonzero(touched[edges.ends].any(axis=1)):
        low, high = edges.ends[number].tolist()
        way = mesh.points[high] - mesh.points[low]
        way = way / np.linalg.norm(way)
        for corner, direction in ((low, way), (high, -way)):
            if touched[corner]:
                around.setdefault(corner, []).append(direction)
                patches.setdefault(corner, set()).add(int(patch[number]))
    fronts: dict[int, list[np.ndarray]] = {}
    if not both:
        rims = np.unique(edges.ends[edges.cells == 1])
        for cell, corner in zip(*np.nonzero(touched[mesh.cells]), strict=True):
            fronts.setdefault(int(mesh.cells[cell, corner]), []).append(faces.normal[cell])
    found: list[tuple[int, np.ndarray, int]] = []
    for corner, ways in around.items():
        beyond = np.array(ways)
        direction = _separating(beyond)
        if direction is None:
            continue
        if not both:
            facing = np.array(fronts[corner]) @ direction
            if facing.max() <= 0.0:
                continue
            if corner in rims or facing.min() < 0.0:
                beyond = np.concatenate([beyond, -np.array(fronts[corner])])
        labels = patches[corner]
        found.append((corner, beyond, labels.pop() if len(labels) == 1 else own + corner))
    width = max((len(beyond) for _, beyond, _ in found), default=1)
    table = np.zeros((len(found), width, 3))
    for k, (_, beyond, _) in enumerate(found):
        table[k, : len(beyond)] = beyond
    places = np.array([corner for corner, _, _ in found], int)
    return Corners(mesh.points[places].reshape(-1, 3), table, np.array([label for _, _, label in found], int))


def _separating(ways: np.ndarray) -> np.ndarray | None:
    """(3,) a unit vector v with v . way < 0 for all of the unit vectors `ways`; None where there is none.

    It is opposite to the point of their convex hull that is nearest to the origin.
    """
    rows = np.concatenate([ways.T, np.ones((1, len(ways)))])
    weights, _ = nnls(rows, np.array([0.0, 0.0, 0.0, 1.0]))
    total = weights.sum()
    if total <= 0.0:
        return None
    nearest = ways.T @ weights / total
    size = float(np.linalg.norm(nearest))
    return None if size < FLAT else -nearest / size


def _unit(vectors: np.ndarray) -> np.ndarray:
    found: np.ndarray = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return found
