"""Viscous force of an incompressible or volume-averaged fluid."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.boundary import Boundary, with_ghosts
from jaxdem.fluid.grid import FaceField, Grid, along, divergence, sum_of


def stress_divergence(
    grid: Grid,
    boundary: Boundary,
    side_velocity: tuple[Array, ...],
    velocity: FaceField,
    kinematic_viscosity: Array,
    time: Array,
) -> FaceField:
    """div(tau) / rho on the faces [m/s2], tau = mu (grad u + grad u^T - 2/3 div(u) 1).

    The values on boundary faces are those of the nearest inner face, for the particles that see them.

    Args:
        grid: the grid.
        boundary: sides.
        side_velocity: (D,) velocity of every side [m/s].
        velocity: u on the faces [m/s].
        kinematic_viscosity: () [m2/s].
        time: [s].
    """
    expansion = divergence(grid, velocity)
    result = []
    for which, component in enumerate(velocity):
        terms = []
        for axis in range(grid.dimension):
            if axis == which:
                rate = (along(component, axis, 1, None) - along(component, axis, None, -1)) / grid.spacing[
                    axis
                ]
                stress = 2.0 * rate - (2.0 / 3.0) * expansion
                stress = _wrapped(grid, stress, axis)
                force = (along(stress, axis, 1, None) - along(stress, axis, None, -1)) / grid.spacing[axis]
                terms.append(force)
            else:
                shear = _shear_rate(grid, boundary, side_velocity, velocity, which, axis, time)
                force = (along(shear, axis, 1, None) - along(shear, axis, None, -1)) / grid.spacing[axis]
                terms.append(_inner_only(grid, force, which))
        result.append(_extended(grid, kinematic_viscosity * sum_of(terms), which))
    return tuple(result)


def _shear_rate(
    grid: Grid,
    boundary: Boundary,
    side_velocity: tuple[Array, ...],
    velocity: FaceField,
    which: int,
    axis: int,
    time: Array,
) -> Array:
    """du_which/dx_axis + du_axis/dx_which on the edges between both kinds of faces."""
    rates = []
    for component, direction in ((which, axis), (axis, which)):
        padded = with_ghosts(grid, boundary, side_velocity, velocity[component], component, direction, time)
        near = along(padded, direction, 1, -1)
        rates.append(
            (along(near, direction, 1, None) - along(near, direction, None, -1)) / grid.spacing[direction]
        )
    return rates[0] + rates[1]


def _wrapped(grid: Grid, cell: Array, axis: int) -> Array:
    """A cell array with its periodic images on either end; unchanged on an axis that is not periodic."""
    if not grid.periodic[axis]:
        return cell
    return jnp.concatenate((along(cell, axis, -1, None), cell, along(cell, axis, 0, 1)), axis)


def _inner_only(grid: Grid, faces: Array, axis: int) -> Array:
    return faces if grid.periodic[axis] else along(faces, axis, 1, -1)


def _extended(grid: Grid, faces: Array, axis: int) -> Array:
    if grid.periodic[axis]:
        return faces
    if faces.shape[axis] == 0:  # one cell between two boundaries: no inner face
        shape = grid.face_shape(axis)
        return jnp.zeros(shape, faces.dtype)
    return jnp.concatenate((along(faces, axis, 0, 1), faces, along(faces, axis, -1, None)), axis)
