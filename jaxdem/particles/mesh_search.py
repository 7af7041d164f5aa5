"""How grains find the faces, edges and corners of a mesh: by bins, into lists of fixed size."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import DTypeLike

from jaxdem.numerics import compensated
from jaxdem.numerics.compensated import Low
from jaxdem.numerics.placement import Placement, at_rest
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.mesh_list import MeshList
from jaxdem.particles.mesh_near import FAR, Near, near_corners, near_edges, near_faces
from jaxdem.particles.mesh_room import MeshRoom
from jaxdem.particles.mesh_surface import CornerTable, EdgeTable, FaceTable, MeshSurface, Places
from jaxdem.particles.pairs import at

Table = FaceTable | EdgeTable | CornerTable


def tables(surface: MeshSurface) -> tuple[Table | None, ...]:
    """Of faces, edges and corners; None for what the mesh has not."""
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
        skin, gap: see `NeighborGeometry` [m].
    """

    box: tuple[float, ...]
    periodic: tuple[bool, ...]
    skin: float
    gap: float | None = None

    @property
    def reach(self) -> float:
        """Farthest that a mesh is from a grain in its list, beyond what touches it [m]."""
        return self.skin + (self.gap or 0.0)

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
        near = values.is_near(0.5 * self.skin, own, self.gap) & (place < total)
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
            near = near_of(table, part, places.of(grain), own).is_near(0.5 * search.skin, own, search.gap)
            number += np.bincount(grain[np.asarray(near)], minlength=len(number))
            total += len(grain)
        near_any |= number > 0
        looks.append(total)
        slots.append(int(number.max(initial=0)))
    return np.array([int(near_any.sum()), *looks, *slots])
