"""Parts of space: which points lie in them, how deep, and how large they are. Host, numpy.

A region is a product of shapes that lie in axes at right angles: a box is one interval an axis, a cylinder a disc and
an interval in axes that are turned, a polygon in 3-D the polygon in x and z and an interval in y. Its signed distance
is exact. Inside, the nearest boundary is that of one shape: the largest of the shapes' signed distances. Outside,
the distances to the shapes that do not hold the point add up as the sides of a right angle.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from jaxdem.numerics.static import static

BELONGS = 1e-12
"""Part of the region's size by which a point may lie beyond the boundary and is inside: rounding, not a place."""

ROUNDS = 8
"""Moves by which a point is brought into a polygon. In a narrow corner it meets one edge after the other, and some of
the way is left for the next time."""

SAMPLES = 20_000
"""Points that tell whether two regions overlap."""

FURTHER = 1e-6
"""Part of a margin by which such a move goes further than it must: the last part of the way would take for ever."""


class Shape(Protocol):
    """A part of a line, a plane or space."""

    @property
    def size(self) -> float:
        """Length [m], area [m2] or volume [m3]."""
        ...

    def distance(self, points: np.ndarray) -> np.ndarray:
        """(N,) signed distance of the points (N, d) to the boundary, negative inside [m]."""
        ...

    def kept(self, points: np.ndarray, margin: np.ndarray) -> np.ndarray:
        """(N, d) points moved to where they are `margin` (N,) inside; as deep as possible where there is no room."""
        ...


@static
class Interval:
    """A part of a line, low ... high [m]. One that `wraps` is a whole period: it has no ends."""

    low: float
    high: float
    wraps: bool = False

    @property
    def size(self) -> float:
        """See `Shape`."""
        return self.high - self.low

    def distance(self, points: np.ndarray) -> np.ndarray:
        """See `Shape`."""
        if self.wraps:
            return np.full(len(points), -np.inf)
        return np.maximum(self.low - points[:, 0], points[:, 0] - self.high)

    def kept(self, points: np.ndarray, margin: np.ndarray) -> np.ndarray:
        """See `Shape`."""
        if self.wraps:
            return self.low + into_period(points - self.low, self.size)
        margin = np.minimum(margin, 0.5 * self.size)[:, None]
        return np.clip(points, self.low + margin, self.high - margin)


@static
class Ball:
    """A disc, or in 3-D a ball: its center (d,) and radius [m]."""

    center: tuple[float, ...]
    radius: float

    @property
    def size(self) -> float:
        """See `Shape`."""
        return ball_size(len(self.center)) * self.radius ** len(self.center)

    def distance(self, points: np.ndarray) -> np.ndarray:
        """See `Shape`."""
        return np.linalg.norm(points - self.center, axis=1) - self.radius

    def kept(self, points: np.ndarray, margin: np.ndarray) -> np.ndarray:
        """See `Shape`."""
        away = points - self.center
        reach = np.maximum(self.radius - margin, 0.0) / np.maximum(np.linalg.norm(away, axis=1), 1e-300)
        return self.center + np.minimum(reach, 1.0)[:, None] * away


@static
class Polygon:
    """A polygon whose edges do not cross: its corners in order [m]; either sense."""

    vertices: tuple[tuple[float, float], ...]

    @property
    def size(self) -> float:
        """See `Shape`. The shoelace formula."""
        x, y = np.asarray(self.vertices).T
        return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))

    def distance(self, points: np.ndarray) -> np.ndarray:
        """See `Shape`."""
        inside, distance, _ = self._nearest(points)
        return np.where(inside, -distance, distance)

    def kept(self, points: np.ndarray, margin: np.ndarray) -> np.ndarray:
        """See `Shape`. From the nearest edge again and again, each time by `FURTHER` more than is lacking."""
        points, rows = points.copy(), np.arange(len(points))
        for _ in range(ROUNDS):
            inside, distance, nearest = self._nearest(points[rows])
            lacking = margin[rows] - np.where(inside, distance, -distance)
            left = lacking > 0.0
            rows, inside, distance, nearest = rows[left], inside[left], distance[left], nearest[left]
            if not len(rows):
                break
            away = np.where(inside, 1.0, -1.0)[:, None] * (points[rows] - nearest)
            size = (lacking[left] + FURTHER * margin[rows]) / np.maximum(distance, 1e-300)
            points[rows] += size[:, None] * away
        return points

    def _nearest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Which points are inside, how far the boundary is from each, and its nearest point."""
        vertices = np.asarray(self.vertices)
        inside, least, nearest = np.zeros(len(points), bool), np.full(len(points), np.inf), np.zeros_like(points)
        for a, b in zip(vertices, np.roll(vertices, -1, axis=0), strict=True):
            inside ^= _crosses(points, a, b)
            edge = b - a
            along = np.clip(((points - a) @ edge) / max(edge @ edge, 1e-300), 0.0, 1.0)  # a corner may be given twice
            foot = a + along[:, None] * edge
            distance = np.linalg.norm(points - foot, axis=1)
            nearer = distance < least
            least[nearer], nearest[nearer] = distance[nearer], foot[nearer]
        return inside, least, nearest


def _crosses(points: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Whether the line to the right of each point crosses the edge a ... b."""
    spans = (a[1] > points[:, 1]) != (b[1] > points[:, 1])
    rise = b[1] - a[1] if b[1] != a[1] else 1.0
    return spans & (points[:, 0] < (b[0] - a[0]) * (points[:, 1] - a[1]) / rise + a[0])


@static
class Region:
    """A part of the plane or of space.

    Attributes:
        parts: shapes, each with the numbers of its axes.
        bounds: lower and upper corner of the smallest box that holds it [m].
        origin: where the axes of the shapes begin [m].
        frame: unit vectors of the axes of the shapes as rows; None for those of the box.
    """

    parts: tuple[tuple[tuple[int, ...], Shape], ...]
    bounds: tuple[tuple[float, ...], tuple[float, ...]]
    origin: tuple[float, ...] = ()
    frame: tuple[tuple[float, ...], ...] | None = None

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return len(self.bounds[0])

    @property
    def volume(self) -> float:
        """[m3], in 2-D the area [m2]."""
        return math.prod(shape.size for _, shape in self.parts)

    @property
    def wraps(self) -> tuple[bool, ...]:
        """Whether it goes round the box along each axis: it has no boundary there."""
        if self.frame is not None:
            return (False,) * self.dimension
        whole = {axes[0] for axes, shape in self.parts if isinstance(shape, Interval) and shape.wraps}
        return tuple(axis in whole for axis in range(self.dimension))

    def signed_distance(self, points: np.ndarray) -> np.ndarray:
        """(N,) distance of the points (N, D) to the boundary, negative inside [m]."""
        points = self._turned(points)
        distances = np.stack([shape.distance(points[:, list(axes)]) for axes, shape in self.parts])
        outside = np.linalg.norm(np.maximum(distances, 0.0), axis=0)
        return np.where(outside > 0.0, outside, distances.max(axis=0))

    def inside(self, points: np.ndarray, margin: float | np.ndarray = 0.0) -> np.ndarray:
        """(N,) which of the points (N, D) lie at least `margin` () or (N,) inside [m]; a radius: the whole particle."""
        size = float(np.abs(self.bounds).max())
        return self.signed_distance(points) <= BELONGS * size - margin

    def kept(self, points: np.ndarray, margin: float | np.ndarray) -> np.ndarray:
        """(N, D) the points moved to the place near them that is `margin` () or (N,) inside [m]; see `ROUNDS`."""
        margin, turned = np.broadcast_to(margin, len(points)), self._turned(points)
        moved = turned.copy()
        for axes, shape in self.parts:
            moved[:, list(axes)] = shape.kept(turned[:, list(axes)], margin)
        if self.frame is None:
            return moved
        return points + (moved - turned) @ np.asarray(self.frame)

    def _turned(self, points: np.ndarray) -> np.ndarray:
        """Points in the axes of the shapes."""
        return points if self.frame is None else (points - self.origin) @ np.asarray(self.frame).T


def box(start: Sequence[float], stop: Sequence[float], wraps: Sequence[bool] = ()) -> Region:
    """The box start ... stop [m]; it goes round along the axes that `wraps` names."""
    whole = tuple(wraps) or (False,) * len(start)
    sides = zip(start, stop, whole, strict=True)
    parts = tuple(((axis,), Interval(*side)) for axis, side in enumerate(sides))
    return Region(parts, (tuple(start), tuple(stop)))


def ball(center: Sequence[float], radius: float) -> Region:
    """A sphere, or in 2-D a disc [m]."""
    c = np.asarray(center)
    bounds = (tuple((c - radius).tolist()), tuple((c + radius).tolist()))
    return Region(((tuple(range(len(c))), Ball(tuple(center), radius)),), bounds)


def polygon(vertices: Sequence[Sequence[float]], across: tuple[float, float] | None, wraps: bool = False) -> Region:
    """A polygon in x and z; in 3-D extended along y over `across` [m], which `wraps` if it is a whole period."""
    corners = tuple((float(x), float(z)) for x, z in vertices)
    low, high = np.min(corners, axis=0).tolist(), np.max(corners, axis=0).tolist()
    if across is None:
        return Region((((0, 1), Polygon(corners)),), (tuple(low), tuple(high)))
    parts = (((0, 2), Polygon(corners)), ((1,), Interval(*across, wraps)))
    return Region(parts, ((low[0], across[0], low[1]), (high[0], across[1], high[1])))


def cylinder(base: Sequence[float], axis: Sequence[float], radius: float, length: float, wraps: bool = False) -> Region:
    """A cylinder that begins at `base`, the middle of an end, and goes `length` along `axis`, of any size [m].

    One that `wraps` lies along an axis of the box, over a whole period of it.
    """
    start, along = np.asarray(base, float), np.asarray(axis, float) / np.linalg.norm(axis)
    # A disc at right angles to `along` reaches r sqrt(1 - a_k^2) along axis k.
    wide = radius * np.sqrt(np.maximum(1.0 - along**2, 0.0))
    ends = np.stack([start, start + length * along])
    bounds = (tuple((ends.min(axis=0) - wide).tolist()), tuple((ends.max(axis=0) + wide).tolist()))
    aligned = np.flatnonzero(np.abs(along) == 1.0)
    if len(aligned):
        k = int(aligned[0])
        others = [m for m in range(3) if m != k]
        disc = Ball(tuple(start[others].tolist()), radius)
        return Region(((tuple(others), disc), ((k,), Interval(bounds[0][k], bounds[1][k], wraps))), bounds)
    first = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    first /= np.linalg.norm(first)
    frame = np.stack([first, np.cross(along, first), along])
    parts = (((0, 1), Ball((0.0, 0.0), radius)), ((2,), Interval(0.0, length)))
    return Region(parts, bounds, tuple(start.tolist()), tuple(map(tuple, frame.tolist())))


def meet(first: Region, second: Region, seed: int) -> bool:
    """Whether one of `SAMPLES` points, where the boxes around the two regions overlap, lies in both."""
    low, high = (f([first.bounds[k], second.bounds[k]], axis=0) for k, f in ((0, np.max), (1, np.min)))
    if (high <= low).any():
        return False
    points = np.random.default_rng(seed).uniform(low, high, (SAMPLES, first.dimension))
    apart = 1e-6 * float((high - low).max())
    return bool((first.inside(points, apart) & second.inside(points, apart)).any())


def ball_size(dimension: int) -> float:
    """Area of the disc or volume of the ball of radius 1."""
    return math.pi if dimension == 2 else 4.0 / 3.0 * math.pi


def into_period(x: np.ndarray, side: float | np.ndarray) -> np.ndarray:
    """Coordinates within 0 <= x < side [m]. Just below zero the remainder alone rounds to the side itself."""
    wrapped = np.mod(x, side)
    return np.where(wrapped < side, wrapped, 0.0)


def crossing_edges(vertices: Sequence[Sequence[float]]) -> tuple[int, int] | None:
    """Numbers of two edges of a polygon that cross or touch each other though they are no neighbours; None without."""
    corners = np.asarray(vertices, float)
    following, count = np.roll(corners, -1, axis=0), len(corners)

    def side(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
        return float(np.sign((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])))

    for i, j in itertools.combinations(range(count), 2):
        if j - i in (1, count - 1):
            continue
        a, b, c, d = corners[i], following[i], corners[j], following[j]
        if side(a, b, c) * side(a, b, d) <= 0.0 and side(c, d, a) * side(c, d, b) <= 0.0:
            apart = (np.maximum(a, b) < np.minimum(c, d)).any() or (np.maximum(c, d) < np.minimum(a, b)).any()
            if not apart:
                return i, j
    return None
