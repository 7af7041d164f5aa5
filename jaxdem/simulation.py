"""The static structure of a scene and what can be done with it; made by `jaxdem.build`."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
from jax import Array

from jaxdem.closures.base import DragClosure
from jaxdem.coupling.exchange import FluidInterval
from jaxdem.fluid.boundary import Boundary, ramp
from jaxdem.particles import vectors
from jaxdem.particles.integrate import ParticleState, split_low
from jaxdem.particles.loop import ContactInterval
from jaxdem.particles.neighbors import Neighbors, NeighborSearch, Room, carry_history
from jaxdem.particles.population import Population, renewed
from jaxdem.state import Parameters, ParticleDiagnostics, State

if TYPE_CHECKING:
    from jaxdem.time_steps import TimeSteps


@dataclasses.dataclass(frozen=True, eq=False)
class Simulation:
    """The static structure of a scene: what is compiled. Numbers one may differentiate by are `Parameters`.

    Attributes:
        interval: coupling interval [s].
        steps: time steps and limits.
        box: side lengths [m].
        periodic: whether each axis is periodic.
        boundary: the sides of the box.
        contact: contact model and steps, None without particles.
        fluid: solver and exchange, None without a fluid.
        drag_law: correlation, None without coupling or with a learned closure.
        population: how the number of particles changes, None where it does not.
    """

    interval: float
    steps: TimeSteps
    box: tuple[float, ...]
    periodic: tuple[bool, ...]
    boundary: Boundary
    contact: ContactInterval | None
    fluid: FluidInterval | None
    drag_law: DragClosure | None
    population: Population | None = None

    def step(self, parameters: Parameters, state: State, neighbors: Neighbors | None) -> Any:
        """One coupled step; see `jaxdem.step.step`."""
        from jaxdem.step import step

        return step(self, parameters, state, neighbors)

    def reversible(self) -> Simulation:
        """The same simulation with loops that reverse-mode differentiation can run backwards."""
        contact = None if self.contact is None else self.contact._replace(reversible=True)
        fluid = None if self.fluid is None else dataclasses.replace(self.fluid, reversible=True)
        return dataclasses.replace(self, contact=contact, fluid=fluid)

    def contact_time_step(self, dtype: Any) -> Array:
        """() contact step [s]."""
        return jnp.asarray(self.steps.contact, dtype)

    def wall_velocity(self, parameters: Parameters, time: Array) -> tuple[Array, ...]:
        """(D,) velocity of every wall at a time [m/s]; moving sides of the box drag grains along too."""
        still = jnp.zeros_like(parameters.gravity)
        if self.contact is None:
            return ()
        model = self.contact.model
        given = parameters.side_velocity if parameters.fluid is None else parameters.fluid.side_velocity
        velocities = []
        for wall in model.sides:
            number = 2 * wall.axis + (wall.inward < 0)
            side = self.boundary.sides[number]
            velocities.append(ramp(side, time) * given[number] if side.kind == "moving_wall" else still)
        return (*velocities, *(still,) * len(model.surfaces))

    def renewed(
        self, parameters: Parameters, particles: ParticleState, neighbors: Neighbors, step: Array
    ) -> tuple[ParticleState, Neighbors]:
        """Particles and list after those that leave and come at the end of interval number `step`."""
        return renewed(
            self.population, self.search, self.contact.model.surfaces, parameters.inlet_velocity,
            particles, neighbors, step,
        )  # fmt: skip

    def particle_report(
        self, particles: ParticleState, neighbors: Neighbors, collision: Array, step: Array
    ) -> ParticleDiagnostics:
        """Flags and figures of the particles after `step` intervals."""
        position, velocity = particles.position, particles.velocity
        box = jnp.asarray(self.box, position.dtype)
        outside = ((position < 0.0) | (position > box[None])) & ~jnp.asarray(self.periodic)[None]
        if particles.active is not None:
            outside = outside & particles.active[:, None]
        waiting = None
        if self.population is not None and self.population.inlets:
            waiting = self.population.waiting(particles.inserted, step)
        squared = jnp.sum(velocity**2, axis=1)
        return ParticleDiagnostics(
            collision,
            neighbors.builds,
            neighbors.overflow,
            jnp.all(jnp.isfinite(position))
            & jnp.all(jnp.isfinite(velocity))
            & jnp.all(jnp.isfinite(particles.angular_velocity)),
            jnp.sum(jnp.any(outside, axis=1).astype(jnp.int32)),
            jnp.sqrt(jnp.max(squared, initial=0.0)),
            waiting,
        )

    @property
    def half_width(self) -> tuple[float, ...] | None:
        """How far a particle reaches in the deposition, along every axis; None without an exchange [m]."""
        if self.fluid is None or self.fluid.deposition is None:
            return None
        return self.fluid.deposition.half_width

    @property
    def search(self) -> NeighborSearch:
        """Builder of the neighbour list of a scene with particles."""
        assert self.contact is not None and self.contact.search is not None
        return self.contact.search

    def allocate(self, particles: ParticleState) -> Neighbors:
        """A neighbour list with room for these positions; not jittable."""
        position = vectors.components(particles.position)
        low = split_low(particles.position_low, len(position))
        return self.search.allocate(position, low, active=particles.active)

    def with_room(self, state: State, neighbors: Neighbors, room: Room) -> tuple[State, Neighbors]:
        """State and list with more room, the pairs and what they keep as before; not jittable."""
        particles = state.particles
        assert particles is not None
        wider = self.search.allocate(neighbors.reference, neighbors.reference_low, room, particles.active)
        springs = carry_history(particles.contact_spring, neighbors, wider)
        wider = dataclasses.replace(wider, builds=neighbors.builds)
        return state._replace(particles=particles._replace(contact_spring=springs)), wider
