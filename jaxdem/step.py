"""One coupled step: a coupling interval of the fluid, then of the particles."""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
from jax import named_scope

from jaxdem.coupling.exchange import FluidDiagnostics, FluidForces, advance_fluid, exchange, remembered
from jaxdem.coupling.virtual_mass import with_added_mass
from jaxdem.fluid.momentum import FluidState
from jaxdem.particles.integrate import ParticleState, as_column
from jaxdem.particles.loop import contact_interval
from jaxdem.particles.materials import surroundings
from jaxdem.particles.neighbors import Neighbors
from jaxdem.state import Diagnostics, Parameters, ParticleDiagnostics, State

if TYPE_CHECKING:
    from jaxdem.simulation import Simulation


def step(
    simulation: Simulation, parameters: Parameters, state: State, neighbors: Neighbors | None
) -> tuple[State, Neighbors | None, Diagnostics]:
    """State and neighbour list after one coupling interval; pure, differentiable, for jit and vmap."""
    fluid, forces, fluid_report = fluid_part(simulation, parameters, state)
    particles, neighbors, particle_report = particle_part(simulation, parameters, state, neighbors, forces)
    new = State(particles, fluid, state.step + 1)
    return new, neighbors, Diagnostics(particle_report, fluid_report, forces)


def fluid_part(
    simulation: Simulation, parameters: Parameters, state: State
) -> tuple[FluidState | None, FluidForces | None, FluidDiagnostics | None]:
    """The fluid after the interval, among particles that stand still; and the forces that it puts on them."""
    if simulation.fluid is None:
        return None, None, None
    time = state.step * jnp.asarray(simulation.interval, parameters.gravity.dtype)
    with named_scope("fluid"):
        if state.particles is None:
            fluid, report = advance_fluid(simulation.fluid, parameters.fluid, state.fluid, time)
            return fluid, None, report
        closure = simulation.drag_law if parameters.closure is None else parameters.closure
        return exchange(
            simulation.fluid, closure, parameters.drag_scale, parameters.fluid, parameters.bodies,
            parameters.gravity, state.fluid, state.particles, time,
        )  # fmt: skip


def particle_part(
    simulation: Simulation,
    parameters: Parameters,
    state: State,
    neighbors: Neighbors | None,
    forces: FluidForces | None,
) -> tuple[ParticleState | None, Neighbors | None, ParticleDiagnostics | None]:
    """The particles after the interval's contact steps, under gravity and constant fluid forces."""
    particles = state.particles
    if simulation.contact is None:
        return None, None, None
    time = state.step * jnp.asarray(simulation.interval, parameters.gravity.dtype)
    with named_scope("particles"):
        mass, volume = as_column(parameters.bodies.mass), as_column(parameters.bodies.volume)
        acting = jnp.broadcast_to(mass * parameters.gravity[None], particles.velocity.shape)
        if forces is not None:
            buoyancy = -parameters.fluid.density * volume * parameters.gravity[None]
            particles = particles._replace(fluid_force=forces.total + buoyancy)
            acting = acting + particles.fluid_force
        bodies = parameters.bodies
        if forces is not None and forces.virtual_mass is not None:
            acting = acting + forces.virtual_mass.drive
            bodies = with_added_mass(simulation.fluid.virtual_mass, bodies, parameters.fluid.density)
        walls, start = simulation.wall_velocity(parameters, time), particles.velocity
        particles, neighbors, collision = contact_interval(
            simulation.contact, surroundings(parameters.contact, walls), bodies,
            particles, neighbors, acting, simulation.contact_time_step(acting.dtype),
            None if forces is None else forces.torque,
        )  # fmt: skip
        particles = remembered(
            simulation.fluid, parameters.fluid, parameters.bodies, forces, particles, start
        )
        if simulation.population is not None:
            particles, neighbors = simulation.renewed(parameters, particles, neighbors, state.step + 1)
        report = simulation.particle_report(particles, neighbors, collision, state.step + 1)
        return particles, neighbors, report
