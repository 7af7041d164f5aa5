"""Viscous stress on the open parts of a mesh that surfaces cut, see `cut_cells`."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.boundary import Boundary, Sides, with_ghosts
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.diffusion import to_boundary
from jaxdem.fluid.grid import FaceField, Grid, along, control_width, divergence, sum_of
from jaxdem.fluid.open_faces import continued, padded


def cut_stress(
    grid: Grid, sides: Sides, cut: CutCells, velocity: FaceField, viscosity: Array, compressed: bool
) -> tuple[FaceField, FaceField]:
    """nu sum b (u_n - u)/h^2 on the faces, without the friction on surfaces [m/s2]; and what closed faces gain of it.

    Where the void fraction changes, nu/3 grad(div u) is added between whole cells. What the same gradient would give to
    other faces is the second result: the surfaces take it.

    Args:
        grid: the grid.
        sides: of the box.
        cut: the open parts.
        velocity: u on the faces [m/s].
        viscosity: () kinematic [m2/s].
        compressed: whether the void fraction changes.
    """
    result, lost = [], []
    expansion = _expansion_of_whole_cells(grid, cut, velocity) if compressed else None
    for which, u in enumerate(velocity):
        terms = []
        for axis in range(grid.dimension):
            near = along(with_ghosts(grid, sides, u, which, axis), axis, 1, -1)
            weight = padded(grid, cut.open_faces, which, axis)
            link = jnp.minimum(along(weight, axis, None, -1), along(weight, axis, 1, None))
            flux = link * (along(near, axis, 1, None) - along(near, axis, None, -1)) / grid.spacing[axis]
            width = control_width(grid, axis, u.dtype) if which == axis else grid.spacing[axis]
            terms.append((along(flux, axis, 1, None) - along(flux, axis, None, -1)) / width)
        total, outside = sum_of(terms), jnp.zeros_like(u)
        if expansion is not None:
            slope = _inner_slope(grid, expansion, which)
            whole = _between_whole_cells(grid, cut, which)
            total, outside = total + jnp.where(whole, slope, 0.0), jnp.where(whole, 0.0, slope)
        result.append(viscosity * total)
        lost.append(viscosity * outside)
    return tuple(result), tuple(lost)


def seen_stress(grid: Grid, boundary: Boundary, cut: CutCells, stress: FaceField, friction: FaceField) -> FaceField:
    """div(tau)/rho of the fluid on the open part of the faces, as grains see it [m/s2].

    Args:
        grid: the grid.
        boundary: sides.
        cut: the open parts.
        stress: of `cut_stress` [m/s2].
        friction: nu R (u - u_w) [m/s2].
    """
    found = []
    for axis, (a, s, f) in enumerate(zip(cut.open_faces, stress, friction, strict=True)):
        own = jnp.where(a > 0.0, (s - f) / jnp.where(a > 0.0, a, 1.0), 0.0)
        found.append(to_boundary(grid, boundary, own, axis))
    return continued(cut.open_faces, tuple(found))


def _expansion_of_whole_cells(grid: Grid, cut: CutCells, velocity: FaceField) -> Array:
    return jnp.where(cut.open_cells >= 1.0, divergence(grid, velocity), 0.0) / 3.0


def _between_whole_cells(grid: Grid, cut: CutCells, axis: int) -> Array:
    whole = cut.open_cells >= 1.0
    inner = along(whole, axis, None, -1) & along(whole, axis, 1, None)
    seam = along(whole, axis, -1, None) & along(whole, axis, 0, 1) & grid.periodic[axis]
    return jnp.concatenate((seam, inner, seam), axis)


def _inner_slope(grid: Grid, cell: Array, axis: int) -> Array:
    """Slope on the faces, zero on sides."""
    h = grid.spacing[axis]
    inner = (along(cell, axis, 1, None) - along(cell, axis, None, -1)) / h
    seam = (along(cell, axis, 0, 1) - along(cell, axis, -1, None)) / h * grid.periodic[axis]
    return jnp.concatenate((seam, inner, seam), axis)
