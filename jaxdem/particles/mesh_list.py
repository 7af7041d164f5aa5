"""Which grains are near a mesh, and which of its faces, edges and corners each of them may touch.

Made with the neighbour list and good for as long: until a grain has moved half of the skin. Of what is listed the list
keeps the overlap and the place at its build, computed in pairs of floats, and a contact step only adds the motion since
then, as for two grains. Grains that are near a mesh have a row; the others cost a contact step nothing.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import DTypeLike

from jaxdem.errors import required
from jaxdem.numerics import compensated
from jaxdem.numerics.compensated import Low
from jaxdem.numerics.placement import Placement, at_rest
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.mesh_surface import (
    FAR,
    CornerTable,
    EdgeTable,
    FaceTable,
    MeshSurface,
    Near,
    NearCorners,
    NearEdges,
    NearFaces,
    Places,
    near_corners,
    near_edges,
    near_faces,
)
from jaxdem.particles.pairs import at

KINDS = ("faces", "edges", "corners")
"""Of which a grain may touch several."""

Table = FaceTable | EdgeTable | CornerTable


@static
class MeshRoom:
    """What the list of a mesh has room for; static.

    Attributes:
        rows: M, grains that are near the mesh.
        contacts: C, contacts of a grain with the mesh.
        looks: of each of `KINDS`, grains times what is in their bins.
        slots: of each of `KINDS`, what a grain may touch; 0 for a kind that the mesh has not.
    """

    rows: int
    contacts: int
    looks: tuple[int, int, int]
    slots: tuple[int, int, int]

    @property
    def numbers(self) -> tuple[int, ...]:
        """All of them in a row."""
        return (self.rows, self.contacts, *self.looks, *self.slots)

    @classmethod
    def of(cls, numbers: tuple[int, ...]) -> MeshRoom:
        """The inverse of `numbers`."""
        rows, contacts, *rest = numbers
        return cls(rows, contacts, (rest[0], rest[1], rest[2]), (rest[3], rest[4], rest[5]))


NUMBERS = 8
"""Of a `MeshRoom`."""


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class MeshList:
    """Grains near a mesh, M rows, and what each may touch.

    Attributes:
        surface: the mesh; None in a checkpoint.
        row: (M,) int32, the grain of each row; the number of grains in an empty row.
        faces: (K, M) of each; None without room for any.
        edges: the same.
        corners: the same.
        contacts: C, room for contacts of a grain; static.
        looks: see `MeshRoom`; static.
        placement: of the mesh at the build, with a rotation; None of one at rest.
        reference: (M,) grains of the rows at the build, in the frame of the mesh; None of one at rest.
        images: (M,) whole periods by which they were moved into the box; None without, and of one at rest.
    """

    surface: MeshSurface | None
    row: Array
    faces: NearFaces | None
    edges: NearEdges | None
    corners: NearCorners | None
    contacts: int = dataclasses.field(metadata={"static": True})
    looks: tuple[int, int, int] = dataclasses.field(metadata={"static": True})
    placement: Placement | None = None
    reference: Places | None = None
    images: Places | None = None

    def moved(self, placed: Placement, position: Vector, low: tuple[Low, ...]) -> Vector:
        """D arrays (M,), motion of the grains of the rows since the build in the frame of a mesh that moves [m].

        Args:
            placed: the mesh now.
            position, low: D arrays (N,), all grains now [m].
        """
        reference, images = required(self.reference, "reference"), required(self.images, "images")
        grain = jnp.minimum(self.row, max(position[0].shape[0] - 1, 0))
        now = Places(position, low).of(grain)
        inside = [compensated.difference(*one, *image) for one, image in zip(now.pairs, images.pairs, strict=True)]
        own = placed.to_body(tuple(high for high, _ in inside), tuple(rest for _, rest in inside))
        pairs = zip(Places(*own).pairs, reference.pairs, strict=True)
        return tuple(compensated.rounded_difference(*one, *before) for one, before in pairs)

    def way(self, placed: Placement) -> Array:
        """() how far a point of the mesh has moved at most since the build [m]."""
        hull = required(required(self.surface, "surface").hull, "hull")
        before = required(self.placement, "placement")

        def places(placement: Placement) -> Array:
            found = hull if placement.rotation is None else hull @ placement.rotation.T
            return found + placement.shift[None]

        return jnp.sqrt(jnp.max(jnp.sum((places(placed) - places(before)) ** 2, axis=1)))

    @property
    def near(self) -> tuple[Near, ...]:
        """What there is of the three kinds."""
        return tuple(kind for kind in (self.faces, self.edges, self.corners) if kind is not None)

    @property
    def room(self) -> MeshRoom:
        """What there is room for."""
        faces, edges, corners = (
            0 if kind is None else int(kind.overlap.shape[0]) for kind in (self.faces, self.edges, self.corners)
        )
        return MeshRoom(self.row.shape[0], self.contacts, self.looks, (faces, edges, corners))

    def of_rows(self, values: Vector) -> Vector:
        """Values (M,) of (N,); of an empty row those of some grain."""
        count = values[0].shape[0]
        return at(values, jnp.minimum(self.row, max(count - 1, 0)))

    def added(self, totals: Vector, values: Vector) -> Vector:
        """Totals (N,) with values (M,) of the rows."""
        return tuple(
            total.at[self.row].add(value, mode="drop", unique_indices=True, indices_are_sorted=True)
            for total, value in zip(totals, values, strict=True)
        )

    def radius_of_rows(self, radius: Array) -> Array:
        """() unchanged, (M,) of (N,)."""
        return radius if radius.ndim == 0 else self.of_rows((radius,))[0]

    def with_radius(self, radius: Array, before: Array) -> MeshList:
        """The same with the overlaps of other radii, () or (N,) [m], and with their slopes by these.

        Args:
            radius: now.
            before: at the build.
        """
        change = self.radius_of_rows(radius) - lax.stop_gradient(self.radius_of_rows(before))
        if change.ndim:
            change = change[None]

        def changed(kind: Near | None) -> Any:
            return None if kind is None else kind._replace(overlap=lax.stop_gradient(kind.overlap) + change)

        return dataclasses.replace(
            self, faces=changed(self.faces), edges=changed(self.edges), corners=changed(self.corners)
        )


def tables(surface: MeshSurface) -> tuple[Table | None, ...]:
    """Of each of `KINDS`."""
    return surface.faces, surface.edges, surface.corners


def near_of(table: Table, index: Array, position: Places, radius: Array) -> Near:
    """Grains and parts of a mesh of one kind; see `mesh_surface.near_faces`."""
    if isinstance(table, FaceTable):
        return near_faces(table, index, position, radius)
    if isinstance(table, EdgeTable):
        return near_edges(table, index, position, radius)
    return near_corners(table, index, position, radius)


@static
class MeshSearch:
    """How grains find a mesh; static.

    Attributes:
        box: side lengths of the domain [m].
        periodic: whether each axis is periodic.
        skin: see `NeighborGeometry` [m].
    """

    box: tuple[float, ...]
    periodic: tuple[bool, ...]
    skin: float

    def images(self, position: Vector) -> Places:
        """Whole periods from the box to the images that positions are in."""
        found = [
            compensated.whole_periods(jnp.floor(x / length), length) if wraps else _zero(x)
            for x, length, wraps in zip(position, self.box, self.periodic, strict=True)
        ]
        return Places(tuple(high for high, _ in found), tuple(low for _, low in found))

    def inside(self, position: Vector, low: tuple[Low, ...]) -> Places:
        """Positions moved by whole periods into the box."""
        given = zip(Places(position, low).pairs, self.images(position).pairs, self.periodic, strict=True)
        found = [compensated.difference(*one, *image) if wraps else one for one, image, wraps in given]
        return Places(tuple(high for high, _ in found), tuple(rest for _, rest in found))

    def listed_beside(
        self,
        surface: MeshSurface,
        placement: Placement,
        position: Vector,
        low: tuple[Low, ...],
        radius: Array,
        room: MeshRoom,
        active: Array | None,
    ) -> tuple[MeshList, Array]:
        """`listed` of a mesh that moves, which has this placement now."""
        places = self.inside(position, low)
        own = Places(*placement.to_body(places.high, places.low))
        found, overflow = self.listed(surface, own, radius, room, active)
        grain = jnp.minimum(found.row, max(position[0].shape[0] - 1, 0))
        images = self.images(position)
        kept = dataclasses.replace(found, placement=placement, reference=own.of(grain), images=images.of(grain))
        return kept, overflow

    def listed(
        self, surface: MeshSurface, places: Places, radius: Array, room: MeshRoom, active: Array | None
    ) -> tuple[MeshList, Array]:
        """The list at these places, and () bool, whether there was not enough room; jittable.

        Args:
            surface: the mesh.
            places: (N,) of the grains, in the frame of the mesh [m].
            radius: () or (N,) [m].
            room: for the list.
            active: (N,) bool, which grains there are; None for all.
        """
        count, overflow = places.high[0].shape[0], jnp.zeros((), bool)
        found: list[_Found | None] = []
        for table, looks in zip(tables(surface), room.looks, strict=True):
            if table is None or looks == 0:
                found.append(None)
                continue
            one = self._found(table, places, radius, looks, active)
            overflow = overflow | one.crowded
            found.append(one)
        number = functools.reduce(jnp.add, (one.number for one in found if one is not None))
        listed = number > 0
        upto = jnp.cumsum(listed, dtype=jnp.int32)
        overflow = overflow | (upto[-1] > room.rows)
        place = jnp.where(listed, upto - 1, room.rows)
        row = jnp.full(room.rows, count, jnp.int32).at[place].set(jnp.arange(count, dtype=jnp.int32), mode="drop")
        kinds: list[Any] = []
        for table, of_kind, slots in zip(tables(surface), found, room.slots, strict=True):
            if table is None or of_kind is None:
                kinds.append(None)
                continue
            overflow = overflow | (jnp.max(of_kind.number) > slots)
            kinds.append(self._kept(of_kind, slots, place, room.rows, radius))
        faces, edges, corners = kinds
        return MeshList(surface, row, faces, edges, corners, room.contacts, room.looks), overflow

    def _found(self, table: Table, places: Places, radius: Array, looks: int, active: Array | None) -> _Found:
        """All grains and what is in their bins, grain by grain, and which are in reach."""
        count, levels = places.high[0].shape[0], len(table.bins)
        starts, counts, first = [], [], 0
        for bins in table.bins:
            start, number = bins.entries(places.high)
            starts.append(start + first)
            counts.append(number if active is None else jnp.where(active, number, 0))
            first += bins.entry.shape[0]
        start, number = (jnp.stack(x, axis=1).reshape(-1) for x in (starts, counts))
        end = jnp.cumsum(number, dtype=jnp.int32)
        begin = end - number
        groups = jnp.arange(count * levels, dtype=jnp.int32)
        # Who owns a stretch is written at its start; of several that start there all but the last own nothing.
        marks = jnp.zeros(looks, jnp.int32).at[begin].max(groups, mode="drop")
        group = lax.cummax(marks)
        place = jnp.arange(looks, dtype=jnp.int32)
        total = end[-1]
        entries = jnp.concatenate([bins.entry for bins in table.bins])
        entry = jnp.clip(start[group] + place - begin[group], 0, entries.shape[0] - 1)
        grain, part = group // levels, entries[entry]
        own = radius if radius.ndim == 0 else radius[grain]
        values = near_of(table, part, places.of(grain), own)
        near = values.is_near(0.5 * self.skin, own) & (place < total)
        upto = jnp.concatenate([jnp.zeros(1, jnp.int32), jnp.cumsum(near, dtype=jnp.int32)])
        of_grain = jnp.minimum(jnp.concatenate([begin[::levels], end[-1:]]), looks)
        before = upto[of_grain]
        rank = upto[:-1] - before[grain]
        return _Found(values, grain, rank, near, before[1:] - before[:-1], total > looks)

    def _kept(self, found: _Found, slots: int, place: Array, rows: int, radius: Array) -> Near:
        """(K, M) what the grain of each row may touch; `place` is the row of each grain."""
        # Out of the table where the pair is not in reach, or its grain has no row.
        column = jnp.where(found.near, place[found.grain], rows)
        slot = jnp.where(found.near, found.rank, slots)
        own = jnp.arange(len(found.grain), dtype=jnp.int32)
        number = jnp.full((slots, rows), -1, jnp.int32).at[slot, column].set(own, mode="drop")
        flat = jnp.maximum(number, 0)
        near = jax.tree.map(lambda x: at((x,), flat)[0], found.values)
        blank = -2.0 * FAR * (radius if radius.ndim == 0 else jnp.max(radius))
        return near._replace(overlap=jnp.where(number >= 0, near.overlap, blank))


def _zero(x: Array) -> tuple[Array, Low]:
    return jnp.zeros_like(x), jnp.zeros_like(x) if x.dtype == jnp.float32 else None


def whole(placed: Placement | None, dimension: int, dtype: DTypeLike) -> Placement:
    """A placement with all of its arrays, at rest; that of the file where there is none."""
    like = jnp.zeros((), dtype)
    found = at_rest(dimension, like) if placed is None else placed
    single = like.dtype == jnp.float32
    turn, turn_low = found.rotation, found.rotation_low
    if turn is None:
        turn = jnp.eye(dimension, dtype=dtype)
        turn_low = jnp.zeros_like(turn) if single else None
    zero = jnp.zeros(dimension, dtype)
    placed = Placement(turn, turn_low, found.shift, found.shift_low, zero, None, zero)
    return jax.tree.map(jnp.asarray, lax.stop_gradient(placed))


class _Found:
    """Grains and parts of one kind that share a bin, L of them.

    Attributes:
        values: (L,) of each, the overlaps and places.
        grain: (L,) int32, ascending.
        rank: (L,) int32, how many of the same grain before it are in reach.
        near: (L,) bool, in reach.
        number: (N,) int32, of every grain how many are in reach.
        crowded: () bool, there were more than room.
    """

    def __init__(self, values: Near, grain: Array, rank: Array, near: Array, number: Array, crowded: Array) -> None:
        self.values, self.grain, self.rank = values, grain, rank
        self.near, self.number, self.crowded = near, number, crowded


EXTRA = 1.25
"""Rows and slots are allocated for this multiple of what is found."""

CONTACTS = {2: 3, 3: 4}
"""Contacts of a grain with a mesh, by dimension: with one more than in a corner."""


def needed(search: MeshSearch, surface: MeshSurface, position: Sequence[Any], radius: Any) -> np.ndarray:
    """(7,) rows, looks and slots that grains at these places need; on the host, in float64.

    Args:
        search: how they find the mesh.
        surface: with arrays of NumPy in float64.
        position: D arrays (N,) of NumPy [m].
        radius: () or (N,) [m].
    """
    inside: Any = tuple(
        np.where(wraps, np.mod(x, length), x)
        for x, length, wraps in zip(position, search.box, search.periodic, strict=True)
    )
    places = Places(inside, (None,) * len(inside))
    looks, slots, near_any = [], [], np.zeros(len(position[0]), bool)
    for table in tables(surface):
        if table is None or not len(position[0]):
            looks.append(0)
            slots.append(0)
            continue
        total, number = 0, np.zeros(len(position[0]), int)
        for bins in table.bins:
            start, count = bins.entries(inside)
            grain: Any = np.repeat(np.arange(len(count)), count)
            entry = np.repeat(start, count) + np.arange(len(grain)) - np.repeat(np.cumsum(count) - count, count)
            part = bins.entry[entry]
            own = radius if np.ndim(radius) == 0 else radius[grain]
            near = near_of(table, part, places.of(grain), own).is_near(0.5 * search.skin, own)
            number += np.bincount(grain[np.asarray(near)], minlength=len(number))
            total += len(grain)
        near_any |= number > 0
        looks.append(total)
        slots.append(int(number.max(initial=0)))
    return np.array([int(near_any.sum()), *looks, *slots])


def with_margin(number: float, least: int) -> int:
    """Room for a number that was found."""
    return max(least, math.ceil(EXTRA * number))


def carried(values: Vector, old: MeshList, new: MeshList, count: int) -> Vector:
    """Values (C, M) of the contacts of each row, moved to the rows of another list by the identity of the grains.

    Args:
        values: of the old list.
        old: list that they belong to.
        new: list with C' contacts and M' rows.
        count: N, number of grains.
    """
    rows = old.row.shape[0]
    place = jnp.full(count + 1, rows, jnp.int32).at[old.row].set(jnp.arange(rows, dtype=jnp.int32))
    place = place.at[count].set(rows)
    wanted = place[new.row]

    def moved(x: Array) -> Array:
        wider = jnp.pad(x, ((0, max(new.contacts - x.shape[0], 0)), (0, 1)))
        return wider[:, wanted]

    return tuple(map(moved, values))
