"""Viscous force of an incompressible or volume-averaged fluid."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.boundary import Boundary, Sides, open_fraction, with_ghosts
from jaxdem.fluid.grid import (
    CellOrOne,
    FaceField,
    Grid,
    along,
    control_width,
    divergence,
    face_average_along,
    nearest_inner,
    own_layers,
    sum_of,
)
from jaxdem.fluid.mesh import beyond, of_slab, with_ends
from jaxdem.fluid.subgrid import StrainRates, eddy_viscosity


def stress_divergence(
    grid: Grid, sides: Sides, velocity: FaceField, kinematic_viscosity: Array, mixing_length: CellOrOne | None = None
) -> FaceField:
    """div(tau) / rho on the faces [m/s2], tau = (mu + rho nu_t) (grad u + grad u^T - 2/3 div(u) 1).

    The values on boundary faces are those of the nearest inner face, for the particles that see them. An outlet's face
    stands for half a cell, and mu du/dn is zero beyond it (see `Outlet`): of the stress outside the transposed half, mu
    du/dn again, is left.

    Args:
        grid: the grid.
        sides: of the box.
        velocity: u on the faces [m/s].
        kinematic_viscosity: () [m2/s].
        mixing_length: of the eddy viscosity nu_t, () or in the cells, see `eddy_viscosity`; None leaves it out [m].
    """
    rates = strain_rates(grid, sides, velocity)
    expansion = divergence(grid, velocity)
    eddy = None if mixing_length is None else eddy_viscosity(rates, mixing_length)
    result = []
    for which in range(grid.dimension):
        terms = []
        for axis in range(grid.dimension):
            stress, outside = deviatoric_rates(rates, expansion, which, axis)
            if eddy is not None:
                there = eddy if axis == which else edge_average(grid, eddy, which, axis)
                stress, outside = ((kinematic_viscosity + there) * s for s in (stress, outside))
            terms.append(stress_slope(grid, stress, outside, which, axis))
        total = sum_of(terms)
        result.append(to_boundary(grid, sides.boundary, kinematic_viscosity * total if eddy is None else total, which))
    return tuple(result)


def stress_slope(grid: Grid, stress: Array, outside: Array, which: int, axis: int) -> Array:
    """d(stress)/dx_axis on the faces of component `which`, what a stress on their sides gives them.

    Args:
        grid: the grid.
        stress: in the cells for `which` = `axis`, else on the edges of both axes.
        outside: like `stress`; of the first and the last cell along the axis, the stress beyond the side next to them.
            It counts for `which` = `axis` alone.
        which: axis of the faces.
        axis: of the derivative.
    """
    if axis != which:
        return (along(stress, axis, 1, None) - along(stress, axis, None, -1)) / grid.spacing[axis]
    before, after = beyond(grid, axis, stress, (-1,), (0,), own_layers(outside, axis))
    padded = jnp.concatenate((before, stress, after), axis)
    difference = along(padded, axis, 1, None) - along(padded, axis, None, -1)
    return difference / control_width(grid, axis, stress.dtype)


def strain_rates(grid: Grid, sides: Sides, velocity: FaceField) -> StrainRates:
    """du_i/dx_j + du_j/dx_i by (i, j), i <= j: in the cells for i = j, else on the edges of both axes [1/s].

    Args:
        grid: the grid.
        sides: of the box.
        velocity: u on the faces [m/s].
    """
    rates = {}
    for i, component in enumerate(velocity):
        stretch = (along(component, i, 1, None) - along(component, i, None, -1)) / grid.spacing[i]
        rates[i, i] = 2.0 * stretch
        for j in range(i + 1, grid.dimension):
            across = (shear(grid, sides, velocity[which], which, direction) for which, direction in ((i, j), (j, i)))
            rates[i, j] = sum_of(across)
    return rates


def deviatoric_rates(rates: StrainRates, expansion: Array, which: int, axis: int) -> tuple[Array, Array]:
    """Component (which, axis) of grad u + grad u^T - 2/3 div(u) 1, and its `outside` for `stress_slope` [1/s].

    Args:
        rates: see `strain_rates`.
        expansion: div(u) in the cells [1/s].
        which, axis: of the velocity and of the slope.
    """
    rate = rates[min(which, axis), max(which, axis)]
    if axis != which:
        return rate, rate
    return rate - (2.0 / 3.0) * expansion, 0.5 * rate - (2.0 / 3.0) * expansion


def shear(grid: Grid, sides: Sides, component: Array, which: int, axis: int) -> Array:
    """du_which/dx_axis for another axis, on the edges between both kinds of faces [1/s].

    Args:
        grid: the grid.
        sides: of the box.
        component: u_which on its faces [m/s].
        which: of the velocity.
        axis: of the derivative.
    """
    padded = with_ghosts(grid, sides, component, which, axis)
    near = along(padded, axis, 1, -1)
    return (along(near, axis, 1, None) - along(near, axis, None, -1)) / grid.spacing[axis]


def edge_average(grid: Grid, cell: Array, first: int, second: int) -> Array:
    """Mean of the four cells around every edge between the faces of two axes; at a boundary of those inside."""
    return face_average_along(grid, face_average_along(grid, cell, first), second)


def to_boundary(grid: Grid, boundary: Boundary, faces: Array, axis: int) -> Array:
    """`faces` of an axis; on sides that are no outlet the value of the nearest inner face, or zero without one."""
    if grid.periodic[axis]:
        return faces
    nearest, ends = nearest_inner(along(faces, axis, 1, -1), axis, along(faces, axis, 0, 1)), []
    for upper in (False, True):
        own = along(faces, axis, -1, None) if upper else along(faces, axis, 0, 1)
        is_open = of_slab(grid, open_fraction(grid, boundary.side(axis, upper)), faces.dtype)
        ends.append(is_open * own + (1.0 - is_open) * nearest[upper])
    return with_ends(grid, axis, faces, (ends[0], ends[1]))
