"""The liquid of capillary bridges, in the summary of a run. Host side."""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxdem.devices import gathered
from jaxdem.errors import required
from jaxdem.run.instant import Instant
from jaxdem.run.parts.part import Part
from jaxdem.run.totals import Totals
from jaxdem.setup.builder import Case


class Liquid(Part):
    """Liquid films and bridges."""

    def summary(self, case: Case, instant: Instant, totals: Totals) -> dict[str, Any]:
        """Where the liquid is [m3], and what is missing of it [-]."""
        particles, scene = instant.state.particles, case.scene
        if particles is None or particles.liquid is None or scene.contact is None or scene.contact.cohesion is None:
            return {}
        between_particles: Any = particles.contact_spring[-1:]
        meshes = particles.mesh_memory
        if instant.slabs is not None:  # what contacts keep stays in the slabs; a bridge across a border counts once
            slabs = instant.slabs
            contacts = gathered(slabs.simulation, slabs.state, slabs.neighbors)[1]
            found = required(contacts, "contacts of the slabs")
            between_particles, meshes = found.values[-1:], found.meshes
        at_walls = [*particles.wall_spring[-1:], *(memory.spring[-1] for memory in meshes)]
        held = [np.asarray(volumes) for volumes in between_particles], [np.asarray(volumes) for volumes in at_walls]
        films = float(np.sum(np.asarray(particles.liquid), dtype=np.float64))
        between, walls = (sum(float(np.sum(x, dtype=np.float64)) for x in volumes) for volumes in held)
        radius = np.broadcast_to(np.asarray(case.bodies.radius, float), particles.liquid.shape)
        start = (scene.contact.cohesion.liquid_content or 0.0) * float(np.sum(4.0 / 3.0 * np.pi * radius**3))
        missing = start - films - between - walls
        bridges = sum(int(np.count_nonzero(x)) for volumes in held for x in volumes)
        return {
            "liquid": {
                "start": start,
                "films": films,
                "bridges_between_particles": between,
                "bridges_to_walls": walls,
                "bridges": bridges,
                "missing_relative": missing / start if start else 0.0,
            }
        }
