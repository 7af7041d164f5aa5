"""Contact forces summed over the neighbours and walls of every particle."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
from jax import Array

from jaxdem.numerics.vectors import Vector
from jaxdem.particles.bonds import add_bonds
from jaxdem.particles.contact import ContactMaterial
from jaxdem.particles.contact_model import ContactModel
from jaxdem.particles.contact_pair import ContactLoad, ContactPair, on_bodies
from jaxdem.particles.contact_step import ContactStep, Surroundings
from jaxdem.particles.contact_sums import Sums, Touching
from jaxdem.particles.integrate import Motion, ParticleProperties
from jaxdem.particles.mesh_forces import add_meshes
from jaxdem.particles.neighbors import Neighbors
from jaxdem.particles.pair_forces import add_pairs, pair_contacts, pair_material
from jaxdem.particles.wall_forces import add_walls, wall_contacts, wall_material


def contact_forces(
    model: ContactModel,
    surroundings: Surroundings,
    properties: ParticleProperties,
    motion: Motion,
    neighbors: Neighbors,
    time_step: Array,
    mid_velocity: Vector | None = None,
    active: Array | None = None,
) -> tuple[Sums, Motion]:
    """Force and torque of all contacts on every particle, and the motion with its new contact history.

    Args:
        model: laws and walls; static.
        surroundings: material numbers.
        properties: size and density.
        motion: of the particles at this moment.
        neighbors: list in date.
        time_step: over which the springs grow [s].
        mid_velocity: D arrays (N,), velocity expected in the middle of the step, where `motion` has the
            positions: the dashpots act on it, the tangential ones with the spin at the step's start. The velocity in
            `motion`, at the step's start, if not given; the springs grow by that one, which is in the middle between
            two forces [m/s].
        active: (N,) bool, which particles there are, all if None; the list knows it already, the walls do not.
    """
    step = ContactStep(model, surroundings, properties, motion, mid_velocity or motion.velocity, time_step, active)
    zero = jnp.zeros_like(motion.position[0])
    sums = Sums((zero,) * len(motion.velocity), (zero,) * len(motion.angular_velocity), liquid=motion.liquid)
    spring, wall_spring = motion.contact_spring, motion.wall_spring
    if neighbors.room.slots:
        sums, spring = add_pairs(step, neighbors, sums)
    if model.analytic_walls:
        sums, wall_spring = add_walls(step, sums)
    if model.meshes:
        sums, motion = add_meshes(step, neighbors, sums)
    if model.bonds is not None:
        sums, motion = add_bonds(step, model.bonds, sums, motion)
    return sums, motion._replace(contact_spring=spring, wall_spring=wall_spring, liquid=sums.liquid)


def contacts_now(
    model: ContactModel,
    surroundings: Surroundings,
    properties: ParticleProperties,
    motion: Motion,
    neighbors: Neighbors,
    active: Array | None = None,
    present: Array | None = None,
) -> tuple[Touching | None, Touching | None]:
    """Contacts between the pairs of a list, and with the walls, as they are: no spring grows.

    Args:
        model, surroundings, properties, motion, neighbors, active: see `contact_forces`.
        present: (S,) bool, which walls are there, all if None; the others are out of reach.

    Returns:
        None for the first where the list has no slots, and for the second without walls.
    """
    still = jnp.zeros((), motion.position[0].dtype)
    # Rolling resistance is a torque, and one of its models divides by the time step.
    alone = dataclasses.replace(model, rolling=None)
    step = ContactStep(alone, surroundings, properties, motion, motion.velocity, still, active, present)
    between = walls = None
    if neighbors.room.slots:
        between = _touching(*pair_contacts(step, neighbors), pair_material(step, neighbors))
    if model.analytic_walls:
        walls = _touching(*wall_contacts(step), wall_material(step))
    return between, walls


def _touching(pair: ContactPair, load: ContactLoad, material: ContactMaterial) -> Touching:
    return Touching(pair.overlap, pair.normal, on_bodies(load, pair)[0], material.friction, load.adhesion)
