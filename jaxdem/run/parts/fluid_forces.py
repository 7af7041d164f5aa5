"""Forces of the fluid on the particles, in the frames of a run. Host side."""

from __future__ import annotations

import numpy as np

from jaxdem.run.instant import Instant
from jaxdem.run.parts.part import Arrays, Part
from jaxdem.setup.builder import Case


class FluidForcesOnParticles(Part):
    """Drag, and the further forces of the fluid that act on velocities."""

    def arrays(self, case: Case, instant: Instant) -> dict[str, Arrays]:
        """Means over the last interval [N]: zero at the start, and for particles that are not present: those that were
        removed at the end of the interval had a force within it."""
        particles, coupling, forces = instant.state.particles, case.simulation.coupling, instant.forces
        if particles is None:
            return {}
        drag = np.zeros(particles.position.shape) if forces is None else np.asarray(forces.drag)
        found = {"drag_force": drag.astype(particles.velocity.dtype)}
        for force in () if coupling is None else coupling.forces:
            if force.acts_on_velocity:
                given = np.zeros_like(drag) if forces is None else np.asarray(forces.further[force.name].given)
                found[f"{force.name}_force"] = given.astype(case.parameters.gravity.dtype)
        if particles.active is not None:
            there = np.asarray(particles.active)[:, None]
            found = {name: np.where(there, force, 0) for name, force in found.items()}
        return {"particles": found}
