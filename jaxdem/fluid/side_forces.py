"""Force of the fluid on the sides of the box, from the balance of momentum that the solver keeps.

At a wall the normal velocity of the boundary faces is given. Each of them stands for half a cell, and what that half
cell gains goes into the wall: through its inner surface, in the middle of the first cell, pressure, normal stress and
momentum that is carried there; and what particles in it hand over. Along the wall the shear stress on its faces acts
on the wall. So for a box of walls

    d/dt [ momentum of the fluid and impulses given to the particles ] = - sum of the forces on the sides

holds to rounding in every fluid step. The pressure is the reduced one: the weight of the fluid is not in it, and in a
box without an outlet it is known but for a constant.

A load is the force on every side and its first moments, (2 D, D, 1 + D): of component k on a side sum f_k, then
sum x_j f_k for every axis j, from which follows the torque about any point. x is where the force acts: on the side, and
along it in the middle of a cell. Of j = k, which no torque needs, there is 0.
"""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.fluid.boundary import Boundary, Sides
from jaxdem.fluid.diffusion import edge_average, strain_rates
from jaxdem.fluid.grid import CellOrOne, FaceField, Grid, along, divergence, face_control_volume
from jaxdem.fluid.mesh import at_side, layer_number, of_slab
from jaxdem.fluid.subgrid import eddy_viscosity
from jaxdem.numerics.blocks import total

Measured = tuple[int, ...]
"""Numbers of the sides that are measured: 2 times the axis, and 1 more for the upper one."""

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


def stress_on_sides(grid: Grid, sides: Measured, boundary: Boundary, stresses: Stresses) -> Array:
    """Load of a stress over density: force [m4/s2] and moments."""
    return _of_sides(
        grid,
        sides,
        lambda axis, upper, which: _stress_on_side(grid, boundary, stresses, axis, upper, which),
        next(iter(stresses.values())),
    )


def _stress_on_side(grid: Grid, boundary: Boundary, stresses: Stresses, axis: int, upper: bool, which: int) -> Array:
    at_side = along(stresses[min(axis, which), max(axis, which)], axis, *_end(upper))
    if which != axis:
        at_side = at_side * _solved(grid, boundary, which, at_side)
    area = grid.cell_volume / grid.spacing[axis]
    return (-area if upper else area) * at_side


def pressure_on_sides(grid: Grid, sides: Measured, pressure: Array) -> Array:
    """Load of the pressure of the first cells: force [N] and moments [N m]."""

    def on_side(axis: int, upper: bool, which: int) -> Array | None:
        if which != axis:
            return None
        area = grid.cell_volume / grid.spacing[axis]
        return (area if upper else -area) * along(pressure, axis, *_end(upper))

    return _of_sides(grid, sides, on_side, pressure)


def gained_at_sides(grid: Grid, sides: Measured, acceleration: FaceField) -> Array:
    """Load of the volume of the boundary faces times a quantity on them, such as an acceleration: [m4/s2]; moments."""

    def of_side(axis: int, upper: bool, which: int) -> Array | None:
        if which != axis:
            return None
        own = acceleration[axis]
        volume = along(face_control_volume(grid, axis), axis, *_end(upper)).astype(own.dtype)
        return volume * along(own, axis, *_end(upper))

    return _of_sides(grid, sides, of_side, acceleration[0])


def _of_sides(grid: Grid, sides: Measured, force: Callable[[int, bool, int], Array | None], like: Array) -> Array:
    """(2 D, D, 1 + D) loads of `force(axis, upper, which)` on the faces of a side, None for none; NaN on sides that are
    not measured."""
    dimension = grid.dimension
    nothing = jnp.zeros(1 + dimension, like.dtype)

    def load(axis: int, upper: bool, which: int) -> Array:
        if 2 * axis + upper not in sides:
            return nothing * jnp.nan
        found = None if grid.periodic[axis] else force(axis, upper, which)
        if found is None:
            return nothing
        found = at_side(grid, axis, upper, found, 0.0)
        force_k = jnp.sum(found)
        moments = [
            _moment(found, force_k, grid, (axis, upper), j) if j != which else 0.0 * force_k for j in range(dimension)
        ]
        return jnp.stack([force_k, *moments])

    rows = [
        jnp.stack([load(axis, upper, which) for which in range(dimension)])
        for axis in range(dimension)
        for upper in (False, True)
    ]
    return total(grid.blocks, jnp.stack(rows))


def _moment(force: Array, summed: Array, grid: Grid, side: tuple[int, bool], j: int) -> Array:
    """Sum of a force on the faces of a side, which is `summed`, times their coordinate along axis j."""
    axis, upper = side
    if j == axis:
        return (grid.size[axis] if upper else 0.0) * summed
    middle = grid.spacing[j] * (layer_number(grid, j, force) + 0.5)
    return jnp.sum(force * middle.reshape([-1 if a == j else 1 for a in range(grid.dimension)]))


def _end(upper: bool) -> tuple[int | None, int | None]:
    return (-1, None) if upper else (0, 1)


def _solved(grid: Grid, boundary: Boundary, axis: int, like: Array) -> Array:
    """Part of the control volume of every face of an axis whose velocity is solved for, over a cell: 0 on walls."""
    part = np.ones(grid.whole_cells[axis] + 1)
    if grid.periodic[axis]:
        part[-1] = 0.0  # the first face once more
    else:
        part[[0, -1]] = [0.5 * boundary.side(axis, upper).condition.sets_pressure for upper in (False, True)]
    own = of_slab(grid, part.reshape([-1 if a == axis else 1 for a in range(grid.dimension)]), like.dtype)
    if grid.cut_along(axis) is None:
        return own
    # The last face of a slab is the first one of the next.
    last = at_side(grid, axis, True, along(own, axis, -1, None), 0.0)
    return jnp.concatenate((along(own, axis, None, -1), last), axis)
