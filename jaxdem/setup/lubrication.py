"""What lubrication does to the limits of a scene: its largest resistance. Host side, plain numbers."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

from jaxdem.errors import required
from jaxdem.particles.lubrication import ROLLING_SHARE
from jaxdem.scene.lubrication import Lubrication
from jaxdem.setup.contact_bodies import ContactBody, effective
from jaxdem.setup.particles import ParticleSetup


def largest_resistance(particles: ParticleSetup, radius: float) -> float:
    """6 pi mu R*^2 / roughness of two bodies with R* [N s/m]; 0 without lubrication."""
    table = particles.contact.lubrication
    return 0.0 if table is None else 6.0 * math.pi * _viscosity(particles, table) * radius**2 / table.roughness


def largest_shear(particles: ParticleSetup, radius: float, smaller: float) -> float:
    """Dashpot across a contact that has the effect of the film on the stable step at most [N s/m].

    Rolling, d = lever (w1 - w2) - skew s with |skew| <= 1, has a sign of its own: with |a + b|^2 <= 2 |a|^2 + 2 |b|^2
    its resistance counts twice as one against sliding.

    Args:
        particles: of the scene.
        radius: R* [m].
        smaller: of the two radii [m].
    """
    table = particles.contact.lubrication
    if table is None or not table.shear:
        return 0.0
    sliding = 2.0 * math.pi * _viscosity(particles, table) * radius * math.log(smaller / table.roughness)
    return (1.0 + 2.0 * ROLLING_SHARE) * sliding


def _viscosity(particles: ParticleSetup, table: Lubrication) -> float:
    """Dynamic, of the liquid [Pa s]."""
    fluid = particles.scene.fluid
    return table.viscosity or required(fluid, "fluid").density * required(fluid, "fluid").viscosity


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
