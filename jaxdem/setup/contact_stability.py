"""The stability limit of the contact step for the materials, sizes and walls of a scene. Host side, plain numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence

from jaxdem.particles.materials import TANGENTIAL_SHARE
from jaxdem.scene import Contact
from jaxdem.setup import stability
from jaxdem.setup.bond_stability import bond_growth
from jaxdem.setup.cohesion import Pair, bridge_volume, largest_bridge_damping, strongest
from jaxdem.setup.contact_bodies import ContactBody, ContactConstants, crowding, worst_constants
from jaxdem.setup.lubrication import largest_resistance, largest_shear
from jaxdem.setup.particles import ParticleSetup


def contact_stability(
    particles: ParticleSetup, bodies: Sequence[ContactBody], speed: float, overlap: float | None = None
) -> float:
    """Stability limit of the contact step [s].

    Every contact that a particle has room for is taken to be as deep as an impact of the heaviest particle at
    `speed`, on the lightest, makes it, up to `contact.maximum_overlap`; with several materials, of the stiffest and
    most damped pair there is.

    Args:
        particles: of the scene.
        bodies: extremes of them.
        speed: largest to expect [m/s].
        overlap: of all contacts in place of the expected one [m].
    """
    scene, contact = particles.scene, particles.contact
    grains = [body for body in bodies if not body.is_wall]
    small, large = min(body.radius for body in grains), max(body.radius for body in grains)
    light, heavy = min(body.mass for body in grains), max(body.mass for body in grains)
    # Light particles touch each other and heavy ones. These move less: their factor 1 + q is such that the bound
    # over a heavy particle's contacts, of which it has more, is the same.
    more = (0.5 * (1.0 + large / small)) ** (scene.dimension - 1)
    kinds = [(2.0, 0.5 * light, 0.5 * small)]
    if heavy > light:
        reduced = light * heavy / (light + heavy)
        kinds.append((1.0 + more * light / heavy, reduced, small * large / (small + large)))

    def depth(mass: float, radius: float, modulus: float, wall: bool) -> float:
        deepest = stability.hertz_overlap(mass, radius, modulus, speed)
        if contact.cohesion is not None and contact.law == "hertz_mindlin":
            volume = bridge_volume(particles, large)
            pair = Pair(contact.cohesion, strongest(particles, wall), radius, modulus, volume=volume)
            deepest = pair.depth(0.5 * mass * speed**2)[1]
            if overlap is not None:
                return pair.law_depth(overlap)
        return overlap or min(deepest, contact.maximum_overlap * 2.0 * small)

    def with_film(contact: stability.LinearContact, radius: float) -> stability.LinearContact:
        """Bodies that press each other have no film between them, but their neighbours may; and all have bridges."""
        liquid = largest_resistance(particles, radius) + largest_bridge_damping(particles, radius)
        return contact._replace(
            normal_damping=contact.normal_damping + liquid,
            tangential_damping=contact.tangential_damping + largest_shear(particles, radius, small),
        )

    of_pair, of_wall = (worst_constants(particles, wall) for wall in (False, True))
    pair_depth = depth(0.5 * heavy, 0.5 * small, of_pair.modulus, wall=False)
    wall_depth = depth(heavy, small, of_wall.modulus, wall=True)
    pairs = [
        (factor, with_film(_linearised(contact, of_pair, mass, radius, pair_depth, radius / small), radius))
        for factor, mass, radius in kinds
    ]
    thin = sum(
        not wraps and length <= 2.0 * large for wraps, length in zip(scene.periodic, scene.domain.size, strict=True)
    )
    return stability.contact_stability_limit(
        light / crowding(particles),  # of a clump with so many times the contacts of a sphere
        scene.dimension,
        pairs,
        with_film(_linearised(contact, of_wall, light, small, wall_depth, 1.0), small),
        particles.total - 1,
        min(scene.dimension, scene.periodic.count(False) + len(scene.walls)),
        thin,
        bond_growth(particles),
    )


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
