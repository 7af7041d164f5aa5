"""Viscous force of a fluid whose viscosity differs from cell to cell."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.boundary import Sides
from jaxdem.fluid.diffusion import deviatoric_rates, edge_average, strain_rates, stress_slope, to_boundary
from jaxdem.fluid.grid import CellOrOne, FaceField, Grid, along, box_largest, divergence, sum_of
from jaxdem.fluid.mesh import end_faces


def local_stress(grid: Grid, sides: Sides, velocity: FaceField, fluidity: Array) -> FaceField:
    """div(tau) on the faces [N/m3], tau = mu (grad u + grad u^T - 2/3 div(u) 1), as in `stress_divergence`.

    On the edges 1/mu is the mean of the cells around, so that a shear stress is continuous across layers along the
    axes: the flow of two layers that shear each other is exact.

    Args:
        grid: the grid.
        sides: of the box.
        velocity: u on the faces [m/s].
        fluidity: 1/mu in the cells [1/(Pa s)].
    """
    rates, expansion = strain_rates(grid, sides, velocity), divergence(grid, velocity)
    result = []
    for which in range(grid.dimension):
        terms = []
        for axis in range(grid.dimension):
            stress, outside = deviatoric_rates(rates, expansion, which, axis)
            there = _on_surfaces(grid, fluidity, which, axis)
            terms.append(stress_slope(grid, stress / there, outside / there, which, axis))
        result.append(to_boundary(grid, sides.boundary, sum_of(terms), which))
    return tuple(result)


def largest_diffusivity(grid: Grid, fluidity: Array, density: tuple[CellOrOne, ...]) -> Array:
    """() largest viscosity on the surfaces of a control volume over the density in it [m2/s].

    Args:
        grid: the grid.
        fluidity: 1/mu in the cells [1/(Pa s)].
        density: on the faces [kg/m3].
    """
    found = []
    for which in range(grid.dimension):
        for axis in range(grid.dimension):
            there = _on_surfaces(grid, fluidity, which, axis)
            if axis == which:
                inner = jnp.minimum(along(there, axis, None, -1), along(there, axis, 1, None))
                ends = end_faces(grid, axis, there, jnp.minimum, lambda first, last: (first, last))
                lowest = jnp.concatenate((ends[0], inner, ends[1]), axis)
            else:
                lowest = jnp.minimum(along(there, axis, None, -1), along(there, axis, 1, None))
            found.append(box_largest(grid, 1.0 / (lowest * density[which])))
    return jnp.max(jnp.stack(found))


def _on_surfaces(grid: Grid, fluidity: Array, which: int, axis: int) -> Array:
    """1/mu on the surfaces, normal to `axis`, of the control volumes of the faces of axis `which`."""
    return fluidity if axis == which else edge_average(grid, fluidity, which, axis)
