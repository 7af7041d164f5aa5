"""A second, lighter fluid beside the one of a scene: its numbers, what a cell holds of both, what is beyond the sides.

A cell of the liquid fraction c holds c of the first fluid, the liquid, and 1 - c of the second one:

    rho = rho_2 + c (rho_1 - rho_2),   1/mu = c/mu_1 + (1 - c)/mu_2.

The density keeps the mass. The viscosity is the harmonic mean, with which the shear stress is continuous across layers
along a surface, and with which mu/rho is nowhere much larger than in the pure fluids.

The pressure p of the solver is reduced by the weight of the liquid, p = P - rho_1 g.x. So in liquid at rest it is
constant, in the other fluid above it rises by (rho_1 - rho_2) |g| z.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.fluid.boundary import Boundary, Side, open_fraction
from jaxdem.fluid.carried_heat import HeatOfPhases
from jaxdem.fluid.dissolved import Dissolved
from jaxdem.fluid.grid import FaceField, Grid, along
from jaxdem.fluid.mesh import at_side, of_slab


class SecondFluid(NamedTuple):
    """Numbers of the second fluid; traced.

    Attributes:
        density: () [kg/m3].
        viscosity: () kinematic [m2/s].
        tension: () of the surface between both fluids [N/m].
        side_level: (2 D,) height along the last axis below which there is liquid beyond a side, lower sides before
            upper, axis by axis; of inlets and outlets [m].
        number: () int32, of the coupling interval in progress, and in a fluid step that of the step: it orders the axes
            of the transport. None for a step on its own, whose number is its time over its length.
        heat: of both fluids, which they carry; None without temperatures.
        dissolved: scalars that they carry.
    """

    density: Array
    viscosity: Array
    tension: Array
    side_level: Array
    number: Array | None = None
    heat: HeatOfPhases | None = None
    dissolved: tuple[Dissolved, ...] = ()

    def in_step(self, k: Array, count: Array) -> SecondFluid:
        """In step number k of `count` in an interval."""
        return self if self.number is None else self._replace(number=(self.number * count + k).astype(jnp.int32))

    def number_at(self, time: Array, time_step: Array) -> Array:
        """() int32, number of the step that begins at a time [s]. A time in float32 knows 2^24 of them apart."""
        return jnp.round(time / time_step).astype(jnp.int32) if self.number is None else self.number


def mixture_density(second: SecondFluid, density: Array, fraction: Array) -> Array:
    """Density of the content of cells with a liquid fraction [kg/m3]; `density` is that of the liquid."""
    return second.density + fraction * (density - second.density)


def mass_flux(second: SecondFluid, density: Array, flux: FaceField, liquid_flux: FaceField) -> FaceField:
    """Flux of mass through the faces, rho_2 f + (rho_1 - rho_2) f_1 [kg/(m2 s)].

    Args:
        second: the second fluid.
        density: of the liquid [kg/m3].
        flux, liquid_flux: f of both fluids together, and f_1 of the liquid [m/s].
    """
    return tuple(second.density * f + (density - second.density) * c for f, c in zip(flux, liquid_flux, strict=True))


def fluidity(second: SecondFluid, density: Array, viscosity: Array, fraction: Array) -> Array:
    """1/mu of the content of cells [1/(Pa s)]; density and kinematic viscosity are those of the liquid."""
    heavy, light = 1.0 / (density * viscosity), 1.0 / (second.density * second.viscosity)
    return light + fraction * (heavy - light)


def liquid_beyond(grid: Grid, second: SecondFluid, axis: int, upper: bool) -> Array:
    """Part of every face of a side beyond which there is liquid; size 1 along the axis of the side [-]."""
    level, last = second.side_level[2 * axis + upper], grid.dimension - 1
    if axis == last:
        here = grid.size[last] if upper else 0.0
        return jnp.where(level > here, 1.0, 0.0).astype(level.dtype).reshape((1,) * grid.dimension)
    h = grid.spacing[last]
    lower_ends = of_slab(grid, _upright(grid, h * np.arange(grid.whole_cells[last])), level.dtype)
    return jnp.clip((level - lower_ends) / h, 0.0, 1.0)


def _upright(grid: Grid, values: np.ndarray) -> np.ndarray:
    """Values along the last axis as an array on cells, of size 1 along the others."""
    return values.reshape([-1 if a == grid.dimension - 1 else 1 for a in range(grid.dimension)])


def inflow_of_sides(grid: Grid, boundary: Boundary, second: SecondFluid) -> tuple[Array | None, ...]:
    """Liquid's part of what comes in through every side, lower before upper, for `advance_fraction`; None where nothing
    passes [-]."""
    return tuple(
        liquid_beyond(grid, second, side.axis, side.upper) if side.kind in ("inlet", "outlet") else None
        for side in boundary.sides
    )


def outside_pressure(
    grid: Grid, second: SecondFluid, density: Array, gravity: Array, side: Side, fraction: Array
) -> Array:
    """Reduced pressure beyond every face of a side that sets it [Pa].

    (rho_1 - rho_2) |g| (z + max(L - z, 0) min(2 c, 1)): that of the second fluid at rest, and of liquid at rest below
    the level L, in one atmosphere of the second fluid for all sides. c is the liquid fraction of the cell at the side:
    liquid that stands higher outside than inside slumps there, and does not push gas with the weight of its depth.

    In the row of the level, of which the part b is below it, min(b, 1 - b) min(c/b, 1) h/2 is added to z: so high is
    the pressure there in layers at rest, whose weight between two rows is that of their mean density.

    Args:
        grid: the grid.
        second: the second fluid.
        density: of the liquid [kg/m3].
        gravity: (D,), its last entry counts [m/s2].
        side: of the box.
        fraction: c on the cells, of whole ones where walls cut them [-].
    """
    last, dtype = grid.dimension - 1, density.dtype
    beside = along(fraction, side.axis, *((-1, None) if side.upper else (0, 1)))
    share: Array | float = 0.0
    if side.axis == last:
        height = jnp.full((1,) * grid.dimension, grid.size[last] if side.upper else 0.0, dtype)
    else:
        middles = grid.spacing[last] * (np.arange(grid.whole_cells[last]) + 0.5)
        height = of_slab(grid, _upright(grid, middles), dtype)
        below = liquid_beyond(grid, second, side.axis, side.upper)
        partly = below > 0.0
        share = jnp.where(partly, jnp.minimum(1.0, 1.0 / jnp.where(partly, below, 1.0) - 1.0), 0.0)
        share = share * jnp.clip(beside, 0.0, below)
    level = second.side_level[2 * side.axis + side.upper]
    wet = jnp.clip(2.0 * beside, 0.0, 1.0)
    above = height + jnp.maximum(level - height, 0.0) * wet + 0.5 * grid.spacing[last] * share
    return (second.density - density) * gravity[last] * above


def with_outside_pressure(
    grid: Grid,
    boundary: Boundary,
    second: SecondFluid,
    density: Array,
    gravity: Array,
    slope: FaceField,
    fraction: Array,
) -> FaceField:
    """A pressure gradient on the faces that was taken with zero beyond the sides, with the pressure that is there,
    beside cells of a liquid fraction [Pa/m]."""
    result = list(slope)
    for side in boundary.sides:
        if not side.condition.sets_pressure:
            continue
        there = outside_pressure(grid, second, density, gravity, side, fraction)
        is_open = of_slab(grid, open_fraction(grid, side), density.dtype)
        more = is_open * there * ((2.0 if side.upper else -2.0) / grid.spacing[side.axis])
        place = (slice(None),) * side.axis + (slice(-1, None) if side.upper else slice(0, 1),)
        more = at_side(grid, side.axis, side.upper, more, 0.0)
        result[side.axis] = result[side.axis].at[place].add(jnp.broadcast_to(more, result[side.axis][place].shape))
    return tuple(result)


def with_closed_sides(grid: Grid, boundary: Boundary, faces: FaceField) -> FaceField:
    """A field that is zero on the sides of the box, continued to the closed ones from the nearest inner face: as
    `pressure_gradient` with `continued`."""
    result = list(faces)
    for side in boundary.sides:
        axis = side.axis
        if grid.periodic[axis] or grid.cells[axis] < 2:
            continue
        closed = 1.0 - of_slab(grid, open_fraction(grid, side), faces[axis].dtype)
        end, inner = (slice(-1, None), slice(-2, -1)) if side.upper else (slice(0, 1), slice(1, 2))
        before = (slice(None),) * axis
        more = at_side(grid, axis, side.upper, closed * faces[axis][(*before, inner)], 0.0)
        result[axis] = result[axis].at[(*before, end)].add(more)
    return tuple(result)


def through_sides(grid: Grid, flux: FaceField) -> Array:
    """(2 D,) volume per time that comes in through every side, lower before upper; zero along periodic axes; in a slab
    what passes there [m3/s]."""
    found = []
    for axis, faces in enumerate(flux):
        area = grid.cell_volume / grid.spacing[axis]
        for sign, ends in ((area, (0, 1)), (-area, (-1, None))):
            total = at_side(grid, axis, sign < 0.0, jnp.sum(along(faces, axis, *ends)), 0.0)
            found.append(0.0 * total if grid.periodic[axis] else sign * total)
    return jnp.stack(found)
