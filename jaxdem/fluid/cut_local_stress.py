"""Viscous force of a fluid whose viscosity differs from cell to cell, between surfaces within the mesh."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.boundary import Sides, with_ghosts
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.cut_eddy import at_links, transposed_stress
from jaxdem.fluid.grid import FaceField, Grid, along, control_width, sum_of, sum_of_fields


def cut_local_stress(
    grid: Grid, sides: Sides, cut: CutCells, velocity: FaceField, fluidity: Array
) -> tuple[FaceField, FaceField]:
    """sum b mu (u_n - u)/h^2 on the faces, with the transposed part between whole cells, without the friction on
    surfaces; and what the surfaces take of the transposed part [N/m3].

    `cut_stress` with the viscosity of `local_stress`: its harmonic mean on the edges.

    Args:
        grid: the grid.
        sides: of the box.
        cut: the open parts.
        velocity: u on the faces [m/s].
        fluidity: 1/mu in the cells, closed ones included [1/(Pa s)].
    """
    result = []
    for which, u in enumerate(velocity):
        terms = []
        for axis in range(grid.dimension):
            near = along(with_ghosts(grid, sides, u, which, axis), axis, 1, -1)
            link = jnp.maximum(cut.links[which][axis], 0.0) / at_links(grid, fluidity, which, axis)
            flux = link * (along(near, axis, 1, None) - along(near, axis, None, -1)) / grid.spacing[axis]
            width = control_width(grid, axis, u.dtype) if which == axis else grid.spacing[axis]
            terms.append((along(flux, axis, 1, None) - along(flux, axis, None, -1)) / width)
        result.append(sum_of(terms))
    turned, lost = transposed_stress(grid, sides, cut, velocity, fluidity, inverse=True)
    return sum_of_fields(tuple(result), turned), lost
