"""Two fluids in what a run writes: frames, history and summary. Host side."""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxdem.errors import required
from jaxdem.run.instant import Instant
from jaxdem.run.parts.part import Part
from jaxdem.run.totals import Means, Totals
from jaxdem.setup.builder import Case
from jaxdem.state import State


class TwoFluids(Part):
    """A second fluid with a sharp surface."""

    def arrays(self, case: Case, instant: Instant) -> dict[str, dict[str, np.ndarray]]:
        """The liquid fraction of the cells."""
        fluid = instant.state.fluid
        if fluid is None or fluid.liquid_fraction is None:
            return {}
        return {"fluid": {"liquid_fraction": np.asarray(fluid.liquid_fraction)}}

    def columns(self, case: Case, instant: Instant, means: Means) -> dict[str, float]:
        """Volume of the liquid, and height of its centre."""
        fluid = instant.state.fluid
        if fluid is None or fluid.liquid_fraction is None:
            return {}
        liquid = _liquid(instant.state, case)
        volume, grid = float(liquid.sum()), required(case.simulation.fluid, "fluid").solver.grid
        height = grid.spacing[-1] * (np.arange(grid.cells[-1]) + 0.5)
        centre = float((liquid * height).sum()) / volume if volume > 0.0 else np.nan
        return {"liquid_volume": volume, "liquid_centre_height": centre}

    def summary(self, case: Case, instant: Instant, totals: Totals) -> dict[str, Any]:
        """The balance of the volume of the liquid [m3], and how far its fraction is from 0 ... 1 [-]."""
        fluid = instant.state.fluid
        if fluid is None or fluid.liquid_fraction is None or fluid.liquid_supplied is None:
            return {}
        start, *sides = np.asarray(fluid.liquid_supplied, float).tolist()
        volume, fraction = float(_liquid(instant.state, case).sum()), np.asarray(fluid.liquid_fraction, float)
        missing = volume - start - sum(sides)
        return {
            "liquid_phase": {
                "start": start,
                "end": volume,
                "through_sides": dict(zip(case.scene.sides, sides, strict=True)),
                "missing": missing,
                "missing_relative": missing / max(start, sum(map(abs, sides)), 1e-300),
                "beyond_bounds": max(0.0, float(-fraction.min()), float(fraction.max()) - 1.0),
            }
        }


def _liquid(state: State, case: Case) -> np.ndarray:
    """Volume of the liquid in every cell [m3]."""
    fluid = required(state.fluid, "state.fluid")
    volume = required(case.simulation.fluid, "fluid").solver.grid.cell_volume
    share = 1.0 if fluid.void_fraction is None else np.asarray(fluid.void_fraction, float)
    cut = case.parameters.flow.cut
    if cut is not None:
        share = share * np.asarray(cut.open_cells, float)
    return volume * share * np.asarray(required(fluid.liquid_fraction, "liquid_fraction"), float)
