"""The inside of a closed surface of triangles: which points lie in it, how deep, and how large it is. Host, numpy."""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxdem.solids.inside import inside
from jaxdem.solids.nearest import NearestPoint
from jaxdem.solids.surface_mesh import SurfaceMesh

ROUNDS = 8
"""Moves by which a point is brought inside; in a narrow corner it meets one side after the other."""

FURTHER = 1e-6
"""Part of a margin by which such a move goes further than it must: the last part of the way would take for ever."""

TOUCHING = 1e-12
"""Over the extent: a point so near to the surface has no direction from it, and is moved along the normal [-]."""

SAMPLES = 20_000
"""Points by which the volume is checked."""

DEVIATIONS = 6.0
"""Standard deviations by which that check may be off."""


@dataclasses.dataclass(frozen=True, eq=False)
class Interior:
    """The inside of a surface, or what of it lies in a box: a `Shape` of `particles.regions`.

    Attributes:
        mesh: closed, with the front outside.
        low, high: (3,) corners of the box that it is cut to [m].
        depth: up to which distances are exact; deeper points have a lower bound of theirs [m].
        size: volume [m3].
    """

    mesh: SurfaceMesh
    low: np.ndarray
    high: np.ndarray
    depth: float
    size: float
    _near: NearestPoint

    @classmethod
    def of(cls, mesh: SurfaceMesh, low: np.ndarray, high: np.ndarray, depth: float) -> Interior:
        """The inside of a closed mesh with its front outside, cut to a box; see the attributes."""
        lowest, highest = mesh.bounds
        low, high = np.maximum(low, lowest), np.minimum(high, highest)
        return cls(mesh, low, high, depth, volume_in(mesh, low, high), NearestPoint(mesh, depth))

    def distance(self, points: np.ndarray) -> np.ndarray:
        """(N,) signed distance of the points (N, 3) to the boundary, negative inside [m].

        Inside it is exact to `depth`. Outside of the box it is no more than the true one.
        """
        within = inside(self.mesh, points)
        to_mesh = self._near.of(points, self.depth).distance
        to_box = np.maximum(self.low - points, points - self.high).max(axis=1)
        return np.maximum(np.where(within, -to_mesh, to_mesh), to_box)

    def kept(self, points: np.ndarray, margin: np.ndarray) -> np.ndarray:
        """(N, 3) points moved to where they are `margin` (N,) inside, from the nearest place of the surface again and
        again, each time by `FURTHER` more than is lacking."""
        points, rows = points.copy(), np.arange(len(points))
        half = 0.5 * (self.high - self.low)
        for _ in range(ROUNDS):
            room = np.minimum(margin[rows, None], half)
            points[rows] = np.clip(points[rows], self.low + room, self.high - room)
            within = inside(self.mesh, points[rows])
            found = self._near.of(points[rows], np.where(within, margin[rows], np.inf))
            lacking = margin[rows] - np.where(within, found.distance, -found.distance)
            left = lacking > 0.0
            rows, lacking, within = rows[left], lacking[left], within[left]
            if not len(rows):
                break
            away = np.where(within, 1.0, -1.0)[:, None] * (points[rows] - found.point[left])
            length = found.distance[left][:, None]
            on = length <= TOUCHING * self.mesh.extent
            direction = np.where(on, -found.normal[left], away / np.where(on, 1.0, length))
            points[rows] += (lacking + FURTHER * margin[rows])[:, None] * direction
        return points

    @property
    def is_sound(self) -> bool:
        """Whether the volume agrees with the part of `SAMPLES` points that lie inside: the surfaces neither cross each
        other nor lie in each other."""
        whole = float(np.prod(self.high - self.low))
        points = np.random.default_rng(0).uniform(self.low, self.high, (SAMPLES, 3))
        part, expected = float(inside(self.mesh, points).mean()), self.size / whole
        error = max(expected * (1.0 - expected), 1.0 / SAMPLES) / SAMPLES
        return abs(part - expected) <= DEVIATIONS * error**0.5


def volume_in(mesh: SurfaceMesh, low: np.ndarray, high: np.ndarray) -> float:
    """Volume of the part of a closed surface that lies in a box; exact [m3].

    Over every point (x, y) of the box the heights of the surface, cut to those of the box, are summed, positive where
    it looks up and negative where it looks down. So the volume is that sum over the areas of the triangles in the plan.
    """
    import trimesh

    points, cells = mesh.points, mesh.cells
    for axis in (0, 1):
        for normal, level in ((1.0, low), (-1.0, high)):
            points, cells = _beyond(trimesh, points, cells, axis, normal, level)
    found = 0.0
    for sign, level in ((1.0, low), (-1.0, high)):
        above, own = _beyond(trimesh, points, cells, 2, 1.0, level)
        if len(own):
            (ax, ay, az), (bx, by, bz), (cx, cy, cz) = above[own].transpose(1, 2, 0)
            plan = 0.5 * ((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))
            found += sign * float(np.sum(plan * ((az + bz + cz) / 3.0 - level[2])))
    return abs(found)


def _beyond(
    trimesh: object, points: np.ndarray, cells: np.ndarray, axis: int, normal: float, level: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Points and triangles of the part on one side of a plane across an axis."""
    if not len(cells) or (normal * (points[cells][..., axis] - level[axis]) >= 0.0).all():
        return points, cells
    direction, origin = np.zeros(3), np.zeros(3)
    direction[axis], origin[axis] = normal, level[axis]
    cut = trimesh.intersections.slice_faces_plane(points, cells, direction, origin)  # type: ignore[attr-defined]
    return np.asarray(cut[0]), np.asarray(cut[1], int)
