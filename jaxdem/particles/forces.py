"""Contact forces summed over the neighbours and walls of every particle."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics import vectors
from jaxdem.numerics.placement import Placement
from jaxdem.numerics.vectors import Vector
from jaxdem.particles import liquid, tangent, walls
from jaxdem.particles.cohesion import TOUCHING, Attraction, Gap
from jaxdem.particles.contact import Contact, ContactForce, ContactMaterial
from jaxdem.particles.contact_model import ContactModel
from jaxdem.particles.integrate import Motion, ParticleProperties
from jaxdem.particles.mesh_contact import MeshMemory, MeshTouch, remembered, touching
from jaxdem.particles.mesh_list import MeshList
from jaxdem.particles.moving_walls import PistonState, WallMotions, placements
from jaxdem.particles.neighbors import Neighbors, displacement_since_build
from jaxdem.particles.pairs import Pairs, at, sum_over_pairs
from jaxdem.particles.stages import stage
from jaxdem.particles.surfaces import surface_contacts


class Surroundings(NamedTuple):
    """Materials of the contacts; traced.

    Attributes:
        pair: between particles; of each pair of materials in a scene with several.
        wall: between particles and walls; the same.
        wall_velocity: velocity (D,) of each wall that does not move by `motions`, sliding sides of the box included
            [m/s].
        motions: of the surfaces; None where all are at rest.
        placements: of every surface at the moment of the contacts, None for one at rest; empty where all are.
    """

    pair: ContactMaterial
    wall: ContactMaterial
    wall_velocity: tuple[Array, ...]
    motions: WallMotions | None = None
    placements: tuple[Placement | None, ...] = ()

    def after(self, model: ContactModel, elapsed: Array, pistons: PistonState | None) -> Surroundings:
        """The same with the surfaces where they are `elapsed` after the start of the interval [s]."""
        if not model.motions:
            return self
        motions = required(self.motions, "motions of the walls")
        # A stage: the series of sines would be summed anew for every particle.
        placed = stage(elapsed >= 0, lambda: placements(model.motions, motions, elapsed, pistons))
        return self._replace(placements=placed)


class WallLoads(NamedTuple):
    """What particles do to walls: D and A arrays (S,) of all walls, NaN for those that are not measured; or (M, N),
    what each particle does to those that are.

    Attributes:
        force: minus the forces on the particles [N].
        torque: about the origin: minus x cross F + T, with x the centre of a particle, F the force of the wall on it
            and T the torque about its centre [N m].
        power: one array, of these forces and torques at the wall's velocity: what it takes from the wall [W].
        mass: one array, of the particles that touch it [kg].
    """

    force: Vector
    torque: Vector
    power: Vector
    mass: Vector

    def summed(self, model: ContactModel) -> WallLoads:
        """Of all particles, (S,) from (M, N)."""
        places, blank = jnp.asarray(model.measured), jnp.full(model.walls, jnp.nan, self.force[0].dtype)
        return WallLoads(*(tuple(blank.at[places].set(jnp.sum(x, axis=1)) for x in vector) for vector in self))


class Sums(NamedTuple):
    """Sums over contacts.

    Attributes:
        force: D arrays (N,), on every particle [N].
        torque: A arrays (N,), the same [N m].
        walls: what each particle does to the walls that are measured; None without.
        liquid: (N,) films after the bridges that formed or ruptured; None without capillary bridges [m3].
        crowded: () bool, a particle has more contacts with a mesh than there is room for; None without meshes.
    """

    force: Vector
    torque: Vector
    walls: WallLoads | None = None
    liquid: Array | None = None
    crowded: Array | None = None


class Touching(NamedTuple):
    """Contacts at a moment, (P,) between particles or (S, N) of N particles with S walls.

    Attributes:
        overlap: negative for a gap [m].
        normal: D components, unit vector towards the (first) particle.
        force: D components, on the (first) particle [N].
        friction: () or such that it goes with the contacts, Coulomb's coefficient [-].
        adhesion: what Coulomb's limit counts beside the normal force; None without cohesion [N].
    """

    overlap: Array
    normal: Vector
    force: Vector
    friction: Array
    adhesion: Array | None = None


class _ContactPair(NamedTuple):
    """Two bodies that may touch, the one and the other.

    Attributes:
        overlap: negative for a gap [m].
        normal: unit vector from the other to the one.
        approach: velocity of the one relative to the other, expected in the middle of the step: of the dashpots [m/s].
        velocity: the same at the start of the step, in the middle between two forces: of the springs [m/s].
        spin: angular velocity of the one [rad/s].
        other_spin: of the other; None for a wall.
        radius: of the one [m].
        other_radius: of the other [m].
        effective_radius, effective_mass, rolling_inertia: of both, see `Contact`.
        wall_spin: angular velocity of a wall; None for particles, and for walls that do not turn [rad/s].
    """

    overlap: Array
    normal: Vector
    approach: Vector
    velocity: Vector
    spin: Vector
    other_spin: Vector | None
    radius: Array
    other_radius: Array
    effective_radius: Array
    effective_mass: Array
    rolling_inertia: Array
    wall_spin: Vector | None = None


class _ContactLoad(NamedTuple):
    """What a contact does to the one of two bodies, and what it keeps.

    Attributes:
        along: force along the normal, positive away from the other [N].
        across: force in the contact plane [N].
        resistance: torque against rolling [N m]; empty without rolling friction.
        spring: what the contact keeps; see `ContactModel.history_size`.
        adhesion: what Coulomb's limit counts beside `along`; None without cohesion [N].
    """

    along: Array
    across: Vector
    resistance: Vector
    spring: Vector
    adhesion: Array | None = None


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
    loop = _Loop(model, surroundings, properties, motion, mid_velocity or motion.velocity, time_step, active)
    zero = jnp.zeros_like(motion.position[0])
    sums = Sums((zero,) * len(motion.velocity), (zero,) * len(motion.angular_velocity), liquid=motion.liquid)
    spring, wall_spring = motion.contact_spring, motion.wall_spring
    if neighbors.room.slots:
        sums, spring = loop.add_pairs(neighbors, sums)
    if model.analytic_walls:
        sums, wall_spring = loop.add_walls(sums)
    if model.meshes:
        sums, motion = loop.add_meshes(neighbors, sums)
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
    loop = _Loop(alone, surroundings, properties, motion, motion.velocity, still, active, present)
    between = _touching(*loop.pairs(neighbors), loop.pair_material(neighbors)) if neighbors.room.slots else None
    walls = _touching(*loop.walls(), loop.wall_material()) if model.analytic_walls else None
    return between, walls


def _touching(pair: _ContactPair, load: _ContactLoad, material: ContactMaterial) -> Touching:
    return Touching(pair.overlap, pair.normal, _on_bodies(load, pair)[0], material.friction, load.adhesion)


@dataclasses.dataclass(frozen=True)
class _Loop:
    """What all contacts of a step share. All P pairs are one array each, and so are all S walls of N particles."""

    model: ContactModel
    surroundings: Surroundings
    properties: ParticleProperties
    motion: Motion
    mid_velocity: Vector
    time_step: Array
    active: Array | None = None
    present: Array | None = None

    def pairs(self, neighbors: Neighbors) -> tuple[_ContactPair, _ContactLoad]:
        """The contacts between particles, and what they do."""
        pairs, radius = neighbors.pairs, self.properties.radius
        one, other = _of(radius, pairs.first), _of(radius, pairs.second)
        # Outside of the stage, for a gather would compute it anew.
        displacement = displacement_since_build(self.motion.position, self.motion.low, neighbors)
        change, approach, velocity, spin, other_spin = stage(
            pairs.first[0] != pairs.second[0], lambda: self._relative_motion(pairs, displacement)
        )
        overlap, normal = _pair_geometry(neighbors, change, one + other)
        mass, inertia = self.properties.mass, self.properties.mass * radius**2
        pair = _ContactPair(
            overlap, normal, approach, velocity, spin, other_spin, one, other,
            effective_radius=_harmonic(one, other),
            effective_mass=_harmonic(_of(mass, pairs.first), _of(mass, pairs.second)),
            rolling_inertia=1.4 * _harmonic(_of(inertia, pairs.first), _of(inertia, pairs.second)),
        )  # fmt: skip
        return pair, self._load(self.pair_material(neighbors), pair, self.motion.contact_spring)

    def pair_material(self, neighbors: Neighbors) -> ContactMaterial:
        """Numbers of the contacts between particles."""
        material, index = self.surroundings.pair, self.model.materials
        return (
            material if index is None else index.between_particles(material, neighbors.pairs, self.properties.identity)
        )

    def add_pairs(self, neighbors: Neighbors, sums: Sums) -> tuple[Sums, Vector]:
        """Adds the contacts between particles; returns their new springs too."""
        pair, load = self.pairs(neighbors)
        force, torque, other_torque = _on_bodies(load, pair)

        def added(total: Vector, on_one: Vector, on_other: Vector) -> Vector:
            parts = zip(total, on_one, on_other, strict=True)
            return tuple(x + sum_over_pairs(a, b, neighbors.pairs) for x, a, b in parts)

        both = added(sums.force, force, vectors.scale(-1.0, force))
        film, spring = sums.liquid, load.spring
        if film is not None:
            volume, constants = self.motion.contact_spring[-1], required(self.surroundings.pair.cohesion, "cohesion")
            volume, film = liquid.with_pairs(pair.overlap, volume, film, neighbors.pairs, constants)
            spring = (*spring[:-1], volume)
        return Sums(both, added(sums.torque, torque, other_torque), liquid=film), spring

    def _relative_motion(self, pairs: Pairs, displacement: Vector) -> tuple[Vector, Vector, Vector, Vector, Vector]:
        """Of all pairs: change of the separation since the build, velocities of approach and now, both spins."""

        def difference(quantity: Vector) -> Vector:
            return vectors.subtract(at(quantity, pairs.first), at(quantity, pairs.second))

        spin = self.motion.angular_velocity
        return (
            difference(displacement),
            difference(self.mid_velocity),
            difference(self.motion.velocity),
            at(spin, pairs.first),
            at(spin, pairs.second),
        )

    def walls(self) -> tuple[_ContactPair, _ContactLoad]:
        """The contacts with the walls, bodies of infinite radius and mass, and what they do."""
        motion, radius, mass = self.motion, _row(self.properties.radius), _row(self.properties.mass)
        overlap, normal = self._wall_geometry()
        particles_there = None if self.active is None else self.active[None]
        walls_there = None if self.present is None else self.present[:, None]
        for there in (particles_there, walls_there):
            if there is not None:  # the others are out of reach by a radius, whatever the speed
                overlap = jnp.where(there, overlap, -jnp.ones_like(overlap) * radius)
        wall, spin = self._wall_velocity(overlap, normal), self._wall_spin()
        spring = motion.wall_spring if spin is None else self._turned_with_walls(motion.wall_spring, spin)
        pair = _ContactPair(
            overlap, normal,
            approach=vectors.subtract(_rows(self.mid_velocity), wall),
            velocity=vectors.subtract(_rows(motion.velocity), wall),
            spin=_rows(motion.angular_velocity), other_spin=None,
            radius=radius, other_radius=jnp.zeros((), overlap.dtype),
            effective_radius=radius, effective_mass=mass, rolling_inertia=1.4 * mass * radius**2, wall_spin=spin,
        )  # fmt: skip
        return pair, self._load(self.wall_material(), pair, spring)

    def _wall_velocity(self, overlap: Array, normal: Vector) -> Vector:
        """Velocity of the walls at the contacts, D arrays (S, 1), or (S, N) where walls move [m/s]."""
        velocities = self.surroundings.wall_velocity[: self.model.analytic_walls]
        if not self.surroundings.placements:
            return tuple(jnp.stack(components)[:, None] for components in zip(*velocities, strict=True))
        sides, placed_surfaces = len(self.model.sides), self.surroundings.placements
        # In the middle of the overlap, where the force acts; of a particle that does not touch, at its surface.
        arm = 0.5 * jnp.maximum(overlap, 0.0) - _row(self.properties.radius)
        rows = []
        for number, velocity in enumerate(velocities):
            placed = placed_surfaces[number - sides] if number >= sides else None
            own = tuple(velocity[k] for k in range(velocity.shape[0]))
            if placed is not None:
                moved = placed.velocity_at(
                    tuple(x + arm[number] * n[number] for x, n in zip(self.motion.position, normal, strict=True))
                )
                own = vectors.add(own, moved)
            rows.append(tuple(jnp.broadcast_to(x, overlap.shape[1:]) for x in own))
        return tuple(jnp.stack(components) for components in zip(*rows, strict=True))

    def _wall_spin(self) -> Vector | None:
        """Angular velocity of the walls, A arrays (S, 1); None where none turns [rad/s]."""
        placed_surfaces = self.surroundings.placements[: len(self.model.surfaces)]
        if all(placed is None or placed.angular_velocity is None for placed in placed_surfaces):
            return None
        still = jnp.zeros_like(self.motion.angular_velocity[0], shape=len(self.motion.angular_velocity))
        given = [None if placed is None else placed.angular_velocity for placed in placed_surfaces]
        rows = [still] * len(self.model.sides) + [still if spin is None else spin for spin in given]
        return tuple(column[:, None] for column in jnp.stack(rows).T)

    def _turned_with_walls(self, springs: Vector, spin: Vector) -> Vector:
        """Springs turned with the walls since the step before: a grain that turns with a wall strains none.

        In 2-D a spring is a number along the contact line and turns by itself.
        """
        if len(self.motion.position) == 2:
            return springs
        turned: Vector = ()
        vector_parts = len(springs) - self.model.memory  # the others are scalars
        for first in range(0, vector_parts, 3):
            turned = (*turned, *tangent.turned_by(springs[first : first + 3], vectors.scale(self.time_step, spin)))
        return (*turned, *springs[vector_parts:])

    def wall_material(self) -> ContactMaterial:
        """Numbers of the contacts with the walls."""
        material, index = self.surroundings.wall, self.model.materials
        if index is None:
            return material
        return index.with_walls(material, self.properties.identity, self.model.analytic_walls)

    def add_walls(self, sums: Sums) -> tuple[Sums, Vector]:
        """Adds the contacts with the walls."""
        pair, load = self.walls()
        force, torque, _ = _on_bodies(load, pair)
        loads = None
        if self.model.measured_analytic:
            loads = self._wall_loads(pair, load)
        added = vectors.add(sums.force, tuple(_sum_slots(x) for x in force))
        film, spring = sums.liquid, load.spring
        if film is not None:
            volume, constants = self.motion.wall_spring[-1], required(self.surroundings.wall.cohesion, "cohesion")
            volume, film = liquid.with_walls(pair.overlap, volume, film, constants)
            spring = (*spring[:-1], volume)
        return Sums(added, vectors.add(sums.torque, tuple(_sum_slots(x) for x in torque)), loads, film), spring

    def _wall_loads(self, pair: _ContactPair, load: _ContactLoad) -> WallLoads:
        """What each particle does to the M walls that are measured, (M, N).

        Computed anew from their contacts: so the forces of all walls stay within the sums of the particles.
        """
        of_walls = []
        for k in self.model.measured_analytic:
            own = jax.tree.map(lambda x, k=k: x[k : k + 1] if x.ndim == 2 and len(x) > 1 else x, (pair, load))
            force, torque, _ = _on_bodies(own[1], own[0])
            turning = vectors.add(vectors.moment(_rows(self.motion.position), force), torque)
            force, turning = vectors.scale(-1.0, force), vectors.scale(-1.0, turning)
            of_walls.append(WallLoads(force, turning, self._power(k, force, turning), self._mass(own[0])))
        loads: WallLoads = jax.tree.map(lambda *rows: jnp.concatenate(rows), *of_walls)
        return loads

    def _power(self, wall: int, force: Vector, torque: Vector) -> Vector:
        """Power (1, N) of loads about the origin at the velocity of a wall."""
        placed_surfaces, sides = self.surroundings.placements, len(self.model.sides)
        velocity = self.surroundings.wall_velocity[wall]
        at_origin = tuple(velocity[k] for k in range(velocity.shape[0]))
        placed = placed_surfaces[wall - sides] if placed_surfaces and wall >= sides else None
        if placed is None:
            return (vectors.dot(at_origin, force),)
        at_origin = vectors.add(at_origin, placed.velocity_at((jnp.zeros((), velocity.dtype),) * len(force)))
        power = vectors.dot(at_origin, force)
        if placed.angular_velocity is not None:
            power = power + vectors.dot(tuple(placed.angular_velocity), torque)
        return (power,)

    def _mass(self, pair: _ContactPair) -> Vector:
        """Mass (1, N) of the particles that touch a wall."""
        mass = jnp.broadcast_to(_row(self.properties.mass), pair.overlap.shape)
        return (jnp.where(pair.overlap > 0, mass, 0.0),)

    def _wall_geometry(self) -> tuple[Array, Vector]:
        """Overlap (S, N) with all walls, and their unit normals, (S, 1) if all are sides of the box."""
        model, motion, radius = self.model, self.motion, self.properties.radius
        overlaps, normals = [], []
        if model.sides:
            depths = [walls.wall_overlap(side, motion.position, motion.low, radius) for side in model.sides]
            overlaps.append(jnp.stack(depths))
            normals.append(walls.wall_normals(model.sides, overlaps[0].dtype, len(motion.position)))
        if model.surfaces:
            placed = self.surroundings.placements[: len(model.surfaces)]
            overlap, normal = surface_contacts(model.surfaces, motion.position, motion.low, radius, placed)
            overlaps.append(overlap)
            normals.append(normal)
        if len(overlaps) == 1:
            return overlaps[0], normals[0]
        normals[0] = tuple(jnp.broadcast_to(x, overlaps[0].shape) for x in normals[0])
        return jnp.concatenate(overlaps), tuple(map(jnp.concatenate, zip(*normals, strict=True)))

    def add_meshes(self, neighbors: Neighbors, sums: Sums) -> tuple[Sums, Motion]:
        """Adds the contacts with the meshes; returns the motion with what they keep."""
        displacement = displacement_since_build(self.motion.position, self.motion.low, neighbors)
        placements, surfaces = self.surroundings.placements, len(self.model.surfaces)
        memory, crowded, loads = list(self.motion.mesh_memory), jnp.zeros((), bool), []
        for k, mesh in enumerate(self.model.meshes):
            listed, wall = neighbors.meshes[mesh.number], self.model.analytic_walls + k
            placed = placements[surfaces + k] if placements else None
            moved = listed.of_rows(displacement)
            if placed is not None:
                moved = listed.moved(placed, self.motion.position, self.motion.low)
            pair, touch, springs = self.mesh(listed, moved, memory[mesh.number], placed)
            material, index = self.surroundings.wall, self.model.materials
            if index is not None:
                material = index.with_wall(material, wall, listed.row)
            load = self._load(material, pair, springs)
            force, torque, _ = _on_bodies(load, pair)
            force, torque = tuple(map(_sum_slots, force)), tuple(map(_sum_slots, torque))
            sums = sums._replace(force=listed.added(sums.force, force), torque=listed.added(sums.torque, torque))
            kept = vectors.where(touch.found & (pair.overlap > 0), pair.normal, 0.0)
            memory[mesh.number] = MeshMemory(kept, load.spring)
            crowded = crowded | touch.crowded
            if wall in self.model.measured:
                mass = jnp.where(jnp.any(pair.overlap > 0, axis=0), listed.radius_of_rows(self.properties.mass), 0.0)
                loads.append(self._mesh_loads(listed, wall, force, torque, mass))
        walls = loads if sums.walls is None else [sums.walls, *loads]
        joined: WallLoads | None = jax.tree.map(lambda *rows: jnp.concatenate(rows), *walls) if walls else None
        return sums._replace(walls=joined, crowded=crowded), self.motion._replace(mesh_memory=tuple(memory))

    def mesh(
        self, listed: MeshList, moved: Vector, memory: MeshMemory, placed: Placement | None
    ) -> tuple[_ContactPair, MeshTouch, Vector]:
        """The contacts (C, M) with a mesh, a body of infinite radius and mass, and what they have kept."""
        motion = self.motion
        radius, mass = listed.radius_of_rows(self.properties.radius), listed.radius_of_rows(self.properties.mass)
        expected, velocity = listed.of_rows(self.mid_velocity), listed.of_rows(motion.velocity)
        # Within the step an overlap changes by less than this.
        reach, position = vectors.length(expected), listed.of_rows(motion.position)
        if placed is not None:
            reach = vectors.length(vectors.subtract(expected, placed.velocity_at(position)))
            if placed.angular_velocity is not None:
                reach = reach + 2.0 * radius * vectors.length(tuple(placed.angular_velocity))
        touch = touching(listed, moved, radius, 0.5 * self.time_step * reach)
        radius, mass, expected, velocity = _row(radius), _row(mass), _rows(expected), _rows(velocity)
        normal = touch.normal
        if placed is not None:
            normal = placed.to_box(normal)
            arm = 0.5 * jnp.maximum(touch.overlap, 0.0) - radius
            wall = placed.velocity_at(vectors.add_scaled(_rows(position), arm, normal))
            expected, velocity = vectors.subtract(expected, wall), vectors.subtract(velocity, wall)
            memory = self._turned_memory(memory, placed)
        pair = _ContactPair(
            touch.overlap, normal, approach=expected, velocity=velocity,
            spin=_rows(listed.of_rows(motion.angular_velocity)), other_spin=None,
            radius=radius, other_radius=jnp.zeros((), touch.overlap.dtype),
            effective_radius=radius, effective_mass=mass, rolling_inertia=1.4 * mass * radius**2,
        )  # fmt: skip
        return pair, touch, remembered(memory, touch, pair.normal)

    def _turned_memory(self, memory: MeshMemory, placed: Placement) -> MeshMemory:
        """What contacts keep, turned with the mesh since the step before."""
        if placed.angular_velocity is None or len(self.motion.position) == 2:
            return memory
        spin = tuple(placed.angular_velocity)
        angle = vectors.scale(self.time_step, spin)
        normal = tangent.turned_by(memory.normal, angle)
        return MeshMemory(normal, self._turned_with_walls(memory.spring, spin))

    def _mesh_loads(self, listed: MeshList, wall: int, force: Vector, torque: Vector, mass: Array) -> WallLoads:
        """What each particle does to a mesh, (1, N), of the forces and torques (M,) on those that are listed, and of
        the mass (M,) of those that touch it."""
        turning = vectors.add(vectors.moment(listed.of_rows(self.motion.position), force), torque)
        blank = jnp.zeros_like(self.motion.position[0])

        def spread(values: Vector) -> Vector:
            return _rows(listed.added((blank,) * len(values), values))

        forces, torques = spread(vectors.scale(-1.0, force)), spread(vectors.scale(-1.0, turning))
        return WallLoads(forces, torques, self._power(wall, forces, torques), spread((mass,)))

    def _load(self, material: ContactMaterial, pair: _ContactPair, spring: Vector) -> _ContactLoad:
        """What all contacts do; zero, and nothing computed, where nothing touches."""
        # Within the step an overlap changes by less than this: also a contact that is about to begin has a dashpot.
        change = 0.5 * self.time_step * vectors.length(pair.approach)
        if self.model.cohesion is not None:
            change = change + self.model.cohesion.reach(_gap(pair, material), required(material.cohesion, "cohesion"))
        return stage(jnp.any(pair.overlap + change > 0), lambda: self._law(material, pair, spring))

    def _law(self, material: ContactMaterial, pair: _ContactPair, spring: Vector) -> _ContactLoad:
        """The contact law and rolling resistance."""
        overlap, normal = pair.overlap, pair.normal
        approach_speed = -vectors.dot(pair.approach, normal)
        kept = len(spring) - self.model.memory
        memory, spring = spring[kept:], spring[:kept]
        attraction = self._attraction(material, pair, memory)
        depth = overlap if attraction is None else attraction.depth
        share = _share_of_step(depth, 0.5 * self.time_step * jnp.abs(approach_speed))
        touching = depth > 0
        # The laws take square roots: elsewhere they see an overlap at which these and their slopes are finite,
        # the same from either side, for a dashpot may act already.
        overlap = jnp.where(touching, overlap, TOUCHING * pair.effective_radius)
        spin, relative_spin = vectors.scale(pair.radius - 0.5 * overlap, pair.spin), pair.spin
        sharing: Array | float = 1.0
        if pair.other_spin is None:
            sharing = jnp.maximum(jnp.sum(touching, axis=0, dtype=overlap.dtype), 1.0)[None]
            if pair.wall_spin is not None:
                relative_spin = vectors.subtract(relative_spin, pair.wall_spin)
        else:
            other = vectors.scale(pair.other_radius - 0.5 * overlap, pair.other_spin)
            spin, relative_spin = (
                vectors.add(spin, other),
                vectors.subtract(relative_spin, pair.other_spin),
            )
        turning = tangent.surface_velocity(spin, normal)
        slip = vectors.subtract(tangent.part_in_plane(pair.velocity, normal), turning)
        expected_slip = vectors.subtract(tangent.part_in_plane(pair.approach, normal), turning)
        begun = overlap
        if attraction is not None and attraction.holds is not None:  # the whole step, whatever the overlap
            begun = jnp.where(attraction.holds, pair.effective_radius, overlap)
        growth = _time_of_growth(begun, -vectors.dot(pair.velocity, normal), self.time_step)
        in_plane = vectors.angular_size(len(normal))
        spring, rolling_spring = spring[:in_plane], spring[in_plane:]
        turned = tangent.turned_into_plane(spring, normal)
        contact = Contact(
            overlap=overlap if attraction is None else attraction.overlap,
            approach_speed=share * approach_speed,
            slip=vectors.scale(share, expected_slip),
            spring=vectors.add_scaled(turned, growth, slip),
            effective_radius=pair.effective_radius,
            effective_mass=pair.effective_mass,
            rolling_inertia=pair.rolling_inertia,
            sharing=sharing,
            adhesion=None if attraction is None else attraction.friction,
        )
        result = self.model.law(contact, material)
        # A contact that begins or ends within the step, but not in its middle, has its dashpot only.
        along = jnp.where(touching, result.normal, result.normal - result.elastic)
        adhesion = None
        if attraction is not None:
            along, adhesion = self._pulled(result, attraction, share, approach_speed)
        across = vectors.where(share > 0, result.tangential, 0.0)
        resistance: Vector = ()
        rolled: Vector = ()
        if self.model.rolling is not None:
            resistance, rolled = self.model.rolling(
                contact, result, material, normal, relative_spin, rolling_spring, self.time_step
            )
            resistance = vectors.where(touching, resistance, 0.0)
        springs = vectors.where(touching, (*result.spring, *rolled), 0.0)
        if attraction is not None:
            springs = (*springs, *attraction.kept)
        return _ContactLoad(along, across, resistance, springs, adhesion)

    def _attraction(self, material: ContactMaterial, pair: _ContactPair, memory: Vector) -> Attraction | None:
        """What cohesion makes of all contacts; None without."""
        cohesion = self.model.cohesion
        if cohesion is None:
            return None
        return cohesion(_gap(pair, material), required(material.cohesion, "cohesion"), memory)

    def _pulled(
        self, result: ContactForce, attraction: Attraction, share: Array, approach_speed: Array
    ) -> tuple[Array, Array]:
        """Force along the normal with the pull; and what Coulomb's limit counts beside it.

        A pull that begins or ends at once within the step counts for its part of the step, which makes the force a
        continuous function of the position.
        """
        dashpot = result.normal - result.elastic
        if required(self.model.cohesion, "cohesion").sudden:
            along = dashpot + share * (result.elastic - attraction.pull)
        else:
            along = dashpot + jnp.where(attraction.touching, result.elastic, 0.0) - attraction.pull
        if attraction.damping is not None:
            along = along + attraction.damping * approach_speed
        beside = attraction.pull
        return along, beside if attraction.friction is None else beside + attraction.friction


def _gap(pair: _ContactPair, material: ContactMaterial) -> Gap:
    """What cohesion is given of all contacts."""
    other = None if pair.other_spin is None else pair.other_radius
    return Gap(pair.overlap, pair.radius, other, pair.effective_radius, material.effective_young_modulus)


def _on_bodies(load: _ContactLoad, pair: _ContactPair) -> tuple[Vector, Vector, Vector]:
    """Force and torque on the one, and torque on the other, of all contacts [N, N m]."""
    normal = pair.normal
    force = vectors.add_scaled(tangent.in_space(load.across, normal), load.along, normal)
    # The tangential force turns both bodies the same way, rolling resistance one against the other.
    moment = tangent.moment(normal, load.across)
    arm, other_arm = pair.radius - 0.5 * pair.overlap, pair.other_radius - 0.5 * pair.overlap
    torque, other_torque = vectors.scale(-arm, moment), vectors.scale(-other_arm, moment)
    if load.resistance:
        torque = vectors.add(torque, load.resistance)
        other_torque = vectors.subtract(other_torque, load.resistance)
    return force, torque, other_torque


def _sum_slots(array: Array) -> Array:
    """Sum of a (K, N) array over the slots, written out: XLA hands a reduction to a library that is slower."""
    total = array[0]
    for k in range(1, array.shape[0]):
        total = total + array[k]
    return total


def _of(quantity: Array, index: Array) -> Array:
    """() unchanged, of (N,) the rows of these indices."""
    return quantity if quantity.ndim == 0 else at((quantity,), index)[0]


def _harmonic(a: Array, b: Array) -> Array:
    """1/(1/a + 1/b)."""
    return a * b / (a + b)


def _row(quantity: Array) -> Array:
    """() unchanged, (N,) as (1, N)."""
    return quantity if quantity.ndim == 0 else quantity[None]


def _rows(vector: Vector) -> Vector:
    return tuple(x[None] for x in vector)


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


def _time_of_growth(overlap: Array, closing_speed: Array, time_step: Array) -> Array:
    """Time for which a spring has grown since the step before: a step, or less where the bodies did not touch then [s].

    From the middle of the step before to that of this one all velocities are those at this step's start. A spring that
    takes the whole step's slip when the contact begins gives an elastic impact up to 7 % more energy than it had, at
    twenty steps per contact.

    Source: MFIX has the same, `calc_tangential_displacement` in its `calc_force_dem.f`.
    """
    begins = overlap < time_step * closing_speed
    return jnp.where(begins, overlap / jnp.where(begins, closing_speed, 1.0), time_step)


def _pair_geometry(neighbors: Neighbors, change: Vector, radius_sum: Array) -> tuple[Array, Vector]:
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
