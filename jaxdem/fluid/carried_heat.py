"""Heat that two fluids with a sharp surface carry, by the flux that moves the surface.

    d(g C T)/dt + div(Phi T) = 0,   C = C_2 + c (C_1 - C_2),   Phi = C_2 F + (C_1 - C_2) F_c

C is the heat capacity of the content of a cell by volume, C_i = rho_i c_i that of either fluid, F the flux of both
fluids and F_c the flux of the liquid that has moved the surface. g C changes by Phi alone. So the heat of both fluids
changes by what passes the sides of the box, a uniform temperature stays uniform at any ratio of the capacities, and hot
liquid does not give its heat to gas that takes its place. A cell has one temperature.

One axis follows the other, in the order of the surface: liquid may pass a corner of a cell in a step, and has to be
there with its heat before it leaves. No cell is left with less than none of either fluid, so what leaves a cell in a
sweep is a part of what it holds, and temperatures stay between those around up to `volume_of_fluid.SURFACE_COURANT`.
What leaves has the mean over the part of the cell that it comes from, with van Leer's slope.

The temperature is carried less its mean over the box: what the flux fails continuity by, in the tolerance of the
pressure solver, would be times the temperature itself.

Source: Weymouth & Yue as in `volume_of_fluid`; heat by their flux as M. Rudman, Int. J. Numer. Meth. Fluids 28 (1998)
357-378, has momentum. Derived here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.advection import VanLeer
from jaxdem.fluid.grid import CellOrOne, FaceField, Grid, along, box_mean, face_average, own_layers
from jaxdem.fluid.mesh import Ends, at_side, beyond, with_ends
from jaxdem.fluid.sweeps import in_order


class HeatOfPhases(NamedTuple):
    """Numbers of the heat of two fluids; traced. Pairs are of the liquid and of the second fluid.

    Attributes:
        capacity: by volume, C_1 and C_2 [J/(m3 K)].
        expansion: rho beta, by which they are lighter where they are warmer [kg/(m3 K)]; None compiles none.
        reference: () temperature at which they have their densities [K].
        inflow: of every side, lower before upper: temperature of what comes in, None for that of the cell there [K].
    """

    capacity: tuple[Array, Array]
    expansion: tuple[Array, Array] | None
    reference: Array
    inflow: tuple[Array | None, ...]

    def content(self, fraction: Array, void_fraction: CellOrOne) -> Array:
        """g C of cells with a liquid fraction [J/(m3 K)]."""
        return void_fraction * mixed(self.capacity, fraction)

    def carrier(self, flux: FaceField, liquid_flux: FaceField) -> FaceField:
        """Phi on the faces, of the volume fluxes of both fluids and of the liquid [J/(m2 s K)]."""
        liquid, second = self.capacity
        return tuple(second * f + (liquid - second) * c for f, c in zip(flux, liquid_flux, strict=True))


class CarriedHeat(NamedTuple):
    """The heat of two fluids within a coupling interval.

    Attributes:
        temperature: on the cells [K].
        through_sides: (2 D,) heat that came in through every side since the start of the interval, lower before upper
            [J].
    """

    temperature: Array
    through_sides: Array


def mixed(pair: tuple[Array, Array], fraction: Array) -> Array:
    """The mean of a quantity by volume of liquid and second fluid in cells with a liquid fraction."""
    liquid, second = pair
    return second + fraction * (liquid - second)


def lightened(
    grid: Grid, numbers: HeatOfPhases | None, heat: CarriedHeat | None, fraction: Array, void_fraction: CellOrOne
) -> FaceField | None:
    """Mass by the volume of the box that warm fluid lacks on the faces, the mean of two cells [kg/m3]: g c rho_1 beta_1
    (T - T_0) and the same of the second fluid (Boussinesq). None where nothing expands."""
    if numbers is None or heat is None or numbers.expansion is None:
        return None
    warmth = heat.temperature - numbers.reference
    return face_average(grid, void_fraction * mixed(numbers.expansion, fraction) * warmth)  # type: ignore[return-value]


def carried_heat(
    grid: Grid,
    numbers: HeatOfPhases,
    heat: CarriedHeat,
    carrier: FaceField,
    contents: tuple[Array, Array],
    step: Array,
    order: Array,
) -> CarriedHeat:
    """The heat after a step of the fluids.

    Args:
        grid: the grid.
        numbers: of both fluids.
        heat: at the start.
        carrier: Phi, mean over the step, on the faces [J/(m2 s K)].
        contents: g C of the cells at the start and at the end, which differ by what Phi brings [J/(m3 K)].
        step: () [s].
        order: () int, number of the step, see `sweeps`.
    """
    mean, (before, after) = box_mean(grid, heat.temperature), contents
    own = heat.temperature - mean
    inflow = tuple(None if value is None else value - mean for value in numbers.inflow)
    sweeps = [
        _sweep(grid, inflow[2 * axis : 2 * axis + 2], carrier[axis], step, axis) for axis in range(grid.dimension)
    ]
    start = _Sweeping(before * own, before, jnp.zeros_like(heat.through_sides))
    found = in_order(sweeps, order, start)
    passed = heat.through_sides + found.passed + mean * _through_sides(grid, carrier, step)
    return CarriedHeat(mean + found.heat / after, passed)


class _Sweeping(NamedTuple):
    """Between the sweeps of a step.

    Attributes:
        heat: of the cells by volume, from the mean temperature of the box [J/m3].
        capacity: of the cells by volume [J/(m3 K)].
        passed: see `CarriedHeat.through_sides`, from the mean temperature [J].
    """

    heat: Array
    capacity: Array
    passed: Array


def _sweep(
    grid: Grid, inflow: tuple[Array | None, ...], carrier: Array, step: Array, axis: int
) -> Callable[[_Sweeping, Array], _Sweeping]:
    """The transport along one axis."""

    def swept(carry: _Sweeping, _: Array) -> _Sweeping:
        passing = (step / grid.spacing[axis]) * carrier
        value = carry.heat / carry.capacity
        carried = passing * _value_of_passing(grid, inflow, value, passing, carry.capacity, axis)
        heat, capacity = (
            content - (along(through, axis, 1, None) - along(through, axis, None, -1))
            for content, through in ((carry.heat, carried), (carry.capacity, passing))
        )
        return _Sweeping(heat, capacity, carry.passed + _at_ends(grid, carried, axis))

    return swept


def _value_of_passing(
    grid: Grid, inflow: tuple[Array | None, ...], value: Array, passing: Array, capacity: Array, axis: int
) -> Array:
    """Value of what passes the faces of an axis: of the cell that it comes from, with (1 - p) of half the slope, p the
    part of the cell's capacity that leaves.

    Then what stays differs from the value of the cell by half a slope at most, whatever leaves through two faces.
    """
    lower, upper = _beside(grid, value, axis)
    behind, ahead = value - along(lower, axis, None, -1), along(upper, axis, 1, None) - value
    half = _beside(grid, 0.5 * VanLeer().slope(behind, ahead), axis)
    held = _beside(grid, capacity, axis)
    left, right = (1.0 - jnp.clip(jnp.abs(passing) / c, 0.0, 1.0) for c in held)
    found = jnp.where(passing > 0.0, lower + half[0] * left, upper - half[1] * right)
    if grid.periodic[axis]:
        return found
    ends = []
    for given, place, sign in zip(inflow, ((0, 1), (-1, None)), (1.0, -1.0), strict=True):
        own = along(found, axis, *place)
        ends.append(own if given is None else jnp.where(sign * along(passing, axis, *place) > 0.0, given, own))
    return with_ends(grid, axis, found, (ends[0], ends[1]))


def _beside(grid: Grid, cells: Array, axis: int) -> Ends:
    """The cells below and above every face of an axis; beyond a side its own cell."""
    ends = beyond(grid, axis, cells, (-1,), (0,), own_layers(cells, axis))
    wide = jnp.concatenate((ends[0], cells, ends[1]), axis)
    return along(wide, axis, None, -1), along(wide, axis, 1, None)


def _at_ends(grid: Grid, passing: Array, axis: int) -> Array:
    """(2 D,) what comes in through the two sides across an axis, of what passes its faces over the volume of a cell;
    zero for the others and along periodic axes; in a slab what passes there."""
    found = jnp.zeros(2 * grid.dimension, passing.dtype)
    if grid.periodic[axis]:
        return found
    lower, upper = (
        at_side(grid, axis, is_upper, jnp.sum(along(passing, axis, *place)), 0.0)
        for is_upper, place in ((False, (0, 1)), (True, (-1, None)))
    )
    return found.at[2 * axis : 2 * axis + 2].set(grid.cell_volume * jnp.stack((lower, -upper)))


def _through_sides(grid: Grid, carrier: FaceField, step: Array) -> Array:
    """(2 D,) heat capacity that comes in through every side in a step [J/K]."""
    parts = [
        _at_ends(grid, (step / h) * f, axis) for axis, (h, f) in enumerate(zip(grid.spacing, carrier, strict=True))
    ]
    return sum(parts[1:], parts[0])
