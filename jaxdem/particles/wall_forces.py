"""Contacts with the sides of the box and with surfaces that have a formula: geometry, motion and loads of the walls."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics import vectors
from jaxdem.numerics.compensated import Low
from jaxdem.numerics.placement import Placement
from jaxdem.numerics.vectors import Vector
from jaxdem.particles import liquid, walls
from jaxdem.particles.contact import ContactMaterial
from jaxdem.particles.contact_load import contact_load
from jaxdem.particles.contact_model import ContactModel
from jaxdem.particles.contact_pair import ContactLoad, ContactPair, on_bodies, row, rows, sum_slots
from jaxdem.particles.contact_step import ContactStep
from jaxdem.particles.contact_sums import FoundContacts, Sums, WallLoads
from jaxdem.particles.surfaces import surface_contacts
from jaxdem.particles.tiles import ALL, Cut, in_tiles


def wall_contacts(step: ContactStep) -> tuple[ContactPair, ContactLoad]:
    """The contacts with the walls, bodies of infinite radius and mass, and what they do."""
    motion, radius, mass = step.motion, row(step.properties.radius), row(step.properties.mass)
    position, low, placed = motion.position, motion.low, step.surroundings.placements
    overlap, normal = wall_geometry(step.model, position, low, step.properties.radius, placed)
    particles_there = None if step.active is None else step.active[None]
    walls_there = None if step.present is None else step.present[: step.model.analytic_walls, None]
    for there in (particles_there, walls_there):
        if there is not None:  # the others are out of reach by a radius, whatever the speed
            overlap = jnp.where(there, overlap, -jnp.ones_like(overlap) * radius)
    wall, spin = _wall_velocity(step, overlap, normal), _wall_spin(step)
    spring = motion.wall_spring if spin is None else step.turned_with_walls(motion.wall_spring, spin)
    pair = ContactPair(
        overlap, normal,
        approach=vectors.subtract(rows(step.mid_velocity), wall),
        velocity=vectors.subtract(rows(motion.velocity), wall),
        spin=rows(motion.angular_velocity), other_spin=None,
        radius=radius, other_radius=jnp.zeros((), overlap.dtype),
        effective_radius=radius, effective_mass=mass, rolling_inertia=1.4 * mass * radius**2, wall_spin=spin,
    )  # fmt: skip
    return pair, contact_load(step, wall_material(step), pair, spring)


def wall_material(step: ContactStep) -> ContactMaterial:
    """Numbers of the contacts with the walls."""
    material, index = step.surroundings.wall, step.model.materials
    if index is None:
        return material
    return index.with_walls(material, step.properties.identity, step.model.analytic_walls)


class _WallSums(NamedTuple):
    """What the walls do to the particles (N,).

    Attributes:
        force, torque: on every particle [N, N m].
        loads: what each does to the walls that are measured; None without.
        liquid: films; None without capillary bridges [m3].
        found: the contacts themselves, None where no balance of energy is kept.
    """

    force: Vector
    torque: Vector
    loads: WallLoads | None
    liquid: Array | None
    found: tuple[ContactPair, ContactLoad] | None


def add_walls(step: ContactStep, sums: Sums) -> tuple[Sums, Vector]:
    """Adds the contacts with the walls."""

    def of_rows(cut: Cut, spring: Vector) -> tuple[_WallSums, Vector]:
        return _walls_of(step.of_rows(cut, spring), cut(sums.liquid))

    count, number, kept = len(step.motion.position[0]), step.model.analytic_walls, step.motion.wall_spring
    done, spring = in_tiles(count, of_rows, kept, number) if step.tiled else of_rows(ALL, kept)
    force, torque = vectors.add(sums.force, done.force), vectors.add(sums.torque, done.torque)
    summed = Sums(force, torque, done.loads, done.liquid)
    if done.found is not None:
        first = len(spring) - step.model.memory
        memory = ((kept[first:], spring[first:]),) if step.model.memory else ()
        numbers = tuple(range(number))
        pair, load = done.found
        found = FoundContacts(pair, load, wall_material(step), rows, None, sum_slots, memory, walls=numbers)
        summed = summed._replace(found=(*sums.found, found))
    return summed, spring


def _walls_of(step: ContactStep, film: Array | None) -> tuple[_WallSums, Vector]:
    """What the walls do to the particles of a step, whose films are given, and what the contacts keep, (S, N) each."""
    pair, load = wall_contacts(step)
    force, torque, _ = on_bodies(load, pair)
    loads = _wall_loads(step, pair, load) if step.model.measured_analytic else None
    spring = load.spring
    if film is not None:
        # Bridges as the law gives them back: where it is not needed there is none.
        constants = required(step.surroundings.wall.cohesion, "cohesion")
        volume, film = liquid.with_walls(pair.overlap, spring[-1], film, constants)
        spring = (*spring[:-1], volume)
    found = (pair, load) if step.model.energy else None
    force, torque = (tuple(sum_slots(x) for x in vector) for vector in (force, torque))
    return _WallSums(force, torque, loads, film, found), spring


def wall_geometry(
    model: ContactModel, position: Vector, low: tuple[Low, ...], radius: Array, placed: tuple[Placement | None, ...]
) -> tuple[Array, Vector]:
    """Overlap (S, N) with all analytic walls, and their unit normals, (S, 1) if all are sides of the box.

    Args:
        model: which walls there are; static.
        position, low: of the particles, D arrays (N,) [m].
        radius: () or (N,) [m].
        placed: where every surface is; empty where all are at rest.
    """
    overlaps, normals = [], []
    if model.sides:
        depths = [walls.wall_overlap(side, position, low, radius) for side in model.sides]
        overlaps.append(jnp.stack(depths))
        normals.append(walls.wall_normals(model.sides, overlaps[0].dtype, len(position)))
    if model.surfaces:
        overlap, normal = surface_contacts(model.surfaces, position, low, radius, placed[: len(model.surfaces)])
        overlaps.append(overlap)
        normals.append(normal)
    if len(overlaps) == 1:
        return overlaps[0], normals[0]
    normals[0] = tuple(jnp.broadcast_to(x, overlaps[0].shape) for x in normals[0])
    return jnp.concatenate(overlaps), tuple(map(jnp.concatenate, zip(*normals, strict=True)))


def _wall_velocity(step: ContactStep, overlap: Array, normal: Vector) -> Vector:
    """Velocity of the walls at the contacts, D arrays (S, 1), or (S, N) where walls move [m/s]."""
    velocities = step.surroundings.wall_velocity[: step.model.analytic_walls]
    if not step.surroundings.placements:
        return tuple(jnp.stack(components)[:, None] for components in zip(*velocities, strict=True))
    sides, placed_surfaces = len(step.model.sides), step.surroundings.placements
    # In the middle of the overlap, where the force acts; of a particle that does not touch, at its surface.
    arm = 0.5 * jnp.maximum(overlap, 0.0) - row(step.properties.radius)
    of_walls = []
    for number, velocity in enumerate(velocities):
        placed = placed_surfaces[number - sides] if number >= sides else None
        own = tuple(velocity[k] for k in range(velocity.shape[0]))
        if placed is not None:
            moved = placed.velocity_at(
                tuple(x + arm[number] * n[number] for x, n in zip(step.motion.position, normal, strict=True))
            )
            own = vectors.add(own, moved)
        of_walls.append(tuple(jnp.broadcast_to(x, overlap.shape[1:]) for x in own))
    return tuple(jnp.stack(components) for components in zip(*of_walls, strict=True))


def _wall_spin(step: ContactStep) -> Vector | None:
    """Angular velocity of the walls, A arrays (S, 1); None where none turns [rad/s]."""
    placed_surfaces = step.surroundings.placements[: len(step.model.surfaces)]
    if all(placed is None or placed.angular_velocity is None for placed in placed_surfaces):
        return None
    still = jnp.zeros_like(step.motion.angular_velocity[0], shape=len(step.motion.angular_velocity))
    given = [None if placed is None else placed.angular_velocity for placed in placed_surfaces]
    of_walls = [still] * len(step.model.sides) + [still if spin is None else spin for spin in given]
    return tuple(column[:, None] for column in jnp.stack(of_walls).T)


def _wall_loads(step: ContactStep, pair: ContactPair, load: ContactLoad) -> WallLoads:
    """What each particle does to the M walls that are measured, (M, N).

    Computed anew from their contacts: so the forces of all walls stay within the sums of the particles.
    """
    of_walls = []
    for k in step.model.measured_analytic:
        own = jax.tree.map(lambda x, k=k: x[k : k + 1] if x.ndim == 2 and len(x) > 1 else x, (pair, load))
        force, torque, _ = on_bodies(own[1], own[0])
        turning = vectors.add(vectors.moment(rows(step.motion.position), force), torque)
        force, turning = vectors.scale(-1.0, force), vectors.scale(-1.0, turning)
        of_walls.append(WallLoads(force, turning, step.power(k, force, turning), _mass(step, own[0])))
    loads: WallLoads = jax.tree.map(lambda *parts: jnp.concatenate(parts), *of_walls)
    return loads


def _mass(step: ContactStep, pair: ContactPair) -> Vector:
    """Mass (1, N) of the particles that touch a wall."""
    mass = jnp.broadcast_to(row(step.properties.mass), pair.overlap.shape)
    return (jnp.where(pair.overlap > 0, mass, 0.0),)
