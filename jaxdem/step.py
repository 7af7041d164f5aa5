"""One step: an interval of the fluid among resting particles, then of the particles under the fluid's forces."""

from __future__ import annotations

import jax.numpy as jnp
from jax import named_scope

from jaxdem.coupling.exchange import ExchangeDiagnostics, FluidForces
from jaxdem.errors import required
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.fluid.interval import FluidDiagnostics
from jaxdem.particles.energy import flow_of_interval
from jaxdem.particles.integrate import ParticleState, as_column
from jaxdem.particles.loop import contact_interval
from jaxdem.particles.materials import surroundings
from jaxdem.particles.migration import settled
from jaxdem.particles.neighbors import Neighbors
from jaxdem.particles.walls_present import with_walls_present
from jaxdem.scalar_step import FlowOfInterval, advance_scalars, with_buoyancy
from jaxdem.state import Diagnostics, Parameters, ParticleDiagnostics, Places, State
from jaxdem.structure import Structure


def step(
    simulation: Structure, parameters: Parameters, state: State, neighbors: Neighbors | None
) -> tuple[State, Neighbors | None, Diagnostics]:
    """State and neighbour list after one coupling interval; pure, differentiable, for jit and vmap."""
    fluid, forces, fluid_report, exchange_report = advance_fluid(simulation, parameters, state)
    particles, listed, report, places = advance_particles(simulation, parameters, state, neighbors, forces)
    scalars = None
    if simulation.scalars is not None:
        flow = FlowOfInterval(fluid, forces, fluid_report)
        scalars, fluid_report = advance_scalars(simulation, parameters, state, neighbors, flow, particles)
    new = State(particles, fluid, state.step + 1, scalars)
    return new, listed, Diagnostics(report, fluid_report, exchange_report, forces, places)


@named_scope("fluid")
def advance_fluid(
    simulation: Structure, parameters: Parameters, state: State
) -> tuple[FluidState | None, FluidForces | None, FluidDiagnostics | None, ExchangeDiagnostics | None]:
    """The fluid after the interval, among particles that stand still; and the mean forces that it puts on them."""
    if simulation.fluid is None:
        return None, None, None, None
    parameters = with_buoyancy(simulation, simulation.during(parameters, state.step), state)
    time, fluid = simulation.time(parameters, state), required(state.fluid, "state.fluid")
    parameters, fluid = simulation.with_moved_walls(parameters, fluid, state.step)
    if simulation.coupling is not None:
        particles = required(state.particles, "state.particles")
        bodies = required(parameters.bodies, "parameters.bodies").of_rows(particles.identity)
        parameters = parameters._replace(bodies=bodies)
        return simulation.coupling.advance(parameters.mixture, fluid, particles, time)
    fluid, report = simulation.fluid.advance(parameters.flow, fluid, time)
    return fluid, None, report, None


@named_scope("particles")
def advance_particles(
    simulation: Structure,
    parameters: Parameters,
    state: State,
    neighbors: Neighbors | None,
    forces: FluidForces | None,
) -> tuple[ParticleState | None, Neighbors | None, ParticleDiagnostics | None, Places | None]:
    """The particles after the contact steps, under gravity and the mean fluid forces; then who leaves and comes."""
    if simulation.contact is None:
        return None, None, None, None
    parameters = simulation.during(parameters, state.step)
    before, neighbors = required(state.particles, "state.particles"), required(neighbors, "neighbors")
    everyone = required(parameters.bodies, "parameters.bodies")
    bodies = everyone.of_rows(before.identity)
    parameters, plain = parameters._replace(bodies=bodies), bodies
    load = jnp.broadcast_to(as_column(bodies.mass) * parameters.gravity[None], before.velocity.shape)
    if simulation.coupling is not None and forces is not None:
        force = forces.total + parameters.mixture.buoyancy
        before, load = before._replace(fluid_force=force), load + force
        bodies, load = simulation.coupling.with_moving_fluid(parameters.mixture, forces, load)
    step, torque = simulation.contact_time_step(load.dtype), None if forces is None else forces.torque
    middle, listed = simulation.middle(parameters, state.step), neighbors
    walls = surroundings(parameters.materials, simulation.wall_velocity(parameters, middle))
    walls = walls._replace(motions=simulation.wall_motions(parameters, state.step), bonds=parameters.bonds)
    particles, neighbors, means = with_walls_present(
        simulation.contact, walls, before, middle,
        lambda contact, walls, start: contact_interval(contact, walls, bodies, start, listed, load, step, torque),
    )  # fmt: skip
    energy = means.energy
    if energy is not None:
        energy = flow_of_interval(energy, plain, bodies, parameters.gravity, before, particles)
    if simulation.coupling is not None and forces is not None:
        particles = simulation.coupling.remember(parameters.mixture, forces, before, particles)
    places = None if simulation.cut is None else Places(particles.position, particles.position_low)
    if simulation.population is not None:
        whole = parameters._replace(bodies=everyone)
        remaining, kept = particles, neighbors
        particles, neighbors = simulation.renewed(whole, particles, neighbors, state.step + 1)
        if energy is not None:
            stored = simulation.stored(whole, particles, neighbors, state.step + 1)
            without = simulation.stored(whole, remaining, kept, state.step + 1)
            energy = energy._replace(population=stored.total - without.total)
    if simulation.contact.division is not None:
        division, search = simulation.contact.division, simulation.search
        meshes = simulation.meshes_placed(parameters, particles, state.step + 1)
        particles, neighbors = settled(division, search, everyone.radius, particles, neighbors, meshes)
    buried = simulation.buried(parameters, before, listed, state.step)
    means = means._replace(energy=energy)
    report = simulation.particle_report(particles, neighbors, means, state.step + 1, buried, bodies)
    return particles, neighbors, report, places
