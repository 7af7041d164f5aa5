"""The stability limit of the contact step for the materials, sizes and walls of a scene. Host side, plain numbers."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

from jaxdem.particles.materials import TANGENTIAL_SHARE
from jaxdem.scene import Contact, Scene
from jaxdem.setup import stability
from jaxdem.setup.attraction import Pair, bridge_volume, strongest
from jaxdem.setup.bond_stability import bond_growth
from jaxdem.setup.cohesion import largest_bridge_damping
from jaxdem.setup.contact_bodies import ContactBody, ContactConstants, crowding, effective, pair_constants
from jaxdem.setup.contact_limit import ROOM, Neighbours, contact_stability_limit
from jaxdem.setup.curved_wall_contacts import contacts_with_curved_walls
from jaxdem.setup.lubrication import largest_resistance, largest_shear
from jaxdem.setup.particles import ParticleSetup
from jaxdem.setup.plane_wall_contacts import contacts_with_planes
from jaxdem.setup.wall_functions import NO_FUNCTIONS, WallFunctions
from jaxdem.solids.simultaneous_contacts import SimultaneousContacts, worst_of


def contact_stability(
    particles: ParticleSetup,
    bodies: Sequence[ContactBody],
    speed: float,
    overlap: float | None = None,
    own_walls: WallFunctions = NO_FUNCTIONS,
) -> float:
    """Stability limit of the contact step [s].

    The least over the kinds of particles, each with all the contacts that it has room for, with its own kind, the
    others and walls, as many of each as there are particles of it. A contact has the materials, masses and radii of
    the two that make it. All are taken to be as deep as an impact of the heaviest particle at `speed` makes them, up to
    `contact.maximum_overlap`: it may press them all.

    Args:
        particles: of the scene.
        bodies: kinds of particles, and walls.
        speed: largest to expect [m/s].
        overlap: of all contacts in place of the expected one [m].
        own_walls: of the user. With a slope s the overlap o of a wall is s times the way of a grain x. So the stiffness
            dF/dx is s dF/do, and an impact is as deep in o as one that is sqrt(s) times as fast, so that dF/do goes
            with s^0.2: a step that is shorter by 1/s counts for all terms.
    """
    scene = particles.scene
    grains = [body for body in bodies if not body.is_wall]
    if particles.shapes is not None:
        grains = _pooled(grains)
    contacts = _contacts(particles, grains, speed, overlap)
    thin = _thin_axes(scene, contacts.large)
    walls = _walls_at_once(scene, own_walls)
    bonds, limits = bond_growth(particles), []
    deepest = contacts.into_walls(grains)

    @functools.cache
    def at_once(radius: float) -> tuple[SimultaneousContacts, ...]:
        """Walls that a particle of this radius touches at once and that are not at right angles."""
        found = contacts_with_planes(scene, particles.meshes, radius, deepest)
        return worst_of(
            (*_of_meshes(particles), *found, *contacts_with_curved_walls(scene, own_walls, radius, deepest))
        )

    for body in grains:
        found = []
        for other in grains:
            if body.others(other) > 0:
                q, crowd, count = _room(body, other, scene.dimension)
                found.append(Neighbours(contacts.between(body, other), crowd * (1.0 + q), count, other.group))
        mass = body.mass / crowding(particles)  # of a clump with so many times the contacts of a sphere
        wall = contacts.between(body, None)
        limits.append(
            contact_stability_limit(mass, scene.dimension, found, wall, walls, thin, bonds, at_once(body.radius))
        )
    return min(limits) / own_walls.slope


class _Contacts(NamedTuple):
    """What all contacts of a scene are linearised about, see `contact_stability`.

    Attributes:
        particles: of the scene.
        speed: largest to expect [m/s].
        overlap: of all contacts in place of the expected one; None for that [m].
        large: radius of the largest particle [m].
        heavy: mass of the heaviest particle [kg].
        rough: whether contacts between particles have friction. Of all or of none: among smooth and rough ones the
            worst neighbourhood is none of those that are tried.
    """

    particles: ParticleSetup
    speed: float
    overlap: float | None
    large: float
    heavy: float
    rough: bool

    def between(self, one: ContactBody, other: ContactBody | None) -> stability.LinearContact:
        """The contact of two bodies, or of one with a wall, on `one`.

        Bodies that press each other have no film between them, but their neighbours may; and all have bridges.
        """
        particles, contact = self.particles, self.particles.contact
        constants = pair_constants(particles, one.material, None if other is None else other.material)
        if other is not None:
            constants = constants._replace(rough=self.rough)
        mass = one.mass if other is None else effective(one.mass, other.mass)
        radius = one.radius if other is None else effective(one.radius, other.radius)
        small = one.radius if other is None else min(one.radius, other.radius)
        depth = self._depth(other is None, radius, small, constants.modulus)
        found = _linearised(contact, constants, mass, radius, depth, radius / one.radius)
        liquid = largest_resistance(particles, radius) + largest_bridge_damping(particles, radius)
        return found._replace(
            normal_damping=found.normal_damping + liquid,
            tangential_damping=found.tangential_damping + largest_shear(particles, radius, small),
        )

    def into_walls(self, grains: Sequence[ContactBody]) -> float:
        """Deepest overlap of one of these kinds of particles with a wall [m]."""
        contact = self.particles.contact
        if contact.law == "linear_spring_dashpot" and self.overlap is None:
            plain = stability.linear_overlap(self.heavy, contact.normal_stiffness or 0.0, self.speed)
            return min(plain, contact.maximum_overlap * 2.0 * self.large)
        moduli = [pair_constants(self.particles, body.material, None).modulus for body in grains]
        radii = [body.radius for body in grains]
        return max(self._depth(True, r, r, modulus) for r, modulus in zip(radii, moduli, strict=True))

    def _depth(self, wall: bool, radius: float, small: float, modulus: float) -> float:
        """Overlap of a contact, with a wall or not, of R* `radius`; `small` is the radius of the smaller body [m]."""
        contact, mass = self.particles.contact, self.heavy if wall else 0.5 * self.heavy
        deepest = stability.hertz_overlap(mass, radius, modulus, self.speed)
        if contact.cohesion is not None and contact.law == "hertz_mindlin":
            volume = bridge_volume(self.particles, self.large)
            pair = Pair(contact.cohesion, strongest(self.particles, wall), radius, modulus, volume=volume)
            deepest = pair.depth(0.5 * mass * self.speed**2)[1]
            if self.overlap is not None:
                return pair.law_depth(self.overlap)
        return self.overlap or min(deepest, contact.maximum_overlap * 2.0 * small)


def _contacts(
    particles: ParticleSetup, grains: Sequence[ContactBody], speed: float, overlap: float | None
) -> _Contacts:
    """Of these kinds of particles; see there."""
    large, heavy = max(body.radius for body in grains), max(body.mass for body in grains)
    meetings = {(one.material, other.material) for one in grains for other in grains if one.others(other) > 0}
    rough = any(pair_constants(particles, *pair).rough for pair in meetings)
    return _Contacts(particles, speed, overlap, large, heavy, rough)


def _thin_axes(scene: Scene, radius: float) -> int:
    """Number of axes with walls along which the box holds one grain of this radius [m]."""
    lengths = zip(scene.periodic, scene.domain.size, strict=True)
    return sum(not wraps and length <= 2.0 * radius for wraps, length in lengths)


def _walls_at_once(scene: Scene, own_walls: WallFunctions) -> int:
    """Number of walls that a particle may touch at the same time."""
    # A particle may lie in a corner of a mesh.
    surfaces = own_walls.number + sum(scene.dimension if wall.kind == "mesh" else 1 for wall in scene.walls)
    return min(scene.dimension, scene.periodic.count(False) + surfaces)


def _of_meshes(particles: ParticleSetup) -> list[SimultaneousContacts]:
    """The most faces of a mesh that a particle touches at once; none where they are at right angles."""
    found = [mesh.at_once for mesh in particles.meshes if mesh.at_once is not None]
    return [SimultaneousContacts(*map(max, zip(*found, strict=True)))] if found else []


def _pooled(grains: Sequence[ContactBody]) -> list[ContactBody]:
    """The smallest and lightest and the largest and heaviest member of clumps of every material."""
    found = []
    for material in sorted({body.material for body in grains}):
        own = [body for body in grains if body.material == material]
        number = sum({body.group: body.number for body in own}.values())
        for most in (min, max):
            radius, mass = most(body.radius for body in own), most(body.mass for body in own)
            found.append(own[0]._replace(radius=radius, mass=mass, number=number))
    return found


def _room(one: ContactBody, other: ContactBody, dimension: int) -> tuple[float, float, int]:
    """Contacts of a particle with particles of another kind, as `Neighbours` counts them.

    A particle of radius R has room for 12 (in a plane 6) as large as itself or larger, and for
    ((1 + R/r) / 2)^(D-1) times as many of radius r < R; there may be fewer of them. A contact moves both, which
    |a - b|^2 <= (1 + q) |a|^2 + (1 + 1/q) |b|^2 shares out between them; any q does, and with q = (Z'/m') / (Z/m) the
    Z contacts of the one and the Z' of the other bound both alike.

    Returns:
        q; by how much more than one of its size a contact counts, for there are so many times as many; and the number
        of contacts counted in this way, at most.
    """
    room = float(ROOM[dimension][0])

    def crowd(of: ContactBody, by: ContactBody) -> float:
        return max(1.0, 0.5 * (1.0 + of.radius / by.radius)) ** (dimension - 1)

    own = min(room * crowd(one, other), one.others(other))
    back = min(room * crowd(other, one), other.others(one))
    more, there = crowd(one, other), one.others(other)
    count = math.ceil(there / more)
    if count < room:
        more = there / count  # of all that there are, and not of as many as there is room for
    return back * one.mass / (own * other.mass), more, count


def _linearised(
    contact: Contact, constants: ContactConstants, mass: float, radius: float, depth: float, arm: float
) -> stability.LinearContact:
    """A contact about an overlap.

    Args:
        contact: table of the scene, for the laws.
        constants: of the contact.
        mass, radius: effective m* [kg] and R* [m].
        depth: the overlap [m].
        arm: R* over the radius of the particle [-].
    """
    if contact.law == "linear_spring_dashpot":
        spring, across = contact.normal_stiffness or 0.0, contact.tangential_stiffness
        across = TANGENTIAL_SHARE * spring if across is None else across
        result = stability.linear_contact(mass, spring, across, constants.restitution, constants.rough)
    else:
        moduli = constants.modulus, constants.shear_modulus
        result = stability.hertz_mindlin_contact(mass, radius, *moduli, depth, constants.restitution, constants.rough)
    if constants.rolling_friction > 0.0 and contact.rolling_model == "epsd":
        return _with_rolling_spring(result, contact, constants.rolling_friction * arm, mass)
    return result


def _with_rolling_spring(
    contact: stability.LinearContact, settings: Contact, lever: float, mass: float
) -> stability.LinearContact:
    """With the spring of epsd, 9/4 (mu_r R*)^2 F_e/d, and its dashpot; `lever` is mu_r R* over the radius."""
    secant = contact.normal * (2.0 / 3.0 if settings.law == "hertz_mindlin" else 1.0)
    spring = 2.25 * lever**2 * secant
    dashpot = 2.0 * settings.rolling_damping * math.sqrt(1.4 * mass * spring)
    return contact._replace(rolling=spring, rolling_damping=dashpot)
