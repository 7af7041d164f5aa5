"""Contacts between particles: where two of them stand to one another, and the sums of what they do."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics import vectors
from jaxdem.numerics.quotients import harmonic
from jaxdem.numerics.stages import stage
from jaxdem.numerics.vectors import Vector
from jaxdem.particles import liquid
from jaxdem.particles.contact import ContactMaterial
from jaxdem.particles.contact_load import contact_load
from jaxdem.particles.contact_pair import ContactLoad, ContactPair, on_bodies
from jaxdem.particles.contact_step import ContactStep, PairSizes
from jaxdem.particles.contact_sums import FoundContacts, Sums
from jaxdem.particles.integrate import ParticleProperties
from jaxdem.particles.neighbors import Neighbors, displacement_since_build
from jaxdem.particles.pairs import Pairs, at, sum_over_pairs
from jaxdem.particles.tiles import ALL, Cut, in_tiles


def pair_contacts(
    step: ContactStep, neighbors: Neighbors, displacement: Vector | None = None
) -> tuple[ContactPair, ContactLoad]:
    """The contacts between particles, and what they do.

    Args:
        step: all particles.
        neighbors: list in date.
        displacement: of every particle since it was built, if it is known [m].
    """
    pairs, sizes = neighbors.pairs, step.pair_sizes
    if sizes is None:
        sizes = pair_sizes(step.properties, pairs)
    if displacement is None:  # outside of the stage, for a gather would compute it anew
        displacement = displacement_since_build(step.motion.position, step.motion.low, neighbors)
    change, approach, velocity, spin, other_spin = stage(
        pairs.first[0] != pairs.second[0], lambda: _relative_motion(step, pairs, displacement)
    )
    overlap, normal = pair_geometry(neighbors, change, sizes.radius + sizes.other_radius)
    pair = ContactPair(overlap, normal, approach, velocity, spin, other_spin, *sizes)
    return pair, contact_load(step, pair_material(step, neighbors), pair, step.motion.contact_spring)


def pair_sizes(properties: ParticleProperties, pairs: Pairs) -> PairSizes:
    """Sizes of all pairs."""
    radius, mass = properties.radius, properties.mass
    one, other = _of(radius, pairs.first), _of(radius, pairs.second)
    inertia = mass * radius**2
    return PairSizes(
        one,
        other,
        harmonic(one, other),
        harmonic(_of(mass, pairs.first), _of(mass, pairs.second)),
        1.4 * harmonic(_of(inertia, pairs.first), _of(inertia, pairs.second)),
    )


def pair_material(step: ContactStep, neighbors: Neighbors) -> ContactMaterial:
    """Numbers of the contacts between particles."""
    material, index = step.surroundings.pair, step.model.materials
    return material if index is None else index.between_particles(material, neighbors.pairs, step.properties.identity)


class _PairSums(NamedTuple):
    """What the contacts between particles do, (P,) each.

    Attributes:
        force: on the first of each pair, minus that on the second [N].
        torque, other_torque: on the first, and on the second [N m].
        changed: bool, bridges that form or rupture; None without liquid.
        found: the contacts themselves, None where no balance of energy is kept.
    """

    force: Vector
    torque: Vector
    other_torque: Vector
    changed: Array | None
    found: tuple[ContactPair, ContactLoad] | None


def counted_pairs(neighbors: Neighbors) -> Array | None:
    """(P,) bool, which pairs belong to this slab: one across a border is in the lists of both, and is counted with its
    first particle. None on one device."""
    ghosts = neighbors.ghosts
    return None if ghosts is None else ghosts.body(neighbors.pairs.first) < ghosts.rows


def add_pairs(step: ContactStep, neighbors: Neighbors, sums: Sums) -> tuple[Sums, Vector]:
    """Adds the contacts between particles; returns their new springs too."""
    contacts, spring = _all_pairs(step, neighbors)
    pairs = neighbors.pairs

    def added(total: Vector, on_one: Vector, on_other: Vector) -> Vector:
        parts = zip(total, on_one, on_other, strict=True)
        return tuple(x + sum_over_pairs(a, b, pairs) for x, a, b in parts)

    both = added(sums.force, contacts.force, vectors.scale(-1.0, contacts.force))
    film = sums.liquid
    if film is not None:
        volume, constants = spring[-1], required(step.surroundings.pair.cohesion, "cohesion")
        changed = required(contacts.changed, "changed bridges")
        volume, film = liquid.with_pairs(changed, volume, film, pairs, constants, sparsely=step.tiled)
        spring = (*spring[:-1], volume)
    summed = Sums(both, added(sums.torque, contacts.torque, contacts.other_torque), liquid=film)
    if contacts.found is not None:
        summed = summed._replace(found=(_found(step, neighbors, *contacts.found, spring),))
    return summed, spring


def _all_pairs(step: ContactStep, neighbors: Neighbors) -> tuple[_PairSums, Vector]:
    """What all contacts between particles do, and what they keep."""
    displacement = displacement_since_build(step.motion.position, step.motion.low, neighbors)
    pairs = neighbors.pairs

    kept = step.motion.contact_spring
    springs = kept if step.motion.liquid is None else kept[:-1]  # the law leaves the bridges as they are
    bridges = kept[len(springs) :]

    def of_rows(cut: Cut, spring: Vector) -> tuple[_PairSums, Vector]:
        own = dataclasses.replace(
            neighbors,
            pairs=pairs._replace(first=cut(pairs.first), second=cut(pairs.second)),
            separation=cut(neighbors.separation),
            overlap=cut(neighbors.overlap),
        )
        motion = step.motion._replace(contact_spring=(*spring, *cut(bridges)))
        seen = dataclasses.replace(step, motion=motion, pair_sizes=cut(step.pair_sizes))
        pair, load = pair_contacts(seen, own, displacement)
        changed = None
        if bridges:
            constants = required(step.surroundings.pair.cohesion, "cohesion")
            changed = liquid.changes(pair.overlap, cut(bridges[0]), constants)
        found = (pair, load) if step.model.energy else None
        return _PairSums(*on_bodies(load, pair), changed, found), load.spring[: len(springs)]

    done, springs = in_tiles(len(pairs.first), of_rows, springs) if step.tiled else of_rows(ALL, springs)
    return done, (*springs, *bridges)


def _found(
    step: ContactStep, neighbors: Neighbors, pair: ContactPair, load: ContactLoad, spring: Vector
) -> FoundContacts:
    """The contacts one by one, with what they keep from now on."""
    pairs, before = neighbors.pairs, step.motion.contact_spring
    number = len(spring) - step.model.memory
    return FoundContacts(
        pair, load, pair_material(step, neighbors),
        of_one=lambda values: at(values, pairs.first), of_other=lambda values: at(values, pairs.second),
        onto=lambda values: sum_over_pairs(values, values, pairs),
        memory=((before[number:], spring[number:]),) if step.model.memory else (), counted=counted_pairs(neighbors),
    )  # fmt: skip


def _relative_motion(
    step: ContactStep, pairs: Pairs, displacement: Vector
) -> tuple[Vector, Vector, Vector, Vector, Vector]:
    """Of all pairs: change of the separation since the build, velocities of approach and now, both spins."""

    def difference(quantity: Vector) -> Vector:
        return vectors.subtract(at(quantity, pairs.first), at(quantity, pairs.second))

    spin = step.motion.angular_velocity
    return (
        difference(displacement),
        difference(step.mid_velocity),
        difference(step.motion.velocity),
        at(spin, pairs.first),
        at(spin, pairs.second),
    )


def pair_geometry(neighbors: Neighbors, change: Vector, radius_sum: Array) -> tuple[Array, Vector]:
    """Overlap now, and unit normal towards the first particle, of all pairs.

    |r0 + D| - |r0| = D.(2 r0 + D) / (|r0 + D| + |r0|), D the change of the separation since the build:
    so the overlap keeps its leading digits.
    """
    initial = neighbors.separation
    separation = vectors.add(initial, change)
    distance = vectors.length(separation)
    apart = distance > 0
    distance = jnp.where(apart, distance, 1.0)
    inverse = 1.0 / distance
    growth = vectors.dot(change, vectors.add(initial, separation))
    initial_distance = radius_sum - neighbors.overlap
    overlap = neighbors.overlap - growth / (distance + initial_distance)
    # Coincident centres have no direction: they part along the first axis, the lower index backwards.
    first = jnp.where(apart, separation[0] * inverse, -1.0)
    return overlap, (first.astype(distance.dtype), *(x * inverse for x in separation[1:]))


def _of(quantity: Array, index: Array) -> Array:
    """() unchanged, of (N,) the rows of these indices."""
    return quantity if quantity.ndim == 0 else at((quantity,), index)[0]
