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
        return Places(
            at_index(self.high, index), tuple(low if low is None else at_index((low,), index)[0] for low in self.low)
        )


class Distance(NamedTuple):
    """Numbers as pairs of arrays [m]."""

    high: Array
    low: Low

    def of(self, index: Array) -> Pair:
        """Those at these indices."""
        return at_index((self.high,), index)[0], self.low if self.low is None else at_index((self.low,), index)[0]


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
        start = at_index((self.start,), place)[0]
        return start, at_index((self.start,), place + 1)[0] - start


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
        cell: (F,) int32, which triangle of the file each is; None without wear.
    """

    anchor: Places
    normal: Places
    both: Array
    inward: tuple[Places, ...]
    offset: tuple[Distance, ...]
    patch: Array
    bins: tuple[Bins, ...]
    cell: Array | None = None


class EdgeTable(NamedTuple):
    """See `jaxdem.solids.features.EdgeLines`."""

    anchor: Places
    along: Places
    length: Distance
    beyond: tuple[Vector, ...]
    patch: Array
    bins: tuple[Bins, ...]
    cell: Array | None = None


class CornerTable(NamedTuple):
    """See `jaxdem.solids.features.Corners`."""

    anchor: Places
    beyond: tuple[Vector, ...]
    patch: Array
    bins: tuple[Bins, ...]
    cell: Array | None = None


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


def at_index(vector: Vector, index: Array) -> Vector:
    """Components at these indices, which are in range; on the host or in JAX."""
    if namespace(vector[0]) is jnp:
        return at(vector, index)
    return tuple(x[index] for x in vector)
