"""Signed distance from a surface of cells at the corners of a regular mesh. Host, numpy.

The distance is exact within a band around the surface, from the cells that are near; beyond it is the width of the
band, with the right sign. What is solid is found along the last axis: from a point upwards the fronts of the surface
are crossed as often as its backs only outside. So bodies of one file may overlap.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import KDTree

from jaxdem.solids.surface_mesh import SurfaceMesh

MOST_PAIRS = 2**20
"""Pairs of cells and corners that are looked at together."""

SHIFT = (1.234567e-9, 2.345678e-9)
"""Over the mesh's extent, by which rays pass beside the corners: one through an edge would count twice or not at all
[-]."""


class GridDistance(NamedTuple):
    """A surface on a regular mesh of corners.

    Attributes:
        distance: at the corners, negative in the solid [m].
        uncovered: number of lines along the last axis that nowhere meet the surface.
    """

    distance: np.ndarray
    uncovered: int


def grid_distance(mesh: SurfaceMesh, spacing: tuple[float, ...], corners: tuple[int, ...], band: float) -> GridDistance:
    """The signed distance at corners k h, k = 0, 1, ... along every axis.

    Args:
        mesh: whose fronts look out of the solid.
        spacing: h of every axis [m].
        corners: their number along every axis.
        band: width on either side of the surface where the distance is exact [m].
    """
    steps = np.asarray(spacing)
    found, ceiling = _band(mesh, steps, corners, band)
    cells = mesh.corners
    middle = cells.mean(axis=1)
    radius = np.linalg.norm(cells - middle[:, None], axis=-1).max(axis=1)
    lower = np.floor((cells.min(axis=1) - band) / steps).astype(int)
    upper = np.ceil((cells.max(axis=1) + band) / steps).astype(int)
    for cell, index in _pairs(lower, upper, corners):
        flat, points = np.ravel_multi_index(tuple(index.T), corners), index * steps
        near = np.linalg.norm(points - middle[cell], axis=1) - radius[cell] <= ceiling[flat]
        np.minimum.at(found, flat[near], _to_cells(cells[cell[near]], points[near]))
    turns = _turns(mesh, steps, corners)
    below = turns[..., ::-1].cumsum(axis=-1)[..., ::-1][..., 1:]
    solid = below.reshape(corners) != 0
    distance = found.reshape(corners)
    lines = turns.reshape(-1, turns.shape[-1])
    return GridDistance(np.where(solid, -distance, distance), int(np.sum(~lines.any(axis=1))))


def _band(mesh: SurfaceMesh, steps: np.ndarray, corners: tuple[int, ...], band: float) -> tuple[np.ndarray, np.ndarray]:
    """The width of the band at all corners; and a bound of the distance from what is nearest: a corner of a cell."""
    index = np.stack(np.meshgrid(*(np.arange(n) for n in corners), indexing="ij"), axis=-1).reshape(-1, len(corners))
    used = mesh.points[np.unique(mesh.cells)]
    bound, _ = KDTree(used).query(index * steps, distance_upper_bound=band + mesh.extent)
    return np.full(len(index), band), np.minimum(bound, band)


def _pairs(lower: np.ndarray, upper: np.ndarray, corners: tuple[int, ...]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Cells, and the indices of corners in the boxes from `lower` to `upper`; some at a time."""
    first, last = np.maximum(lower, 0), np.minimum(upper, np.asarray(corners) - 1)
    size = np.maximum(last - first + 1, 0)
    count = size.prod(axis=1)
    ends = np.cumsum(count)
    begin = 0
    while begin < len(count):
        done = ends[begin - 1] if begin else 0
        stop = max(begin + 1, int(np.searchsorted(ends, done + MOST_PAIRS, side="right")))
        own = count[begin:stop]
        cell = begin + np.repeat(np.arange(len(own)), own)
        place = np.arange(own.sum()) - np.repeat(np.cumsum(own) - own, own)
        index = np.empty((len(cell), len(corners)), int)
        for axis in reversed(range(len(corners))):
            place, index[:, axis] = np.divmod(place, size[cell, axis]) if len(cell) else (place, place)
        yield cell, index + first[cell]
        begin = stop


def _to_cells(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(P,) distance of points (P, D) from cells (P, D, D) [m]."""
    count = corners.shape[1]
    edges = [(0, 1)] if count == 2 else [(0, 1), (1, 2), (2, 0)]
    nearest = np.min([_to_segments(corners[:, a], corners[:, b], points) for a, b in edges], axis=0)
    if count == 2:
        return nearest
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = _cross(b - a, c - a)
    squared = np.einsum("pd,pd->p", normal, normal)
    usable = squared > 0.0
    inside = usable.copy()
    for one, other in ((a, b), (b, c), (c, a)):
        inside &= np.einsum("pd,pd->p", _cross(other - one, points - one), normal) >= 0.0
    height = np.abs(np.einsum("pd,pd->p", points - a, normal)) / np.sqrt(np.where(usable, squared, 1.0))
    return np.where(inside, height, nearest)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)


def _to_segments(a: np.ndarray, b: np.ndarray, points: np.ndarray) -> np.ndarray:
    along = b - a
    squared = np.einsum("pd,pd->p", along, along)
    share = np.einsum("pd,pd->p", points - a, along) / np.where(squared > 0.0, squared, 1.0)
    found: np.ndarray = np.linalg.norm(points - a - np.clip(share, 0.0, 1.0)[:, None] * along, axis=1)
    return found


def _turns(mesh: SurfaceMesh, steps: np.ndarray, corners: tuple[int, ...]) -> np.ndarray:
    """(..., n + 1) what every line along the last axis crosses above how many corners: 1 for a front, -1 for a back."""
    flat = mesh.dimension - 1
    shift = np.asarray(SHIFT[:flat]) * mesh.extent
    places, upwards = mesh.corners, np.where(mesh.area_vectors[:, -1] > 0.0, 1, -1)
    lower = np.floor((places[..., :flat].min(axis=1) - shift) / steps[:flat]).astype(int)
    upper = np.ceil((places[..., :flat].max(axis=1) + shift) / steps[:flat]).astype(int)
    found = np.zeros((int(np.prod(corners[:flat])), corners[-1] + 1), int)
    for cell, index in _pairs(lower, upper, corners[:flat]):
        # Towards the middle of the box, which a map of heights may cover just so.
        inwards = np.where(2 * index >= np.asarray(corners[:flat]), -shift, shift)
        through, height = _crossed(places[cell], index * steps[:flat] + inwards)
        line = np.ravel_multi_index(tuple(index[through].T), corners[:flat])
        above = np.clip(np.ceil(height[through] / steps[-1]), 0, corners[-1]).astype(int)
        np.add.at(found, (line, above), upwards[cell[through]])
    return found.reshape(*corners[:flat], corners[-1] + 1)


def _crossed(corners: np.ndarray, flat: np.ndarray) -> tuple[Any, np.ndarray]:
    """(P,) bool, whether lines along the last axis at (P, D - 1) go through cells; and at which height [m]."""
    if corners.shape[1] == 2:
        a, b = corners[:, 0], corners[:, 1]
        between = (a[:, 0] > flat[:, 0]) != (b[:, 0] > flat[:, 0])
        width = np.where(between, b[:, 0] - a[:, 0], 1.0)
        return between, a[:, 1] + (flat[:, 0] - a[:, 0]) * (b[:, 1] - a[:, 1]) / width
    sides = []
    for k in range(3):
        a, b = corners[:, k, :2], corners[:, (k + 1) % 3, :2]
        sides.append((b[:, 0] - a[:, 0]) * (flat[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (flat[:, 0] - a[:, 0]))
    weights = np.stack([sides[1], sides[2], sides[0]], axis=1)
    through = (weights > 0.0).all(axis=1) | (weights < 0.0).all(axis=1)
    total = np.where(through, weights.sum(axis=1), 1.0)
    return through, np.einsum("pk,pk->p", weights, corners[..., 2]) / total
