"""Particles that come and go, in what a run writes. Host side."""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxdem.run.instant import Instant
from jaxdem.run.parts.part import Arrays, Part
from jaxdem.run.totals import Means, Totals
from jaxdem.setup.builder import Case
from jaxdem.simulation import Simulation
from jaxdem.state import State


class Population(Part):
    """Particles that come and go."""

    def arrays(self, case: Case, instant: Instant) -> dict[str, Arrays]:
        """`active`, 1 for particles that are present."""
        particles = instant.state.particles
        if particles is None or particles.active is None:
            return {}
        return {"particles": {"active": np.asarray(particles.active).astype(np.uint8)}}

    def columns(self, case: Case, instant: Instant, means: Means) -> dict[str, float]:
        """Numbers of particles that are present and that have been removed."""
        counts = particle_counts(case.simulation, instant.state)
        return {name: counts[name] for name in ("present", "removed") if name in counts}

    def summary(self, case: Case, instant: Instant, totals: Totals) -> dict[str, Any]:
        """What waited for room at the inlets."""
        population, particles = case.simulation.population, instant.state.particles
        if population is None or not population.inlets or particles is None:
            return {}
        inserted = np.asarray(particles.inserted)
        return {
            "inlets": {
                "inserted": inserted.tolist(),
                "waiting": totals.waiting,
                "waiting_most": totals.waiting_most,
                # Every interval that a particle waits delays it by one; those that still wait count too.
                "delay_mean_s": totals.waited * case.simulation.interval / max(int(inserted.sum()) + totals.waiting, 1),
            }
        }


def particle_counts(simulation: Simulation, state: State) -> dict[str, int]:
    """How many there were at the start, have come in, have been removed and are present; {} where none comes or goes.

    initial + inserted = removed + present, for a row of the state is used once.
    """
    population, particles = simulation.population, state.particles
    if population is None or particles is None or particles.active is None:
        return {}
    coming = sum(len(inlet.due) for inlet in population.inlets) + population.never
    initial = particles.position.shape[0] - coming
    inserted = 0 if particles.inserted is None else int(np.sum(np.asarray(particles.inserted)))
    present = int(np.sum(np.asarray(particles.active)))
    removed = initial + inserted - present
    return {"initial": initial, "inserted": inserted, "removed": removed, "present": present}
