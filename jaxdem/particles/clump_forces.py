"""Contacts of clumps: members go through the list and the contact kernel of spheres, bodies get the sums."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import jax.numpy as jnp
from jax import Array, lax

from jaxdem.errors import required
from jaxdem.numerics import compensated, vectors
from jaxdem.numerics.placement import Placement
from jaxdem.numerics.stages import stage
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.clump_shape import Clumps, Placed
from jaxdem.particles.clumps import arm_change, farthest_way, member_places, placed, way_ahead
from jaxdem.particles.contact_pair import sum_slots
from jaxdem.particles.contact_step import ContactStep
from jaxdem.particles.contact_sums import Sums
from jaxdem.particles.forces import contact_forces
from jaxdem.particles.integrate import Motion, ParticleState, drift
from jaxdem.particles.neighbor_search import NeighborSearch
from jaxdem.particles.neighbors import Neighbors, displacement_since_build

SURELY = 0.99
"""Of the room of a member: below it none has left, whatever the rounding [-]."""


def clump_forces(step: ContactStep, neighbors: Neighbors) -> tuple[Sums, Motion]:
    """Force and torque about the centre of mass of all contacts on every body; see `forces.contact_forces`.

    A member at the arm a has the velocity v + w x a; a force F on it is the force F and the torque a x F on the body.
    """
    motion, clumps, reference = step.motion, step.properties.rigid, _placed(neighbors)
    count = motion.velocity[0].shape[0]

    def moved() -> tuple[Vector, Motion, Vector]:
        change = arm_change(reference, motion)
        arm = vectors.add(reference.arm, change)
        around = vectors.rotate(tuple(w[None] for w in motion.angular_velocity), arm)

        def of_members(velocity: Vector) -> Vector:
            return tuple((v[None] + w).reshape(-1) for v, w in zip(velocity, around, strict=True))

        position, low = member_places(reference, motion, change)
        members = Motion(
            position, low, of_members(motion.velocity),
            tuple(clumps.rows(w, count) for w in motion.angular_velocity), (), (),
        )  # fmt: skip
        return arm, members, of_members(step.mid_velocity)

    # Stages: every gather of the contact kernel would compute the members anew, and for the torque the forces would be
    # summed over the pairs once more. The condition holds, and is not known before the program runs.
    always = neighbors.builds >= 0
    arm, members, middle = stage(always, moved)
    members = members._replace(
        contact_spring=motion.contact_spring,
        wall_spring=motion.wall_spring,
        liquid=motion.liquid,
        mesh_memory=motion.mesh_memory,
    )
    seen = dataclasses.replace(
        step,
        properties=step.properties.spheres(count),
        motion=members,
        mid_velocity=middle,
        active=reference.active_rows(step.active),
    )
    sums, members = contact_forces(seen, neighbors)

    def summed() -> tuple[Vector, Vector]:
        force, torque = (tuple(x.reshape(clumps.members, count) for x in v) for v in (sums.force, sums.torque))
        torque = vectors.add(torque, vectors.moment(arm, force))
        return tuple(map(sum_slots, force)), tuple(map(sum_slots, torque))

    force, torque = stage(always, summed)
    walls = sums.walls
    if walls is not None:  # the mass of a body counts once, however many of its members touch
        mass = jnp.max(walls.mass[0].reshape(-1, clumps.members, count), axis=1)
        walls = walls._replace(mass=(jnp.zeros_like(walls.mass[0]).at[:, :count].set(mass),))
    on_bodies = sums._replace(walls=walls, force=force, torque=torque)
    return on_bodies, motion._replace(
        contact_spring=members.contact_spring, wall_spring=members.wall_spring, mesh_memory=members.mesh_memory
    )


def touching_motion(clumps: Clumps, neighbors: Neighbors, motion: Motion) -> Motion:
    """The motion with the velocities (m N,) of all members where the bodies stand."""
    reference, count = _placed(neighbors), motion.velocity[0].shape[0]
    arm = vectors.add(reference.arm, arm_change(reference, motion))
    around = vectors.rotate(tuple(w[None] for w in motion.angular_velocity), arm)
    return motion._replace(
        velocity=tuple((v[None] + w).reshape(-1) for v, w in zip(motion.velocity, around, strict=True)),
        angular_velocity=tuple(clumps.rows(w, count) for w in motion.angular_velocity),
    )


def on_bodies(clumps: Clumps | None, values: Array) -> Array:
    """(N,) sums on bodies of values of all members; the values themselves where there are no clumps."""
    return values if clumps is None else sum_slots(values.reshape(clumps.members, -1))


def _placed(neighbors: Neighbors) -> Placed:
    return neighbors.bodies if neighbors.bodies is not None else required(neighbors.bodies, "bodies of a list")


def displacement_ahead(
    search: NeighborSearch, motion: Motion, neighbors: Neighbors, time_step: Array, way: Array | float = 0.0
) -> Vector:
    """Motion of all spheres from the list's build to the end of the coming step [m]; of clumps zeros while no member
    can have left its room, a mesh having moved by `way` [m]."""
    moved = drift(motion, time_step)
    if neighbors.bodies is None:
        return displacement_since_build(moved.position, moved.low, neighbors)
    bodies, skin = neighbors.bodies, search.geometry.skin
    far = jnp.max(farthest_way(bodies, moved, time_step)) + way > SURELY * 0.5 * skin
    return stage(far, lambda: way_ahead(bodies, moved, time_step, skin))


def updated(
    search: NeighborSearch,
    motion: Motion,
    neighbors: Neighbors,
    active: Array | None,
    meshes: Sequence[Placement | None] = (),
) -> Neighbors:
    """The list rebuilt at these places of particles or bodies; see `NeighborSearch.update`."""
    if neighbors.bodies is None:
        return search.update(motion.position, motion.low, neighbors, active, meshes)
    bodies, position, low = members_at(motion, neighbors.bodies.offset, neighbors.bodies.there)
    made = search.update(position, low, neighbors, bodies.active_rows(active), meshes)
    return dataclasses.replace(made, bodies=bodies)


def members_at(
    motion: Motion, offset: Vector, there: Array | None
) -> tuple[Placed, Vector, tuple[compensated.Low, ...]]:
    """Bodies as a list remembers them, and the centres of their members as pairs, D arrays (m N,)."""
    bodies = placed(motion.position, motion.low, motion.orientation, motion.orientation_low, offset, there)
    bodies = lax.stop_gradient(bodies)
    still = tuple(jnp.zeros_like(x) for x in bodies.arm)
    return bodies, *member_places(bodies, motion, still)


def as_members(state: ParticleState, clumps: Clumps | None) -> ParticleState:
    """The state of all spheres, each with its own centre and velocity; the state itself where there are no clumps."""
    if clumps is None:
        return state
    motion, count = Motion.of(state), state.position.shape[0]
    bodies, position, low = members_at(motion, clumps.offset, clumps.there)
    around = vectors.rotate(tuple(w[None] for w in motion.angular_velocity), bodies.arm)
    velocity = tuple((v[None] + w).reshape(-1) for v, w in zip(motion.velocity, around, strict=True))
    moved = motion._replace(
        position=position,
        low=low,
        velocity=velocity,
        angular_velocity=tuple(clumps.rows(w, count) for w in motion.angular_velocity),
        orientation=(),
        orientation_low=(),
    )
    return moved.into(state)._replace(active=bodies.active_rows(state.active))
