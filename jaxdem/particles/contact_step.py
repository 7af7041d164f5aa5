"""What all contacts of a step share: where the particles and the walls are, and what they are made of."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics import vectors
from jaxdem.numerics.placement import Placement
from jaxdem.numerics.stages import stage
from jaxdem.numerics.vectors import Vector
from jaxdem.particles import tangent
from jaxdem.particles.bond_geometry import BondParameters
from jaxdem.particles.contact import ContactMaterial
from jaxdem.particles.contact_model import ContactModel
from jaxdem.particles.integrate import Motion, ParticleProperties
from jaxdem.particles.moving_walls import PistonState, WallMotions, placements
from jaxdem.particles.tiles import Cut


class Surroundings(NamedTuple):
    """Materials of the contacts; traced.

    Attributes:
        pair: between particles; of each pair of materials in a scene with several.
        wall: between particles and walls; the same.
        wall_velocity: velocity (D,) of each wall that does not move by `motions`, sliding sides of the box included
            [m/s].
        motions: of the surfaces; None where all are at rest.
        placements: of every surface at the moment of the contacts, None for one at rest; empty where all are.
        bonds: between particles; None without.
    """

    pair: ContactMaterial
    wall: ContactMaterial
    wall_velocity: tuple[Array, ...]
    motions: WallMotions | None = None
    placements: tuple[Placement | None, ...] = ()
    bonds: BondParameters | None = None

    def after(self, model: ContactModel, elapsed: Array, pistons: PistonState | None) -> Surroundings:
        """The same with the surfaces where they are `elapsed` after the start of the interval [s]."""
        if not model.motions:
            return self
        motions = required(self.motions, "motions of the walls")
        # A stage: the series of sines would be summed anew for every particle.
        placed = stage(elapsed >= 0, lambda: placements(model.motions, motions, elapsed, pistons))
        return self._replace(placements=placed)


class PairSizes(NamedTuple):
    """Sizes of both particles of every pair of a list, (P,) or (); see `ContactPair`."""

    radius: Array
    other_radius: Array
    effective_radius: Array
    effective_mass: Array
    rolling_inertia: Array


@dataclasses.dataclass(frozen=True)
class ContactStep:
    """What all contacts of a step share. All P pairs are one array each, and so are all S walls of N particles.

    Attributes:
        model: laws and walls; static.
        surroundings: material numbers.
        properties: size and density.
        motion: of the particles at this moment.
        mid_velocity: D arrays (N,), velocity expected in the middle of the step, where `motion` has the positions: the
            dashpots act on it, the tangential ones with the spin at the step's start. The springs grow by the velocity
            of `motion`, at the step's start, which is in the middle between two forces [m/s].
        time_step: over which the springs grow [s].
        active: (N,) bool, which particles there are, all if None; the list knows it already, the walls do not.
        present: (S,) bool, which walls are there, all if None; the others are out of reach. Those of meshes may follow.
        tiled: whether many contacts are worked out tile by tile, see `tiles`; static.
        pair_sizes: of the list, where they are known already; None: they are gathered.
    """

    model: ContactModel
    surroundings: Surroundings
    properties: ParticleProperties
    motion: Motion
    mid_velocity: Vector
    time_step: Array
    active: Array | None = None
    present: Array | None = None
    tiled: bool = False
    pair_sizes: PairSizes | None = None

    def of_rows(self, cut: Cut, spring: Vector) -> ContactStep:
        """The step of the particles in a tile alone, as contacts with walls need it.

        Args:
            cut: takes the rows of the tile. What belongs to pairs, meshes and bonds is left as it is.
            spring: what the contacts of these rows with walls keep.
        """
        motion, properties = self.motion, cut(self.properties)
        if self.model.materials is not None and properties.identity is None and cut.start is not None:
            numbers = jnp.arange(len(motion.position[0]), dtype=jnp.int32)
            properties = properties._replace(identity=cut(numbers))
        own = motion._replace(
            position=cut(motion.position), low=cut(motion.low), velocity=cut(motion.velocity),
            angular_velocity=cut(motion.angular_velocity), wall_spring=spring,
        )  # fmt: skip
        return dataclasses.replace(
            self,
            properties=properties,
            motion=own,
            mid_velocity=cut(self.mid_velocity),
            active=cut(self.active),
        )

    def turned_with_walls(self, springs: Vector, spin: Vector) -> Vector:
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

    def power(self, wall: int, force: Vector, torque: Vector) -> Vector:
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
