"""Viscous stress on the open parts of a mesh that surfaces cut, see `cut_cells`."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.boundary import Boundary, Sides, with_ghosts
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.cut_eddy import at_links, transposed_stress
from jaxdem.fluid.diffusion import to_boundary
from jaxdem.fluid.grid import (
    FaceField,
    Grid,
    along,
    control_width,
    divergence,
    face_average_along,
    no_ends,
    slope_over,
    sum_of,
    sum_of_fields,
)
from jaxdem.fluid.mesh import end_faces
from jaxdem.fluid.open_faces import continued


class CutViscosity(NamedTuple):
    """Viscosity of the fluid between surfaces.

    Attributes:
        molecular: () kinematic [m2/s].
        eddy: nu_t in the cells, see `cut_eddy`; None without [m2/s].
    """

    molecular: Array
    eddy: Array | None = None

    def on_faces(self, grid: Grid) -> tuple[Array, ...]:
        """That of friction on surfaces, for the faces of every axis [m2/s]."""
        if self.eddy is None:
            return (self.molecular,) * grid.dimension
        return tuple(self.molecular + face_average_along(grid, self.eddy, axis) for axis in range(grid.dimension))

    @property
    def in_cells(self) -> Array:
        """() or in the cells [m2/s]."""
        return self.molecular if self.eddy is None else self.molecular + self.eddy


def cut_stress(
    grid: Grid, sides: Sides, cut: CutCells, velocity: FaceField, viscosity: CutViscosity, compressed: bool
) -> tuple[FaceField, FaceField | None]:
    """nu sum b (u_n - u)/h^2 on the faces, without the friction on surfaces [m/s2]; and what closed faces gain of it.

    Where the void fraction changes, nu/3 grad(div u) is added between whole cells. What the same gradient would give to
    other faces is the second result: the surfaces take it. With an eddy viscosity see `transposed_stress` too; without
    both it is None.

    Args:
        grid: the grid.
        sides: of the box.
        cut: the open parts.
        velocity: u on the faces [m/s].
        viscosity: of the fluid.
        compressed: whether the void fraction changes.
    """
    result, lost, eddy = [], [], viscosity.eddy
    expansion = _expansion_of_whole_cells(grid, cut, velocity) if compressed else None
    for which, u in enumerate(velocity):
        terms = []
        for axis in range(grid.dimension):
            near = along(with_ghosts(grid, sides, u, which, axis), axis, 1, -1)
            link = jnp.maximum(cut.links[which][axis], 0.0)
            flux = link * (along(near, axis, 1, None) - along(near, axis, None, -1)) / grid.spacing[axis]
            if eddy is not None:
                flux = (viscosity.molecular + at_links(grid, eddy, which, axis)) * flux
            width = control_width(grid, axis, u.dtype) if which == axis else grid.spacing[axis]
            terms.append((along(flux, axis, 1, None) - along(flux, axis, None, -1)) / width)
        total, outside = sum_of(terms), jnp.zeros_like(u)
        if expansion is not None:
            slope = _inner_slope(grid, expansion, which)
            if eddy is not None:
                slope = viscosity.molecular * slope
            whole = _between_whole_cells(grid, cut, which)
            total, outside = total + jnp.where(whole, slope, 0.0), jnp.where(whole, 0.0, slope)
        result.append(total if eddy is not None else viscosity.molecular * total)
        lost.append(outside if eddy is not None else viscosity.molecular * outside)
    if eddy is None:
        return tuple(result), None if expansion is None else tuple(lost)
    turned, left = transposed_stress(grid, sides, cut, velocity, eddy)
    return sum_of_fields(tuple(result), turned), sum_of_fields(tuple(lost), left)


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
    return continued(grid, cut.open_faces, tuple(found))


def _expansion_of_whole_cells(grid: Grid, cut: CutCells, velocity: FaceField) -> Array:
    return jnp.where(cut.open_cells >= 1.0, divergence(grid, velocity), 0.0) / 3.0


def _between_whole_cells(grid: Grid, cut: CutCells, axis: int) -> Array:
    whole = cut.open_cells >= 1.0
    inner = along(whole, axis, None, -1) & along(whole, axis, 1, None)
    ends = end_faces(grid, axis, whole, lambda below, above: below & above, no_ends)
    return jnp.concatenate((ends[0], inner, ends[1]), axis)


def _inner_slope(grid: Grid, cell: Array, axis: int) -> Array:
    """Slope on the faces, zero on sides."""
    h = grid.spacing[axis]
    inner = (along(cell, axis, 1, None) - along(cell, axis, None, -1)) / h
    ends = end_faces(grid, axis, cell, slope_over(h), no_ends)
    return jnp.concatenate((ends[0], inner, ends[1]), axis)
