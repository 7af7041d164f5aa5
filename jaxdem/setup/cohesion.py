"""What cohesion does to the limits of a scene: depth of an impact, pull-off force, steepest attraction, liquid.

Host side, plain numbers. How far it reaches is in `attraction`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

from jaxdem.errors import InputError, required
from jaxdem.setup.attraction import Pair, bridge_volume, strongest
from jaxdem.setup.contact_bodies import ContactBody, effective
from jaxdem.setup.particles import ParticleSetup


def pair_of(particles: ParticleSetup, one: ContactBody, other: ContactBody) -> Pair | None:
    """The strongest attraction that these two may have; None without cohesion."""
    contact = particles.contact
    if contact.cohesion is None:
        return None
    linear = contact.law == "linear_spring_dashpot"
    return Pair(
        contact.cohesion,
        strongest(particles, one.is_wall or other.is_wall),
        effective(one.radius, other.radius),
        0.0 if linear else effective(one.modulus, other.modulus),
        (contact.normal_stiffness or 0.0) if linear else 0.0,
        bridge_volume(particles, min(one.radius, other.radius)),
    )


def largest_volume(particles: ParticleSetup) -> float:
    """Volume of the largest particle [m3]."""
    return 4.0 / 3.0 * math.pi * (0.5 * particles.bodies.largest_diameter) ** 3


def largest_bridge_damping(particles: ParticleSetup, radius: float) -> float:
    """6 pi mu R*^2 / (minimum gap), what a viscous bridge between two bodies with R* resists their approach and parting
    by at most [N s/m]; 0 without."""
    table = particles.contact.cohesion
    if table is None or not table.liquid_viscosity:
        return 0.0
    return 6.0 * math.pi * table.liquid_viscosity * radius**2 / required(table.minimum_gap, "minimum_gap")


def check_bridges(particles: ParticleSetup) -> None:
    """Refuses bridges that could take more liquid than a particle has, if all for which there is room form at once.

    Spheres of radius r around one of radius R: at most 4 (1 + R/r)^2, in a plane pi / arcsin(r / (R + r)).

    Raises:
        InputError: `contact.cohesion.bridge_share` is too large.
    """
    table = particles.contact.cohesion
    if table is None or table.bridge_share is None or particles.bodies.radius.size == 0:
        return
    ratio = 0.5 * particles.bodies.largest_diameter / particles.bodies.smallest_radius
    around = 4.0 * (1.0 + ratio) ** 2
    if particles.scene.dimension == 2:
        around = math.pi / math.asin(1.0 / (1.0 + ratio))
    if table.bridge_share * around > 1.0 + 1e-9:
        limit = f"a particle has room for {around:.0f} others, which together would take more than all of its liquid"
        raise InputError("contact.cohesion.bridge_share", table.bridge_share, limit, f"set it to {0.99 / around:.2g}")


def attraction_time(particles: ParticleSetup, bodies: Sequence[ContactBody]) -> float:
    """Shortest time in which an attraction multiplies a speed, sqrt(m*/k) with its steepest slope k [s]."""
    found = [math.inf]
    for one, other in itertools.combinations_with_replacement(bodies, 2):
        pair = None if one.is_wall and other.is_wall else pair_of(particles, one, other)
        if pair is not None and pair.steepest > 0.0:
            found.append(math.sqrt(effective(one.mass, other.mass) / pair.steepest))
    return min(found)
