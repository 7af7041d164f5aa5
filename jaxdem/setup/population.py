"""How the number of particles of a scene changes. Host, numpy."""

from __future__ import annotations

import numpy as np

from jaxdem.particles.population import Exit, Inlet, Population
from jaxdem.setup.arrivals import ROUNDING
from jaxdem.setup.particles import ParticleSetup


def population_of(particles: ParticleSetup, interval: float) -> Population | None:
    """How the number of particles changes in coupling intervals of this length [s]; None where it does not."""
    scene = particles.scene
    if not scene.comes_and_goes:
        return None
    exits = tuple(
        Exit(number // 2, bool(number % 2), scene.domain.size[number // 2] if number % 2 else 0.0)
        for number, name in enumerate(scene.sides)
        if scene.boundary[name].particles == "remove"
    )
    inlets, first = [], particles.count
    for inlet, coming in zip(particles.table.inlet, particles.arrivals, strict=True):
        due = np.maximum(np.ceil(coming.time / interval * (1.0 - ROUNDING) - ROUNDING), 1.0).astype(np.int32)
        most = int(np.bincount(due).max())
        start, stop = inlet.start or (), inlet.stop or ()
        # Twice as many as come at once, so that those who had to wait can catch up.
        inlets.append(Inlet(first, tuple(due.tolist()), start, stop, min(2 * most + 2, len(due))))
        first += len(due)
    return Population(exits, tuple(inlets), scene.domain.size, scene.periodic, scene.seed)
