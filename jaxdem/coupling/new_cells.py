"""The pressure in cells that have just opened to the fluid."""

from __future__ import annotations

from jax import Array, lax

from jaxdem.fluid.grid import Grid, sum_of
from jaxdem.fluid.open_faces import next_to
from jaxdem.numerics.host import namespace


def in_new_cells(grid: Grid, pressure: Array, before: Array, now: Array) -> Array:
    """The pressure, in cells that have just opened the mean of their neighbours that were open [Pa]."""
    xp = namespace(pressure)
    known, open_before = xp.where(before, pressure, 0.0), before.astype(pressure.dtype)
    total = sum_of(next_to(grid, known, axis) for axis in range(pressure.ndim))
    count = sum_of(next_to(grid, open_before, axis) for axis in range(pressure.ndim))
    new = now & ~before & (count > 0.0)
    return xp.where(new, total / xp.where(count > 0.0, count, 1.0), pressure)


def in_new_bodies(grid: Grid, pressure: Array, before: Array, now: Array) -> Array:
    """The same of bodies that are many cells thick: from the cells that were open inwards [Pa]."""

    def further(_: int, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        value, known = carry
        beside = sum_of(next_to(grid, known.astype(value.dtype), axis) for axis in range(value.ndim)) > 0.0
        return in_new_cells(grid, value, known, now), known | (now & beside)

    return lax.fori_loop(0, max(grid.whole_cells), further, (pressure, before))[0]
