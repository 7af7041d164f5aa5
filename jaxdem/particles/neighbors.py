"""Neighbour list: who may touch whom, and where the pair stood when the list was made.

Room for a list is counted on the host by SciPy's tree. Inside jit `cells` finds who is in reach of whom, or a list of
jax-md says it (`jax_md_list`); `pairs` has each pair once. Beside each pair a list keeps the separation and the overlap
at the build, computed in pairs of floats; a contact step only adds the change of distance since then, so that float32
resolves overlaps of a nanometre in a box of metres.
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
from scipy.spatial import KDTree

from jaxdem.numerics import compensated, vectors
from jaxdem.numerics.compensated import Low
from jaxdem.numerics.placement import Placement
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.cells import CellGrid, neighbors_in_cells
from jaxdem.particles.ghosts import Ghosts
from jaxdem.particles.mesh_contact import MeshMemory
from jaxdem.particles.mesh_list import NUMBERS, MeshList, MeshRoom, MeshSearch, carried, needed, whole, with_margin
from jaxdem.particles.mesh_surface import MeshSurface, on_host
from jaxdem.particles.pairs import WRITTEN_OUT, Pairs, at, pairs_of, place_of
from jaxdem.particles.regions import into_period

EXTRA_CAPACITY = 1.25
"""Slots are allocated for this multiple of the largest number of neighbours found."""

USUAL_SLOTS = {2: 8, 3: 16}
"""Slots allocated at least, by dimension: what a dense pack of equal spheres needs once it has formed."""

USUAL_PAIRS = {2: 3.25, 3: 5.0}
"""Pairs allocated at least for each particle, by dimension: three in a hexagonal layer, and a margin."""

EXTRA_PAIRS = 1.1
"""Pairs are allocated for this multiple of those found: their sum varies less than the most that one particle has."""

DENSE = {2: 0.85, 3: 0.64}
"""Solid fraction of a dense pack, by dimension."""


@static
class NeighborGeometry:
    """What the search needs to know; static.

    Attributes:
        box: side lengths of the domain [m].
        periodic: whether each axis is periodic.
        cutoff: largest distance of two centres in contact, the largest diameter [m].
        skin: extra distance that is listed; the list is good until a particle has moved skin/2 [m].
        cells: number of cells of the search along each axis; as many as the reach allows if None. With it cutoff and
            skin may be traced.
    """

    box: tuple[float, ...]
    periodic: tuple[bool, ...]
    cutoff: float
    skin: float
    cells: tuple[int, ...] | None = None


@static
class Room:
    """What a list has room for; static.

    Attributes:
        slots: K, neighbours of a particle; 0 for nothing to list.
        pairs: P, pairs and the empty one.
        cell: particles in a column of the search's table.
        mesh: what the lists of the meshes have room for, `MeshRoom.numbers` of one after the other.
    """

    slots: int
    pairs: int
    cell: int
    mesh: tuple[int, ...] = ()

    @property
    def numbers(self) -> tuple[int, ...]:
        """All of them in a row."""
        return (self.slots, self.pairs, self.cell, *self.mesh)

    @classmethod
    def of(cls, numbers: Sequence[int]) -> Room:
        """The inverse of `numbers`."""
        slots, pairs, cell, *mesh = numbers
        return cls(slots, pairs, cell, tuple(mesh))

    @property
    def meshes(self) -> tuple[MeshRoom, ...]:
        """Of each mesh."""
        return tuple(MeshRoom.of(self.mesh[k : k + NUMBERS]) for k in range(0, len(self.mesh), NUMBERS))

    def enlarged(self) -> Room:
        """Half as much again; what a mesh has nothing of stays so."""
        slots, pairs, cell = (n + max(2, n // 2) for n in (self.slots, self.pairs, self.cell))
        return Room(slots, pairs, cell, tuple(n + max(2, n // 2) if n else 0 for n in self.mesh))

    def covering(self, other: Room) -> Room:
        """Room for what either has room for."""
        return Room.of(tuple(map(max, self.numbers, other.numbers)))


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Neighbors:
    """Pairs in reach: P pairs, each once, and K slots for each of N particles, where each stands twice.

    Attributes:
        index: (K, N) int32, the other particle; an empty slot holds the particle itself.
        pairs: who the pairs are, and where those of each particle stand.
        separation: D arrays (P,), centre of the first less centre of the second, at the build [m].
        radius: () or (N,) at the build [m].
        overlap: (P,) overlap at the build, of these radii, negative for a gap [m].
        reference: D arrays (N,), positions at the build, leading part [m].
        reference_low: D arrays (N,), trailing part, or Nones in float64.
        overflow: () bool, there were more neighbours or pairs than room; the list is then incomplete.
        builds: () int32, number of builds so far.
        cell_slots: room for particles in a column of the search's table; static.
        ghosts: in a box that is cut into slabs, whose particles the N rows are; None on one device.
        meshes: which particles are near each mesh; none in a scene without meshes.
    """

    index: Array
    pairs: Pairs
    separation: Vector
    radius: Array
    overlap: Array
    reference: Vector
    reference_low: tuple[Low, ...]
    overflow: Array
    builds: Array
    cell_slots: int = dataclasses.field(metadata={"static": True})
    ghosts: Ghosts | None = None
    meshes: tuple[MeshList, ...] = ()

    @property
    def room(self) -> Room:
        """What there is room for."""
        meshes = tuple(number for mesh in self.meshes for number in mesh.room.numbers)
        return Room(self.index.shape[0], self.overlap.shape[0], self.cell_slots, meshes)

    @property
    def surfaces(self) -> tuple[MeshSurface, ...]:
        """The meshes."""
        return tuple(mesh.surface for mesh in self.meshes if mesh.surface is not None)

    def without_surfaces(self) -> Neighbors:
        """The list without the meshes themselves, for a checkpoint."""
        meshes = tuple(dataclasses.replace(mesh, surface=None) for mesh in self.meshes)
        return dataclasses.replace(self, meshes=meshes)

    def with_surfaces(self, surfaces: tuple[MeshSurface, ...]) -> Neighbors:
        """The inverse of `without_surfaces`."""
        pairs = zip(self.meshes, surfaces, strict=True)
        return dataclasses.replace(self, meshes=tuple(dataclasses.replace(mesh, surface=own) for mesh, own in pairs))

    @property
    def lists_nothing(self) -> bool:
        """Whether there is nothing that it could list: a particle alone, and no mesh."""
        return self.index.shape[0] == 0 and not self.meshes


def displacement_since_build(position: Vector, low: tuple[Low, ...], neighbors: Neighbors) -> Vector:
    """Motion of every particle since the list was built [m]; small, hence well resolved in one float."""
    return tuple(
        compensated.rounded_difference(*pair)
        for pair in zip(position, low, neighbors.reference, neighbors.reference_low, strict=True)
    )


def radius_sum(radius: Array, pairs: Pairs) -> Array:
    """() or (P,) sum of the radii of each pair [m]."""
    return 2.0 * radius if radius.ndim == 0 else radius[pairs.first] + radius[pairs.second]


def with_radius(neighbors: Neighbors, radius: Array) -> Neighbors:
    """The same list with the overlaps of other radii, () or (N,) [m], and with their slopes by these radii.

    The list reaches as far as when it was made.
    """
    overlap, before = lax.stop_gradient((neighbors.overlap, radius_sum(neighbors.radius, neighbors.pairs)))
    overlap = overlap + (radius_sum(radius, neighbors.pairs) - before)
    meshes = tuple(mesh.with_radius(radius, neighbors.radius) for mesh in neighbors.meshes)
    return dataclasses.replace(neighbors, radius=radius, overlap=overlap, meshes=meshes)


def way_of_meshes(neighbors: Neighbors, placed: Sequence[Placement | None]) -> Array | float:
    """() how far a point of a mesh has moved at most since the list was built [m]; `placed` is where each is now."""
    found: Array | float = 0.0
    for mesh, now in zip(neighbors.meshes, placed, strict=True) if placed else ():
        if now is not None and mesh.placement is not None:
            found = jnp.maximum(found, mesh.way(lax.stop_gradient(now)))
    return found


def out_of_date(displacement: Vector, geometry: NeighborGeometry, way: Array | float = 0.0) -> Array:
    """() bool: a particle has moved so far that an unlisted pair might touch, meshes having moved by `way` [m]."""
    most, limit = jnp.max(vectors.dot(displacement, displacement)), 0.5 * geometry.skin
    return most > limit**2 if isinstance(way, float) else jnp.sqrt(most) + way > limit


@static
class NeighborSearch:
    """Allocates and updates `Neighbors`; a single particle and no particle at all have no slots.

    Attributes:
        geometry: of the box, and how far the list reaches.
        typical_radius: of the mean volume of all particles, those still to come included [m].
        moving: of each mesh, whether it moves.
    """

    geometry: NeighborGeometry
    typical_radius: float
    moving: tuple[bool, ...] = ()

    @property
    def reach(self) -> float:
        """Pairs nearer than this are listed [m]."""
        return self.geometry.cutoff + self.geometry.skin

    @property
    def cells(self) -> tuple[int, ...]:
        """Number of cells of the search along each axis."""
        geometry = self.geometry
        return geometry.cells or CellGrid(geometry.box, geometry.periodic, self.reach, 0).shape

    def _cells(self, position: Vector) -> CellGrid:
        geometry = self.geometry
        return CellGrid(geometry.box, geometry.periodic, self.reach, position[0].shape[0], geometry.cells)

    def allocate(
        self,
        position: Vector,
        low: tuple[Low, ...],
        radius: Array,
        room: Room | None = None,
        active: Array | None = None,
        surfaces: tuple[MeshSurface, ...] = (),
    ) -> Neighbors:
        """A new list with room for these positions, and for what is usual; not jittable.

        Args:
            position: D arrays (N,), leading parts [m]; must be finite.
            low: D arrays (N,) or Nones, trailing parts.
            radius: () or (N,) [m].
            room: exactly so much room instead. A resumed run asks for what it had, so that it compiles and
                computes the same.
            active: (N,) bool, which particles there are; all if None.
            surfaces: the meshes; with some the room must be given.
        """
        if room is None:
            room = self.room(position, active)
        # As one program: outside of jit every operation would be compiled by itself.
        built = jax.jit(self._built)
        return built(position, low, radius, room, np.zeros((), bool), active, surfaces)

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
            given = (position, low, radius, room, np.zeros((), bool), None, surfaces)
            return jax.eval_shape(self._built, *given)
        count, dtype = position[0].shape[0], position[0].dtype

        def shape(*sizes: int, dtype: DTypeLike = jnp.int32) -> Any:  # JAX has no type for arrays and shapes alike
            return jax.ShapeDtypeStruct(sizes, dtype)

        real, index = shape(room.pairs, dtype=dtype), shape(room.slots, count)
        given = jax.tree.map(lambda a: shape(*a.shape, dtype=a.dtype), (position, low, radius))
        return Neighbors(
            index=index,
            pairs=Pairs(shape(room.pairs), shape(room.pairs), index),
            separation=(real,) * len(position),
            radius=given[2],
            overlap=real,
            reference=given[0],
            reference_low=given[1],
            overflow=shape(dtype=bool),
            builds=shape(),
            cell_slots=room.cell,
        )

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
        built = self._built(*given, neighbors.room, neighbors.overflow, active, neighbors.surfaces, tuple(placed))
        return dataclasses.replace(with_radius(built, radius), builds=neighbors.builds + 1)

    def _built(
        self,
        position: Vector,
        low: tuple[Low, ...],
        radius: Array,
        room: Room,
        overflow: Array,
        active: Array | None = None,
        surfaces: tuple[MeshSurface, ...] = (),
        placed: tuple[Placement | None, ...] = (),
    ) -> Neighbors:
        if room.slots == 0:
            index = jnp.zeros((0, *position[0].shape), jnp.int32)
        else:
            index, crowded = self.in_reach(position, low, room, active)
            overflow = overflow | crowded
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

    def with_room_for_meshes(
        self,
        room: Room,
        surfaces: tuple[MeshSurface, ...],
        usual: tuple[tuple[int, ...], ...],
        position: Vector,
        radius: Array,
        active: Array | None,
    ) -> Room:
        """Room for the lists of the meshes too; on the host.

        Args:
            room: for that of the particles.
            surfaces: the meshes.
            usual: room of each mesh that is needed in any case, `MeshRoom.numbers`.
            position, radius, active: see `allocate`.
        """
        count = position[0].shape[0]
        there = np.full(count, True) if active is None else np.asarray(active)
        place = tuple(np.asarray(x, float)[there] for x in position)
        size = np.asarray(radius, float)
        size = size if size.ndim == 0 else size[there]
        numbers: list[int] = []
        for surface, least in zip(surfaces, usual, strict=True):
            wanted = needed(self.mesh_search, on_host(surface), place, size)
            rows, contacts, *rest = least
            wanted[1:] *= np.array(rest) > 0
            numbers += [min(with_margin(wanted[0], rows), max(count, 1)), contacts]
            share = min(1.0, count / rows)  # of the grains that the mesh has room for
            rest = [math.ceil(share * looks) for looks in rest[:3]] + rest[3:]
            numbers += [with_margin(number, own) for number, own in zip(wanted[1:], rest, strict=True)]
        return dataclasses.replace(room, mesh=tuple(numbers))

    @property
    def mesh_search(self) -> MeshSearch:
        """How particles find the meshes."""
        return MeshSearch(self.geometry.box, self.geometry.periodic, self.geometry.skin)

    def in_reach(self, position: Vector, low: tuple[Low, ...], room: Room, active: Array | None) -> tuple[Array, Array]:
        """(K, N) int32 index of a list at these positions, and () bool, whether there was not room enough."""
        inside = compensated.into_box(position, low, self.geometry.box, self.geometry.periodic)
        return neighbors_in_cells(self._cells(position), inside, room.slots, room.cell, active)

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
            pairs, too_many = pairs_of(index, room.pairs, identity)
            overflow = overflow | too_many
            separation, overlap = self._pair_geometry(pairs, position, low, radius)
        builds = jnp.ones((), jnp.int32)
        return Neighbors(index, pairs, separation, radius, overlap, position, low, overflow, builds, room.cell)

    def _pair_geometry(
        self, pairs: Pairs, position: Vector, low: tuple[Low, ...], radius: Array
    ) -> tuple[Vector, Array]:
        """Separation, D arrays (P,), and overlap (P,) of all pairs."""
        apart = []
        for k, (high, trailing) in enumerate(zip(position, low, strict=True)):
            one_low = None if trailing is None else trailing[pairs.first]
            other_low = None if trailing is None else trailing[pairs.second]
            separation = compensated.difference(high[pairs.first], one_low, high[pairs.second], other_low)
            if self.geometry.periodic[k]:
                number = jnp.round(separation[0] / self.geometry.box[k])
                image = compensated.whole_periods(number, self.geometry.box[k])
                separation = compensated.difference(*separation, *image)
            apart.append(separation)
        # Where there is no pair the first particle stands with itself: placed out of reach, so that it never touches.
        empty = pairs.first == pairs.second
        far = jnp.asarray(2.0 * (self.geometry.cutoff + self.geometry.skin), position[0].dtype)
        first_low = None if apart[0][1] is None else jnp.where(empty, 0.0, apart[0][1])
        apart[0] = (jnp.where(empty, far, apart[0][0]), first_low)
        return tuple(high for high, _ in apart), compensated.overlap_of_spheres(tuple(apart), radius_sum(radius, pairs))

    def room(self, position: Vector, active: Array | None = None) -> Room:
        """Room for these positions and for a dense pack, with a margin; on the host."""
        count, dimension = position[0].shape[0], len(position)
        if count < 2:
            return Room(0, 0, 1)
        present = jax.tree.map(np.asarray, position)
        if active is not None:
            present = tuple(x[np.asarray(active)] for x in present)
        cells = self._cells(position)
        crowd = max(cells.largest_occupancy(present), cells.dense_occupancy(self.geometry.cutoff))
        usual, each = USUAL_SLOTS[dimension], USUAL_PAIRS[dimension]
        if active is not None:  # what stands there at the start tells nothing of those who come
            usual = math.ceil(EXTRA_CAPACITY * self._crowd(self.reach))
            each = max(each, 0.5 * self._crowd(self.reach))
            widths = (length / n for length, n in zip(self.geometry.box, cells.shape, strict=True))
            crowd = max(crowd, self._crowd(0.6 * max(widths)))
        found, most = self._found(present)
        everyone = count * (count - 1) // 2
        pairs = min(max(math.ceil(EXTRA_PAIRS * found), math.ceil(each * count)), everyone)
        # The wide cells of a vast box have room for more than there are.
        held = min(math.ceil(EXTRA_CAPACITY * crowd), count)
        return Room(min(max(int(EXTRA_CAPACITY * most), usual), count - 1), pairs + 1, held)

    def _crowd(self, reach: float) -> int:
        """How many particles of the mean volume a dense pack has within `reach` [m], `USUAL_SLOTS` at least.

        Where particles come in while the scene runs, what stands at the start tells nothing.
        """
        dimension = len(self.geometry.box)
        return max(USUAL_SLOTS[dimension], math.ceil(DENSE[dimension] * (reach / self.typical_radius) ** dimension))

    def _found(self, position: Vector) -> tuple[int, int]:
        """Number of pairs in reach at these positions, and the most neighbours that a particle has; not jittable."""
        tree = self.tree(position)
        others = tree.query_ball_point(tree.data, self.reach, return_length=True, workers=-1) - 1
        return int(others.sum()) // 2, int(others.max(initial=0))

    def tree(self, position: Vector) -> KDTree:
        """SciPy's tree of these positions, in the box; on the host."""
        geometry = self.geometry
        stacked = np.stack([np.asarray(x, float) for x in position], axis=1)
        inside = np.where(geometry.periodic, into_period(stacked, np.asarray(geometry.box)), stacked)
        # A period of zero is none.
        return KDTree(inside, boxsize=np.where(geometry.periodic, geometry.box, 0.0))


def carry_history(history: Vector, old: Neighbors, new: Neighbors) -> Vector:
    """Values kept per pair, moved to the places of a new list by the identity of the two particles.

    Args:
        history: components (P,), the value of each pair in the old list.
        old: list that `history` belongs to.
        new: list with P' pairs.

    Returns:
        Components (P',); zero for pairs that were not listed before.
    """
    first, second = new.pairs.first, new.pairs.second
    if len(old.index) > WRITTEN_OUT:
        place, found = place_of(old.pairs, first, second)
        return tuple(jnp.where(found, component, 0.0) for component in at(history, place))
    # Of its first particle a pair is an entry below P; a pair stands once in a list, so the sum has one term.
    place, found = jnp.zeros_like(first), jnp.zeros(first.shape, bool)
    for others, entries in zip(old.index, old.pairs.entry, strict=True):
        other, entry = at((others, entries), first)
        same = (other == second) & (first != second)
        place, found = place + jnp.where(same, entry, 0), found | same
    return tuple(jnp.where(found, component, 0.0) for component in at(history, place))


def carry_memory(memory: tuple[MeshMemory, ...], old: Neighbors, new: Neighbors) -> tuple[MeshMemory, ...]:
    """What contacts with meshes keep, moved to the rows of a new list by the identity of the particles."""
    count = old.reference[0].shape[0]
    return tuple(
        MeshMemory(*(carried(values, before, after, count) for values in kept))
        for kept, before, after in zip(memory, old.meshes, new.meshes, strict=True)
    )
