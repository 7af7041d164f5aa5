"""Time-step limits, each in one place; host side, plain numbers."""

from __future__ import annotations

import math


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


def hertz_stiffness(radius: float, modulus: float, overlap: float) -> float:
    """Tangent stiffness dF/dd = 2 E* sqrt(R* d) of a Hertz contact [N/m]."""
    return 2.0 * modulus * math.sqrt(radius * overlap)


def linear_duration(mass: float, stiffness: float, damping_ratio: float) -> float:
    """Duration of a linear spring-dashpot contact, pi / (w sqrt(1 - b^2)), w = sqrt(k/m*) [s]."""
    return math.pi * math.sqrt(mass / stiffness) / math.sqrt(max(1.0 - damping_ratio**2, 1e-12))


def linear_overlap(mass: float, stiffness: float, speed: float) -> float:
    """Largest overlap of an undamped linear contact, v sqrt(m*/k) [m]."""
    return speed * math.sqrt(mass / stiffness)


def contact_stability_limit(mass: float, stiffness: float) -> float:
    """Largest stable contact step, 2 / w_max with w_max = sqrt(8 k / m) [s].

    8 k/m is the highest squared frequency of a close-packed lattice of masses m with contacts of stiffness
    k; looser packs and single contacts (2 k/m) are slower.
    """
    return 2.0 / math.sqrt(8.0 * stiffness / mass)


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
