"""What passes the boundaries that let the fluid pass, in what a run writes: history and summary. Host side."""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxdem.errors import required
from jaxdem.io.part_columns import PASSING
from jaxdem.run.instant import Instant, open_cells
from jaxdem.run.parts.part import Part
from jaxdem.run.totals import Means, Totals
from jaxdem.setup.builder import Case


class Passages(Part):
    """Inlets and outlets of the box, and openings of walls."""

    name = "fluid_volume"

    def columns(self, case: Case, instant: Instant, means: Means) -> dict[str, float]:
        """Mean volume per time since the last output that came in and that left; not of a side that only a condition of
        the user's lets pass, of which the scene does not know [m3/s]."""
        keys, sides = _boundaries(case), case.scene.boundary
        found: dict[str, float] = {}
        for key, flows in zip(keys, _of_each(case, means.passed), strict=True):
            if key not in sides or sides[key].kind in ("inlet", "outlet"):
                name = key.replace("walls.", "wall_").replace(".", "_")
                found |= {f"{kind}_{name}": flow for kind, flow in flows.items()}
        return found

    def start(self, case: Case, instant: Instant) -> float | None:
        """Volume of the fluid [m3]; None where none may pass."""
        return _volume(case, instant) if _boundaries(case) else None

    def summary(self, case: Case, instant: Instant, totals: Totals) -> dict[str, Any]:
        """The balance of the volume of the fluid [m3]; without what is missing where walls change their place, which
        take up volume too."""
        start, moving = totals.at_start.get(self.name), case.simulation.walls_in_fluid
        if not (keys := _boundaries(case)) or not isinstance(start, float):  # a run that a version before began
            return {}
        interval, end = case.simulation.interval, _volume(case, instant)
        passed = np.asarray(totals.passed) * interval if totals.passed else None
        through = dict(zip(keys, _of_each(case, passed), strict=True))
        found: dict[str, Any] = {"start": start, "end": end, "through": through}
        if moving is None or not moving.change_place:
            missing = end - start - sum(one["inflow"] - one["outflow"] for one in through.values())
            turned_over = max(start, *(max(one["inflow"], one["outflow"]) for one in through.values()), 1e-300)
            found |= {"missing": missing, "missing_relative": missing / turned_over}
        return {"fluid_volume": found}


def _boundaries(case: Case) -> tuple[str, ...]:
    """Names of the sides of the box that fluid may pass, and keys of the openings of walls; none without fluid."""
    if case.simulation.fluid is None:
        return ()
    sides, passable = case.scene.sides, case.simulation.boundary.passable
    return (*(sides[number] for number in passable), *(one.key for one in case.fluid_walls.openings))


def _of_each(case: Case, passed: np.ndarray | None) -> list[dict[str, float]]:
    """What passed every boundary, by how it did; zero for None."""
    keys, kinds = _boundaries(case), PASSING[: 4 if case.scene.surface else 2]
    rows = np.reshape(np.zeros(len(keys) * len(kinds)) if passed is None else passed, (len(keys), len(kinds)))
    return [dict(zip(kinds, row, strict=True)) for row in rows.tolist()]


def _volume(case: Case, instant: Instant) -> float:
    """Of the fluid: what grains and walls leave [m3]."""
    fluid = required(instant.state.fluid, "state.fluid")
    grid = required(case.simulation.fluid, "fluid").solver.grid
    room = open_cells(case, instant)
    room = np.ones(grid.cells) if room is None else room
    gaps = 1.0 if fluid.void_fraction is None else np.asarray(fluid.void_fraction, float)
    return grid.cell_volume * float(np.sum(room * gaps))
