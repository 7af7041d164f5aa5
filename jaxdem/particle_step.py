"""The particles in an interval: their contact steps under gravity and the fluid's forces, and who leaves and comes."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.coupling.exchange_result import FluidForces
from jaxdem.errors import required
from jaxdem.numerics.blocks import all_of, any_of, largest, total
from jaxdem.particles.clump_forces import as_members, on_bodies
from jaxdem.particles.contact_interval import ContactMeans
from jaxdem.particles.contact_step import ContactStep
from jaxdem.particles.energy import carried, flow_of_interval
from jaxdem.particles.integrate import Motion, ParticleProperties, ParticleState, as_column
from jaxdem.particles.loop import contact_interval
from jaxdem.particles.materials import surroundings
from jaxdem.particles.migration import settled
from jaxdem.particles.neighbors import Neighbors, with_radius
from jaxdem.particles.population import Entry, renewed
from jaxdem.particles.slab_population import renewed_in_slab
from jaxdem.particles.slab_rows import Sizes
from jaxdem.particles.stored_energy import StoredEnergy, stored_energy, strained
from jaxdem.particles.walls_present import Buried, buried, with_walls_present
from jaxdem.scalars.scalar_state import ScalarState
from jaxdem.state import Parameters, ParticleDiagnostics, State
from jaxdem.structure import Structure


class Moved(NamedTuple):
    """What the contact steps of an interval come to.

    Attributes:
        before: the particles at the start, with the force of the fluid on them.
        particles, neighbors, means: at the end.
        bodies: that have moved, with the fluid that moves along.
        scalars: that go along with the particles; None without.
    """

    before: ParticleState
    particles: ParticleState
    neighbors: Neighbors
    means: ContactMeans
    bodies: ParticleProperties
    scalars: ScalarState | None = None


def of_rows(parameters: Parameters, state: State) -> Parameters:
    """The parameters with the bodies in the rows of the state."""
    particles, bodies = required(state.particles, "state.particles"), required(parameters.bodies, "parameters.bodies")
    return parameters._replace(bodies=bodies.of_rows(particles.identity))


def moved_particles(
    simulation: Structure, parameters: Parameters, state: State, neighbors: Neighbors, forces: FluidForces | None
) -> Moved:
    """The particles after the contact steps, under gravity and the mean fluid forces."""
    contact, coupling = required(simulation.contact, "particles"), simulation.coupling
    whole, before = parameters, required(state.particles, "state.particles")
    parameters = of_rows(parameters, state)
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
        if contact.model.wall_times is not None:
            flow = carried(flow, "wall_changes", *_as_walls_change(simulation, whole, state, neighbors))
        means = means._replace(energy=flow)
    if means.heat is not None:  # what springs along the contacts store is not heat yet
        before_it = strained_in_particles(simulation, whole, before, neighbors, state.step)
        strain = strained_in_particles(simulation, whole, particles, listed, state.step + 1)
        means = means._replace(heat=means.heat - (strain - before_it))
    if coupling is not None and forces is not None:
        particles = coupling.remember(parameters.mixture, forces, before, particles)
    return Moved(before, particles, listed, means, bodies)


def at_end_of_interval(simulation: Structure, parameters: Parameters, state: State, moved: Moved) -> Moved:
    """The particles after those that leave, come and go to other slabs, and the energy of the interval with what those
    that leave and come carry; their heat is counted."""
    particles, neighbors = moved.particles, moved.neighbors
    scalars = _warmed(simulation, parameters, moved)
    division = required(simulation.contact, "particles").division
    if simulation.population is not None:
        particles, neighbors = renewed_particles(simulation, parameters, particles, neighbors, state.step + 1)
        if scalars is not None and simulation.scalars is not None:
            numbers = required(parameters.scalars, "parameters.scalars")
            bodies = required(parameters.bodies, "parameters.bodies")
            scalars = simulation.scalars.renewed(numbers, scalars, bodies, moved.particles, particles)
    if division is not None:
        sizes = Sizes.of(required(parameters.bodies, "parameters.bodies"))
        meshes = simulation.meshes_placed(parameters, particles, state.step + 1)
        along = None if scalars is None else scalars.grains
        given = division, simulation.search, sizes, particles, neighbors, meshes, along
        particles, neighbors, along = settled(*given)
        scalars = None if scalars is None else scalars._replace(grains=along)
    means = moved.means
    if means.energy is not None and simulation.population is not None:
        now = stored(simulation, parameters, particles, neighbors, state.step + 1)
        without = stored(simulation, parameters, moved.particles, moved.neighbors, state.step + 1)
        means = means._replace(energy=carried(means.energy, "population", without, now))
    return moved._replace(particles=particles, neighbors=neighbors, means=means, scalars=scalars)


def _warmed(simulation: Structure, parameters: Parameters, moved: Moved) -> ScalarState | None:
    """The scalars with the heat that contacts have made of motion."""
    if moved.scalars is None or simulation.scalars is None or moved.means.heat is None:
        return moved.scalars
    numbers, bodies = required(parameters.scalars, "parameters.scalars"), required(parameters.bodies, "bodies")
    own = bodies.of_rows(moved.particles.identity)
    return simulation.scalars.rubbed(numbers, moved.scalars, own, moved.means.heat)


def renewed_particles(
    simulation: Structure, parameters: Parameters, particles: ParticleState, neighbors: Neighbors, step: Array
) -> tuple[ParticleState, Neighbors]:
    """Particles and list after those that leave and come at the end of interval number `step`."""
    population, contact = required(simulation.population, "population"), required(simulation.contact, "particles")
    times = contact.model.wall_times
    placed = simulation.placed(parameters, particles, step)
    present = None
    if times is not None:
        present = times.present(simulation.middle(parameters, step))[: len(contact.model.surfaces)]
    bodies = required(parameters.bodies, "parameters.bodies")
    if contact.division is None:
        radius = neighbors.radius if bodies.clumps is None else bodies.outer_radius
        entry = Entry(radius, parameters.inlet_velocity, present, placed)
        return renewed(population, contact, entry, particles, neighbors, step)
    entry = Entry(bodies.outer_radius, parameters.inlet_velocity, present, placed)
    return renewed_in_slab(population, contact, entry, particles, neighbors, step)


def stored(
    simulation: Structure,
    parameters: Parameters,
    particles: ParticleState,
    neighbors: Neighbors,
    step: Array,
    walls_of: Array | None = None,
) -> StoredEnergy:
    """What is stored in the particles after `step` intervals, of a slab what is counted there; with the walls that are
    there in the interval `walls_of`, in the last one that is over if None."""
    contact, bodies = required(simulation.contact, "particles"), required(parameters.bodies, "parameters.bodies")
    particles, bodies = contact.seen(bodies, particles, neighbors)
    parameters = parameters._replace(bodies=bodies)
    touching, listed = _touching(simulation, parameters, particles, neighbors, step, walls_of)
    gravity = simulation.during(parameters, jnp.maximum(step - 1, 0)).gravity
    return stored_energy(touching, listed, bodies, gravity, particles)


def strained_in_particles(
    simulation: Structure, parameters: Parameters, particles: ParticleState, neighbors: Neighbors, step: Array
) -> Array:
    """(N,) what the tangential and rolling springs of every particle store after `step` intervals [J]."""
    contact, bodies = required(simulation.contact, "particles"), required(parameters.bodies, "parameters.bodies")
    seen, bodies = contact.seen(bodies, particles, neighbors)
    parameters = parameters._replace(bodies=bodies)
    energy = on_bodies(bodies.clumps, strained(*_touching(simulation, parameters, seen, neighbors, step, None)))
    return energy if contact.division is None else energy[: particles.velocity.shape[0]]


def _touching(
    simulation: Structure,
    parameters: Parameters,
    particles: ParticleState,
    neighbors: Neighbors,
    step: Array,
    walls_of: Array | None,
) -> tuple[ContactStep, Neighbors]:
    """What touches after `step` intervals, and its list; see `stored`."""
    contact, bodies = required(simulation.contact, "particles"), required(parameters.bodies, "parameters.bodies")
    last, model = jnp.maximum(step - 1, 0), contact.model
    parameters = simulation.during(parameters, last)
    around = surroundings(
        parameters.materials, simulation.wall_velocity(parameters, simulation.time_after(parameters, step))
    )
    around = around._replace(placements=simulation.placed(parameters, particles, step), bonds=parameters.bonds)
    members, present = as_members(particles, bodies.clumps), None
    if model.wall_times is not None:
        there = model.wall_times.present(simulation.middle(parameters, last if walls_of is None else walls_of))
        present = jnp.concatenate([jnp.ones(len(model.sides), bool), there])
    motion, spheres = Motion.of(members), bodies.spheres(particles.velocity.shape[0])
    still = jnp.zeros((), particles.velocity.dtype)
    touching = ContactStep(model, around, spheres, motion, motion.velocity, still, members.active, present)
    return touching, with_radius(neighbors, spheres.radius)


def _as_walls_change(
    simulation: Structure, parameters: Parameters, state: State, neighbors: Neighbors
) -> tuple[StoredEnergy, StoredEnergy]:
    """What is stored in a state with the walls of the interval that ends, and with those of the one that begins."""
    given = simulation, parameters, required(state.particles, "state.particles"), neighbors, state.step
    return stored(*given), stored(*given, walls_of=state.step)


def buried_particles(
    simulation: Structure, parameters: Parameters, particles: ParticleState, neighbors: Neighbors, step: Array
) -> Buried | None:
    """Particles within walls as these come, after `step` intervals. None where all walls always are."""
    contact = required(simulation.contact, "particles")
    if contact.model.wall_times is None:
        return None
    middle = simulation.middle(parameters, step)
    interval = jnp.asarray(simulation.interval, parameters.gravity.dtype)
    bodies, count = required(parameters.bodies, "parameters.bodies"), particles.position.shape[0]
    placed = simulation.placed(parameters, particles, step)
    spheres = as_members(particles, bodies.clumps)
    return buried(contact, spheres, neighbors, bodies.spheres(count).radius, (middle, interval), placed)


def particle_report(
    simulation: Structure, moved: Moved, step: Array, within: Buried | None = None
) -> ParticleDiagnostics:
    """Flags and figures of the particles after `step` intervals.

    Args:
        simulation: static.
        moved: particles and list after those that left and came.
        step: () int32.
        within: those within a wall that came.
    """
    particles, neighbors, means, bodies = moved.particles, moved.neighbors, moved.means, moved.bodies
    position, velocity = particles.position, particles.velocity
    box, blocks = jnp.asarray(simulation.box, position.dtype), simulation.cut
    outside = ((position < 0.0) | (position > box[None])) & ~jnp.asarray(simulation.periodic)[None]
    if particles.active is not None:
        outside = outside & particles.active[:, None]
    waiting = None
    if simulation.population is not None and simulation.population.inlets:
        waiting = simulation.population.waiting(required(particles.inserted, "inserted of the particles"), step)
    present = None
    if simulation.population is not None:
        there = required(moved.before.active, "active of the particles")
        present = total(blocks, jnp.sum(there.astype(jnp.int32)))
    squared = jnp.sum(velocity**2, axis=1)
    if bodies.clumps is not None:  # their surface is faster than their centre
        turning = bodies.outer_radius * jnp.sqrt(jnp.sum(particles.angular_velocity**2, axis=1))
        squared = (jnp.sqrt(squared) + turning) ** 2
    finite = (
        jnp.all(jnp.isfinite(position))
        & jnp.all(jnp.isfinite(velocity))
        & jnp.all(jnp.isfinite(particles.angular_velocity))
    )
    overflow = neighbors.overflow
    if within is not None and within.crowded is not None:
        overflow = overflow | within.crowded
    travel = required(simulation.contact, "particles").model.travel
    return ParticleDiagnostics(
        means.collision_force,
        neighbors.builds,
        any_of(blocks, overflow),
        all_of(blocks, finite),
        total(blocks, jnp.sum(jnp.any(outside, axis=1).astype(jnp.int32))),
        largest(blocks, jnp.sqrt(jnp.max(squared, initial=0.0))),
        waiting,
        None if within is None else total(blocks, jnp.sum(jnp.any(within.found, axis=0).astype(jnp.int32))),
        means.walls,
        total(blocks, means.energy),
        None if travel is None else travel.met(required(particles.pistons, "pistons of the particles")),
        present,
    )
