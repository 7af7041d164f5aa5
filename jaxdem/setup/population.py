"""How the number of particles of a scene changes. Host, numpy."""

from __future__ import annotations

import numpy as np

from jaxdem.particles.population import Exit, Inlet, Population
from jaxdem.scene.particles import largest_arrival, outer_factor
from jaxdem.setup.inlet_flow import ROUNDING
from jaxdem.setup.inlet_regions import inlet_region
from jaxdem.setup.particles import ParticleSetup
from jaxdem.structure import Clock


def population_of(particles: ParticleSetup, interval: float, clock: Clock | None = None) -> Population | None:
    """How the number of particles changes in coupling intervals of this length [s]; None where it does not.

    Args:
        particles: of the scene.
        interval: coupling interval [s].
        clock: from which the intervals are counted; see `Structure`.
    """
    scene = particles.scene
    if not scene.comes_and_goes:
        return None
    exits = tuple(
        Exit(number // 2, bool(number % 2), scene.domain.size[number // 2] if number % 2 else 0.0)
        for number, name in enumerate(scene.sides)
        if scene.boundary[name].particles == "remove"
    )
    begin, first = (0.0, 0) if clock is None else (clock.start, clock.step)
    inlets = []
    for k, (inlet, queue) in enumerate(zip(particles.table.inlet, particles.queues, strict=True)):
        steps = np.ceil((queue.time - begin) / interval * (1.0 - ROUNDING) - ROUNDING)
        due = first + np.maximum(steps, 1.0).astype(np.int32)
        most = int(np.unique(due, return_counts=True)[1].max())
        start, stop = inlet.start or (), inlet.stop or ()
        in_order = (np.diff(queue.rows) == 1).all()
        # Twice as many as come at once, so that those who had to wait can catch up.
        batch = min(2 * most + 2, len(due))
        rows = None if in_order else tuple(queue.rows.tolist())
        region = None
        if inlet.region is not None:
            largest = outer_factor(particles.table, scene.dimension) * largest_arrival(particles.table, inlet)
            region = inlet_region(f"particles.inlet.{k}", inlet.region, scene.box, largest)
        inlets.append(Inlet(int(queue.rows[0]), tuple(due.tolist()), start, stop, batch, rows, region))
    size, never = scene.domain.size, particles.never
    return Population(exits, tuple(inlets), size, scene.periodic, scene.seed, never)
