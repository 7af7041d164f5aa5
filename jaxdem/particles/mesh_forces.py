"""Contacts with walls of triangles: bodies of infinite radius and mass, which turn what their contacts keep."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics import vectors
from jaxdem.numerics.placement import Placement
from jaxdem.numerics.vectors import Vector
from jaxdem.particles import tangent
from jaxdem.particles.contact import ContactMaterial
from jaxdem.particles.contact_load import contact_load
from jaxdem.particles.contact_model import MeshWall
from jaxdem.particles.contact_pair import ContactLoad, ContactPair, on_bodies, row, rows, sum_slots
from jaxdem.particles.contact_step import ContactStep
from jaxdem.particles.contact_sums import FoundContacts, Sums, WallLoads
from jaxdem.particles.integrate import Motion
from jaxdem.particles.mesh_cohesion import gap_of_laws, going_on, lost_at_once, with_bridges, with_springs
from jaxdem.particles.mesh_contact import MeshMemory, MeshTouch, begins, remembered, touching
from jaxdem.particles.mesh_list import MeshList
from jaxdem.particles.neighbors import Neighbors, displacement_since_build
from jaxdem.particles.wear import WearContact, worn


def add_meshes(step: ContactStep, neighbors: Neighbors, sums: Sums) -> tuple[Sums, Motion]:
    """Adds the contacts with the meshes; returns the motion with what they keep."""
    displacement = displacement_since_build(step.motion.position, step.motion.low, neighbors)
    memory, crowded, loads = list(step.motion.mesh_memory), jnp.zeros((), bool), []
    wear: list[Array | None] = []
    for k, mesh in enumerate(step.model.meshes):
        listed, wall = neighbors.meshes[mesh.number], step.model.analytic_walls + k
        pair, touch, before, springs, material = _contacts_with(step, listed, k, displacement)
        load = contact_load(step, material, pair, springs)
        force, torque, _ = on_bodies(load, pair)
        if sums.liquid is not None:
            constants = required(material.cohesion, "cohesion")
            load, film = with_bridges(listed, pair, load, before.spring, sums.liquid, constants)
            sums = sums._replace(liquid=film)
        if step.model.energy:
            found = _found(step, listed, pair, load, material, springs)._replace(walls=(wall,))
            if step.model.tracks_meshes:
                found = found._replace(lost=lost_at_once(step, before, touch, pair, springs, material))
            sums = sums._replace(found=(*sums.found, found))
        force, torque = tuple(map(sum_slots, force)), tuple(map(sum_slots, torque))
        sums = sums._replace(force=listed.added(sums.force, force), torque=listed.added(sums.torque, torque))
        wear.append(None if mesh.wear is None else _worn(step, mesh, pair, touch, before, load))
        kept = vectors.where(going_on(step.model, touch, load.spring), pair.normal, 0.0)
        overlap = (touch.overlap,) if step.model.tracks_meshes else ()
        memory[mesh.number] = MeshMemory(kept, load.spring, overlap)
        crowded = crowded | touch.crowded
        if wall in step.model.measured:
            mass = jnp.where(jnp.any(pair.overlap > 0, axis=0), listed.radius_of_rows(step.properties.mass), 0.0)
            loads.append(_mesh_loads(step, listed, wall, force, torque, mass))
    walls = loads if sums.walls is None else [sums.walls, *loads]
    joined: WallLoads | None = jax.tree.map(lambda *parts: jnp.concatenate(parts), *walls) if walls else None
    sums = sums._replace(wear=tuple(wear) if step.model.wears else ())
    return sums._replace(walls=joined, crowded=crowded), step.motion._replace(mesh_memory=tuple(memory))


def _contacts_with(
    step: ContactStep, listed: MeshList, number: int, displacement: Vector
) -> tuple[ContactPair, MeshTouch, MeshMemory, Vector, ContactMaterial]:
    """The contacts with the mesh of a number, what those of the step before and they have kept, and their constants."""
    placements, surfaces = step.surroundings.placements, len(step.model.surfaces)
    placed = placements[surfaces + number] if placements else None
    moved = listed.of_rows(displacement)
    if placed is not None:
        moved = listed.moved(placed, step.motion.position, step.motion.low)
    memory = step.motion.mesh_memory[step.model.meshes[number].number]
    material, index = step.surroundings.wall, step.model.materials
    if index is not None:
        material = index.with_wall(material, step.model.analytic_walls + number, listed.row, step.properties.identity)
    if placed is not None:
        memory = _turned_memory(step, memory, placed)
    pair, touch, springs = mesh_contacts(step, listed, moved, memory, placed, material)
    return pair, touch, memory, springs, material


def mesh_pair(
    step: ContactStep, neighbors: Neighbors, number: int
) -> tuple[ContactPair, ContactMaterial, Vector, Array]:
    """The contacts with the mesh of a number as they are, their constants, what they keep, and which are any."""
    displacement = displacement_since_build(step.motion.position, step.motion.low, neighbors)
    listed = neighbors.meshes[step.model.meshes[number].number]
    pair, _, _, springs, material = _contacts_with(step, listed, number, displacement)
    return pair, material, springs, _there(step, listed)


def _there(step: ContactStep, listed: MeshList) -> Array:
    """(1, M) bool, rows that are not empty."""
    return (listed.row < step.motion.position[0].shape[0])[None]


def _found(
    step: ContactStep,
    listed: MeshList,
    pair: ContactPair,
    load: ContactLoad,
    material: ContactMaterial,
    before: Vector,
) -> FoundContacts:
    """The contacts with a mesh one by one; `before` is what they had kept."""
    there, first = _there(step, listed), len(before) - step.model.memory
    memory = ((before[first:], load.spring[first:]),) if step.model.memory else ()
    of_one: Callable[[Vector], Vector] = lambda values: rows(listed.of_rows(values))  # noqa: E731
    return FoundContacts(pair, load, material, of_one, None, onto_particles(step, listed), memory, there)


def onto_particles(step: ContactStep, listed: MeshList) -> Callable[[Array], Array]:
    """From values (C, M) of the contacts with a mesh to sums (N,) on the particles."""
    blank = jnp.zeros_like(step.motion.position[0])
    return lambda values: listed.added((blank,), (sum_slots(values),))[0]


def mesh_contacts(
    step: ContactStep,
    listed: MeshList,
    moved: Vector,
    memory: MeshMemory,
    placed: Placement | None,
    material: ContactMaterial,
) -> tuple[ContactPair, MeshTouch, Vector]:
    """The contacts (C, M) with a mesh, a body of infinite radius and mass, and what they have kept.

    `memory` is what those of the step before have kept, turned with the mesh.
    """
    motion = step.motion
    radius, mass = listed.radius_of_rows(step.properties.radius), listed.radius_of_rows(step.properties.mass)
    expected, velocity = listed.of_rows(step.mid_velocity), listed.of_rows(motion.velocity)
    position: Vector = () if placed is None else listed.of_rows(motion.position)

    def speed(velocity: Vector) -> Array:
        """Faster than a gap changes."""
        if placed is None:
            return vectors.length(velocity)
        found = vectors.length(vectors.subtract(velocity, placed.velocity_at(position)))
        if placed.angular_velocity is None:
            return found
        return found + 2.0 * radius * vectors.length(tuple(placed.angular_velocity))

    # Within the step an overlap changes by less than this.
    reach, gap = 0.5 * step.time_step * speed(expected), gap_of_laws(step, material, radius)
    if gap is not None:
        reach = reach + gap
        if step.model.memory:  # what ends beyond the gap is told of it
            reach = reach + step.time_step * speed(velocity)
    touch = touching(listed, moved, radius, reach)
    radius, mass, expected, velocity = row(radius), row(mass), rows(expected), rows(velocity)
    normal, wall_spin = touch.normal, None
    if placed is not None:
        normal = placed.to_box(normal)
        arm = 0.5 * jnp.maximum(touch.overlap, 0.0) - radius
        wall = placed.velocity_at(vectors.add_scaled(rows(position), arm, normal))
        expected, velocity = vectors.subtract(expected, wall), vectors.subtract(velocity, wall)
        if placed.angular_velocity is not None:
            wall_spin = tuple(placed.angular_velocity)
    pair = ContactPair(
        touch.overlap, normal, approach=expected, velocity=velocity,
        spin=rows(listed.of_rows(motion.angular_velocity)), other_spin=None,
        radius=radius, other_radius=jnp.zeros((), touch.overlap.dtype),
        effective_radius=radius, effective_mass=mass, rolling_inertia=1.4 * mass * radius**2, wall_spin=wall_spin,
    )  # fmt: skip
    return pair, touch, remembered(memory, touch, pair.normal, with_springs(step.model, memory))


def _worn(
    step: ContactStep, mesh: MeshWall, pair: ContactPair, touch: MeshTouch, memory: MeshMemory, load: ContactLoad
) -> Array:
    """(F,) volume that the contacts of the step take from each triangle of a mesh [m3]."""
    touches, cell = touch.found & (pair.overlap > 0), required(touch.cell, "cell")
    turning = tangent.surface_velocity(vectors.scale(pair.radius - 0.5 * pair.overlap, pair.spin), pair.normal)
    slip = vectors.length(vectors.subtract(tangent.part_in_plane(pair.velocity, pair.normal), turning))
    new = begins(memory, touch, pair.normal, with_springs(step.model, memory))
    if step.model.attracts_over_gaps:  # a contact may go on without touch
        new = new | (pair.overlap < -step.time_step * vectors.dot(pair.velocity, pair.normal))
    new = new & touches
    contact = WearContact(touches, new, load.along, slip, pair.velocity, pair.normal, pair.effective_mass)
    return worn(contact, required(mesh.wear, "wear"), cell, mesh.cells, step.time_step)


def _turned_memory(step: ContactStep, memory: MeshMemory, placed: Placement) -> MeshMemory:
    """What contacts keep, turned with the mesh since the step before."""
    if placed.angular_velocity is None or len(step.motion.position) == 2:
        return memory
    spin = tuple(placed.angular_velocity)
    angle = vectors.scale(step.time_step, spin)
    normal = tangent.turned_by(memory.normal, angle)
    return MeshMemory(normal, step.turned_with_walls(memory.spring, spin), memory.overlap)


def _mesh_loads(
    step: ContactStep, listed: MeshList, wall: int, force: Vector, torque: Vector, mass: Array
) -> WallLoads:
    """What each particle does to a mesh, (1, N), of the forces and torques (M,) on those that are listed, and of
    the mass (M,) of those that touch it."""
    turning = vectors.add(vectors.moment(listed.of_rows(step.motion.position), force), torque)
    blank = jnp.zeros_like(step.motion.position[0])

    def spread(values: Vector) -> Vector:
        return rows(listed.added((blank,) * len(values), values))

    forces, torques = spread(vectors.scale(-1.0, force)), spread(vectors.scale(-1.0, turning))
    return WallLoads(forces, torques, step.power(wall, forces, torques), spread((mass,)))
