"""Void fraction from the particles' volumes."""

from __future__ import annotations

from jax import Array

from jaxdem.coupling.interpolation import Weights, deposit
from jaxdem.coupling.open_cells import over_open_part
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.grid import Grid
from jaxdem.numerics.host import namespace


def solid_fraction(grid: Grid, weights: Weights, volume: Array, cut: CutCells | None = None) -> Array:
    """Solid fraction of every cell, sum_p w_pc V_p / V_cell [-].

    Summed over the cells, times the volume of their open part, it is the volume of the particles to round-off.

    Args:
        grid: the grid.
        weights: of the N particles.
        volume: () or (N,) [m3].
        cut: surfaces that leave a part of the cells open; None without.
    """
    per_particle = namespace(weights.weight).broadcast_to(volume / grid.cell_volume, weights.index.shape[:1])
    return over_open_part(deposit(grid, weights, per_particle), cut)
