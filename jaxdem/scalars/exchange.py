"""Exchange of heat between grains and the fluid in whose cells they are, over a coupling interval.

    C_p dT_p/dt = H_p (T_f - T_p),   H_p = Nu k pi d,

with T_f the temperature of the fluid at the grain. Both sides are implicit, so the step may be far longer than the
time in which gas in a bed takes the temperature of the grains: with K_p = C_p (1 - exp(-H_p t / C_p)) / t, which is
exact for a grain in a fluid of constant temperature, and T* the fluid before the exchange, a cell changes by

    dT_c = t S_c / (C_c + t R_c),   R_c = sum_p w_pc K_p,   S_c = sum_p w_pc K_p (T_p - T*_f),

and a grain gives Q_p = K_p (T_p - T*_f - sum_c w_pc dT_c). Term by term the sums over cells and grains are equal: heat
is kept to rounding. Derived here.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.coupling.interpolation import Weights, deposit, interpolate
from jaxdem.fluid.grid import Grid


def exchanged(
    grid: Grid,
    weights: Weights,
    fluid: Array,
    grains: Array,
    conductance: Array,
    capacities: tuple[Array, Array],
    duration: Array,
) -> tuple[Array, Array]:
    """Temperatures of the cells and of the grains after the exchange [K].

    Args:
        grid: the grid.
        weights: of the N grains.
        fluid: temperature of the cells [K].
        grains: (N,) [K].
        conductance: (N,) H_p, zero of grains that are not present [W/K].
        capacities: C_c of the fluid in the cells, and C_p () or (N,) of the grains [J/K].
        duration: t [s].
    """
    of_cells, of_grains = capacities
    response = -of_grains * jnp.expm1(-conductance * duration / of_grains) / duration
    apart = grains - interpolate(weights, (fluid,))[:, 0]
    resistance, supply = deposit(grid, weights, response), deposit(grid, weights, response * apart)
    change = duration * supply / (of_cells + duration * resistance)
    given = response * (apart - interpolate(weights, (change,))[:, 0])
    return fluid + change, grains - duration * given / of_grains
