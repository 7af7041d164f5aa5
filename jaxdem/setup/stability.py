"""Time-step limits, each in one place; host side, plain numbers."""

from __future__ import annotations

import math
from typing import NamedTuple


def rayleigh_time(radius: float, density: float, young_modulus: float, poisson_ratio: float) -> float:
    """Time a Rayleigh wave takes around a sphere, pi R sqrt(rho/G) / (0.1631 nu + 0.8766) [s].

    Source: Y. Li, Y. Xu, C. Thornton, Powder Technol. 160 (2005) 219-228, eq. 6.
    """
    shear = young_modulus / (2.0 * (1.0 + poisson_ratio))
    return math.pi * radius * math.sqrt(density / shear) / (0.1631 * poisson_ratio + 0.8766)


def hertz_duration(mass: float, radius: float, modulus: float, speed: float) -> float:
    """Duration of an elastic Hertz impact, 2.868 (m*^2 / (R* E*^2 v))^(1/5) [s].

    Args:
        mass: effective m* [kg].
        radius: effective R* [m].
        modulus: effective E* [Pa].
        speed: of approach [m/s].

    Source: K. L. Johnson, Contact Mechanics (1985), eq. 11.24 (constant 2.87).
    """
    return 2.868 * (mass**2 / (radius * modulus**2 * speed)) ** 0.2


def hertz_overlap(mass: float, radius: float, modulus: float, speed: float) -> float:
    """Largest overlap of an elastic Hertz impact, (15 m* v^2 / (16 E* sqrt(R*)))^(2/5) [m].

    Source: K. L. Johnson, Contact Mechanics (1985), eq. 11.23.
    """
    return (15.0 * mass * speed**2 / (16.0 * modulus * math.sqrt(radius))) ** 0.4


def hertz_speed(mass: float, radius: float, modulus: float, overlap: float) -> float:
    """Speed of an elastic Hertz impact that is so deep [m/s]; the inverse of `hertz_overlap`."""
    return math.sqrt(16.0 * modulus * math.sqrt(radius) * overlap**2.5 / (15.0 * mass))


def hertz_resting_overlap(force: float, radius: float, modulus: float) -> float:
    """Overlap of a Hertz contact at rest under a force, (3 F / (4 E* sqrt(R*)))^(2/3) [m].

    Source: K. L. Johnson, Contact Mechanics (1985), eq. 4.23.
    """
    return (0.75 * force / (modulus * math.sqrt(radius))) ** (2.0 / 3.0)


def hertz_stiffness(radius: float, modulus: float, overlap: float) -> float:
    """Tangent stiffness dF/dd = 2 E* sqrt(R* d) of a Hertz contact [N/m]."""
    return 2.0 * modulus * math.sqrt(radius * overlap)


def linear_duration(mass: float, stiffness: float, damping_ratio: float) -> float:
    """Duration of a linear spring-dashpot contact, pi / (w sqrt(1 - b^2)), w = sqrt(k/m*) [s]."""
    return math.pi * math.sqrt(mass / stiffness) / math.sqrt(max(1.0 - damping_ratio**2, 1e-12))


def linear_overlap(mass: float, stiffness: float, speed: float) -> float:
    """Largest overlap of an undamped linear contact, v sqrt(m*/k) [m]."""
    return speed * math.sqrt(mass / stiffness)


class LinearContact(NamedTuple):
    """A contact about a given overlap: stiffnesses and dashpots per displacement and velocity of the surfaces.

    Attributes:
        normal: [N/m].
        tangential: 0 without friction [N/m].
        normal_damping: [N s/m].
        tangential_damping: [N s/m].
        rolling: of the rolling spring over the particle's radius squared, 0 without [N/m].
        rolling_damping: over the radius squared [N s/m].
    """

    normal: float
    tangential: float
    normal_damping: float
    tangential_damping: float
    rolling: float = 0.0
    rolling_damping: float = 0.0


def hertz_mindlin_contact(
    mass: float, radius: float, modulus: float, shear: float, overlap: float, restitution: float, rough: bool
) -> LinearContact:
    """A Hertz-Mindlin contact about an overlap d: S_n = 2 E* sqrt(R* d), S_t = 8 G* sqrt(R* d).

    Dashpots 2 sqrt(5/6) |b| sqrt(S m*) of either; both are in `jaxdem.particles.contact`.

    Args:
        mass: effective m* [kg].
        radius: effective R* [m].
        modulus: effective E* [Pa].
        shear: effective G* [Pa].
        overlap: [m].
        restitution: [-].
        rough: whether there is friction.
    """
    normal = hertz_stiffness(radius, modulus, overlap)
    tangential = 4.0 * shear / modulus * normal if rough else 0.0
    factor = 2.0 * math.sqrt(5.0 / 6.0) * damping_ratio(restitution)
    return LinearContact(normal, tangential, factor * math.sqrt(normal * mass), factor * math.sqrt(tangential * mass))


def linear_contact(mass: float, normal: float, tangential: float, restitution: float, rough: bool) -> LinearContact:
    """A linear spring-dashpot contact; the tangential dashpot is half the normal one.

    Args:
        mass: effective m* [kg].
        normal, tangential: stiffness [N/m].
        restitution: [-].
        rough: whether there is friction.
    """
    damping = 2.0 * damping_ratio(restitution) * math.sqrt(normal * mass)
    return LinearContact(normal, tangential if rough else 0.0, damping, 0.5 * damping if rough else 0.0)


def damping_ratio(restitution: float) -> float:
    """|b| = -ln e / sqrt(ln^2 e + pi^2) [-]."""
    if restitution == 0.0:
        return 1.0
    logarithm = math.log(restitution)
    return -logarithm / math.hypot(logarithm, math.pi)


def stokes_relaxation_time(mass: float, radius: float, dynamic_viscosity: float) -> float:
    """Relaxation time m / (6 pi mu r) of a sphere under Stokes drag, the longest it can be [s]."""
    return mass / (6.0 * math.pi * dynamic_viscosity * radius)


def courant_time(speed: float, spacing: tuple[float, ...], courant: float) -> float:
    """Time step at which |u| t / h of the shortest cell side reaches `courant`; infinite at rest [s]."""
    return courant * min(spacing) / speed if speed > 0.0 else math.inf


def viscous_time(viscosity: float, spacing: tuple[float, ...], limit: float) -> float:
    """Time step at which nu t sum(1/h^2) reaches `limit`; infinite without viscosity [s]."""
    return limit / (viscosity * sum(1.0 / h**2 for h in spacing)) if viscosity > 0.0 else math.inf
