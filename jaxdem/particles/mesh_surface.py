"""A surface of triangles, in 2-D of segments, as the contacts see it: faces, edges and corners as traced arrays.

How they are found is `jaxdem.solids.features`. Numbers are pairs of floats (`compensated`): in float32 the foot of a
perpendicular on a triangle that is metres long is then as exact as the overlap of two grains.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.numerics import compensated, vectors
from jaxdem.numerics import pair_arithmetic as arithmetic
from jaxdem.numerics.compensated import Low, Pair
from jaxdem.numerics.host import namespace
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.pairs import at


class Places(NamedTuple):
    """Points or directions, D pairs of arrays.

    Attributes:
        high: D arrays, leading part.
        low: D arrays, trailing part, or Nones in float64.
    """

    high: Vector
    low: tuple[Low, ...]

    @property
    def pairs(self) -> tuple[Pair, ...]:
        """Component by component."""
        return tuple(zip(self.high, self.low, strict=True))

    def of(self, index: Array) -> Places:
        """Those at these indices, which are in range."""
        return Places(_at(self.high, index), tuple(low if low is None else _at((low,), index)[0] for low in self.low))


class Distance(NamedTuple):
    """Numbers as pairs of arrays [m]."""

    high: Array
    low: Low

    def of(self, index: Array) -> Pair:
        """Those at these indices."""
        return _at((self.high,), index)[0], self.low if self.low is None else _at((self.low,), index)[0]


class Bins(NamedTuple):
    """A level of bins; see `jaxdem.solids.bins`.

    Attributes:
        width: () of a bin [m].
        start: (B + 1,) int32, where the entries of each place begin.
        entry: (E,) int32, numbers of the parts.
    """

    width: Array
    start: Array
    entry: Array

    def entries(self, position: Vector) -> tuple[Array, Array]:
        """(N,) int32 where the entries of the bins that these points [m] are in begin, and how many there are."""
        xp = namespace(position[0])
        total = xp.zeros(position[0].shape, xp.uint32)
        for x, prime in zip(position, PRIMES, strict=False):
            # By way of int32: below zero the conversion to a number without sign is not defined.
            index = xp.floor(x / self.width).astype(xp.int32).astype(xp.uint32)
            total = total ^ (index * xp.uint32(prime))
        place = (total & xp.uint32(len(self.start) - 2)).astype(xp.int32)
        start = _at((self.start,), place)[0]
        return start, _at((self.start,), place + 1)[0] - start


PRIMES = (73856093, 19349663, 83492791)
"""Multipliers of the hash, those of `jaxdem.solids.bins`."""


class FaceTable(NamedTuple):
    """See `jaxdem.solids.features.Faces`; D borders.

    Attributes:
        anchor: a corner [m].
        normal: towards the front.
        both: () bool, whether they are touched from both sides.
        inward: of each border.
        offset: of each border [m].
        patch: (F,) int32.
        bins: in which they are found.
    """

    anchor: Places
    normal: Places
    both: Array
    inward: tuple[Places, ...]
    offset: tuple[Distance, ...]
    patch: Array
    bins: tuple[Bins, ...]


class EdgeTable(NamedTuple):
    """See `jaxdem.solids.features.EdgeLines`."""

    anchor: Places
    along: Places
    length: Distance
    beyond: tuple[Vector, ...]
    patch: Array
    bins: tuple[Bins, ...]


class CornerTable(NamedTuple):
    """See `jaxdem.solids.features.Corners`."""

    anchor: Places
    beyond: tuple[Vector, ...]
    patch: Array
    bins: tuple[Bins, ...]


class MeshSurface(NamedTuple):
    """What grains can touch of a mesh; None for what it has not.

    Attributes:
        faces, edges, corners: in the frame of the mesh.
        hull: (H, D) points that enclose it, of a mesh that moves; None of one at rest [m].
    """

    faces: FaceTable
    edges: EdgeTable | None
    corners: CornerTable | None
    hull: Array | None = None


def on_host(surface: MeshSurface) -> MeshSurface:
    """The same with arrays of NumPy in float64, without trailing parts."""

    def is_pair(node: object) -> bool:
        return isinstance(node, Places | Distance)

    def joined(node: Any) -> Any:
        if isinstance(node, Places):
            pairs = [(np.asarray(high, float), low) for high, low in node.pairs]
            sums: Any = tuple(high if low is None else high + np.asarray(low, float) for high, low in pairs)
            return Places(sums, (None,) * len(sums))
        if isinstance(node, Distance):
            high: Any = np.asarray(node.high, float)
            return Distance(high if node.low is None else high + np.asarray(node.low, float), None)
        return np.asarray(node)

    found: MeshSurface = jax.tree.map(joined, surface, is_leaf=is_pair)
    return found


def _at(vector: Vector, index: Array) -> Vector:
    if namespace(vector[0]) is jnp:
        return at(vector, index)
    return tuple(x[index] for x in vector)


def from_anchor(position: Places, anchor: Places) -> tuple[Pair, ...]:
    """Vectors from the anchors to the positions, as pairs."""
    return tuple(compensated.difference(*one, *other) for one, other in zip(position.pairs, anchor.pairs, strict=True))


def _dot(a: tuple[Pair, ...], b: tuple[Pair, ...]) -> Pair:
    """Scalar product of two vectors of pairs."""
    total = arithmetic.product(a[0], b[0])
    for x, y in zip(a[1:], b[1:], strict=True):
        total = arithmetic.total(total, arithmetic.product(x, y))
    return total


class NearFaces(NamedTuple):
    """Grains and faces, arrays of any one shape S, at the build of a list.

    Attributes:
        overlap: negative for a gap [m].
        normal: D components, towards the grain.
        inside: of each border the distance of the foot from it, positive inside [m].
        inward: of each border the unit vector by which this distance grows.
        patch: of the face.
    """

    overlap: Array
    normal: Vector
    inside: tuple[Array, ...]
    inward: tuple[Vector, ...]
    patch: Array

    def is_near(self, slack: Array | float, reach: Array | float) -> Array:
        """Whether a grain may touch the face after a motion of `slack` [m], `reach` being its radius [m]."""
        found = (self.overlap > -slack) & (self.overlap < 1.5 * reach + slack)
        for inside in self.inside:
            found = found & (inside > -slack - NEXT * reach)
        return found

    def now(self, moved: Vector, radius: Array) -> tuple[Array, Vector, Array]:
        """Overlap, normal and whether the foot lies on the face, after the grains have moved [m]."""
        within = self.overlap > -FAR * radius
        for inside, inward in zip(self.inside, self.inward, strict=True):
            within = within & (inside + vectors.dot(inward, moved) > -NEXT * radius)
        return self.overlap - vectors.dot(self.normal, moved), self.normal, within


NEXT = 1.5e-5
"""The regions of neighbouring faces, edges and corners overlap by this part of a radius, so that none is missed [-]."""

FAR = 4.0
"""Overlap, in radii below zero, that stands for no contact [-]."""


class NearEdges(NamedTuple):
    """Grains and edges, arrays of any one shape S, at the build of a list.

    Attributes:
        overlap: negative for a gap [m].
        apart: D components, from the nearest point of the line to the centre [m].
        along: unit vector along the edge.
        place: of the nearest point along the edge [m].
        rest: of the edge beyond it [m].
        beyond: see `EdgeTable`.
        patch: of the edge.
    """

    overlap: Array
    apart: Vector
    along: Vector
    place: Array
    rest: Array
    beyond: tuple[Vector, ...]
    patch: Array

    def is_near(self, slack: Array | float, reach: Array | float) -> Array:
        """See `NearFaces`."""
        margin = slack + NEXT * reach
        found = (self.overlap > -slack) & (self.place > -margin) & (self.rest > -margin)
        for beyond in self.beyond:
            found = found & (vectors.dot(beyond, self.apart) < margin)
        return found

    def now(self, moved: Vector, radius: Array) -> tuple[Array, Vector, Array]:
        """See `NearFaces`."""
        further = vectors.dot(self.along, moved)
        overlap, normal, apart = _overlap_after(
            self.overlap, self.apart, vectors.add_scaled(moved, -further, self.along), radius
        )
        margin = NEXT * radius
        within = (self.overlap > -FAR * radius) & (self.place + further > -margin) & (self.rest - further > -margin)
        for beyond in self.beyond:
            within = within & (vectors.dot(beyond, apart) < margin)
        return overlap, normal, within


class NearCorners(NamedTuple):
    """Grains and corners, arrays of any one shape S, at the build of a list.

    Attributes:
        overlap: negative for a gap [m].
        apart: D components, from the corner to the centre [m].
        beyond: see `CornerTable`.
        patch: of the corner.
    """

    overlap: Array
    apart: Vector
    beyond: tuple[Vector, ...]
    patch: Array

    def is_near(self, slack: Array | float, reach: Array | float) -> Array:
        """See `NearFaces`."""
        found = self.overlap > -slack
        for beyond in self.beyond:
            found = found & (vectors.dot(beyond, self.apart) < slack + NEXT * reach)
        return found

    def now(self, moved: Vector, radius: Array) -> tuple[Array, Vector, Array]:
        """See `NearFaces`."""
        overlap, normal, apart = _overlap_after(self.overlap, self.apart, moved, radius)
        within = self.overlap > -FAR * radius
        for beyond in self.beyond:
            within = within & (vectors.dot(beyond, apart) < NEXT * radius)
        return overlap, normal, within


Near = NearFaces | NearEdges | NearCorners


def _overlap_after(overlap: Array, initial: Vector, moved: Vector, radius: Array) -> tuple[Array, Vector, Vector]:
    """Overlap, normal and vector from the point, of the overlap and vector at the build and the motion since then.

    |r0 + D| - |r0| = D.(2 r0 + D) / (|r0 + D| + |r0|), see `pair_forces._pair_geometry`.
    """
    apart = vectors.add(initial, moved)
    distance = vectors.length(apart)
    away = distance > 0
    distance = jnp.where(away, distance, 1.0)
    growth = vectors.dot(moved, vectors.add(initial, apart))
    now = overlap - growth / (distance + (radius - overlap))
    first = jnp.where(away, apart[0] / distance, 1.0).astype(distance.dtype)
    return now, (first, *(x / distance for x in apart[1:])), apart


def near_faces(table: FaceTable, index: Array, position: Places, radius: Array) -> NearFaces:
    """Grains and faces.

    Args:
        table: of the mesh.
        index: int32, which face.
        position: of the grains, of the same shape [m].
        radius: of that shape or () [m].
    """
    apart = from_anchor(position, table.anchor.of(index))
    unit = table.normal.of(index)
    high, low = _dot(unit.pairs, apart)
    xp = namespace(high)
    side = xp.where(table.both & (high < 0.0), -1.0, 1.0).astype(high.dtype)
    normal = vectors.scale(side, unit.high)
    high, low = side * high, None if low is None else side * low
    overlap = radius - high
    inside, inward = [], []
    for direction, offset in zip(table.inward, table.offset, strict=True):
        across = direction.of(index)
        inside.append(arithmetic.value(compensated.difference(*_dot(across.pairs, apart), *offset.of(index))))
        inward.append(across.high)
    patch = _at((table.patch,), index)[0]
    return NearFaces(overlap if low is None else overlap - low, normal, tuple(inside), tuple(inward), patch)


def near_edges(table: EdgeTable, index: Array, position: Places, radius: Array) -> NearEdges:
    """Grains and edges; see `near_faces`."""
    from_end = from_anchor(position, table.anchor.of(index))
    along = table.along.of(index)
    place = _dot(along.pairs, from_end)
    apart = tuple(
        compensated.difference(*x, *arithmetic.product(place, u)) for x, u in zip(from_end, along.pairs, strict=True)
    )
    rest = compensated.difference(*table.length.of(index), *place)
    return NearEdges(
        overlap=compensated.overlap_of_spheres(apart, radius),
        apart=tuple(map(arithmetic.value, apart)),
        along=along.high,
        place=arithmetic.value(place),
        rest=arithmetic.value(rest),
        beyond=tuple(_at(beyond, index) for beyond in table.beyond),
        patch=_at((table.patch,), index)[0],
    )


def near_corners(table: CornerTable, index: Array, position: Places, radius: Array) -> NearCorners:
    """Grains and corners; see `near_faces`."""
    apart = from_anchor(position, table.anchor.of(index))
    return NearCorners(
        overlap=compensated.overlap_of_spheres(apart, radius),
        apart=tuple(map(arithmetic.value, apart)),
        beyond=tuple(_at(beyond, index) for beyond in table.beyond),
        patch=_at((table.patch,), index)[0],
    )
