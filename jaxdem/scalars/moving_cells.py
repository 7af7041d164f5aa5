"""Scalars in cells that surfaces open and close: what a cell holds, and how it changes hands.

A cell holds W c, with W its capacity, see `fluid.cut_scalar`. Where surfaces change their place W is a part of the
state. In an interval it changes by what the fluid carries,

    W_end = W_start - t div(F),

with the flux F that carries the scalar too. So a uniform scalar stays uniform to rounding, whatever the flux is, and
the sum of W c changes by what passes sides and surfaces alone. The pressure solver makes div(F) the rate at which cells
open, so that W follows their open part times the void fraction. It does not exactly: small cells close and open in one
step. Therefore, before it is carried, capacity changes hands, and takes along the c of the cell that it comes from:

1. A cell that has closed gives all that it has to the open cells beside it.
2. Of what cells have more than they should, W_end = max(v g, L n), a part goes through open faces to cells that have
   less, some times over: v is the open part, g the void fraction, and L n the least with which explicit steps are
   stable, n what the open faces pass of what those of a whole cell do.

Neither changes a sum of W or W c, or a uniform c. Derived here.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxdem.coupling.open_parts import mean_of_corners
from jaxdem.errors import required
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.cut_friction import exchange_of_cells
from jaxdem.fluid.cut_scalar import ScalarWalls
from jaxdem.fluid.grid import CellOrOne, FaceField, Grid, along, divergence, sum_of
from jaxdem.fluid.mesh import has_next, next_cells
from jaxdem.numerics.host import namespace
from jaxdem.scalars.scalar_state import ScalarState
from jaxdem.solids.clipping import positive_part

SWEEPS = 8
"""Times that capacity changes hands in an interval."""

LEAST = 0.5
"""L, least capacity of a cell over what its open faces pass [-]."""

MOST = 0.9
"""Part of its capacity that a cell gives at once [-]."""


class Held(NamedTuple):
    """What the cells hold in an interval.

    Attributes:
        walls: the surfaces where they are in it, without capacity that is lent.
        fields: at its start [unit].
        before, after: void fractions whose products with the open parts are W at start and end [-].
        capacity: W at the end, 0 of cells without fluid [-].
    """

    walls: ScalarWalls | None
    fields: tuple[Array, ...]
    before: CellOrOne
    after: CellOrOne
    capacity: Array | None


class Change(NamedTuple):
    """What changes the cells in an interval.

    Attributes:
        cut: the surfaces in it; None without.
        flux: F, mean on the faces [m/s].
        before, after: g at its start and end; 1.0 without particles [-].
        duration: () t [s].
    """

    cut: CutCells | None
    flux: FaceField
    before: CellOrOne
    after: CellOrOne
    duration: Array


def held_by_cells(grid: Grid, walls: ScalarWalls | None, state: ScalarState, change: Change) -> Held:
    """What the cells hold in an interval, after capacity has changed hands where surfaces change their place.

    Args:
        grid: the grid.
        walls: values and fluxes of the surfaces; None without.
        state: at the start.
        change: of the cells.
    """
    fields, capacity = state.fields, state.capacity
    if walls is None or capacity is None:
        return Held(walls, fields, change.before, change.after, None)
    cut = required(change.cut, "surfaces in the fluid")
    fluid, gained = cut.open_cells > 0.0, -change.duration * divergence(grid, change.flux)
    wanted = jnp.maximum(cut.open_cells * change.after, LEAST * _passed(grid, cut.open_faces)) - gained
    wanted = jnp.where(fluid, jnp.maximum(wanted, 0.0), 0.0)
    held = jnp.stack([capacity, *(capacity * field for field in fields)])
    held = _given_away(grid, fluid, held)
    held = lax.fori_loop(0, SWEEPS, lambda _, now: _evened(grid, cut.open_faces, wanted, now), held)
    start, known = held[0], fluid & (held[0] > 0.0)
    found = tuple(
        jnp.where(known, own / jnp.where(known, start, 1.0), field) for own, field in zip(held[1:], fields, strict=True)
    )
    open_part = jnp.where(fluid, cut.open_cells, 1.0)
    exchange, area = exchange_and_area(grid, cut, required(cut.distance, "distance from the surfaces"))
    walls = walls._replace(lent=jnp.zeros_like(walls.lent), exchange=exchange, area=area)
    return Held(
        walls, found, start / open_part, (start + gained) / open_part, jnp.where(fluid, start + gained, start)
    )  # fmt: skip


def exchange_and_area(grid: Grid, cut: CutCells, distance: Array) -> tuple[Array, Array]:
    """`exchange` and `area` of `ScalarWalls`; arrays of NumPy or JAX.

    The area is that by which what the faces leave open closes: their sum, taken as vectors, is zero with it.

    Args:
        grid: the grid.
        cut: the open parts.
        distance: from the nearest surface at the corners (n + 1, m + 1, ...) [m].
    """
    xp, axes, open_cells = namespace(distance), tuple(range(grid.dimension)), cut.open_cells
    there = open_cells > 0.0
    integral = positive_part(distance, axes).integral
    mean = xp.where(there, integral / xp.where(there, open_cells, 1.0), 0.0)
    whole = mean_of_corners(distance, axes)
    exchange = exchange_of_cells(grid, cut.open_faces, open_cells, mean, whole)
    parts = [
        (along(a, axis, 1, None) - along(a, axis, None, -1)) / grid.spacing[axis]
        for axis, a in enumerate(cut.open_faces)
    ]
    squared = sum_of(part**2 for part in parts)
    least = np.finfo(squared.dtype).tiny
    return exchange, xp.where(there & (squared > 0.0), xp.sqrt(xp.maximum(squared, least)), 0.0)


def _passed(grid: Grid, open_faces: FaceField) -> Array:
    """n of the cells [-]."""
    per_face = [1.0 / h**2 for h in grid.spacing]
    return sum_of(
        0.5 * share / sum(per_face) * (along(a, axis, None, -1) + along(a, axis, 1, None))
        for axis, (share, a) in enumerate(zip(per_face, open_faces, strict=True))
    )


def _given_away(grid: Grid, fluid: Array, held: Array) -> Array:
    """(1 + F, ...) capacity and contents with those of closed cells in the open cells beside them, if there are any."""
    closed = ~fluid & (held[0] > 0.0)
    ways = []
    for axis in range(grid.dimension):
        upper, both = next_cells(grid, axis, fluid), has_next(grid, axis)
        ways.append((closed & upper & both, fluid & next_cells(grid, axis, closed) & both))
    number = sum_of(
        up.astype(held.dtype) + next_cells(grid, axis, down.astype(held.dtype), upwards=False)
        for axis, (up, down) in enumerate(ways)
    )
    share = held[0] / jnp.where(number > 0.0, number, 1.0)
    down_share = (next_cells(grid, axis, share) for axis in range(grid.dimension))
    flows = zip(ways, down_share, strict=True)
    return _moved(grid, held, [jnp.where(up, share, 0.0) - jnp.where(down, other, 0.0) for (up, down), other in flows])


def _evened(grid: Grid, open_faces: FaceField, wanted: Array, held: Array) -> Array:
    """The same after a part of what is too much has gone to cells that have less."""
    excess, flows = held[0] - wanted, []
    for axis, a in enumerate(open_faces):
        is_open = (along(a, axis, 1, None) > 0.0) & has_next(grid, axis)
        flows.append(jnp.where(is_open, (excess - next_cells(grid, axis, excess)) / (2.0 * grid.dimension), 0.0))
    given = sum_of(
        jnp.maximum(f, 0.0) + next_cells(grid, axis, jnp.maximum(-f, 0.0), upwards=False)
        for axis, f in enumerate(flows)
    )
    share = jnp.minimum(1.0, MOST * held[0] / jnp.where(given > 0.0, given, 1.0))
    below = (next_cells(grid, axis, share) for axis in range(grid.dimension))
    return _moved(grid, held, [f * jnp.where(f > 0.0, share, other) for f, other in zip(flows, below, strict=True)])


def _moved(grid: Grid, held: Array, flows: list[Array]) -> Array:
    """With capacity that goes from every cell to the next one along each axis, and what it holds."""
    own = held[:1]
    inside = jnp.where(own > 0.0, held / jnp.where(own > 0.0, own, 1.0), 0.0)
    for axis, flow in enumerate(flows):
        carried = flow[None] * jnp.where(flow[None] > 0.0, inside, next_cells(grid, axis, inside))
        held = held - carried + next_cells(grid, axis, carried, upwards=False)
    return held
