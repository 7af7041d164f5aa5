"""Neighbour list: who may touch whom, and where the pair stood when the list was made.

The list is jax-md's dense list: allocated by jax-md outside jit, and updated inside by `cells`, which finds the
same pairs faster. Beside each index it keeps the separation and the overlap of the pair at the build, computed
in pairs of floats; a contact step only adds the change of distance since then, so that float32 resolves
overlaps of a nanometre in a box of metres.
"""

from __future__ import annotations

import dataclasses
import importlib
import importlib.machinery
import math
import sys
import types
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxdem.particles import compensated, vectors
from jaxdem.particles.cells import CellGrid, neighbors_in_cells
from jaxdem.particles.compensated import Low
from jaxdem.particles.vectors import Vector

EXTRA_CAPACITY = 1.25
"""Slots are allocated for this multiple of the largest number of neighbours found."""

USUAL_SLOTS = {2: 8, 3: 16}
"""Slots allocated at least, by dimension: what a dense pack of equal spheres needs once it has formed."""


DENSE = {2: 0.85, 3: 0.64}
"""Solid fraction of a dense pack, by dimension."""


class NeighborGeometry(NamedTuple):
    """What the search needs to know; static.

    Attributes:
        box: side lengths of the domain [m].
        periodic: whether each axis is periodic.
        cutoff: largest distance of two centres in contact, the largest diameter [m].
        skin: extra distance that is listed; the list is good until a particle has moved skin/2 [m].
    """

    box: tuple[float, ...]
    periodic: tuple[bool, ...]
    cutoff: float
    skin: float


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Neighbors:
    """Pairs in reach (K slots for each of N particles; every pair stands twice, once from either side).

    Attributes:
        index: (K, N) int32, the other particle; an empty slot holds the particle itself.
        separation: D arrays (K, N), centre of the particle less centre of the other, at the build [m].
        overlap: (K, N) overlap at the build, negative for a gap [m].
        reference: D arrays (N,), positions at the build, leading part [m].
        reference_low: D arrays (N,), trailing part, or Nones in float64.
        overflow: () bool, a particle had more neighbours than slots; the list is then incomplete.
        builds: () int32, number of builds so far.
        cell_slots: room for particles in a cell of the search; static.
    """

    index: Array
    separation: Vector
    overlap: Array
    reference: Vector
    reference_low: tuple[Low, ...]
    overflow: Array
    builds: Array
    cell_slots: int = dataclasses.field(metadata={"static": True})

    @property
    def capacity(self) -> int:
        """Number of slots per particle; 0 where there is nothing to list."""
        return self.index.shape[0]


def wrap(displacement: Array, geometry: NeighborGeometry) -> Array:
    """Nearest image of (..., D) displacements along the periodic axes."""
    if not any(geometry.periodic):
        return displacement
    box = jnp.asarray(geometry.box, displacement.dtype)
    nearest = displacement - box * jnp.round(displacement / box)
    return jnp.where(jnp.asarray(geometry.periodic), nearest, displacement)


def displacement_since_build(position: Vector, low: tuple[Low, ...], neighbors: Neighbors) -> Vector:
    """Motion of every particle since the list was built [m]; small, hence well resolved in one float."""
    return tuple(
        compensated.rounded_difference(*pair)
        for pair in zip(position, low, neighbors.reference, neighbors.reference_low, strict=True)
    )


def out_of_date(displacement: Vector, geometry: NeighborGeometry) -> Array:
    """() bool: a particle has moved so far that an unlisted pair might touch."""
    return jnp.max(vectors.dot(displacement, displacement)) > (0.5 * geometry.skin) ** 2


class NeighborSearch:
    """Allocates and updates `Neighbors` for one geometry and one particle number.

    The radius is one number or (N,); a single particle and no particle at all have no slots.
    """

    def __init__(self, geometry: NeighborGeometry, radius: Array):
        self.geometry = geometry
        self.radius = radius
        self._grid = CellGrid(geometry.box, geometry.periodic, geometry.cutoff + geometry.skin)

    def allocate(
        self,
        position: Vector,
        low: tuple[Low, ...],
        slots: int = 0,
        cell_slots: int | None = None,
        active: Array | None = None,
    ) -> Neighbors:
        """A new list with room for these positions, and for `slots` neighbours at least; not jittable.

        Args:
            position: D arrays (N,), leading parts [m]; must be finite.
            low: D arrays (N,) or Nones, trailing parts.
            slots: smallest number of slots per particle.
            cell_slots: room in a cell of the search; then `slots` is exact too. A resumed run asks for the
                capacities that it had, so that it compiles and computes the same.
            active: (N,) bool, which particles there are; all if None.
        """
        count = position[0].shape[0]
        present = position if active is None else tuple(x[np.asarray(active)] for x in position)
        if count < 2:
            slots = 0
        elif cell_slots is None:
            usual = USUAL_SLOTS[len(position)]
            if active is not None:
                usual = math.ceil(EXTRA_CAPACITY * self._crowd(self._grid.reach))
            slots = max(slots, self._slots_of_jax_md(present), min(usual, count - 1))
        if cell_slots is None:
            crowd = max(
                self._grid.largest_occupancy(present), self._grid.dense_occupancy(self.geometry.cutoff)
            )
            if active is not None:
                widths = (length / n for length, n in zip(self.geometry.box, self._grid.shape, strict=True))
                crowd = max(crowd, self._crowd(0.6 * max(widths)))
            cell_slots = math.ceil(EXTRA_CAPACITY * crowd)
        # As one program: outside of jit every operation would be compiled by itself.
        built = jax.jit(self._built, static_argnums=(2, 3))
        return built(position, low, slots, cell_slots, jnp.zeros((), bool), jnp.ones((), jnp.int32), active)

    def update(
        self, position: Vector, low: tuple[Low, ...], neighbors: Neighbors, active: Array | None = None
    ) -> Neighbors:
        """The list rebuilt at these positions; jittable, capacities unchanged, overflow flagged."""
        position, low = lax.stop_gradient((position, low))
        return self._built(
            position, low, neighbors.capacity, neighbors.cell_slots, neighbors.overflow,
            neighbors.builds + 1, active,
        )  # fmt: skip

    def _built(
        self,
        position: Vector,
        low: tuple[Low, ...],
        slots: int,
        cell_slots: int,
        overflow: Array,
        builds: Array,
        active: Array | None = None,
    ) -> Neighbors:
        if slots == 0:
            nothing = jnp.zeros((0, *position[0].shape), position[0].dtype)
            index, separation, overlap = nothing.astype(jnp.int32), (nothing,) * len(position), nothing
        else:
            index, crowded = neighbors_in_cells(self._grid, position, slots, cell_slots, active)
            overflow = overflow | crowded
            separation, overlap = self._pair_geometry(index, position, low)
        return Neighbors(index, separation, overlap, position, low, overflow, builds, cell_slots)

    def _pair_geometry(self, other: Array, position: Vector, low: tuple[Low, ...]) -> tuple[Vector, Array]:
        """Separation, D arrays (K, N), and overlap (K, N) of all pairs."""
        pairs = []
        for k, (high, trailing) in enumerate(zip(position, low, strict=True)):
            other_low = None if trailing is None else trailing[other]
            separation = compensated.difference(high[None], _row(trailing), high[other], other_low)
            if self.geometry.periodic[k]:
                box = jnp.asarray(self.geometry.box[k], high.dtype)
                image = box * jnp.round(separation[0] / box)
                image_low = None if trailing is None else jnp.zeros_like(image)
                separation = compensated.difference(*separation, image, image_low)
            pairs.append(separation)
        radius_sum = 2.0 * self.radius if self.radius.ndim == 0 else self.radius[None] + self.radius[other]
        # An empty slot pairs a particle with itself: place it out of reach, so that it never touches.
        empty = other == jnp.arange(other.shape[1], dtype=jnp.int32)[None]
        far = jnp.asarray(2.0 * (self.geometry.cutoff + self.geometry.skin), position[0].dtype)
        first_low = None if pairs[0][1] is None else jnp.where(empty, 0.0, pairs[0][1])
        pairs[0] = (jnp.where(empty, far, pairs[0][0]), first_low)
        return tuple(high for high, _ in pairs), compensated.overlap_of_spheres(tuple(pairs), radius_sum)

    def _crowd(self, reach: float) -> int:
        """How many particles of the mean volume a dense pack has within `reach` [m], `USUAL_SLOTS` at least.

        Where particles come in while the scene runs, what stands at the start tells nothing.
        """
        dimension = len(self.geometry.box)
        mean = float(np.mean(np.asarray(self.radius) ** dimension))
        return max(USUAL_SLOTS[dimension], math.ceil(DENSE[dimension] * reach**dimension / mean))

    def _slots_of_jax_md(self, position: Vector) -> int:
        """Room for neighbours that jax-md allocates at these positions."""
        if position[0].shape[0] < 2:  # jax-md does not handle no particles
            return 0
        partition, geometry = _import_partition(), self.geometry
        reach = self._grid.reach
        # Padding keeps jax-md from comparing all pairs where a non-periodic side is under three cutoffs.
        margin = np.where(geometry.periodic, 0.0, 2.0 * reach)
        side = np.maximum(
            np.asarray(geometry.box) + 2.0 * margin, np.where(geometry.periodic, 0.0, 3.5 * reach)
        )

        def displacement(a: Array, b: Array, **unused: Any) -> Array:  # jax-md passes a time
            return wrap(a - b, geometry)

        stacked = np.stack([np.asarray(x) for x in position], axis=1)
        inside = np.where(geometry.periodic, np.mod(stacked, np.asarray(geometry.box)), stacked) + margin
        with jax.numpy_rank_promotion("allow"):  # jax-md relies on it
            functions = partition.neighbor_list(
                displacement,
                side,
                reach,
                dr_threshold=0.0,  # the time loop decides when to rebuild
                capacity_multiplier=EXTRA_CAPACITY,
                format=partition.NeighborListFormat.Dense,
            )
            return functions.allocate(jnp.asarray(inside, position[0].dtype)).idx.shape[1]


def carry_history(history: Vector, old: Neighbors, new: Neighbors) -> Vector:
    """Values kept per pair, moved to the slots of a new list by the identity of the other particle.

    Args:
        history: components (K, N), the value of each pair in the old list.
        old: list that `history` belongs to.
        new: list with K' slots.

    Returns:
        Components (K', N); zero for pairs that were not listed before.
    """
    # An empty slot matches empty slots, whose values are zero. A pair stands once in a list, so the sum has
    # one term.
    same = old.index[None] == new.index[:, None]
    return tuple(jnp.sum(jnp.where(same, component[None], 0.0), axis=1) for component in history)


def _row(low: Low) -> Low:
    return None if low is None else low[None]


def _import_partition() -> Any:
    """jax_md.partition without the rest of the package.

    `import jax_md` takes about 6 s and 500 MB, for its `__init__` imports everything; the module with the
    neighbour lists needs three small siblings only. A bare package object stands in while they load.
    """
    if "jax_md.partition" not in sys.modules and "jax_md" not in sys.modules:
        spec = importlib.machinery.PathFinder.find_spec("jax_md")
        if spec is None or spec.submodule_search_locations is None:
            raise ImportError("the package jax-md is not installed; pip install jax-md==0.2.29")
        bare = types.ModuleType("jax_md")
        bare.__path__ = list(spec.submodule_search_locations)
        sys.modules["jax_md"] = bare
        try:
            importlib.import_module("jax_md.partition")
        finally:
            # A later `import jax_md` by the user runs the real __init__ and reuses these modules.
            del sys.modules["jax_md"]
    return sys.modules.get("jax_md.partition") or importlib.import_module("jax_md.partition")
