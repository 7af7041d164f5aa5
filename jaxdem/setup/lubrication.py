"""What lubrication does to the limits of a scene: reach and largest resistance. Host side, plain numbers."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

from jaxdem.errors import InputError, required
from jaxdem.setup.contact_bodies import ContactBody, effective
from jaxdem.setup.particles import ParticleSetup

LARGEST_REACH = 0.5
"""Longest cutoff that is accepted, over the radius of the smallest particle."""


def lubrication_reach(particles: ParticleSetup) -> float:
    """Longest gap at which the liquid acts [m].

    Raises:
        InputError: it is longer than half of the smallest radius.
    """
    table = particles.contact.lubrication
    if table is None or particles.bodies.radius.size == 0:
        return 0.0
    longest = LARGEST_REACH * particles.bodies.smallest_radius
    if table.cutoff > longest:
        limit = f"is at most half of the smallest radius, {longest:.3g} m: the force is that of a narrow gap"
        raise InputError("contact.lubrication.cutoff", table.cutoff, limit, "lower it")
    return table.cutoff


def largest_resistance(particles: ParticleSetup, radius: float) -> float:
    """6 pi mu R*^2 / roughness of two bodies with R* [N s/m]; 0 without lubrication."""
    table, fluid = particles.contact.lubrication, particles.scene.fluid
    if table is None:
        return 0.0
    viscosity = table.viscosity
    if viscosity is None:
        viscosity = required(fluid, "fluid").density * required(fluid, "fluid").viscosity
    return 6.0 * math.pi * viscosity * radius**2 / table.roughness


def lubrication_time(particles: ParticleSetup, bodies: Sequence[ContactBody]) -> float:
    """Shortest time in which the liquid at the narrowest gap stops an approach, m* roughness / (6 pi mu R*^2) [s]."""
    found = [math.inf]
    for one, other in itertools.combinations_with_replacement(bodies, 2):
        resistance = 0.0
        if not (one.is_wall and other.is_wall):
            resistance = largest_resistance(particles, effective(one.radius, other.radius))
        if resistance > 0.0:
            found.append(effective(one.mass, other.mass) / resistance)
    # At a wall that is none of the bodies, for it is hard, R* is twice as large and so is m*: half of the time.
    grains = [body for body in bodies if not body.is_wall]
    resistances = [(body.mass, largest_resistance(particles, body.radius)) for body in grains]
    found += [mass / resistance for mass, resistance in resistances if resistance > 0.0]
    return min(found)
