"""Contact forces summed over the neighbours and walls of every particle."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.particles import vectors, walls
from jaxdem.particles.contact import Contact, ContactLaw, ContactMaterial
from jaxdem.particles.integrate import Motion, ParticleProperties
from jaxdem.particles.neighbors import Neighbors, displacement_since_build
from jaxdem.particles.rolling import RollingFriction
from jaxdem.particles.vectors import Vector


class ContactModel(NamedTuple):
    """Which contacts a scene has; static.

    Attributes:
        law: between bodies that touch.
        rolling: rolling friction, or None: then no such term is compiled.
        sides: walls of the box.
    """

    law: ContactLaw
    rolling: RollingFriction | None
    sides: tuple[walls.BoxSide, ...]


class Surroundings(NamedTuple):
    """Materials of the contacts; traced.

    Attributes:
        pair: between particles.
        wall: between particles and walls.
        wall_velocity: velocity (D,) of each side of the box, sliding walls included [m/s].
    """

    pair: ContactMaterial
    wall: ContactMaterial
    wall_velocity: tuple[Array, ...]


class Sums(NamedTuple):
    """Force and torque on every particle, summed over its contacts: D and A arrays (N,) [N, N m]."""

    force: Vector
    torque: Vector


class _Body(NamedTuple):
    """The other body of a contact, as the particle sees it; no angular velocity means that it cannot turn."""

    arm: Array
    velocity: Vector
    mid_velocity: Vector
    angular_velocity: Vector | None
    effective_radius: Array
    effective_mass: Array


def contact_forces(
    model: ContactModel,
    surroundings: Surroundings,
    properties: ParticleProperties,
    motion: Motion,
    neighbors: Neighbors,
    time_step: Array,
    mid_velocity: Vector | None = None,
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
            positions: the normal dashpots act on it. The velocity in `motion`, at the step's start, if not
            given; the springs grow by that one, which is in the middle between two forces [m/s].
    """
    loop = _Loop(model, surroundings, properties, motion, mid_velocity or motion.velocity, time_step)
    displacement = displacement_since_build(motion.position, motion.low, neighbors)
    zero = jnp.zeros_like(motion.position[0])
    sums = Sums((zero,) * len(motion.velocity), (zero,) * len(motion.angular_velocity))
    springs, wall_springs = [], []
    for slot in range(neighbors.capacity):
        sums, spring = loop.add_pairs(neighbors, slot, displacement, sums)
        springs.append(spring)
    for number in range(len(model.sides)):
        sums, spring = loop.add_wall(number, sums)
        wall_springs.append(spring)
    return sums, motion._replace(contact_spring=tuple(springs), wall_spring=tuple(wall_springs))


class _Loop(NamedTuple):
    """What all contacts of a step share."""

    model: ContactModel
    surroundings: Surroundings
    properties: ParticleProperties
    motion: Motion
    mid_velocity: Vector
    time_step: Array

    def add_pairs(
        self, neighbors: Neighbors, slot: int, displacement: Vector, sums: Sums
    ) -> tuple[Sums, Vector]:
        """Adds the contacts with the neighbours in one slot; returns their new springs too."""
        other, motion = neighbors.index[slot], self.motion
        radius, mass = self.properties.radius, self.properties.mass
        other_radius = radius if radius.ndim == 0 else radius[other]
        other_mass = mass if mass.ndim == 0 else mass[other]
        overlap, normal = _pair_geometry(neighbors, slot, displacement, radius + other_radius)
        body = _Body(
            arm=other_radius,
            velocity=tuple(x[other] for x in motion.velocity),
            mid_velocity=tuple(x[other] for x in self.mid_velocity),
            angular_velocity=tuple(x[other] for x in motion.angular_velocity),
            effective_radius=radius * other_radius / (radius + other_radius),
            effective_mass=mass * other_mass / (mass + other_mass),
        )
        return self._add(self.surroundings.pair, body, overlap, normal, motion.contact_spring[slot], sums)

    def add_wall(self, number: int, sums: Sums) -> tuple[Sums, Vector]:
        """Adds the contacts with one side of the box, a body of infinite radius and mass."""
        side, motion, radius = self.model.sides[number], self.motion, self.properties.radius
        overlap = walls.wall_overlap(side, motion.position, motion.low, radius)
        wall_velocity = self.surroundings.wall_velocity[number]
        velocity = tuple(wall_velocity[k] for k in range(len(motion.position)))
        body = _Body(
            arm=jnp.zeros((), overlap.dtype),
            velocity=velocity,
            mid_velocity=velocity,
            angular_velocity=None,
            effective_radius=radius,
            effective_mass=self.properties.mass,
        )
        normal = walls.wall_normal(side, overlap.dtype, len(motion.position))
        return self._add(self.surroundings.wall, body, overlap, normal, motion.wall_spring[number], sums)

    def _add(
        self,
        material: ContactMaterial,
        body: _Body,
        overlap: Array,
        normal: Vector,
        spring: Vector,
        sums: Sums,
    ) -> tuple[Sums, Vector]:
        """Force and torque of one contact per particle, added to the sums; and its new spring."""
        motion, radius = self.motion, self.properties.radius
        approach_speed = -vectors.dot(vectors.subtract(self.mid_velocity, body.mid_velocity), normal)
        share = _share_of_step(overlap, 0.5 * self.time_step * jnp.abs(approach_speed))
        touching = overlap > 0
        # The laws take square roots: elsewhere they see an overlap at which these and their slopes are finite,
        # the same from either side, for a dashpot may act already.
        overlap = jnp.where(touching, overlap, 1e-12 * body.effective_radius)
        arm = radius - 0.5 * overlap
        spin, relative_spin = vectors.scale(arm, motion.angular_velocity), motion.angular_velocity
        if body.angular_velocity is not None:
            spin = vectors.add(spin, vectors.scale(body.arm - 0.5 * overlap, body.angular_velocity))
            relative_spin = vectors.subtract(relative_spin, body.angular_velocity)
        relative = vectors.subtract(motion.velocity, body.velocity)
        separation_rate = vectors.dot(relative, normal)
        surface = vectors.subtract(relative, vectors.scale(separation_rate, normal))
        surface = vectors.subtract(surface, vectors.rotate(spin, normal))
        grown = vectors.add(_into_plane(spring, normal), vectors.scale(self.time_step, surface))
        contact = Contact(
            overlap=overlap,
            approach_speed=share * approach_speed,
            tangential_velocity=surface,
            spring=grown,
            effective_radius=body.effective_radius,
            effective_mass=body.effective_mass,
        )
        result = self.model.law(contact, material)
        # A contact that begins or ends within the step, but not in its middle, has its dashpot only.
        along = jnp.where(touching, result.normal, result.normal - result.elastic)
        across = vectors.where(touching, result.tangential, 0.0)
        force = vectors.add(vectors.scale(along, normal), across)
        torque = vectors.scale(-arm, vectors.moment(normal, result.tangential))
        if self.model.rolling is not None:
            resistance = self.model.rolling(contact, result, material, relative_spin, self.time_step)
            torque = vectors.add(torque, resistance)
        sums = Sums(
            vectors.add(sums.force, force),
            vectors.add(sums.torque, vectors.where(touching, torque, 0.0)),
        )
        return sums, vectors.where(touching, result.spring, 0.0)


def _share_of_step(overlap: Array, reach: Array) -> Array:
    """Part of the step for which a pair touches [-].

    `overlap` is that in the middle of the step, `reach` how far it changes in half a step. Without this the
    impulse of a dashpot that starts at full strength, as that of the linear law, depends on where in a step
    the contact begins: 0.3 % of the rebound speed at a hundred steps per contact. It also makes the force a
    continuous function of the position.
    """
    changes = jnp.abs(overlap) < reach
    within = 0.5 + 0.5 * overlap / jnp.where(changes, reach, 1.0)
    return jnp.where(changes, within, (overlap > 0).astype(overlap.dtype))


def _pair_geometry(
    neighbors: Neighbors, slot: int, displacement: Vector, radius_sum: Array
) -> tuple[Array, Vector]:
    """Overlap now, and unit normal towards the particle, of the pairs in one slot.

    |r0 + D| - |r0| = D.(2 r0 + D) / (|r0 + D| + |r0|), D the change of the separation since the build:
    so the overlap keeps its leading digits.
    """
    other, initial = neighbors.index[slot], neighbors.separation[slot]
    change = vectors.subtract(displacement, tuple(x[other] for x in displacement))
    separation = vectors.add(initial, change)
    distance = vectors.safe_sqrt(vectors.dot(separation, separation))
    apart = distance > 0
    distance = jnp.where(apart, distance, 1.0)
    growth = vectors.dot(change, vectors.add(initial, separation))
    initial_distance = radius_sum - neighbors.overlap[slot]
    overlap = neighbors.overlap[slot] - growth / (distance + initial_distance)
    # Coincident centres have no direction: they part along the first axis, the lower index backwards.
    own = jnp.arange(other.shape[0], dtype=other.dtype)
    first = jnp.where(apart, separation[0] / distance, jnp.where(own < other, -1.0, 1.0))
    return overlap, (first.astype(distance.dtype), *(x / distance for x in separation[1:]))


def _into_plane(spring: Vector, normal: Vector) -> Vector:
    """The spring turned into the present contact plane: its part in the plane, with its old length."""
    along = vectors.dot(spring, normal)
    flat = vectors.subtract(spring, vectors.scale(along, normal))
    before, after = vectors.dot(spring, spring), vectors.dot(flat, flat)
    stretched = after > 0
    ratio = jnp.where(stretched, before / jnp.where(stretched, after, 1.0), 1.0)
    return vectors.scale(jnp.sqrt(ratio), flat)
