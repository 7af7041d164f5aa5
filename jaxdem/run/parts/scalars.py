"""Temperatures and other scalars in what a run writes: frames, history and summary. Host side."""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxdem.errors import required
from jaxdem.fluid.carried_heat import mixed
from jaxdem.fluid.dissolved import PART, least_volume
from jaxdem.fluid.scalar_transport import ScalarField
from jaxdem.run.instant import Instant, present
from jaxdem.run.parts.part import Arrays, Part
from jaxdem.run.totals import Means, Totals
from jaxdem.scalars.in_cells import fluid_share
from jaxdem.scalars.phases import capacities
from jaxdem.scalars.scalars import TEMPERATURE
from jaxdem.setup.builder import Case
from jaxdem.state import State


class Temperatures(Part):
    """Temperatures of fluid and grains, and what else the fluid carries."""

    name = "heat"

    def arrays(self, case: Case, instant: Instant) -> dict[str, Arrays]:
        """`temperature` of the grains; of the fluid every scalar by its name, of two fluids 0 in cells without the one
        that it is dissolved in."""
        scalars, found = case.simulation.scalars, instant.state.scalars
        if scalars is None or found is None:
            return {}
        grains = {} if found.grains is None else {"temperature": np.asarray(found.grains)}
        fields = zip(scalars.fields, found.fields, strict=True)
        fluid = {field.name: _seen(instant.state, field, np.asarray(value)) for field, value in fields}
        return {"particles": grains, "fluid": fluid}

    def columns(self, case: Case, instant: Instant, means: Means) -> dict[str, float]:
        """Means over the volume of the fluid, and over the heat capacity of the grains."""
        arrays, state, found = self.arrays(case, instant), instant.state, {}
        own = {} if case.simulation.scalars is None else {field.name: field for field in case.simulation.scalars.fields}
        for name, values in arrays.get("fluid", {}).items():
            column = "fluid_temperature_mean" if name == "temperature" else f"scalar_{name}_mean"
            part = 1.0 if name == TEMPERATURE else _part(state, own[name])
            weights = np.broadcast_to(_room(case, state) * part, values.shape)
            found[column] = float(np.average(np.asarray(values, float), weights=weights)) if weights.any() else np.nan
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
        """The balance of heat."""
        scalars, found = case.simulation.scalars, instant.state.scalars
        if scalars is None or found is None:
            return {}
        if scalars.heat is None:
            return {}
        sides = np.asarray(found.supplied.sides, float)
        passed = np.zeros(len(case.scene.sides) + len(case.fluid_walls.walls))
        if scalars.temperature is not None:
            # Of two fluids, whose capacity is not one number, what has passed is heat already.
            passed = sides[scalars.temperature] * (1.0 if case.scene.surface else _volumetric(case))
        kept = totals.at_start.get(self.name)
        return {"heat": heat_balance(case, instant.state, kept if isinstance(kept, float) else 0.0, passed)}


class Contents(Part):
    """What the fluid holds of the scalars that are no temperature."""

    name = "scalars"

    def start(self, case: Case, instant: Instant) -> tuple[float, ...] | None:
        """Of every scalar, the concentration summed over the volume [unit m3]; None without."""
        return tuple(_contents(instant.state, case).values()) or None

    def summary(self, case: Case, instant: Instant, totals: Totals) -> dict[str, Any]:
        """The balance of every scalar."""
        scalars, found = case.simulation.scalars, instant.state.scalars
        contents, start = _contents(instant.state, case), totals.at_start.get(self.name)
        if not contents or scalars is None or found is None:
            return {}
        sides, balances = np.asarray(found.supplied.sides, float), {}
        passed = {field.name: sides[number] for number, field in enumerate(scalars.fields)}
        for number, (name, end) in enumerate(contents.items()):
            own: dict[str, Any] = {"end": end, **_by_place(case, passed[name])}
            if isinstance(start, tuple) and len(start) == len(contents):
                missing = end - start[number] - float(np.sum(passed[name]))
                turned_over = max(abs(start[number]), float(np.sum(np.abs(passed[name]))), 1e-300)
                own = {"start": start[number], **own, "missing": missing, "missing_relative": missing / turned_over}
            balances[name] = own
        return {"scalars": balances}


def heat_balance(case: Case, state: State, start: float, passed: np.ndarray) -> dict[str, Any]:
    """Heat at the end, where it came from, and what is missing [J].

    Args:
        case: that ran.
        state: at the end.
        start: heat of the first state [J].
        passed: (2 D + S,) that came in through every side, and from every surface that the fluid sees [J].
    """
    supplied = required(state.scalars, "scalars").supplied
    fluid, grains = _heat(state, case)
    walls, brought = float(supplied.walls), float(supplied.grains)
    rubbed = 0.0 if supplied.friction is None else float(supplied.friction)
    missing = fluid + grains - start - float(np.sum(passed)) - walls - brought - rubbed
    turned_over = max(abs(start), float(np.sum(np.abs(passed))), abs(walls), abs(brought), abs(rubbed), 1e-300)
    return {
        "start": start,
        "fluid": fluid,
        "grains": grains,
        **_by_place(case, passed),
        "from_walls_to_grains": walls,
        "brought_by_grains": brought,
        **({} if supplied.friction is None else {"from_friction": rubbed}),
        "missing": missing,
        "missing_relative": missing / turned_over,
    }


def _by_place(case: Case, passed: np.ndarray) -> dict[str, dict[str, float]]:
    """What came in through every side, and from every wall that the fluid sees, by its name or number."""
    sides = case.scene.sides
    found = {"through_sides": dict(zip(sides, passed[: len(sides)].tolist(), strict=True))}
    of_walls: dict[str, float] = {}
    for wall, amount in zip(case.fluid_walls.walls, passed[len(sides) :].tolist(), strict=True):
        name = case.scene.walls[wall].name or str(wall)
        of_walls[name] = of_walls.get(name, 0.0) + amount
    return found | ({"from_walls_to_fluid": of_walls} if of_walls else {})


def _heat(state: State, case: Case) -> tuple[float, float]:
    """Heat of the fluid and of the grains [J]."""
    scalars, found = case.simulation.scalars, state.scalars
    fluid = grains = 0.0
    if scalars is None or found is None or scalars.heat is None:
        return fluid, grains
    if scalars.temperature is not None and state.fluid is not None:
        share = _room(case, state)
        volume = required(case.simulation.fluid, "fluid").solver.grid.cell_volume
        values = np.asarray(found.fields[scalars.temperature], float)
        fraction = state.fluid.liquid_fraction
        capacity = _volumetric(case) if fraction is None else _of_phases(case, np.asarray(fraction, float))
        fluid = volume * float(np.sum(capacity * share * values))
    if found.grains is not None:
        values = np.asarray(found.grains, float)
        grains = float(np.sum(np.where(present(state, len(values)), _capacities(case) * values, 0.0)))
    return fluid, grains


def _room(case: Case, state: State) -> np.ndarray | float:
    """What of the cells is open to a scalar of the fluid [-]."""
    fluid, found = required(state.fluid, "state.fluid"), required(state.scalars, "scalars")
    if found.capacity is not None:
        return np.asarray(found.capacity, float)
    share = 1.0 if fluid.void_fraction is None else np.asarray(fluid.void_fraction, float)
    cut = None if case.parameters.fluid is None else case.parameters.fluid.cut
    if cut is None:
        return share
    volumes = fluid_share(required(case.parameters.scalars, "scalars").walls, cut, share)  # type: ignore[arg-type]
    return np.where(np.asarray(cut.open_cells) > 0.0, np.asarray(volumes, float), 0.0)


def _part(state: State, field: ScalarField) -> np.ndarray | float:
    """Part of what is open in the cells that holds the fluid which a scalar is dissolved in [-]."""
    fraction = required(state.fluid, "state.fluid").liquid_fraction
    return 1.0 if fraction is None else np.asarray(mixed(PART[field.phase], np.asarray(fraction, float)))  # type: ignore[arg-type]


def _seen(state: State, field: ScalarField, values: np.ndarray) -> np.ndarray:
    """A scalar as frames have it."""
    if state.fluid is None or state.fluid.liquid_fraction is None or field.name == TEMPERATURE:
        return values
    part = np.asarray(_part(state, field))
    return np.where(part > least_volume(values), values, 0.0).astype(values.dtype)


def _contents(state: State, case: Case) -> dict[str, float]:
    """Concentration of every scalar that is no temperature, summed over the volume of its fluid [unit m3]; by name."""
    scalars, found = case.simulation.scalars, state.scalars
    if scalars is None or found is None or state.fluid is None:
        return {}
    volume, room = required(case.simulation.fluid, "fluid").solver.grid.cell_volume, _room(case, state)
    return {
        field.name: volume * float(np.sum(room * _part(state, field) * np.asarray(value, float)))  # type: ignore[operator]
        for field, value in zip(scalars.fields, found.fields, strict=True)
        if field.name != TEMPERATURE
    }


def _volumetric(case: Case) -> float:
    """Heat capacity of the fluid by volume [J/(m3 K)]."""
    numbers = required(required(case.parameters.scalars, "scalars").fluid, "heat of the fluid")
    return float(case.parameters.flow.density) * float(numbers.capacity)


def _of_phases(case: Case, fraction: np.ndarray) -> np.ndarray:
    """The same of two fluids with a liquid fraction."""
    liquid, second = map(float, capacities(required(case.parameters.scalars, "scalars"), case.parameters.flow))
    return second + fraction * (liquid - second)


def _capacities(case: Case) -> np.ndarray:
    """() or (N,) of the grains [J/K]."""
    numbers = required(required(case.parameters.scalars, "scalars").grains, "heat of the grains")
    return np.asarray(numbers.of_each(required(case.parameters.bodies, "bodies")), float)
