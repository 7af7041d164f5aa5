"""Heat that two fluids with a sharp surface carry, by the flux that moves the surface.

    d(g C T)/dt + div(Phi T) = 0,   C = C_2 + c (C_1 - C_2),   Phi = C_2 F + (C_1 - C_2) F_c

C is the heat capacity of the content of a cell by volume, C_i = rho_i c_i that of either fluid, F the flux of both
fluids and F_c the flux of the liquid that has moved the surface. g C changes by Phi alone. So the heat of both fluids
changes by what passes the sides of the box, a uniform temperature stays uniform at any ratio of the capacities, and hot
liquid does not give its heat to gas that takes its place. A cell has one temperature. See `phase_transport`.

The temperature is carried less its mean over the box: what the flux fails continuity by, in the tolerance of the
pressure solver, would be times the temperature itself.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.grid import CellOrOne, FaceField, Grid, box_mean, face_average
from jaxdem.fluid.phase_transport import Held, Transport


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
        return mixed_flux(self.capacity, flux, liquid_flux)


class CarriedHeat(NamedTuple):
    """The heat of two fluids within a coupling interval.

    Attributes:
        temperature: on the cells [K].
        through_sides: (2 D,) heat that came in through every side since the start of the interval, lower before upper
            [J].
    """

    temperature: Array
    through_sides: Array


def mixed(pair: tuple[CellOrOne, CellOrOne], fraction: Array) -> Array:
    """The mean of a quantity by volume of liquid and second fluid in cells with a liquid fraction."""
    liquid, second = pair
    return second + fraction * (liquid - second)


def mixed_flux(pair: tuple[CellOrOne, CellOrOne], flux: FaceField, liquid_flux: FaceField) -> FaceField:
    """The flux of a quantity by volume of liquid and second fluid, of the volume fluxes of both and of the liquid."""
    liquid, second = pair
    return tuple(second * f + (liquid - second) * c for f, c in zip(flux, liquid_flux, strict=True))


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
    transport = Transport(grid, carrier, inflow, step, order)
    found = transport.carried(Held(before * own, before, jnp.zeros_like(heat.through_sides)))
    passed = heat.through_sides + found.passed + mean * transport.through_sides()
    return CarriedHeat(mean + found.content / after, passed)
