"""Contact forces summed over the neighbours and walls of every particle."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp

from jaxdem.particles.bonds import add_bonds
from jaxdem.particles.contact import ContactMaterial
from jaxdem.particles.contact_pair import ContactLoad, ContactPair, on_bodies
from jaxdem.particles.contact_step import ContactStep
from jaxdem.particles.contact_sums import Sums, Touching
from jaxdem.particles.integrate import Motion
from jaxdem.particles.mesh_forces import add_meshes
from jaxdem.particles.neighbors import Neighbors
from jaxdem.particles.pair_forces import add_pairs, pair_contacts, pair_material
from jaxdem.particles.wall_forces import add_walls, wall_contacts, wall_material


def contact_forces(step: ContactStep, neighbors: Neighbors) -> tuple[Sums, Motion]:
    """Force and torque of all contacts on every particle, and the motion with its new contact history.

    Args:
        step: particles, walls and laws.
        neighbors: list in date.
    """
    model, motion = step.model, step.motion
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


def contacts_now(step: ContactStep, neighbors: Neighbors) -> tuple[Touching | None, Touching | None]:
    """Contacts between the pairs of a list, and with the walls, as they are.

    Args:
        step: of no time, so that no spring grows.
        neighbors: list in date.

    Returns:
        None for the first where the list has no slots, and for the second without walls.
    """
    # Rolling resistance is a torque, and one of its models divides by the time step.
    step = dataclasses.replace(step, model=dataclasses.replace(step.model, rolling=None))
    between = walls = None
    if neighbors.room.slots:
        between = _touching(*pair_contacts(step, neighbors), pair_material(step, neighbors))
    if step.model.analytic_walls:
        walls = _touching(*wall_contacts(step), wall_material(step))
    return between, walls


def _touching(pair: ContactPair, load: ContactLoad, material: ContactMaterial) -> Touching:
    return Touching(pair.overlap, pair.normal, on_bodies(load, pair)[0], material.friction, load.adhesion)
