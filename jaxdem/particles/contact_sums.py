"""What the contacts of a step give: sums on every particle, loads on the walls, and the contacts one by one."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.numerics.vectors import Vector
from jaxdem.particles.contact import ContactMaterial
from jaxdem.particles.contact_model import ContactModel
from jaxdem.particles.contact_pair import ContactLoad, ContactPair
from jaxdem.particles.pairs import Pairs


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


class FoundContacts(NamedTuple):
    """Contacts of a kind in a step, and of whom they are.

    Attributes:
        pair, load: what they are and do.
        material: their constants.
        of_one: values of the particles (N,), as those of the one body of each contact.
        of_other: the same of the other body; None for a wall.
        onto: values of the contacts, as sums (N,) on the particles: of each on both bodies.
        memory: what cohesion remembers before and after the step; () for none.
        there: such that it goes with the contacts, which of them are any; None where all are.
        walls: numbers of the walls, one a row of the contacts or one for all; () between particles.
        counted: which of them belong to this slab, see `counted_pairs`; None for all.
        lost: such that it goes with the contacts, energy of contacts that have gone at once, less that of those that
            have come so; None where there are none [J].
    """

    pair: ContactPair
    load: ContactLoad
    material: ContactMaterial
    of_one: Callable[[Vector], Vector]
    of_other: Callable[[Vector], Vector] | None
    onto: Callable[[Array], Array]
    memory: tuple[tuple[Vector, Vector], ...] = ()
    there: Array | None = None
    walls: tuple[int, ...] = ()
    counted: Array | None = None
    lost: Array | None = None


class FoundBonds(NamedTuple):
    """The bonds of a step. A load is the force on the first grain (minus that on the second) [N], and the torque on the
    first and on the second [N m], of three components each.

    Attributes:
        pairs: who is bonded.
        holds: (B,) bool, which act in the step.
        broken: (B,) bool, which have broken at its beginning.
        energy: (B,) elastic, in the middle of the step, of those that held before it [J].
        elastic: load of those.
        dashpots: load; None where no bond has any.
        counted: see `BondState`.
    """

    pairs: Pairs
    holds: Array
    broken: Array
    energy: Array
    elastic: tuple[Vector, Vector, Vector]
    dashpots: tuple[Vector, Vector, Vector] | None
    counted: Array | None = None


class Sums(NamedTuple):
    """Sums over contacts.

    Attributes:
        force: D arrays (N,), on every particle [N].
        torque: A arrays (N,), the same [N m].
        walls: what each particle does to the walls that are measured; None without.
        liquid: (N,) films after the bridges that formed or ruptured; None without capillary bridges [m3].
        crowded: () bool, a particle has more contacts with a mesh than there is room for; None without meshes.
        wear: (F,) volume that they take from the triangles of each mesh, None from one that does not wear [m3].
        found: the contacts one by one, for the balance of energy; none where it is not kept.
        bonded: the bonds, for the same; None where it is not kept, and without bonds.
    """

    force: Vector
    torque: Vector
    walls: WallLoads | None = None
    liquid: Array | None = None
    crowded: Array | None = None
    wear: tuple[Array | None, ...] = ()
    found: tuple[FoundContacts, ...] = ()
    bonded: FoundBonds | None = None


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
