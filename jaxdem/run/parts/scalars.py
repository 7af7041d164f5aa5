"""Temperatures and other scalars in what a run writes: frames, history and summary. Host side."""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxdem.errors import required
from jaxdem.run.instant import Instant, present
from jaxdem.run.parts.part import Arrays, Part
from jaxdem.run.totals import Means, Totals
from jaxdem.setup.builder import Case
from jaxdem.state import State


class Temperatures(Part):
    """Temperatures of fluid and grains, and what else the fluid carries."""

    name = "heat"

    def arrays(self, case: Case, instant: Instant) -> dict[str, Arrays]:
        """`temperature` of the grains; of the fluid every scalar by its name."""
        scalars, found = case.simulation.scalars, instant.state.scalars
        if scalars is None or found is None:
            return {}
        grains = {} if found.grains is None else {"temperature": np.asarray(found.grains)}
        fields = zip(scalars.fields, found.fields, strict=True)
        return {"particles": grains, "fluid": {field.name: np.asarray(value) for field, value in fields}}

    def columns(self, case: Case, instant: Instant, means: Means) -> dict[str, float]:
        """Means over the volume of the fluid, and over the heat capacity of the grains."""
        arrays, state, found = self.arrays(case, instant), instant.state, {}
        share = None if state.fluid is None else state.fluid.void_fraction
        for name, values in arrays.get("fluid", {}).items():
            column = "fluid_temperature_mean" if name == "temperature" else f"scalar_{name}_mean"
            weights = None if share is None else np.asarray(share, float)
            found[column] = float(np.average(np.asarray(values, float), weights=weights))
        if grains := arrays.get("particles"):
            capacity, values = np.asarray(_capacities(case), float), np.asarray(grains["temperature"], float)
            there = present(state, len(values))
            weights = np.where(there, capacity, 0.0)
            found["particle_temperature_mean"] = float(np.average(values, weights=weights)) if there.any() else np.nan
        return found

    def start(self, case: Case, instant: Instant) -> float:
        """Heat of fluid and grains, from zero of the scale of temperature [J]; 0 without."""
        return sum(_heat(instant.state, case))

    def summary(self, case: Case, instant: Instant, totals: Totals) -> dict[str, Any]:
        """The balance of heat and of every scalar."""
        scalars, found = case.simulation.scalars, instant.state.scalars
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
        passed = np.zeros(len(case.scene.sides))
        if scalars.temperature is not None:
            passed = sides[scalars.temperature] * _volumetric(case)
        kept = totals.at_start.get(self.name)
        summary["heat"] = heat_balance(case, instant.state, kept if isinstance(kept, float) else 0.0, passed)
        return summary


def heat_balance(case: Case, state: State, start: float, passed: np.ndarray) -> dict[str, Any]:
    """Heat at the end, where it came from, and what is missing [J].

    Args:
        case: that ran.
        state: at the end.
        start: heat of the first state [J].
        passed: (2 D,) that came in through every side [J].
    """
    supplied = required(state.scalars, "scalars").supplied
    fluid, grains = _heat(state, case)
    walls, brought = float(supplied.walls), float(supplied.grains)
    missing = fluid + grains - start - float(np.sum(passed)) - walls - brought
    return {
        "start": start,
        "fluid": fluid,
        "grains": grains,
        "through_sides": dict(zip(case.scene.sides, passed.tolist(), strict=True)),
        "from_walls_to_grains": walls,
        "brought_by_grains": brought,
        "missing": missing,
        "missing_relative": missing / max(abs(start), float(np.sum(np.abs(passed))), abs(walls), 1e-300),
    }


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
        grains = float(np.sum(np.where(present(state, len(values)), _capacities(case) * values, 0.0)))
    return fluid, grains


def _volumetric(case: Case) -> float:
    """Heat capacity of the fluid by volume [J/(m3 K)]."""
    numbers = required(required(case.parameters.scalars, "scalars").fluid, "heat of the fluid")
    return float(case.parameters.flow.density) * float(numbers.capacity)


def _capacities(case: Case) -> np.ndarray:
    """() or (N,) of the grains [J/K]."""
    numbers = required(required(case.parameters.scalars, "scalars").grains, "heat of the grains")
    return np.asarray(numbers.of_each(required(case.parameters.bodies, "bodies")), float)
