"""What is stored in the particles at a moment: by motion and weight, in springs, surfaces and bonds."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics import vectors
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.bond_geometry import bond_geometry
from jaxdem.particles.clumps import spin_energy
from jaxdem.particles.cohesion import TOUCHING
from jaxdem.particles.cohesion_energy import has_energy
from jaxdem.particles.contact import ContactMaterial, StoringLaw
from jaxdem.particles.contact_load import attraction_of
from jaxdem.particles.contact_model import ContactModel
from jaxdem.particles.contact_pair import ContactPair, sum_slots
from jaxdem.particles.contact_step import ContactStep
from jaxdem.particles.integrate import Motion, ParticleProperties, ParticleState
from jaxdem.particles.mesh_forces import mesh_pair, onto_particles
from jaxdem.particles.neighbors import Neighbors
from jaxdem.particles.normal_energy import normal_energy
from jaxdem.particles.pair_forces import counted_pairs, pair_contacts, pair_material
from jaxdem.particles.pairs import sum_over_pairs
from jaxdem.particles.wall_forces import wall_contacts, wall_material


class StoredEnergy(NamedTuple):
    """What is stored at a moment, each () [J].

    Attributes:
        translation: sum of m v^2 / 2.
        rotation: sum of w.I w / 2.
        potential: minus sum of m g.x.
        normal: of the springs along the normal, and what cohesion strains.
        tangential: of the tangential springs.
        rolling: of the rolling springs.
        surface: of cohesion.
        bonds: elastic, of the bonds that hold.
    """

    translation: Array
    rotation: Array
    potential: Array
    normal: Array
    tangential: Array
    rolling: Array
    surface: Array
    bonds: Array

    @property
    def total(self) -> Array:
        """Sum of all [J]."""
        return sum(self, start=jnp.zeros_like(self.translation))


def knows_energy(model: ContactModel) -> bool:
    """Whether contact law and cohesion say what they store."""
    return isinstance(model.law, StoringLaw) and has_energy(model.cohesion)


def stored_energy(
    step: ContactStep, neighbors: Neighbors, bodies: ParticleProperties, gravity: Array, state: ParticleState
) -> StoredEnergy:
    """What is stored in a state.

    A tangential or rolling spring is that of the middle of the last step.

    Args:
        step: what touches as it is, the particles or the members of clumps, with a time step of zero.
        neighbors: their list, in date.
        bodies: the particles, without fluid that moves along.
        gravity: (D,) [m/s2].
        state: of the particles; in a slab with the ghosts behind them, of which nothing is counted.
    """
    motion, dtype = Motion.of(state), state.velocity.dtype
    there = jnp.ones(state.velocity.shape[0], bool) if state.active is None else state.active
    mass = jnp.where(there, bodies.mass, 0.0)
    height = vectors.dot(tuple(gravity), motion.position)
    if motion.low[0] is not None:
        height = height + vectors.dot(tuple(gravity), motion.low)  # type: ignore[arg-type]
    springs = tuple(jnp.zeros((), dtype) for _ in range(4))
    for contacts in _contacts(step, neighbors):
        own: tuple[Array, ...] = _of_springs(step, contacts)
        if contacts.counted is not None:
            own = tuple(jnp.where(contacts.counted, part, 0.0) for part in own)
        springs = tuple(total + jnp.sum(part) for total, part in zip(springs, own, strict=True))
    normal, tangential, rolling, surface = springs
    return StoredEnergy(
        0.5 * jnp.sum(mass * vectors.dot(motion.velocity, motion.velocity)),
        jnp.sum(jnp.where(there, spin_energies(motion, bodies), 0.0)),
        -jnp.sum(mass * height),
        normal,
        tangential,
        rolling,
        surface,
        _of_bonds(step, bodies, motion),
    )


def strained(step: ContactStep, neighbors: Neighbors) -> Array:
    """(N,) energy of the tangential and rolling springs of what touches, half of that of a contact to each of two
    particles, all of a wall's [J]; see `stored_energy`."""
    total = jnp.zeros_like(step.motion.velocity[0])
    for contacts in _contacts(step, neighbors):
        _, tangential, rolling, _ = _of_springs(step, contacts)
        share = 1.0 if contacts.pair.other_spin is None else 0.5
        total = total + contacts.onto(share * (tangential + rolling))
    return total


def spin_energies(motion: Motion, bodies: ParticleProperties) -> Array:
    """(N,) energy of the rotation of every body [J]."""
    if bodies.clumps is not None:
        return spin_energy(motion.angular_velocity, motion.orientation, bodies)
    return 0.5 * bodies.inertia * vectors.dot(motion.angular_velocity, motion.angular_velocity)


def _of_bonds(step: ContactStep, bodies: ParticleProperties, motion: Motion) -> Array:
    """Elastic energy of the bonds that hold [J]."""
    if step.model.bonds is None or motion.bonds is None:
        return jnp.zeros((), motion.velocity[0].dtype)
    numbers = required(step.surroundings.bonds, "parameters.bonds")
    geometry = bond_geometry(step.model.bonds, numbers, bodies, motion, motion.bonds)
    holds, counted = motion.bonds.intact, motion.bonds.counted
    return jnp.sum(jnp.where(holds if counted is None else holds & counted, geometry.energy(), 0.0))


class _Contacts(NamedTuple):
    """Contacts of a kind as they are.

    Attributes:
        pair: what they are.
        material: their constants.
        kept: what they keep.
        onto: see `FoundContacts`.
        real: which of them are any; None for all.
        counted: which of them belong to this slab, see `counted_pairs`; None for all.
    """

    pair: ContactPair
    material: ContactMaterial
    kept: Vector
    onto: Callable[[Array], Array]
    real: Array | None = None
    counted: Array | None = None


def _contacts(step: ContactStep, neighbors: Neighbors) -> list[_Contacts]:
    """All contacts as they are."""
    found = []
    if neighbors.room.slots:
        pair, _ = pair_contacts(step, neighbors)
        kept, onto, counted = step.motion.contact_spring, _onto_pairs(neighbors), counted_pairs(neighbors)
        found.append(_Contacts(pair, pair_material(step, neighbors), kept, onto, counted=counted))
    if step.model.analytic_walls:
        pair, _ = wall_contacts(step)
        found.append(_Contacts(pair, wall_material(step), step.motion.wall_spring, sum_slots))
    for number in range(len(step.model.meshes)):
        pair, material, kept, real = mesh_pair(step, neighbors, number)
        if step.present is not None:
            real = real & step.present[step.model.analytic_walls + number]
        onto = onto_particles(step, neighbors.meshes[step.model.meshes[number].number])
        found.append(_Contacts(pair, material, kept, onto, real))
    return found


def _onto_pairs(neighbors: Neighbors) -> Callable[[Array], Array]:
    return lambda values: sum_over_pairs(values, values, neighbors.pairs)


def _of_springs(step: ContactStep, contacts: _Contacts) -> tuple[Array, Array, Array, Array]:
    """Energy of every contact: of the normal, tangential and rolling spring, and of the surface [J]."""
    model, law, (pair, material, kept, _, real, _) = step.model, step.model.law, contacts
    if not isinstance(law, StoringLaw):  # refused before
        raise TypeError("the contact law does not say what its springs store")
    number = len(kept) - model.memory
    memory, in_plane = kept[number:], vectors.angular_size(len(pair.normal))
    attraction = attraction_of(step, material, pair, memory)
    touching = pair.overlap > 0 if attraction is None else attraction.touching
    overlap = jnp.where(touching, pair.overlap if attraction is None else attraction.overlap, 0.0)
    radius = pair.effective_radius
    normal, surface = normal_energy(model, pair, material, memory, overlap)
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
    found = normal, jnp.where(touching, tangential, 0.0), rolling, surface
    if real is None:
        return found
    normal, tangential, rolling, surface = (jnp.where(real, part, 0.0) for part in found)
    return normal, tangential, rolling, surface
