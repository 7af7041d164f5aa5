"""Which plane walls a sphere touches at once: alone, and beside a piece of a mesh. Host, numpy, float64.

Its centre x is on the front, n . x - o >= low, of all that bound the space, and touches those with
low <= n . x - o <= high. What touches most of them is at a corner of the region that these bounds leave, for every such
set of x is convex.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np

FLAT = 1e-9
"""Determinant of unit normals, or change of a distance over the size of a piece, below which there is no corner [-]."""

MOST_VALUES = 4_000_000
"""Distances that are worked out at a time."""

MOST_CORNERS = 2_000_000
"""Corners that are looked at: those of a hundred planes. More planes are all taken to be touched at once."""


class Planes(NamedTuple):
    """Plane walls, n of them.

    Attributes:
        normal: (n, D) unit vectors towards the spheres.
        offset: (n,) o of n . x = o [m].
        low: (n,) least distance of a centre on the front [m].
        high: (n,) distance up to which a sphere touches it, minus infinity of what only bounds the box [m].
        bounds: (n,) bool, which of them no sphere is behind.
        tolerance: what counts as rounding [m].
    """

    normal: np.ndarray
    offset: np.ndarray
    low: np.ndarray
    high: np.ndarray
    bounds: np.ndarray
    tolerance: float

    def distances(self, x: np.ndarray) -> np.ndarray:
        """(..., n) from points (..., D) [m]."""
        found: np.ndarray = x @ self.normal.T - self.offset
        return found

    def touched(self, distance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of distances (..., n): whether a centre may be there (...,), and which planes it touches there (..., n)."""
        front = distance >= self.low - self.tolerance
        allowed = np.all(front | ~self.bounds, axis=-1)
        return np.asarray(allowed), front & (distance <= self.high + self.tolerance)

    def levels(self) -> list[tuple[int, float]]:
        """Number of a plane and a distance from it, of all bounds."""
        low = list(enumerate(self.low.tolist()))
        return low + [(k, far) for k, far in enumerate(self.high.tolist()) if np.isfinite(far)]


def planes_at_once(planes: Planes) -> np.ndarray:
    """(S, n) bool, the sets of planes that a sphere may touch at once, without the smaller ones of one corner."""
    dimension, levels = planes.normal.shape[1], planes.levels()
    if math.comb(len(levels), dimension) > MOST_CORNERS:
        return np.isfinite(planes.high)[None]
    plane = np.array([k for k, _ in levels])
    far = np.array([distance for _, distance in levels])
    some = np.array(list(itertools.combinations(range(len(levels)), dimension))).reshape(-1, dimension)
    found = np.zeros((0, len(planes.offset)), bool)
    for part in np.array_split(some, 1 + len(some) * len(planes.offset) // MOST_VALUES):
        matrix = planes.normal[plane[part]]
        corner = np.abs(np.linalg.det(matrix)) > FLAT
        right = (planes.offset[plane[part]] + far[part])[corner]
        x = np.linalg.solve(matrix[corner], right[..., None])[..., 0]
        allowed, touched = planes.touched(planes.distances(x))
        found = np.unique(np.concatenate([found, touched[allowed]]), axis=0)
    return found


def planes_beside(planes: Planes, centres: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which planes a sphere may touch at once that touches a piece of a mesh too.

    Args:
        planes: the planes.
        centres: (E, K, D) corners of the points, segments or triangles in which its centre is as it touches a piece;
            K is 1, 2 or 3 [m].

    Returns:
        Pairs of a piece and a set: number of the piece (Q,), and (Q, n) bool.
    """
    near = planes.distances(centres).min(axis=1) <= planes.high + planes.tolerance
    rows = np.flatnonzero(near.any(axis=1))
    pieces, sets = [np.zeros(0, int)], [np.zeros((0, len(planes.offset)), bool)]
    candidates = 3 + 3 * 2 * len(planes.offset) + (2 * len(planes.offset)) ** 2
    for part in np.array_split(rows, 1 + len(rows) * candidates * len(planes.offset) // MOST_VALUES):
        at_corners = planes.distances(centres[part])
        distance = np.concatenate(list(_corners_of_region(planes, at_corners)), axis=1)
        allowed, touched = planes.touched(distance)
        piece, which = np.nonzero(allowed & touched.any(axis=-1))
        if len(piece):
            found = np.unique(np.column_stack([part[piece], touched[piece, which]]), axis=0)
            pieces.append(found[:, 0])
            sets.append(found[:, 1:].astype(bool))
    return np.concatenate(pieces), np.concatenate(sets)


def _corners_of_region(planes: Planes, at_corners: np.ndarray) -> list[np.ndarray]:
    """Distances (E, C, n) at the corners of the region within pieces with these distances (E, K, n) at their own
    corners; NaN where there is no such corner."""
    count, levels, found = at_corners.shape[1], planes.levels(), [at_corners]
    for a, b in itertools.combinations(range(count), 2):
        first, last = at_corners[:, a], at_corners[:, b]
        for plane, far in levels:
            along = _ratio(far - first[:, plane], last[:, plane] - first[:, plane])
            found.append((first + along[:, None] * (last - first))[:, None])
    if count == 3:
        origin, sides = at_corners[:, 0], at_corners[:, 1:] - at_corners[:, :1]
        for (i, one), (j, other) in itertools.combinations(levels, 2):
            a, b, c, d = sides[:, 0, i], sides[:, 1, i], sides[:, 0, j], sides[:, 1, j]
            right, second, determinant = one - origin[:, i], other - origin[:, j], a * d - b * c
            u, v = _ratio(d * right - b * second, determinant), _ratio(a * second - c * right, determinant)
            outside = u + v > 1.0 + FLAT
            u = np.where(outside, np.nan, u)
            found.append((origin + u[:, None] * sides[:, 0] + v[:, None] * sides[:, 1])[:, None])
    return found


def _ratio(above: np.ndarray, below: np.ndarray) -> np.ndarray:
    """above / below where that is between 0 and 1, else NaN."""
    with np.errstate(divide="ignore", invalid="ignore"):
        found = above / below
    return np.where((found >= -FLAT) & (found <= 1.0 + FLAT), found, np.nan)
