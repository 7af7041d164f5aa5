"""Neighbour list: the pairs in reach, and where each stood when the list was made.

`neighbor_search` makes it. Beside each pair a list keeps the separation and the overlap at the build, computed in pairs
of floats; a contact step only adds the change of distance since then, so that float32 resolves overlaps of a nanometre
in a box of metres.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxdem.numerics import compensated, vectors
from jaxdem.numerics.compensated import Low
from jaxdem.numerics.placement import Placement
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.clump_shape import Placed
from jaxdem.particles.ghosts import Ghosts
from jaxdem.particles.mesh_contact import MeshMemory
from jaxdem.particles.mesh_list import MeshList, carried
from jaxdem.particles.mesh_room import NUMBERS, MeshRoom
from jaxdem.particles.mesh_surface import MeshSurface
from jaxdem.particles.owned_pairs import carried_by_owner
from jaxdem.particles.pairs import WRITTEN_OUT, Pairs, at, place_of


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
        gap: how far from a mesh bodies are still in contact with it, so that lists of meshes reach so far; None where
            they touch [m]. With `cells` it may be traced.
    """

    box: tuple[float, ...]
    periodic: tuple[bool, ...]
    cutoff: float
    skin: float
    cells: tuple[int, ...] | None = None
    gap: float | None = None


class RowRoom(NamedTuple):
    """What a list by levels of size has further room for.

    Attributes:
        width: of the rows of entries.
        further: E, rows beyond the first of every particle.
        across: particles in a column of the tables in which grains of finer levels look.
    """

    width: int
    further: int
    across: int

    def enlarged(self) -> RowRoom:
        """Half as many further rows and particles in a column again; wider rows would be slower."""
        return RowRoom(self.width, self.further + max(16, self.further // 2), self.across + max(2, self.across // 2))


@static
class Room:
    """What a list has room for; static.

    Attributes:
        slots: K, neighbours of a particle, in a list by levels pairs that one owns; 0 for nothing to list.
        pairs: P, pairs and the empty one.
        cell: particles in a column of the search's table.
        mesh: what the lists of the meshes have room for, `MeshRoom.numbers` of one after the other.
        rows: of a list by levels of size; None of others.
    """

    slots: int
    pairs: int
    cell: int
    mesh: tuple[int, ...] = ()
    rows: RowRoom | None = None

    @property
    def numbers(self) -> tuple[int, ...]:
        """All of them in a row; those of `rows`, of which a mesh has none, are negative."""
        rows = () if self.rows is None else tuple(-1 - number for number in self.rows)
        return (self.slots, self.pairs, self.cell, *rows, *self.mesh)

    @classmethod
    def of(cls, numbers: Sequence[int]) -> Room:
        """The inverse of `numbers`."""
        slots, pairs, cell, *rest = numbers
        rows = [-1 - number for number in rest if number < 0]
        mesh = tuple(number for number in rest if number >= 0)
        return cls(slots, pairs, cell, mesh, RowRoom(*rows) if rows else None)

    @property
    def meshes(self) -> tuple[MeshRoom, ...]:
        """Of each mesh."""
        return tuple(MeshRoom.of(self.mesh[k : k + NUMBERS]) for k in range(0, len(self.mesh), NUMBERS))

    def enlarged(self) -> Room:
        """Half as much again; what a mesh has nothing of stays so."""
        slots, pairs, cell = (n + max(2, n // 2) for n in (self.slots, self.pairs, self.cell))
        rows = None if self.rows is None else self.rows.enlarged()
        return Room(slots, pairs, cell, tuple(n + max(2, n // 2) if n else 0 for n in self.mesh), rows)

    def covering(self, other: Room) -> Room:
        """Room for what either has room for."""
        slots, pairs, cell, mesh = max(self.slots, other.slots), max(self.pairs, other.pairs), self.cell, self.mesh
        rows = self.rows
        if rows is not None and other.rows is not None:
            # Rows of another width would be other rows.
            rows = RowRoom(rows.width, max(rows.further, other.rows.further), max(rows.across, other.rows.across))
        return Room(slots, pairs, max(cell, other.cell), tuple(map(max, mesh, other.mesh)), rows)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Neighbors:
    """Pairs in reach: P pairs, each once, and K slots for each of N particles, where each stands twice.

    Attributes:
        index: (K, N) int32, the other particle, in a list by levels of the pairs that one owns; an empty slot holds the
            particle itself.
        pairs: who the pairs are, and where those of each particle stand.
        separation: D arrays (P,), centre of the first less centre of the second, at the build [m].
        radius: () or (N,) at the build [m].
        overlap: (P,) overlap at the build, of these radii, negative for a gap [m].
        reference: D arrays (N,), positions at the build, leading part [m].
        reference_low: D arrays (N,), trailing part, or Nones in float64.
        overflow: () bool, there were more neighbours or pairs than room; the list is then incomplete.
        builds: () int32, number of builds so far.
        cell_slots: room for particles in a column of the search's table; static.
        across_slots: the same of the tables in which grains of finer levels look; 0 without levels; static.
        ghosts: in a box that is cut into slabs, whose particles the N rows are; None on one device.
        meshes: which particles are near each mesh; none in a scene without meshes.
        bodies: where clumps stood whose members the N rows are; None for spheres.
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
    bodies: Placed | None = None
    across_slots: int = dataclasses.field(default=0, metadata={"static": True})

    @property
    def room(self) -> Room:
        """What there is room for."""
        meshes = tuple(number for mesh in self.meshes for number in mesh.room.numbers)
        rows = None
        if self.pairs.owned is not None:
            rows = RowRoom(self.pairs.entry.shape[-2], self.pairs.owned.row.shape[-1], self.across_slots)
        return Room(self.index.shape[-2], self.overlap.shape[-1], self.cell_slots, meshes, rows)

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


def separation_and_overlap(
    geometry: NeighborGeometry, pairs: Pairs, position: Vector, low: tuple[Low, ...], radius: Array
) -> tuple[Vector, Array]:
    """Separation, D arrays (P,), and overlap (P,) of all pairs, of the nearest images."""
    apart = []
    for k, (high, trailing) in enumerate(zip(position, low, strict=True)):
        one_low = None if trailing is None else trailing[pairs.first]
        other_low = None if trailing is None else trailing[pairs.second]
        separation = compensated.difference(high[pairs.first], one_low, high[pairs.second], other_low)
        if geometry.periodic[k]:
            number = jnp.round(separation[0] / geometry.box[k])
            image = compensated.whole_periods(number, geometry.box[k])
            separation = compensated.difference(*separation, *image)
        apart.append(separation)
    # Where there is no pair the first particle stands with itself: placed out of reach, so that it never touches.
    empty = pairs.first == pairs.second
    far = jnp.asarray(2.0 * (geometry.cutoff + geometry.skin), position[0].dtype)
    first_low = None if apart[0][1] is None else jnp.where(empty, 0.0, apart[0][1])
    apart[0] = (jnp.where(empty, far, apart[0][0]), first_low)
    return tuple(high for high, _ in apart), compensated.overlap_of_spheres(tuple(apart), radius_sum(radius, pairs))


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
    squared, limit = vectors.dot(displacement, displacement), 0.5 * geometry.skin
    # Each is asked: of the largest one a library is, which takes several times as long.
    return jnp.any(squared > limit**2 if isinstance(way, float) else jnp.sqrt(squared) + way > limit)


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
    if old.pairs.owned is not None:
        return carried_by_owner(history, old.index, old.pairs, new.pairs)
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
