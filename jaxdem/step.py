"""One step: an interval of the fluid among resting particles, then of the particles under the fluid's forces."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import named_scope

from jaxdem.coupling.exchange import ExchangeDiagnostics, FluidForces
from jaxdem.errors import required
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.fluid.interval import FluidDiagnostics
from jaxdem.particles.contact_interval import ContactMeans
from jaxdem.particles.energy import EnergyFlow, flow_of_interval
from jaxdem.particles.integrate import ParticleProperties, ParticleState, as_column
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
    listed, division = required(neighbors, "neighbors"), simulation.contact.division
    parameters = simulation.during(parameters, state.step)
    moved = _moved(simulation, parameters, state, listed, forces)
    particles, kept, energy = moved.particles, moved.neighbors, moved.means.energy
    places = None if simulation.cut is None else Places(particles.position, particles.position_low)
    if simulation.population is not None:
        particles, kept, energy = _renewed(simulation, parameters, state, moved)
    if division is not None:
        radius = required(parameters.bodies, "parameters.bodies").radius
        meshes = simulation.meshes_placed(parameters, particles, state.step + 1)
        particles, kept = settled(division, simulation.search, radius, particles, kept, meshes)
    buried = simulation.buried(_of_rows(parameters, state), moved.before, listed, state.step)
    means = moved.means._replace(energy=energy)
    report = simulation.particle_report(particles, kept, means, state.step + 1, buried, moved.bodies)
    return particles, kept, report, places


class _Moved(NamedTuple):
    """What the contact steps of an interval come to.

    Attributes:
        before: the particles at the start, with the force of the fluid on them.
        particles, neighbors, means: at the end.
        bodies: that have moved, with the fluid that moves along.
    """

    before: ParticleState
    particles: ParticleState
    neighbors: Neighbors
    means: ContactMeans
    bodies: ParticleProperties


def _of_rows(parameters: Parameters, state: State) -> Parameters:
    """The parameters with the bodies in the rows of the state."""
    particles, bodies = required(state.particles, "state.particles"), required(parameters.bodies, "parameters.bodies")
    return parameters._replace(bodies=bodies.of_rows(particles.identity))


def _moved(
    simulation: Structure, parameters: Parameters, state: State, neighbors: Neighbors, forces: FluidForces | None
) -> _Moved:
    """The particles after the contact steps, under gravity and the mean fluid forces."""
    contact, coupling = required(simulation.contact, "particles"), simulation.coupling
    parameters, before = _of_rows(parameters, state), required(state.particles, "state.particles")
    alone = bodies = required(parameters.bodies, "parameters.bodies")
    load = jnp.broadcast_to(as_column(bodies.mass) * parameters.gravity[None], before.velocity.shape)
    if coupling is not None and forces is not None:
        force = forces.total + parameters.mixture.buoyancy
        before, load = before._replace(fluid_force=force), load + force
        bodies, load = coupling.with_moving_fluid(parameters.mixture, forces, load)
    step, torque = simulation.contact_time_step(load.dtype), None if forces is None else forces.torque
    middle = simulation.middle(parameters, state.step)
    walls = surroundings(parameters.materials, simulation.wall_velocity(parameters, middle))
    walls = walls._replace(motions=simulation.wall_motions(parameters, state.step), bonds=parameters.bonds)
    particles, listed, means = with_walls_present(
        contact, walls, before, middle,
        lambda contact, walls, start: contact_interval(contact, walls, bodies, start, neighbors, load, step, torque),
    )  # fmt: skip
    if means.energy is not None:
        flow = flow_of_interval(means.energy, alone, bodies, parameters.gravity, before, particles)
        means = means._replace(energy=flow)
    if coupling is not None and forces is not None:
        particles = coupling.remember(parameters.mixture, forces, before, particles)
    return _Moved(before, particles, listed, means, bodies)


def _renewed(
    simulation: Structure, parameters: Parameters, state: State, moved: _Moved
) -> tuple[ParticleState, Neighbors, EnergyFlow | None]:
    """Particles and list after those that leave and come, and the energy of the interval with what they carry."""
    particles, neighbors = simulation.renewed(parameters, moved.particles, moved.neighbors, state.step + 1)
    energy = moved.means.energy
    if energy is not None:
        now = simulation.stored(parameters, particles, neighbors, state.step + 1)
        without = simulation.stored(parameters, moved.particles, moved.neighbors, state.step + 1)
        energy = energy._replace(population=now.total - without.total)
    return particles, neighbors, energy
