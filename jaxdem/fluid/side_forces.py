"""Force of the fluid on the sides of the box, from the balance of momentum that the solver keeps.

At a wall the normal velocity of the boundary faces is given. Each of them stands for half a cell, and what that half
cell gains goes into the wall: through its inner surface, in the middle of the first cell, pressure, normal stress and
momentum that is carried there; and what particles in it hand over. Along the wall the shear stress on its faces acts
on the wall. So for a box of walls

    d/dt [ momentum of the fluid and impulses given to the particles ] = - sum of the forces on the sides

holds to rounding in every fluid step. The pressure is the reduced one: the weight of the fluid is not in it, and in a
box without an outlet it is known but for a constant.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.boundary import Boundary, Sides
from jaxdem.fluid.diffusion import edge_average, strain_rates
from jaxdem.fluid.grid import CellOrOne, FaceField, Grid, along, divergence, face_control_volume
from jaxdem.fluid.subgrid import eddy_viscosity

Stresses = dict[tuple[int, int], Array]
"""tau_ij / rho by (i, j), i <= j: in the cells for i = j, else on the edges of both axes [m2/s2]."""


def viscous_stresses(
    grid: Grid, sides: Sides, velocity: FaceField, kinematic_viscosity: Array, mixing_length: CellOrOne | None
) -> Stresses:
    """The stress whose divergence is `stress_divergence`; arguments as there."""
    rates, expansion = strain_rates(grid, sides, velocity), divergence(grid, velocity)
    eddy = None if mixing_length is None else eddy_viscosity(rates, mixing_length)
    found = {}
    for (i, j), rate in rates.items():
        viscosity = kinematic_viscosity
        if eddy is not None:
            viscosity = viscosity + (eddy if i == j else edge_average(grid, eddy, i, j))
        found[i, j] = viscosity * (rate - (2.0 / 3.0) * expansion if i == j else rate)
    return found


def stress_on_sides(grid: Grid, boundary: Boundary, stresses: Stresses) -> Array:
    """(2 D, D) force of a stress over density on every side [m4/s2]."""
    return _of_sides(
        grid,
        lambda axis, upper, which: _stress_on_side(grid, boundary, stresses, axis, upper, which),
        next(iter(stresses.values())),
    )


def _stress_on_side(grid: Grid, boundary: Boundary, stresses: Stresses, axis: int, upper: bool, which: int) -> Array:
    at_side = along(stresses[min(axis, which), max(axis, which)], axis, *_end(upper))
    if which != axis:
        at_side = at_side * _solved(grid, boundary, which, at_side)
    area = grid.cell_volume / grid.spacing[axis]
    return (-area if upper else area) * jnp.sum(at_side)


def pressure_on_sides(grid: Grid, pressure: Array) -> Array:
    """(2 D, D) force of the pressure of the first cells on every side [N]."""

    def on_side(axis: int, upper: bool, which: int) -> Array:
        if which != axis:
            return jnp.zeros((), pressure.dtype)
        area = grid.cell_volume / grid.spacing[axis]
        return (area if upper else -area) * jnp.sum(along(pressure, axis, *_end(upper)))

    return _of_sides(grid, on_side, pressure)


def gained_at_sides(grid: Grid, acceleration: FaceField) -> Array:
    """(2 D, D) volume of the boundary faces of every side times a quantity on them, such as an acceleration [m4/s2]."""

    def of_side(axis: int, upper: bool, which: int) -> Array:
        if which != axis:
            return jnp.zeros((), acceleration[0].dtype)
        own = acceleration[axis]
        volume = along(face_control_volume(grid, axis), axis, *_end(upper)).astype(own.dtype)
        return jnp.sum(volume * along(own, axis, *_end(upper)))

    return _of_sides(grid, of_side, acceleration[0])


def _of_sides(grid, force, like):  # type: ignore[no-untyped-def]
    """Array of `force(axis, upper, which)`, zero for the sides of periodic axes."""
    dimension, zero = grid.dimension, jnp.zeros((), like.dtype)
    rows = [
        jnp.stack([zero if grid.periodic[axis] else force(axis, upper, which) for which in range(dimension)])
        for axis in range(dimension)
        for upper in (False, True)
    ]
    return jnp.stack(rows)


def _end(upper: bool) -> tuple[int | None, int | None]:
    return (-1, None) if upper else (0, 1)


def _solved(grid: Grid, boundary: Boundary, axis: int, like: Array) -> Array:
    """Part of the control volume of every face of an axis whose velocity is solved for, over a cell: 0 on walls."""
    part = jnp.ones(grid.cells[axis] + 1, like.dtype)
    if grid.periodic[axis]:
        part = part.at[-1].set(0.0)  # the first face once more
    else:
        ends = [0.5 * boundary.side(axis, upper).condition.sets_pressure for upper in (False, True)]
        part = part.at[0].set(ends[0]).at[-1].set(ends[1])
    return part.reshape([-1 if a == axis else 1 for a in range(grid.dimension)])
