"""Grains and the faces, edges and corners of a mesh that are in their reach: overlaps and directions, now and later."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.numerics import compensated, vectors
from jaxdem.numerics import pair_arithmetic as arithmetic
from jaxdem.numerics.compensated import Pair
from jaxdem.numerics.host import namespace
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.mesh_surface import CornerTable, EdgeTable, FaceTable, Places, at_index

NEXT = 1.5e-5
"""The regions of neighbouring faces, edges and corners overlap by this part of a radius, so that none is missed [-]."""


FAR = 4.0
"""Overlap, in radii below zero, that stands for no contact [-]."""


def _beyond(slack: Array | float, gap: Array | float | None) -> Array | float:
    """Largest gap of what is listed [m]."""
    return slack if gap is None else slack + gap


class NearFaces(NamedTuple):
    """Grains and faces, arrays of any one shape S, at the build of a list.

    Attributes:
        overlap: negative for a gap [m].
        normal: D components, towards the grain.
        inside: of each border the distance of the foot from it, positive inside [m].
        inward: of each border the unit vector by which this distance grows.
        patch: of the face.
        cell: see `FaceTable`.
    """

    overlap: Array
    normal: Vector
    inside: tuple[Array, ...]
    inward: tuple[Vector, ...]
    patch: Array
    cell: Array | None = None

    def is_near(self, slack: Array | float, reach: Array | float, gap: Array | float | None = None) -> Array:
        """Whether a grain may be in contact with the face after a motion of `slack` [m].

        Args:
            slack: [m].
            reach: its radius [m].
            gap: up to which it is in contact; None where that is touching it [m].
        """
        found = (self.overlap > -_beyond(slack, gap)) & (self.overlap < 1.5 * reach + slack)
        for inside in self.inside:
            found = found & (inside > -slack - NEXT * reach)
        return found

    def now(self, moved: Vector, radius: Array) -> tuple[Array, Vector, Array]:
        """Overlap, normal and whether the foot lies on the face, after the grains have moved [m]."""
        within = self.overlap > -FAR * radius
        for inside, inward in zip(self.inside, self.inward, strict=True):
            within = within & (inside + vectors.dot(inward, moved) > -NEXT * radius)
        return self.overlap - vectors.dot(self.normal, moved), self.normal, within


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
        cell: see `FaceTable`.
    """

    overlap: Array
    apart: Vector
    along: Vector
    place: Array
    rest: Array
    beyond: tuple[Vector, ...]
    patch: Array
    cell: Array | None = None

    def is_near(self, slack: Array | float, reach: Array | float, gap: Array | float | None = None) -> Array:
        """See `NearFaces`."""
        margin = slack + NEXT * reach
        found = (self.overlap > -_beyond(slack, gap)) & (self.place > -margin) & (self.rest > -margin)
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
        cell: see `FaceTable`.
    """

    overlap: Array
    apart: Vector
    beyond: tuple[Vector, ...]
    patch: Array
    cell: Array | None = None

    def is_near(self, slack: Array | float, reach: Array | float, gap: Array | float | None = None) -> Array:
        """See `NearFaces`."""
        found = self.overlap > -_beyond(slack, gap)
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

    |r0 + D| - |r0| = D.(2 r0 + D) / (|r0 + D| + |r0|), see `pair_forces.pair_geometry`.
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
    patch = at_index((table.patch,), index)[0]
    overlap = overlap if low is None else overlap - low
    return NearFaces(overlap, normal, tuple(inside), tuple(inward), patch, _cell(table, index))


def _cell(table: FaceTable | EdgeTable | CornerTable, index: Array) -> Array | None:
    return None if table.cell is None else at_index((table.cell,), index)[0]


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
        beyond=tuple(at_index(beyond, index) for beyond in table.beyond),
        patch=at_index((table.patch,), index)[0],
        cell=_cell(table, index),
    )


def near_corners(table: CornerTable, index: Array, position: Places, radius: Array) -> NearCorners:
    """Grains and corners; see `near_faces`."""
    apart = from_anchor(position, table.anchor.of(index))
    return NearCorners(
        overlap=compensated.overlap_of_spheres(apart, radius),
        apart=tuple(map(arithmetic.value, apart)),
        beyond=tuple(at_index(beyond, index) for beyond in table.beyond),
        patch=at_index((table.patch,), index)[0],
        cell=_cell(table, index),
    )


def from_anchor(position: Places, anchor: Places) -> tuple[Pair, ...]:
    """Vectors from the anchors to the positions, as pairs."""
    return tuple(compensated.difference(*one, *other) for one, other in zip(position.pairs, anchor.pairs, strict=True))


def _dot(a: tuple[Pair, ...], b: tuple[Pair, ...]) -> Pair:
    """Scalar product of two vectors of pairs."""
    total = arithmetic.product(a[0], b[0])
    for x, y in zip(a[1:], b[1:], strict=True):
        total = arithmetic.total(total, arithmetic.product(x, y))
    return total
