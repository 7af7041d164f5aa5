"""Walls that forces hold, and walls that the fluid sees, in what a run writes. Host side."""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxdem.run.instant import Instant
from jaxdem.run.parts.part import Part
from jaxdem.run.totals import Means, Totals
from jaxdem.setup.builder import Case


class Pistons(Part):
    """Walls that a force holds."""

    def columns(self, case: Case, instant: Instant, means: Means) -> dict[str, float]:
        """How far every piston has moved along its direction [m]."""
        particles = instant.state.particles
        pistons = None if particles is None else particles.pistons
        if pistons is None:
            return {}
        displacement = np.asarray(pistons.displacement, np.float64)
        names = [f"wall_{k}_displacement" for k, wall in enumerate(case.scene.walls) if wall.piston is not None]
        return {name: float(displacement[k]) for k, name in enumerate(names)}


class WallsInFluid(Part):
    """Walls that the fluid sees."""

    def summary(self, case: Case, instant: Instant, totals: Totals) -> dict[str, Any]:
        """Mean force of the fluid on every one over the run [N]."""
        owners = case.fluid_walls.walls
        if not owners or not totals.intervals:
            return {}
        forces = np.reshape(totals.surface_force, (len(owners), -1)) / totals.intervals
        found = []
        for number in dict.fromkeys(owners):
            own = forces[[k for k, owner in enumerate(owners) if owner == number]].sum(axis=0)
            name = case.scene.walls[number].name
            found.append({"wall": number, "name": name, "fluid_force_mean": own.tolist()})
        return {"walls_in_fluid": found}
