"""Motion of the particles over one contact step."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics import compensated, vectors
from jaxdem.numerics.compensated import Low
from jaxdem.numerics.quotients import quotient
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.bond_state import BondState
from jaxdem.particles.clump_shape import Clumps
from jaxdem.particles.moving_walls import PistonState


class ParticleState(NamedTuple):
    """What evolves of N particles in D dimensions (A = 1 angular component in 2-D, 3 in 3-D).

    Attributes:
        position: (N, D) centres, leading part [m].
        position_low: (N, D) trailing part, position + position_low is the centre; None in float64 [m].
        velocity: (N, D) [m/s].
        angular_velocity: (N, A) [rad/s].
        contact_spring: elastic tangential displacement of the first particle against the second of every pair,
            (P,) for every component that a vector in the contact plane has (1 in 2-D, 3 in 3-D, see `tangent`) [m];
            then as many of the torque of the rolling spring, if rolling friction has one [N m]; then what cohesion
            remembers, if it does: 1 while JKR holds, or the volume of a bridge [m3].
        wall_spring: the same of every particle at the S walls, arrays (S, N) [m].
        contact_force: (N, D) mean force of all contacts over the last coupling interval [N].
        fluid_force: (N, D) mean fluid force over the last coupling interval, or None without a fluid [N].
        fluid_memory: what forces of the fluid keep of earlier intervals, arrays (..., N, C), N next to the last axis;
            None where no such force is on.
        active: (N,) bool, which particles are present; None where all are, always. See `population`.
        inserted: (I,) int32, how many have come in through each inlet; None without inlets.
        identity: (N,) int32, which particles the rows of a slab are, -1 for none; None on one device, where row i is
            particle i.
        liquid: (N,) film of every particle, which is in no bridge; None without capillary bridges [m3].
        pistons: where the walls are that a force holds; None without.
        mesh_memory: what the contacts with each mesh keep, `MeshMemory` of each; none in a scene without meshes.
        bonds: between the particles; None without.
        mesh_wear: what has been taken from each mesh, `WornMesh`, None of one that does not wear; none where none does.
        orientation: of clumps, (N, 4) unit quaternion (w, x, y, z) that turns the principal axes into those of the box;
            in 2-D (N, 1) an angle [rad]. None for spheres.
        orientation_low: trailing part of the same; None in float64.
        coming: in slabs with inlets, orientation and its trailing part of all clumps by identity, as they come in; None
            of spheres, without inlets and on one device, where rows of those that are still to come have it.
    """

    position: Array
    position_low: Low
    velocity: Array
    angular_velocity: Array
    contact_spring: Vector
    wall_spring: Vector
    contact_force: Array
    fluid_force: Array | None
    fluid_memory: Any = None
    active: Array | None = None
    inserted: Array | None = None
    identity: Array | None = None
    liquid: Array | None = None
    pistons: PistonState | None = None
    mesh_memory: tuple[Any, ...] = ()
    bonds: BondState | None = None
    mesh_wear: tuple[Any, ...] = ()
    orientation: Array | None = None
    orientation_low: Low = None
    coming: tuple[Array, Low] | None = None


class Motion(NamedTuple):
    """The part of the state that changes in a contact step, with components apart (see `vectors`).

    Attributes:
        position: D arrays (N,), leading part [m].
        low: D arrays (N,) or Nones, trailing part [m].
        velocity: D arrays (N,) [m/s].
        angular_velocity: A arrays (N,) [rad/s].
        contact_spring: arrays (P,) [m].
        wall_spring: arrays (S, N) [m].
        liquid: (N,) films, or None [m3].
        mesh_memory, bonds: see `ParticleState`.
        orientation: 4 arrays (N,) of clumps, in 2-D one; none for spheres.
        orientation_low: trailing part of each, or Nones.
    """

    position: Vector
    low: tuple[Low, ...]
    velocity: Vector
    angular_velocity: Vector
    contact_spring: Vector
    wall_spring: Vector
    liquid: Array | None = None
    mesh_memory: tuple[Any, ...] = ()
    bonds: BondState | None = None
    orientation: Vector = ()
    orientation_low: tuple[Low, ...] = ()

    @classmethod
    def of(cls, state: ParticleState) -> Motion:
        """The motion of a state."""
        return cls(
            vectors.components(state.position),
            split_low(state.position_low, state.position.shape[1]),
            vectors.components(state.velocity),
            vectors.components(state.angular_velocity),
            state.contact_spring,
            state.wall_spring,
            state.liquid,
            state.mesh_memory,
            state.bonds,
            () if state.orientation is None else vectors.components(state.orientation),
            () if state.orientation is None else split_low(state.orientation_low, state.orientation.shape[1]),
        )

    def into(self, state: ParticleState) -> ParticleState:
        """The state with this motion."""
        return state._replace(
            position=vectors.stack(self.position),
            position_low=stack_low(self.low),
            velocity=vectors.stack(self.velocity),
            angular_velocity=vectors.stack(self.angular_velocity),
            contact_spring=self.contact_spring,
            wall_spring=self.wall_spring,
            liquid=self.liquid,
            mesh_memory=self.mesh_memory,
            bonds=self.bonds,
            orientation=vectors.stack(self.orientation) if self.orientation else None,
            orientation_low=stack_low(self.orientation_low) if self.orientation else None,
        )


def split_low(low: Low, dimension: int) -> tuple[Low, ...]:
    """Trailing parts by component; Nones where there are none."""
    return (None,) * dimension if low is None else vectors.components(low)


def stack_low(low: tuple[Low, ...]) -> Low:
    """The inverse of `split_low`."""
    return None if low[0] is None else jnp.stack(low, axis=1)  # type: ignore[arg-type]


class Parcels(NamedTuple):
    """What one particle stands for, if it is a parcel of l^D grains; both ().

    Attributes:
        ratio: l, radius of the parcel over that of its grains [-].
        grains: l^D, number of grains in a parcel [-].
    """

    ratio: Array
    grains: Array


class ParticleProperties(NamedTuple):
    """Size and density of the particles: () for equal particles, else (N,), so that equal ones cost nothing.

    Attributes:
        radius: of a particle; of the parcel where a particle stands for several grains, of the sphere of the same
            volume where it is a clump [m].
        density: [kg/m3].
        added_density: of the fluid that moves along, C rho, in the mass but not in the moment of inertia; None
            for none [kg/m3].
        parcels: what one particle stands for; None for a grain.
        identity: (N,) int32, which particles the rows of a slab are; None where row i is particle i.
        clumps: members of bodies that are clumps of spheres; None where all are spheres.
    """

    radius: Array
    density: Array
    added_density: Array | None = None
    parcels: Parcels | None = None
    identity: Array | None = None
    clumps: Clumps | None = None

    def of_rows(self, identity: Array | None) -> ParticleProperties:
        """Of the particles (R,) in the rows of a slab, from those of all particles; unchanged without identities."""
        if identity is None:
            return self
        number = jnp.maximum(identity, 0)
        clumps = None if self.clumps is None else self.clumps.of_rows(number)
        rows: ParticleProperties = jax.tree.map(lambda x: x[number] if x.ndim else x, self._replace(clumps=None))
        return rows._replace(identity=identity, clumps=clumps)

    @property
    def volume(self) -> Array:
        """4/3 pi r^3 of a sphere, in 2-D too; of a parcel that of its grains [m3]."""
        if self.parcels is None:
            return (4.0 / 3.0) * jnp.pi * self.radius**3
        return self.parcels.grains * ((4.0 / 3.0) * jnp.pi * self.grain_radius**3)

    @property
    def grain_radius(self) -> Array:
        """Radius of a grain [m]."""
        return self.radius if self.parcels is None else self.radius / self.parcels.ratio

    def of_all_grains(self, quantity: Array) -> Array:
        """What all grains of a particle have together, of what one of them has."""
        return quantity if self.parcels is None else self.parcels.grains * quantity

    @property
    def mass(self) -> Array:
        """With the added mass, if any [kg]."""
        density = self.density if self.added_density is None else self.density + self.added_density
        return density * self.volume

    @property
    def inertia(self) -> Array:
        """Moment of inertia 2/5 m r^2; of a clump the mean of its principal moments [kg m2]."""
        if self.clumps is None:
            return 0.4 * self.density * self.volume * self.radius**2
        moments = self.clumps.inertia
        return (sum(moments[1:], moments[0]) / len(moments)) * self.density * self.volume * self.radius**2

    @property
    def rigid(self) -> Clumps:
        """The members of a scene of clumps."""
        return self.clumps if self.clumps is not None else required(self.clumps, "clumps of the bodies")

    @property
    def first_inertia(self) -> Array:
        """First principal moment of a clump [kg m2]."""
        return self.rigid.inertia[0] * self.density * self.volume * self.radius**2

    @property
    def outer_radius(self) -> Array:
        """Of the sphere about the centre of mass that holds a particle [m]."""
        return self.radius if self.clumps is None else self.clumps.reach * self.radius

    def spheres(self, count: int) -> ParticleProperties:
        """What touches: the particles, or the members of `count` clumps, each with the mass of its body."""
        if self.clumps is None:
            return self
        radius = self.clumps.rows(self.clumps.radius, count)
        ratio = self.clumps.rows(self.volume, count) / ((4.0 / 3.0) * jnp.pi * radius**3)
        identity = None if self.identity is None else self.clumps.rows(self.identity, count)
        return ParticleProperties(radius, self.clumps.rows(self.density, count) * ratio, identity=identity)


def centres_in_box(state: ParticleState, box: tuple[float, ...], periodic: tuple[bool, ...]) -> Array:
    """(N, D) centres moved by whole periods into the box, to one float [m]; see `compensated.into_box`."""
    if not any(periodic):
        return state.position
    low = split_low(state.position_low, len(box))
    return vectors.stack(compensated.into_box(vectors.components(state.position), low, box, periodic))


def drift(motion: Motion, time_step: Array) -> Motion:
    """Positions moved by velocity times `time_step` [s]; bonded grains turned."""
    moved = [
        compensated.advance(high, low, time_step * speed)
        for high, low, speed in zip(motion.position, motion.low, motion.velocity, strict=True)
    ]
    bonds = motion.bonds
    if bonds is not None:
        bonds = bonds.turned(motion.angular_velocity, time_step)
    return motion._replace(position=tuple(high for high, _ in moved), low=tuple(low for _, low in moved), bonds=bonds)


def kick(motion: Motion, force: Vector, torque: Vector, properties: ParticleProperties, time_step: Array) -> Motion:
    """Velocities changed by force [N] and torque [N m] over `time_step` [s]."""
    linear, angular = quotient(time_step, properties.mass), quotient(time_step, properties.inertia)
    return motion._replace(
        velocity=vectors.add_scaled(motion.velocity, linear, force),
        angular_velocity=vectors.add_scaled(motion.angular_velocity, angular, torque),
    )


def as_column(quantity: Array) -> Array:
    """() unchanged, (N,) as (N, 1): to multiply rows of (N, D)."""
    return quantity if jnp.ndim(quantity) == 0 else quantity[:, None]


def kinetic_energy(state: ParticleState, properties: ParticleProperties) -> Array:
    """Sum of m v^2 / 2 + I w^2 / 2 of spheres; of clumps see `clumps.spin_energy` [J]."""
    translation = properties.mass * jnp.sum(state.velocity**2, axis=1)
    rotation = properties.inertia * jnp.sum(state.angular_velocity**2, axis=1)
    return 0.5 * jnp.sum(translation + rotation)
