"""Neighbour list: who may touch whom, and where the pair stood when the list was made.

Room for a list is counted on the host by SciPy's tree. Inside jit `cells` finds who is in reach of whom, or a list of
jax-md says it (`jax_md_list`); `pairs` has each pair once. Beside each pair a list keeps the separation and the overlap
at the build, computed in pairs of floats; a contact step only adds the change of distance since then, so that float32
resolves overlaps of a nanometre in a box of metres.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import DTypeLike
from scipy.spatial import KDTree

from jaxdem.numerics import compensated, vectors
from jaxdem.numerics.compensated import Low
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.cells import CellGrid, neighbors_in_cells
from jaxdem.particles.ghosts import Ghosts
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
    """

    slots: int
    pairs: int
    cell: int

    def enlarged(self) -> Room:
        """Half as much again."""
        return Room(*(n + max(2, n // 2) for n in dataclasses.astuple(self)))

    def covering(self, other: Room) -> Room:
        """Room for what either has room for."""
        return Room(*map(max, dataclasses.astuple(self), dataclasses.astuple(other)))


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

    @property
    def room(self) -> Room:
        """What there is room for."""
        return Room(self.index.shape[0], self.overlap.shape[0], self.cell_slots)


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
    return dataclasses.replace(neighbors, radius=radius, overlap=overlap)


def out_of_date(displacement: Vector, geometry: NeighborGeometry) -> Array:
    """() bool: a particle has moved so far that an unlisted pair might touch."""
    return jnp.max(vectors.dot(displacement, displacement)) > (0.5 * geometry.skin) ** 2


@static
class NeighborSearch:
    """Allocates and updates `Neighbors`; a single particle and no particle at all have no slots.

    Attributes:
        geometry: of the box, and how far the list reaches.
        typical_radius: of the mean volume of all particles, those still to come included [m].
    """

    geometry: NeighborGeometry
    typical_radius: float

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
    ) -> Neighbors:
        """A new list with room for these positions, and for what is usual; not jittable.

        Args:
            position: D arrays (N,), leading parts [m]; must be finite.
            low: D arrays (N,) or Nones, trailing parts.
            radius: () or (N,) [m].
            room: exactly so much room instead. A resumed run asks for what it had, so that it compiles and
                computes the same.
            active: (N,) bool, which particles there are; all if None.
        """
        if room is None:
            room = self.room(position, active)
        # As one program: outside of jit every operation would be compiled by itself.
        built = jax.jit(self._built)
        return built(position, low, radius, room, np.zeros((), bool), active)

    def shapes(self, position: Vector, low: tuple[Low, ...], radius: Array, room: Room) -> Neighbors:
        """What `allocate` gives for these arguments, shapes and types alone; nothing is compiled."""
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
        self, position: Vector, low: tuple[Low, ...], neighbors: Neighbors, active: Array | None = None
    ) -> Neighbors:
        """The list rebuilt at these positions for the same radii; jittable, room unchanged, overflow flagged."""
        radius = neighbors.radius
        given = lax.stop_gradient((position, low, radius))
        built = self._built(*given, neighbors.room, neighbors.overflow, active)
        return dataclasses.replace(with_radius(built, radius), builds=neighbors.builds + 1)

    def _built(
        self,
        position: Vector,
        low: tuple[Low, ...],
        radius: Array,
        room: Room,
        overflow: Array,
        active: Array | None = None,
    ) -> Neighbors:
        if room.slots == 0:
            index = jnp.zeros((0, *position[0].shape), jnp.int32)
        else:
            index, crowded = self.in_reach(position, low, room, active)
            overflow = overflow | crowded
        return self.listed(index, position, low, radius, room, overflow)

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
