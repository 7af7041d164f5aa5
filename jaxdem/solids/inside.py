"""Which points lie inside a closed surface: those from which a ray upwards crosses it an odd number of times. Host."""

from __future__ import annotations

import numpy as np

from jaxdem.solids.surface_mesh import SurfaceMesh


def inside(mesh: SurfaceMesh, points: np.ndarray) -> np.ndarray:
    """(N,) bool.

    Args:
        mesh: closed.
        points: (N, D) [m].
    """
    lower, upper = mesh.bounds
    found = np.zeros(len(points), bool)
    rows = np.flatnonzero(((points >= lower) & (points <= upper)).all(axis=1))
    # A ray through an edge would count for two cells or none: none goes through one that a file is likely to have.
    shift = np.array([1.234567e-9, 2.345678e-9, 0.0])[: mesh.dimension - 1] * mesh.extent
    places = points[rows]
    flat = places[:, :-1] + shift
    order = np.argsort(flat[:, 0], kind="stable")
    along, corners = flat[order, 0], mesh.corners
    first = np.searchsorted(along, corners[..., 0].min(axis=1))
    count = np.searchsorted(along, corners[..., 0].max(axis=1), side="right") - first
    crossings = np.zeros(len(rows), int)
    # A few cells at a time: each with all points below or above it.
    stops = np.searchsorted(np.cumsum(count), np.arange(2**22, count.sum() + 2**22, 2**22), side="right")
    begin = 0
    for stop in [*np.unique(np.maximum(stops, 1)), len(count)]:
        if stop <= begin:
            continue
        own = count[begin:stop]
        cell = begin + np.repeat(np.arange(len(own)), own)
        point = order[np.repeat(first[begin:stop], own) + np.arange(own.sum()) - np.repeat(np.cumsum(own) - own, own)]
        crossings += np.bincount(point[_above(corners[cell], flat[point], places[point, -1])], minlength=len(rows))
        begin = stop
    found[rows] = crossings % 2 == 1
    return found


def _above(corners: np.ndarray, flat: np.ndarray, height: np.ndarray) -> np.ndarray:
    """(P,) bool, whether the ray upwards from a point goes through a cell."""
    if corners.shape[-1] == 2:
        (a, b), x = (corners[:, 0], corners[:, 1]), flat[:, 0]
        across = (a[:, 0] > x) != (b[:, 0] > x)
        with np.errstate(divide="ignore", invalid="ignore"):
            z = a[:, 1] + (x - a[:, 0]) * (b[:, 1] - a[:, 1]) / (b[:, 0] - a[:, 0])
        return across & (z > height)
    sides = []
    for k in range(3):
        a, b = corners[:, k, :2], corners[:, (k + 1) % 3, :2]
        sides.append((b[:, 0] - a[:, 0]) * (flat[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (flat[:, 0] - a[:, 0]))
    weights = np.stack([sides[1], sides[2], sides[0]], axis=1)
    total = weights.sum(axis=1)
    through = ((weights > 0).all(axis=1) | (weights < 0).all(axis=1)) & (total != 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.einsum("pk,pk->p", weights, corners[..., 2]) / total
    return through & (z > height)
