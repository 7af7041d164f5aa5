"""What the contacts of a step give: sums on every particle, loads on the walls, and the contacts one by one."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.numerics.vectors import Vector
from jaxdem.particles.contact_model import ContactModel


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
        wear: (F,) volume that they take from the triangles of each mesh, None from one that does not wear [m3].
    """

    force: Vector
    torque: Vector
    walls: WallLoads | None = None
    liquid: Array | None = None
    crowded: Array | None = None
    wear: tuple[Array | None, ...] = ()


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
