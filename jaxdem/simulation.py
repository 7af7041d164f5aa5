"""A scene ready to be run: its structure and what can be done with it; made by `jaxdem.build`."""

from __future__ import annotations

import dataclasses

from jaxdem.errors import required
from jaxdem.numerics import vectors
from jaxdem.numerics.static import static
from jaxdem.particles.integrate import ParticleState, split_low
from jaxdem.particles.neighbors import Neighbors, Room, carry_history
from jaxdem.state import Diagnostics, Parameters, State
from jaxdem.step import step
from jaxdem.structure import Structure


@static
class Simulation(Structure):
    """A scene ready to be run; see `Structure` for its parts."""

    def step(
        self, parameters: Parameters, state: State, neighbors: Neighbors | None
    ) -> tuple[State, Neighbors | None, Diagnostics]:
        """State and neighbour list after one coupling interval; see `jaxdem.step`."""
        return step(self, parameters, state, neighbors)

    def reversible(self) -> Simulation:
        """The same simulation with loops that reverse-mode differentiation can run backwards."""
        contact = None if self.contact is None else dataclasses.replace(self.contact, reversible=True)
        fluid, coupling = self.fluid, self.coupling
        if fluid is not None:
            fluid = dataclasses.replace(fluid, reversible=True)
            coupling = None if coupling is None else dataclasses.replace(coupling, interval=fluid)
        return dataclasses.replace(self, contact=contact, fluid=fluid, coupling=coupling)

    def allocate(self, parameters: Parameters, particles: ParticleState, room: Room | None = None) -> Neighbors:
        """A neighbour list with room for these positions, or with exactly so much room; not jittable."""
        position = vectors.components(particles.position)
        low = split_low(particles.position_low, len(position))
        bodies = required(parameters.bodies, "parameters.bodies")
        return self.search.allocate(position, low, bodies.radius, room, particles.active)

    def with_room(self, state: State, neighbors: Neighbors, room: Room) -> tuple[State, Neighbors]:
        """State and list with more room, the pairs and what they keep as before; not jittable."""
        particles = required(state.particles, "state.particles")
        wider = self.search.allocate(
            neighbors.reference, neighbors.reference_low, neighbors.radius, room, particles.active
        )
        springs = carry_history(particles.contact_spring, neighbors, wider)
        wider = dataclasses.replace(wider, builds=neighbors.builds)
        return state._replace(particles=particles._replace(contact_spring=springs)), wider
