"""Search for neighbours: who is in reach of whom.

Room for a list is counted on the host (`list_room`). Inside jit `cells` finds who is in reach of whom, or a list of
jax-md says it (`jax_md_list`); `pairs` has each pair once.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.typing import DTypeLike

from jaxdem.errors import required
from jaxdem.numerics import compensated
from jaxdem.numerics.compensated import Low
from jaxdem.numerics.host import namespace
from jaxdem.numerics.placement import Placement
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.cells import CellGrid, neighbors_in_cells
from jaxdem.particles.mesh_search import MeshSearch, whole
from jaxdem.particles.mesh_surface import MeshSurface
from jaxdem.particles.neighbors import NeighborGeometry, Neighbors, Room, separation_and_overlap, with_radius
from jaxdem.particles.owned_pairs import owned_pairs
from jaxdem.particles.pairs import Owned, Pairs, pairs_of
from jaxdem.particles.size_levels import LevelTables, SizeLevels


@static
class NeighborSearch:
    """Allocates and updates `Neighbors`; a single particle and no particle at all have no slots.

    Attributes:
        geometry: of the box, and how far the list reaches.
        typical_radius: of the mean volume of all particles, those still to come included [m].
        moving: of each mesh, whether it moves.
        members: spheres of a body, which are no pairs with each other; of N bodies row k N + i is one of body i.
        levels: of size, by which grains are looked for; None for one table for all.
        arm: farthest that the centre of a member is from that of its body; 0 of spheres [m].
        bonds: whether there are levels and bonds, which may be longer than a list by levels reaches.
    """

    geometry: NeighborGeometry
    typical_radius: float
    moving: tuple[bool, ...] = ()
    members: int = 1
    levels: SizeLevels | None = None
    arm: float = 0.0
    bonds: bool = False

    @property
    def without_levels(self) -> NeighborSearch:
        """The same with one table for all."""
        if self.levels is None:
            return self
        geometry = dataclasses.replace(self.geometry, skin=self.levels.single_skin)
        return dataclasses.replace(self, geometry=geometry, levels=None)

    @property
    def limits(self) -> list[float]:
        """What decides which pairs are listed: lists of the same pairs have the same [m]."""
        return [self.geometry.cutoff, self.geometry.skin, *(() if self.levels is None else self.levels.radii)]

    @property
    def reach(self) -> float:
        """Pairs nearer than this are listed; in a list by levels, of the largest grains [m]."""
        return self.geometry.cutoff + self.geometry.skin

    def reaches(self, radius: Array) -> Array | None:
        """(N,) how far each particle reaches: two are listed if they are nearer than both together, their radii, the
        gap of an attraction and the skin; None where all have the reach of the list [m].

        Args:
            radius: () or (N,) of all particles that there ever are, NumPy's or JAX's [m].
        """
        if self.levels is not None:
            return radius + 0.5 * (self.levels.gap + self.geometry.skin)
        if self.members > 1 or radius.ndim == 0:
            return None
        return radius + (0.5 * self.reach - namespace(radius).max(radius))

    @property
    def spare_reach(self) -> float:
        """In a list by levels: pairs whose surfaces are nearer than this are listed [m]."""
        return required(self.levels, "levels of size").gap + self.geometry.skin

    @property
    def body_reach(self) -> float:
        """Particles whose centres are farther apart have no spheres within `reach`; of spheres that itself, with bonds
        beside levels that of one table for all [m]."""
        if self.bonds:
            return self.without_levels.reach
        return self.reach if self.members == 1 else self.reach + 2.0 * self.arm

    @property
    def cells(self) -> tuple[int, ...]:
        """Number of cells of the search along each axis."""
        geometry = self.geometry
        return geometry.cells or CellGrid(geometry.box, geometry.periodic, self.reach, 0).shape

    def cells_for(self, position: Vector) -> CellGrid:
        """The cells of the search for so many particles."""
        geometry = self.geometry
        return CellGrid(geometry.box, geometry.periodic, self.reach, position[0].shape[0], geometry.cells)

    def allocate(
        self,
        position: Vector,
        low: tuple[Low, ...],
        radius: Array,
        room: Room,
        active: Array | None = None,
        surfaces: tuple[MeshSurface, ...] = (),
        placed: tuple[Placement | None, ...] = (),
    ) -> Neighbors:
        """A new list; not jittable.

        Args:
            position: D arrays (N,), leading parts [m]; must be finite.
            low: D arrays (N,) or Nones, trailing parts.
            radius: () or (N,) [m].
            room: for it, see `list_room`; a resumed run asks for what it had, so that it compiles and computes the
                same.
            active: (N,) bool, which particles there are; all if None.
            surfaces: the meshes.
            placed: where each of them is, None for one at rest; empty for their places without motion.
        """
        return listing(self)(position, low, radius, room, active, surfaces, placed)

    def shapes(
        self,
        position: Vector,
        low: tuple[Low, ...],
        radius: Array,
        room: Room,
        surfaces: tuple[MeshSurface, ...] = (),
    ) -> Neighbors:
        """What `allocate` gives for these arguments, shapes and types alone; nothing is compiled."""
        if surfaces:
            given = (position, low, radius, room, None, surfaces)
            return jax.eval_shape(self._built, *given)
        count, dtype = position[0].shape[0], position[0].dtype

        def shape(*sizes: int, dtype: DTypeLike = jnp.int32) -> Any:  # JAX has no type for arrays and shapes alike
            return jax.ShapeDtypeStruct(sizes, dtype)

        real, index = shape(room.pairs, dtype=dtype), shape(room.slots, count)
        given = jax.tree.map(lambda a: shape(*a.shape, dtype=a.dtype), (position, low, radius))
        return Neighbors(
            index=index,
            pairs=self._pair_shapes(shape, room, count),
            separation=(real,) * len(position),
            radius=given[2],
            overlap=real,
            reference=given[0],
            reference_low=given[1],
            overflow=shape(dtype=bool),
            builds=shape(),
            cell_slots=room.cell,
            across_slots=0 if room.rows is None else room.rows.across,
        )

    @staticmethod
    def _pair_shapes(shape: Any, room: Room, count: int) -> Pairs:
        """Shapes of the pairs of so many particles."""
        each, rows = shape(room.pairs), room.rows
        if rows is None:
            return Pairs(each, each, shape(room.slots, count))
        owned = Owned(shape(count), each, shape(rows.further))
        return Pairs(each, each, shape(rows.width, count + rows.further), owned)

    def update(
        self,
        position: Vector,
        low: tuple[Low, ...],
        neighbors: Neighbors,
        active: Array | None = None,
        placed: Sequence[Placement | None] = (),
    ) -> Neighbors:
        """The list rebuilt at these positions for the same radii; jittable, room unchanged, overflow flagged.

        `placed` is where each mesh is, None for one at rest; empty where all are.
        """
        radius = neighbors.radius
        given = lax.stop_gradient((position, low, radius))
        built = self._built(*given, neighbors.room, active, neighbors.surfaces, tuple(placed))
        overflow = neighbors.overflow | built.overflow
        return dataclasses.replace(with_radius(built, radius), builds=neighbors.builds + 1, overflow=overflow)

    def _built(
        self,
        position: Vector,
        low: tuple[Low, ...],
        radius: Array,
        room: Room,
        active: Array | None = None,
        surfaces: tuple[MeshSurface, ...] = (),
        placed: tuple[Placement | None, ...] = (),
    ) -> Neighbors:
        overflow = jnp.zeros((), bool)
        if room.slots == 0:
            index = jnp.zeros((0, *position[0].shape), jnp.int32)
        else:
            index, overflow = self.in_reach(position, low, room, active, radius)
        listed = self.listed(index, position, low, radius, room, overflow)
        return self.with_meshes(listed, surfaces, room, active, placed) if surfaces else listed

    def with_meshes(
        self,
        listed: Neighbors,
        surfaces: tuple[MeshSurface, ...],
        room: Room,
        active: Array | None,
        placed: Sequence[Placement | None] = (),
    ) -> Neighbors:
        """The list with those of the meshes, at its own positions; jittable."""
        search, position, low = self.mesh_search, listed.reference, listed.reference_low
        places, found = search.inside(position, low), []
        for k, (surface, own) in enumerate(zip(surfaces, room.meshes, strict=True)):
            if surface.hull is None:
                found.append(search.listed(surface, places, listed.radius, own, active))
            else:
                placement = whole(placed[k] if placed else None, len(position), position[0].dtype)
                found.append(search.listed_beside(surface, placement, position, low, listed.radius, own, active))
        overflow = functools.reduce(jnp.logical_or, (crowded for _, crowded in found), listed.overflow)
        return dataclasses.replace(listed, meshes=tuple(one for one, _ in found), overflow=overflow)

    @property
    def mesh_search(self) -> MeshSearch:
        """How particles find the meshes."""
        return MeshSearch(self.geometry.box, self.geometry.periodic, self.geometry.skin, self.geometry.gap)

    def in_reach(
        self,
        position: Vector,
        low: tuple[Low, ...],
        room: Room,
        active: Array | None,
        radius: Array | None = None,
        who: Array | None = None,
    ) -> tuple[Array, Array]:
        """(K, N) int32 index of a list at these positions, and () bool, whether there was not room enough.

        `radius` () or (N,) says how far each reaches [m]; without it all reach as far as the largest. `who` says in a
        slab whose particles the rows of a list by levels are, see `LevelTables.owned`.
        """
        geometry = self.geometry
        inside = compensated.into_box(position, low, geometry.box, geometry.periodic)
        if self.levels is not None and radius is not None:
            tables = LevelTables(self.levels, geometry.box, geometry.periodic, len(radius))
            rows = room.cell, required(room.rows, "room for rows").across
            return tables.owned(inside, radius, geometry.skin, room.slots, rows, active, who)
        given, reaches = self.cells_for(position), None if radius is None else self.reaches(radius)
        return neighbors_in_cells(given, inside, room.slots, room.cell, active, self.members, reaches)

    def listed(
        self,
        index: Array,
        position: Vector,
        low: tuple[Low, ...],
        radius: Array,
        room: Room,
        overflow: Array,
        identity: Array | None = None,
    ) -> Neighbors:
        """The first list of who is in reach of whom; jittable.

        Args:
            index: (K, N) int32, see `Neighbors`; symmetric, in any order.
            position, low: D arrays (N,), positions at which they are in reach [m].
            radius: () or (N,) [m].
            room: for the list.
            overflow: () bool, whether something is missing in `index`.
            identity: (N,) int32, see `pairs_of`.
        """
        if room.slots == 0:
            none, blank = jnp.zeros(0, jnp.int32), jnp.zeros(0, position[0].dtype)
            pairs, separation, overlap = Pairs(none, none, index), (blank,) * len(position), blank
        else:
            if room.rows is None:
                pairs, too_many = pairs_of(index, room.pairs, identity)
            else:
                pairs, too_many = owned_pairs(index, room.pairs, room.rows.width, room.rows.further, identity)
            overflow = overflow | too_many
            separation, overlap = separation_and_overlap(self.geometry, pairs, position, low, radius)
        builds, across = jnp.ones((), jnp.int32), 0 if room.rows is None else room.rows.across
        first = Neighbors(index, pairs, separation, radius, overlap, position, low, overflow, builds, room.cell)
        return dataclasses.replace(first, across_slots=across) if across else first


@functools.lru_cache(maxsize=8)
def listing(search: NeighborSearch) -> Callable[..., Neighbors]:
    """The program of a new list; equal searches share it, so that a further run of a scene traces nothing anew.

    Outside of `jit` every operation would be compiled by itself.
    """
    return jax.jit(search._built)
