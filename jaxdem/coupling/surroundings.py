"""What the neighbours of the particles add to the mean drag over a coupling interval."""

from __future__ import annotations

import dataclasses
import math

import jax.numpy as jnp
from jax import Array, lax

from jaxdem.closures.base import DragInputs
from jaxdem.closures.neighbor_effect import NeighborEffect, neighbor_effect
from jaxdem.closures.neighbor_places import Frame, Places, axes_along, fluctuation
from jaxdem.closures.neighbors import NeighborClosure, Response
from jaxdem.coupling.far_ghosts import FarGhosts, far_ghosts, most_in_reach
from jaxdem.coupling.forces.protocol import IntervalStart
from jaxdem.errors import required
from jaxdem.numerics.batches import cond_in_batch
from jaxdem.numerics.blocks import Blocks, any_of
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import components
from jaxdem.particles.cells import CellGrid
from jaxdem.particles.ghosts import Division
from jaxdem.particles.integrate import centres_in_box
from jaxdem.particles.wide_search import Region, neighbors_in_regions

MEMORY = "neighbors"
"""Name of what is held in `ParticleState.fluid_memory`."""
AT_ONCE = 128
"""Particles whose neighbours are treated at once: their pairs then stay in the cache."""


@static
class Surroundings:
    """Finds the neighbours within the reach of a `NeighborClosure`, farther than contacts reach; static.

    It is a search of its own, once an interval, on the cells of the neighbour list: a wider list of contacts would cost
    its pairs in every contact step.

    Attributes:
        box: side lengths [m].
        periodic: whether each axis is periodic.
        regions: of the closure, about the slip.
        diameter: of the largest particles [m].
        slots: room for neighbours of a particle.
        cell_slots: room for particles in a column of the search's table.
        held: coupling intervals for which what is found is held.
        division: into slabs of equal width, one a device; None on one device.
    """

    box: tuple[float, ...]
    periodic: tuple[bool, ...]
    regions: tuple[Region, ...]
    diameter: float
    slots: int
    cell_slots: int
    held: int = 1
    division: Division | None = None

    @property
    def reach(self) -> float:
        """Farthest that a neighbour counts [m]."""
        return max(region.reach for region in self.regions)

    def in_blocks(self, blocks: Blocks, drift: float) -> Surroundings:
        """The same in one slab of the box, whose particles may stand `drift` outside of it [m]."""
        division = Division(blocks, self.box[blocks.axis], drift / self.diameter, balanced=False)
        return dataclasses.replace(self, division=division)

    def effect(
        self, closure: NeighborClosure, form: str, start: IntervalStart, inputs: DragInputs, scale: Array
    ) -> NeighborEffect:
        """What the neighbours do in the interval.

        Args:
            closure: gives it.
            form: of the equations, "A" or "B".
            start: of the interval.
            inputs: the fluid as the law sees it.
            scale: () factor on the drag [-].
        """
        frame, held = axes_along(inputs.slip_velocity), (start.particles.fluid_memory or {}).get(MEMORY)
        if held is None:
            found = self.response(closure, start, inputs, frame)
            return neighbor_effect(closure.base, form, found, frame, inputs, scale)

        def renewed(rows: Array) -> Array:
            return _held(self.response(closure, start, inputs, frame), frame, jnp.full_like(rows[:, :1], self.held))

        active = start.particles.active
        over = held[:, -1] < 0.5
        # All slabs look at once: they exchange what they see.
        over = any_of(self._blocks, jnp.any(over if active is None else over & active))
        held = cond_in_batch(over, renewed, held)
        effect = neighbor_effect(closure.base, form, _as_found(held, frame), frame, inputs, scale)
        return effect._replace(memory=held.at[:, -1].add(-1.0))

    def response(self, closure: NeighborClosure, start: IntervalStart, inputs: DragInputs, frame: Frame) -> Response:
        """What the neighbours add to the mean force, where they are now; zero where there was no room for all."""
        beyond = self.beyond(start)
        others, full = self.neighbors(start, frame[0], beyond)
        full = full if beyond is None else full | beyond.lacking
        centres = self._centres(start) if beyond is None else beyond.centres
        periods = [side if wraps else 0.0 for side, wraps in zip(self.box, self.periodic, strict=True)]
        places = Places(centres, others, 2.0 * start.bodies.radius, jnp.asarray(periods, centres.dtype))
        spread = None if beyond is None else beyond.spread
        found = fluctuation(closure, places, frame, inputs.reynolds, inputs.solid_fraction, AT_ONCE, spread)
        room = jnp.where(full, 0.0, 1.0).astype(centres.dtype)
        column = room[:, None]
        return Response(room * found.along, column * found.across, column * found.torque, room * found.weight)

    def beyond(self, start: IntervalStart) -> FarGhosts | None:
        """Particles of the neighbouring slabs in reach of this one's; None on one device."""
        if self.division is None:
            return None
        area = math.prod(self.box) / self.division.length
        thickness = self.reach + 2.0 * self.division.stray * self.diameter
        most = most_in_reach(thickness, area, self.diameter)
        there = required(start.particles.active, "active of the particles of a slab")
        return far_ghosts(self.division, self.reach, self._centres(start), there, most)

    @property
    def _blocks(self) -> Blocks | None:
        return None if self.division is None else self.division.blocks

    def _centres(self, start: IntervalStart) -> Array:
        return centres_in_box(start.particles, self.box, self.periodic)

    def first_memory(self, slip: Array) -> Array | None:
        """(N, 9) nothing that is held, so that the first interval finds it anew; None where nothing is ever held. The
        columns are those of `_held`."""
        return None if self.held == 1 else jnp.zeros((slip.shape[0], 9), slip.dtype)

    def neighbors(self, start: IntervalStart, axis: Array, beyond: FarGhosts | None = None) -> tuple[Array, Array]:
        """(N, K) int32, who is in the regions about every particle, itself in an empty slot; and (N,) bool, whether
        there was no room for all of them, as in a dense pack, which is out of the closure's range. A dense pack
        elsewhere in the box does not matter to a particle. Numbers from N on are of the ghosts `beyond` the slab.

        Args:
            start: of the interval.
            axis: (N, 3) unit vectors along the slip.
            beyond: see `beyond`.
        """
        if beyond is None:
            centres, active = self._centres(start), start.particles.active
        else:
            centres, active = beyond.centres, beyond.there
        grid = CellGrid(self.box, self.periodic, self.reach, len(centres))
        places, axes = (components(lax.stop_gradient(vectors)) for vectors in (centres, axis))
        return neighbors_in_regions(grid, places, axes, self.regions, self.slots, self.cell_slots, active)


def _held(found: Response, frame: Frame, left: Array) -> Array:
    """(N, 9) what was found, its vectors along the axes of the box, and the intervals for which it still holds. The
    axes of `axes_along` are no place for vectors to wait in: across the slip they may jump when the slip turns."""
    across = sum(found.across[:, k, None] * axis for k, axis in enumerate(frame[1:]))
    torque = sum(found.torque[:, k, None] * axis for k, axis in enumerate(frame))
    return jnp.concatenate([found.along[:, None], across, torque, found.weight[:, None], left], axis=1)


def _as_found(held: Array, frame: Frame) -> Response:
    """What is held, along axes of the present slip; what has come to lie along the slip is not part of the force across
    it."""
    across, torque = held[:, 1:4], held[:, 4:7]
    parts = [[jnp.sum(vector * axis, axis=1) for axis in frame] for vector in (across, torque)]
    return Response(held[:, 0], jnp.stack(parts[0][1:], axis=1), jnp.stack(parts[1], axis=1), held[:, 7])
