"""Temperatures and other scalars in what a run writes: frames, history and summary. Host side."""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxdem.errors import required
from jaxdem.setup.builder import Case
from jaxdem.state import State


def scalar_arrays(state: State, case: Case) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Arrays of a frame, of the particles and of the fluid; {} in a scene without scalars."""
    scalars, found = case.simulation.scalars, state.scalars
    if scalars is None or found is None:
        return {}, {}
    grains = {} if found.grains is None else {"temperature": np.asarray(found.grains)}
    return grains, {field.name: np.asarray(value) for field, value in zip(scalars.fields, found.fields, strict=True)}


def scalar_columns(state: State, case: Case) -> dict[str, float]:
    """Means for a row of history.csv: over the volume of the fluid, and over the heat capacity of the grains."""
    grains, fluid = scalar_arrays(state, case)
    found = {}
    share = None if state.fluid is None else state.fluid.void_fraction
    for name, values in fluid.items():
        column = "fluid_temperature_mean" if name == "temperature" else f"scalar_{name}_mean"
        weights = None if share is None else np.asarray(share, float)
        found[column] = float(np.average(np.asarray(values, float), weights=weights))
    if grains:
        capacity, values = np.asarray(_capacities(case), float), np.asarray(grains["temperature"], float)
        there = _present(state, len(values))
        weights = np.where(there, capacity, 0.0)
        found["particle_temperature_mean"] = float(np.average(values, weights=weights)) if there.any() else np.nan
    return found


def heat_content(state: State, case: Case) -> float:
    """Heat of fluid and grains, from zero of the scale of temperature [J]; 0 without."""
    return sum(_heat(state, case))


def heat_summary(state: State, case: Case, start: float) -> dict[str, Any]:
    """The balance of heat and of every scalar, for the summary; {} in a scene without.

    Args:
        state: at the end.
        case: that ran.
        start: `heat_content` of the first state [J].
    """
    scalars, found = case.simulation.scalars, state.scalars
    if scalars is None or found is None:
        return {}
    sides = np.asarray(found.supplied.sides, float)
    summary: dict[str, Any] = {}
    for number, field in enumerate(scalars.fields):
        if number != scalars.temperature:
            by_side = dict(zip(case.scene.sides, sides[number].tolist(), strict=True))
            summary.setdefault("scalars", {})[field.name] = {"through_sides": by_side}
    if scalars.heat is None:
        return summary
    fluid, grains = _heat(state, case)
    passed = np.zeros(len(case.scene.sides))
    if scalars.temperature is not None:
        passed = sides[scalars.temperature] * _volumetric(case)
    walls, brought = float(found.supplied.walls), float(found.supplied.grains)
    missing = fluid + grains - start - float(np.sum(passed)) - walls - brought
    summary["heat"] = {
        "start": start,
        "fluid": fluid,
        "grains": grains,
        "through_sides": dict(zip(case.scene.sides, passed.tolist(), strict=True)),
        "from_walls_to_grains": walls,
        "brought_by_grains": brought,
        "missing": missing,
        "missing_relative": missing / max(abs(start), float(np.sum(np.abs(passed))), abs(walls), 1e-300),
    }
    return summary


def _heat(state: State, case: Case) -> tuple[float, float]:
    """Heat of the fluid and of the grains [J]."""
    scalars, found = case.simulation.scalars, state.scalars
    fluid = grains = 0.0
    if scalars is None or found is None or scalars.heat is None:
        return fluid, grains
    if scalars.temperature is not None and state.fluid is not None:
        share = 1.0 if state.fluid.void_fraction is None else np.asarray(state.fluid.void_fraction, float)
        volume = required(case.simulation.fluid, "fluid").solver.grid.cell_volume
        values = np.asarray(found.fields[scalars.temperature], float)
        fluid = _volumetric(case) * volume * float(np.sum(share * values))
    if found.grains is not None:
        values = np.asarray(found.grains, float)
        grains = float(np.sum(np.where(_present(state, len(values)), _capacities(case) * values, 0.0)))
    return fluid, grains


def _volumetric(case: Case) -> float:
    """Heat capacity of the fluid by volume [J/(m3 K)]."""
    numbers = required(required(case.parameters.scalars, "scalars").fluid, "heat of the fluid")
    return float(case.parameters.flow.density) * float(numbers.capacity)


def _capacities(case: Case) -> np.ndarray:
    """() or (N,) of the grains [J/K]."""
    numbers = required(required(case.parameters.scalars, "scalars").grains, "heat of the grains")
    return np.asarray(numbers.of_each(required(case.parameters.bodies, "bodies")), float)


def _present(state: State, count: int) -> np.ndarray:
    """(N,) bool, grains that are there."""
    active = None if state.particles is None else state.particles.active
    return np.ones(count, bool) if active is None else np.asarray(active)
