"""Temperatures of a scene with two fluids and a sharp surface: numbers of the second one, and the first state."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jax import Array

from jaxdem.errors import required
from jaxdem.scalars.scalar_state import SecondHeat
from jaxdem.scene import Scene


def second_heat(scene: Scene, number: Callable[[float | list[float]], Array]) -> SecondHeat | None:
    """The numbers of a second fluid; None without one, or without temperatures."""
    table = scene.surface
    if table is None or table.heat_capacity is None or table.conductivity is None:
        return None
    return SecondHeat(number(table.heat_capacity), number(table.conductivity), number(table.expansion))


def largest_diffusivity(scene: Scene) -> float:
    """Largest diffusivity of a cell of two fluids, 2 k_n k / ((k_n + k) C) beside cells that conduct best; it is that
    of a cell full of either [m2/s]. 0 with one fluid."""
    heat, fluid, surface = scene.heat, scene.fluid, scene.surface
    if heat is None or fluid is None or surface is None:
        return 0.0
    conductivities = required(heat.fluid_conductivity, "conductivity"), required(surface.conductivity, "conductivity")
    capacities = (
        fluid.density * required(heat.fluid_heat_capacity, "capacity"),
        surface.density * required(surface.heat_capacity, "capacity"),
    )
    best = max(conductivities)
    return max(2.0 * best * k / ((best + k) * c) for k, c in zip(conductivities, capacities, strict=True))


def first_temperature(scene: Scene, liquid: np.ndarray) -> np.ndarray:
    """Temperature of cells with a liquid fraction at the start, which holds the heat of both fluids [K]."""
    heat, fluid = required(scene.heat, "heat"), required(scene.fluid, "fluid")
    surface = required(scene.surface, "surface")
    of_liquid = fluid.density * required(heat.fluid_heat_capacity, "capacity") * liquid
    of_second = surface.density * required(surface.heat_capacity, "capacity") * (1.0 - liquid)
    warm = required(heat.fluid_temperature, "fluid_temperature")
    second = warm if surface.temperature is None else surface.temperature
    return warm + (second - warm) * of_second / (of_liquid + of_second)
