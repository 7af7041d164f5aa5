"""The balance of energy of the particles: what they store at a moment, and what contacts give and take in a step.

A step changes the velocity by F dt/m at a fixed position, and the position by the mean of the velocities before and
after. So the work of a force over the step is F dt times that mean velocity, exactly, for every contact and for every
particle: what the contacts take is summed with it, and the kinetic energy has changed by the sum to rounding. What is
not exact is what springs store: at the end of a step that is an integral over the overlap, and the force has acted at
the overlap in its middle. The difference is of the second order in the step and is told apart, see `conservative`.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics import vectors
from jaxdem.numerics.vectors import Vector
from jaxdem.particles import tangent
from jaxdem.particles.cohesion import TOUCHING
from jaxdem.particles.cohesion_energy import cohesion_energy, energy_lost
from jaxdem.particles.contact import ContactMaterial, StoringLaw
from jaxdem.particles.contact_load import attraction_of, gap_of
from jaxdem.particles.contact_model import ContactModel
from jaxdem.particles.contact_pair import ContactPair
from jaxdem.particles.contact_step import ContactStep, Surroundings
from jaxdem.particles.contact_sums import FoundContacts
from jaxdem.particles.integrate import Motion, ParticleProperties, ParticleState
from jaxdem.particles.mesh_forces import mesh_pair
from jaxdem.particles.neighbors import Neighbors
from jaxdem.particles.pair_forces import pair_contacts, pair_material
from jaxdem.particles.wall_forces import wall_contacts, wall_material


class EnergyFlow(NamedTuple):
    """What contacts and other forces give and take over some steps, each () [J].

    Attributes:
        walls: work of moving walls on the particles.
        fluid: of the forces of the fluid.
        population: energy of the particles that have come less that of those that have left.
        gravity: work of gravity; the potential energy falls by it where gravity does not change with time.
        damping: taken by the dashpots along the normal.
        liquid: by the liquid of bridges and in gaps.
        adhesion: lost where cohesion begins or ends at once.
        tangential: by the tangential forces, what they store included.
        tangential_damping: by the dashpots among these.
        rolling: by the torques against rolling, what they store included.
        conservative: given by the forces along the normal that have a potential.
    """

    walls: Array
    fluid: Array
    population: Array
    gravity: Array
    damping: Array
    liquid: Array
    adhesion: Array
    tangential: Array
    tangential_damping: Array
    rolling: Array
    conservative: Array


class StoredEnergy(NamedTuple):
    """What is stored at a moment, each () [J].

    Attributes:
        translation: sum of m v^2 / 2.
        rotation: sum of I w^2 / 2.
        potential: minus sum of m g.x.
        normal: of the springs along the normal, and what cohesion strains.
        tangential: of the tangential springs.
        rolling: of the rolling springs.
        surface: of cohesion.
    """

    translation: Array
    rotation: Array
    potential: Array
    normal: Array
    tangential: Array
    rolling: Array
    surface: Array

    @property
    def total(self) -> Array:
        """Sum of all [J]."""
        return sum(self, start=jnp.zeros_like(self.translation))


def no_flow(like: Array) -> EnergyFlow:
    """Zeros of a type."""
    return EnergyFlow(*(jnp.zeros((), like.dtype) for _ in EnergyFlow._fields))


# --- a step -----------------------------------------------------------------------------------------------


def flow_of_step(
    model: ContactModel, found: tuple[FoundContacts, ...], before: Motion, after: Motion, time_step: Array
) -> EnergyFlow:
    """What the contacts of a step give and take.

    Args:
        model: laws; static.
        found: its contacts.
        before, after: the velocities at its start and end.
        time_step: [s].
    """
    flow = no_flow(time_step)
    for contacts in found:
        own = _of_contacts(model, contacts, before, after, time_step)
        flow = jax.tree.map(lambda total, parts: total + jnp.sum(parts), flow, own)
    return flow


def _of_contacts(
    model: ContactModel, found: FoundContacts, before: Motion, after: Motion, time_step: Array
) -> EnergyFlow:
    """The same of every contact, arrays of their shape."""
    pair, load, normal = found.pair, found.load, found.pair.normal
    parts = required(load.parts, "parts of the load")
    half, half_spin = (
        vectors.scale(0.5, vectors.subtract(getattr(after, name), getattr(before, name)))
        for name in ("velocity", "angular_velocity")
    )
    # Of the mean velocities over the step; those of the walls are the same all through it.
    velocity = vectors.add(pair.velocity, found.of_one(half))
    spin = vectors.add(pair.spin, found.of_one(half_spin))
    turning = vectors.scale(pair.radius - 0.5 * pair.overlap, spin)
    relative_spin = spin
    if pair.other_spin is not None and found.of_other is not None:
        velocity = vectors.subtract(velocity, found.of_other(half))
        other = vectors.add(pair.other_spin, found.of_other(half_spin))
        turning = vectors.add(turning, vectors.scale(pair.other_radius - 0.5 * pair.overlap, other))
        relative_spin = vectors.subtract(spin, other)
    elif pair.wall_spin is not None:
        relative_spin = vectors.subtract(spin, pair.wall_spin)
    approach = -vectors.dot(velocity, normal)
    slip = vectors.subtract(tangent.part_in_plane(velocity, normal), tangent.surface_velocity(turning, normal))
    rolling = vectors.dot(load.resistance, relative_spin) if load.resistance else jnp.zeros_like(approach)
    walls = jnp.zeros_like(approach)
    if pair.other_spin is None:
        walls = _power_of_wall(found, before)
    conservative = load.along - parts.dashpot - parts.liquid
    none = jnp.zeros_like(approach)
    power = EnergyFlow(
        walls, none, none, none,
        damping=parts.dashpot * approach,
        liquid=parts.liquid * approach,
        adhesion=none,
        tangential=-vectors.dot(load.across, slip),
        tangential_damping=-vectors.dot(parts.across, slip),
        rolling=-rolling,
        conservative=-conservative * approach,
    )  # fmt: skip
    work: EnergyFlow = jax.tree.map(lambda x: time_step * x, power)
    if found.memory and model.cohesion is not None:
        ((earlier, later),) = found.memory
        closing = 2.0 * approach + vectors.dot(pair.velocity, normal)
        gap = gap_of(pair, found.material)._replace(overlap=pair.overlap + 0.5 * time_step * closing)
        constants = required(found.material.cohesion, "cohesion")
        work = work._replace(adhesion=energy_lost(model.cohesion, gap, constants, earlier, later))
    there = found.there
    return work if there is None else jax.tree.map(lambda x: jnp.where(there, x, 0.0), work)


def _power_of_wall(found: FoundContacts, before: Motion) -> Array:
    """Power of a wall's forces on the particles, at the wall's velocity [W]."""
    pair, load = found.pair, found.load
    wall = vectors.subtract(found.of_one(before.velocity), pair.velocity)
    force = vectors.add_scaled(tangent.in_space(load.across, pair.normal), load.along, pair.normal)
    power = vectors.dot(force, wall)
    if load.resistance and pair.wall_spin is not None:
        power = power + vectors.dot(load.resistance, pair.wall_spin)
    return power


def work_on_bodies(force: Vector, torque: Vector | None, before: Motion, after: Motion, time_step: Array) -> Array:
    """() work over a step of forces (N,) and torques on the particles, at the mean velocities [J]."""
    work = vectors.dot(force, vectors.add(before.velocity, after.velocity))
    if torque is not None:
        work = work + vectors.dot(torque, vectors.add(before.angular_velocity, after.angular_velocity))
    return 0.5 * time_step * jnp.sum(work)


def flow_of_interval(
    flow: EnergyFlow,
    properties: ParticleProperties,
    moved: ParticleProperties,
    gravity: Array,
    before: ParticleState,
    after: ParticleState,
) -> EnergyFlow:
    """The flow of an interval with what the forces of the fluid have done, of what all given forces have done.

    Args:
        flow: of the contact steps; `fluid` is the work of all given forces.
        properties: of the particles.
        moved: the same with the fluid that moves along, whose kinetic energy is not the particles'.
        gravity: (D,) [m/s2].
        before, after: the particles.
    """
    change = after.position - before.position
    if after.position_low is not None and before.position_low is not None:
        change = change + (after.position_low - before.position_low)
    there = jnp.ones(change.shape[0], bool) if before.active is None else before.active
    work = jnp.sum(jnp.where(there, properties.mass * jnp.sum(gravity[None] * change, axis=1), 0.0))
    gained = 0.5 * jnp.sum(after.velocity**2 - before.velocity**2, axis=1)
    along = jnp.sum(jnp.where(there, (moved.mass - properties.mass) * gained, 0.0))
    return flow._replace(fluid=flow.fluid - work - along, gravity=work)


# --- a moment ---------------------------------------------------------------------------------------------


def stored_energy(
    model: ContactModel,
    surroundings: Surroundings,
    properties: ParticleProperties,
    gravity: Array,
    state: ParticleState,
    neighbors: Neighbors,
) -> StoredEnergy:
    """What is stored in a state.

    A tangential or rolling spring is that of the middle of the last step.

    Args:
        model: laws and walls; static.
        surroundings: materials, and where the walls are.
        properties: size and density, without fluid that moves along.
        gravity: (D,) [m/s2].
        state: particles.
        neighbors: their list, in date.
    """
    motion, dtype = Motion.of(state), state.velocity.dtype
    there = jnp.ones(state.velocity.shape[0], bool) if state.active is None else state.active
    mass, inertia = (jnp.where(there, x, 0.0) for x in (properties.mass, properties.inertia))
    height = vectors.dot(tuple(gravity), motion.position)
    if motion.low[0] is not None:
        height = height + vectors.dot(tuple(gravity), motion.low)  # type: ignore[arg-type]
    springs = tuple(jnp.zeros((), dtype) for _ in range(4))
    step = ContactStep(model, surroundings, properties, motion, motion.velocity, jnp.zeros((), dtype), state.active)
    for pair, material, kept, real in _contacts(step, neighbors):
        own = _of_springs(step, pair, material, kept)
        springs = tuple(
            total + jnp.sum(part if real is None else jnp.where(real, part, 0.0))
            for total, part in zip(springs, own, strict=True)
        )
    return StoredEnergy(
        0.5 * jnp.sum(mass * vectors.dot(motion.velocity, motion.velocity)),
        0.5 * jnp.sum(inertia * vectors.dot(motion.angular_velocity, motion.angular_velocity)),
        -jnp.sum(mass * height),
        *springs,
    )


def _contacts(
    step: ContactStep, neighbors: Neighbors
) -> list[tuple[ContactPair, ContactMaterial, Vector, Array | None]]:
    """All contacts as they are: what they are, their constants, what they keep, and which of them are any."""
    found: list[tuple[ContactPair, ContactMaterial, Vector, Array | None]] = []
    if neighbors.room.slots:
        pair, _ = pair_contacts(step, neighbors)
        found.append((pair, pair_material(step, neighbors), step.motion.contact_spring, None))
    if step.model.analytic_walls:
        pair, _ = wall_contacts(step)
        found.append((pair, wall_material(step), step.motion.wall_spring, None))
    for number in range(len(step.model.meshes)):
        found.append(mesh_pair(step, neighbors, number))
    return found


def _of_springs(
    step: ContactStep, pair: ContactPair, material: ContactMaterial, kept: Vector
) -> tuple[Array, Array, Array, Array]:
    """Energy of every contact: of the normal, tangential and rolling spring, and of the surface [J]."""
    model, law = step.model, step.model.law
    if not isinstance(law, StoringLaw):  # refused before
        raise TypeError("the contact law does not say what its springs store")
    number = len(kept) - model.memory
    memory, in_plane = kept[number:], vectors.angular_size(len(pair.normal))
    attraction = attraction_of(step, material, pair, memory)
    touching = pair.overlap > 0 if attraction is None else attraction.touching
    overlap = jnp.where(touching, pair.overlap if attraction is None else attraction.overlap, 0.0)
    radius = pair.effective_radius
    normal, surface = law.energy(overlap, radius, material), jnp.zeros_like(overlap)
    if model.cohesion is not None:
        constants = required(material.cohesion, "cohesion")
        beside = cohesion_energy(model.cohesion, gap_of(pair, material), constants, memory)
        normal, surface = normal + beside.elastic, beside.surface
    across = kept[:in_plane]
    tangential = 0.5 * law.tangential_stiffness(overlap, radius, material) * vectors.dot(across, across)
    rolling = jnp.zeros_like(overlap)
    if model.rolling is not None and model.rolling.has_spring:
        torque = kept[in_plane:number]
        pressed = jnp.where(touching, overlap, TOUCHING * radius)
        lever, elastic = material.rolling_friction * radius, law.elastic(pressed, radius, material)
        stiffness = model.rolling.stiffness(lever, elastic, pressed)
        loaded = touching & (stiffness > 0)
        rolling = jnp.where(loaded, 0.5 * vectors.dot(torque, torque) / jnp.where(loaded, stiffness, 1.0), 0.0)
    return normal, jnp.where(touching, tangential, 0.0), rolling, surface
