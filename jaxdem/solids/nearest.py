"""The nearest point of a surface of triangles. Host, numpy.

Triangles are halved until none is much longer than the distances that are asked for, so that the middles of the pieces
tell which are near: the nearest piece lies no farther than the nearest middle, and no piece reaches farther from its
middle than the largest. With smaller or larger pieces more of them would have to be looked at for a point.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from jaxdem.solids.surface_mesh import SurfaceMesh

FEWEST, MOST = 300, 50_000
"""About as many pieces a surface is cut into, if it does not have more triangles."""

AT_ONCE = 2**19
"""Pairs of points and pieces that are looked at together."""


class Nearest(NamedTuple):
    """What of a surface is nearest to points.

    Attributes:
        distance: (N,) to it; beyond the reach that was asked for, a distance that it is at least [m].
        point: (N, 3) it; the point itself beyond the reach [m].
        normal: (N, 3) of the triangle that it is on, of length one; zero beyond the reach.
    """

    distance: np.ndarray
    point: np.ndarray
    normal: np.ndarray


class NearestPoint:
    """A surface of triangles without degenerate ones, made ready to be asked for distances of about this size [m]."""

    def __init__(self, mesh: SurfaceMesh, distance: float):
        shortest, longest = (1.5 * (mesh.area / number) ** 0.5 for number in (MOST, FEWEST))
        self._corners = _pieces(mesh.corners, min(max(1.5 * distance, shortest), longest))
        middle = self._corners.mean(axis=1)
        self._reach = float(np.linalg.norm(self._corners - middle[:, None], axis=2).max())
        self._tree = KDTree(middle)

    def of(self, points: np.ndarray, within: float | np.ndarray = np.inf) -> Nearest:
        """The nearest point of the surface to each of the points (N, 3), where it is `within` () or (N,) so far [m]."""
        import trimesh  # only scenes with such regions wait for it

        bound, within = self._tree.query(points)[0], np.broadcast_to(within, len(points))
        found = Nearest(np.maximum(bound - self._reach, 0.0), points.copy(), np.zeros_like(points))
        rows = np.flatnonzero(bound - self._reach <= within)
        near = np.minimum(bound[rows], within[rows]) + self._reach * (1.0 + 1e-9)
        for some in np.array_split(np.arange(len(rows)), max(1, -(-len(rows) // 4096))):
            listed = self._tree.query_ball_point(points[rows[some]], near[some])
            count = np.fromiter(map(len, listed), int, len(some))
            row = np.repeat(rows[some], count)
            piece = np.fromiter((k for one in listed for k in one), int, count.sum())
            for begin in range(0, len(row), AT_ONCE):
                own, of = row[begin : begin + AT_ONCE], piece[begin : begin + AT_ONCE]
                foot = trimesh.triangles.closest_point(self._corners[of], points[own])
                self._take(found, own, of, foot, np.linalg.norm(points[own] - foot, axis=1), begin > 0)
        return found

    def _take(
        self, found: Nearest, row: np.ndarray, piece: np.ndarray, foot: np.ndarray, distance: np.ndarray, again: bool
    ) -> None:
        """Enters the nearest of the pairs of each row; `again` where a part of the pairs of a row has been entered."""
        order = np.lexsort((distance, row))
        best = order[np.unique(row[order], return_index=True)[1]]
        if again:
            known = np.any(found.normal[row[best]] != 0.0, axis=1)
            best = best[~known | (distance[best] < found.distance[row[best]])]
        rows, corners = row[best], self._corners[piece[best]]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        found.distance[rows], found.point[rows] = distance[best], foot[best]
        found.normal[rows] = across / np.linalg.norm(across, axis=1)[:, None]


def _pieces(corners: np.ndarray, longest: float) -> np.ndarray:
    """(M, 3, 3) triangles cut at the middle of their longest edge until no edge is longer than that [m]."""
    done = []
    while len(corners):
        length = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        large = length.max(axis=1) > longest
        done.append(corners[~large])
        corners, first = corners[large], length[large].argmax(axis=1)
        # With the longest edge from corner 0 to corner 1.
        order = (first[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(corners, order[..., None], axis=1).swapaxes(0, 1)
        middle = 0.5 * (a + b)
        corners = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return np.concatenate(done)
