"""Mixing length of a turbulent stream over a bed of grains: it grows with the height over the bed."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.fluid.grid import Grid


class BedMixing(NamedTuple):
    """Numbers of the mixing length; traced.

    Attributes:
        von_karman: () kappa [-].
        packed_solid_fraction: () phi_m, solid fraction at which the length stops growing [-].
    """

    von_karman: Array
    packed_solid_fraction: Array


def mixing_length_over_bed(grid: Grid, numbers: BedMixing, void_fraction: Array | None) -> Array:
    """l = kappa int_0^z max(1 - phi/phi_m, 0) dz in the cells, z the height over the lower side of the box [m].

    phi is the solid fraction of the cells of a column. Within a packed bed l stays next to zero. Above the bed it is
    kappa times the height over the bed's surface, from which the logarithmic law of a rough wall follows. Without
    particles it is kappa z.

    Args:
        grid: the grid.
        numbers: kappa and phi_m.
        void_fraction: 1 - phi in the cells, None without particles [-].

    Source: L. Li & M. Sawamoto, Coast. Eng. Japan 38 (1995) 157-176; in a coupled model of bed load: R. Maurin, J.
    Chauchat, B. Chareyre & P. Frey, Phys. Fluids 27 (2015) 113302.
    """
    height = grid.spacing[-1]
    if void_fraction is None:
        void_fraction = jnp.ones(grid.cells, numbers.von_karman.dtype)
    growth = jnp.maximum(1.0 - (1.0 - void_fraction) / numbers.packed_solid_fraction, 0.0)
    summed = jnp.cumsum(growth, axis=-1) - 0.5 * growth
    if grid.cut_along(grid.dimension - 1) is not None:
        summed = summed + _of_lower_slabs(grid, jnp.sum(growth, axis=-1, keepdims=True))
    return numbers.von_karman * height * summed


def _of_lower_slabs(grid: Grid, layer: Array) -> Array:
    """Sum of a layer over all slabs below this one."""
    cut = required(grid.blocks, "blocks")
    below = jnp.zeros_like(layer)
    for distance in range(1, cut.number):
        layer = cut.from_lower(layer)
        below = below + jnp.where(cut.index() >= distance, layer, 0.0)
    return below
