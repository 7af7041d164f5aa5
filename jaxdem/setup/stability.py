"""Time-step limits, each in one place; host side, plain numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
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


ROOM = {0: (0,), 1: (2, 1), 2: (6, 4, 2), 3: (12, 9, 5, 3)}
"""Equal spheres that touch one at once, by free dimensions: in the pack, and with 1, 2, 3 walls in their place."""

LOPSIDED = {
    0: (0.0,),
    1: (0.0, 1.0, 0.0),
    2: (0.0, 1.0, math.sqrt(3.0), 2.0, math.sqrt(3.0), 1.0, 0.0),
    3: (0.0, 1.0, *(math.sqrt(z * (12.0 - z) / 3.0) for z in range(2, 11)), 1.0, 0.0),
}
"""Largest |sum of the unit vectors to Z touching spheres|, by free dimensions and Z. In 2-D of neighbours in a hexagon;
in 3-D of places in a close packing, bounded by (Z - Z^2/12) 4: their tensor n n^T sums to 4."""


def contact_stability_limit(
    mass: float,
    dimension: int,
    pairs: Sequence[tuple[float, LinearContact]],
    wall: LinearContact,
    neighbors: int,
    walls: int,
    thin: int = 0,
    bonds: Callable[[float], float] | None = None,
) -> float:
    """Largest stable contact step, 2/omega_max with what dashpots take from it [s].

    The integrator (`jaxdem.particles.loop`) is a leapfrog: springs act at the position in the middle of a step,
    dashpots on v + a dt/2 with the acceleration of the step before, and on the spin at the start of the step. With
    x(n) = (-1)^n x, where it loses stability first, these times dt are 4 and 2 times the displacement and the rotation
    x = (u, w), and the equation of motion becomes

        x.(dt^2 K + dt C D) x = 4 x.M x,   D = 4 for u and 2 for w.

    C D may be replaced by its symmetric part, in which a dashpot counts 4 for u u, 2 for w w and 3 for u w; with 9/4 in
    place of 2 that is the square of 2 u + 3/2 w. All matrices are then sums of squares over contacts, and
    |a - b|^2 <= (1 + q) |a|^2 + (1 + 1/q) |b|^2: so the largest eigenvalue is at most that of one particle's own
    contacts, times 2 between equal particles (q = 1), 1 at a wall. With k_n = dt^2 S_n + 4 dt c_n and
    k_t(D) = dt^2 S_t + D dt c_t, Z contacts of which at most n_Z act along one line and t_Z on one axis of rotation
    (inertia 2/5 m r^2), and s_Z = |sum of their normals|,

        T = k_n n_Z + k_t(4) (Z - n_Z),   R = 5/2 k_t(9/4) t_Z,   X = sqrt(5/2) k_t(3) s_Z,
        dt at which  (T + R)/2 + sqrt((T - R)^2/4 + X^2) = 4 m.

    Without dashpots that is 2/omega_max: omega_max^2 is 2 S_n/m for a smooth pair, 6 and 8 S_n/m for a smooth
    hexagonal and a smooth close-packed lattice, 30 and 40 S_t/m for rough ones, in which all grains spin alike: there
    the bound is met exactly. `benchmarks/stability.py` compares with limits found by trial.

    Args:
        mass: of the lightest particle [kg].
        dimension: 2 or 3.
        pairs: kinds of contacts between particles, each with its factor 1 + q.
        wall: contact with a wall.
        neighbors: number of other particles.
        walls: number of axes with walls, each of which a particle may touch.
        thin: number of these axes along which a particle may touch both walls.
        bonds: largest eigenvalue that bonds have by themselves over the mass, by the step: it adds to that of the
            contacts at most.

    Source: derived here, as element bounds are for finite elements (B. M. Irons, Int. J. Numer. Methods Eng. 2
    (1970) 5-12).
    """
    free = dimension - thin
    limit = math.inf
    for touching in range(min(walls - thin, free) + 1):
        count = min(max(neighbors, 0), ROOM[free][touching])
        at_walls = _at_walls(wall, touching, thin)
        for factor, pair in pairs:
            limit = min(limit, _limit_of(mass, (_among_particles(pair, factor, count, free), at_walls), bonds))
    return limit


class _Touching(NamedTuple):
    """Contacts of one kind that a particle has at once; symbols of `contact_stability_limit`.

    Attributes:
        contact: each of them.
        weight: 1 + q.
        number: Z.
        along: n_Z, as many act along one line at most.
        axis: t_Z, as many act on one axis of rotation.
        lopsided: s_Z, largest |sum of the normals|.
    """

    contact: LinearContact
    weight: float
    number: int
    along: float
    axis: float
    lopsided: float


def _among_particles(pair: LinearContact, weight: float, count: int, free: int) -> _Touching:
    """Of `count` neighbours in so many free dimensions."""
    along = min(count, 2.0 + 0.25 * max(count - 2, 0), 4.0 if free == 3 else 3.0)
    axis = min(count, 6.0 + max(count - 6, 0) / 3.0)
    return _Touching(pair, weight, count, along, axis, LOPSIDED[free][count])


def _at_walls(wall: LinearContact, touching: int, thin: int) -> _Touching:
    """At `touching` single walls and between `thin` pairs of them."""
    held = touching + 2 * thin
    return _Touching(wall, 1.0, held, 2.0 if thin else min(held, 1.0), held, math.sqrt(touching))


def _limit_of(mass: float, kinds: Sequence[_Touching], bonds: Callable[[float], float] | None) -> float:
    """The limit for a particle with these contacts [s]."""

    def largest(step: float) -> float:
        translation = rotation = cross = 0.0
        for contact, weight, number, along, axis, lopsided in kinds:
            normal = weight * (step**2 * contact.normal + 4.0 * step * contact.normal_damping)
            spring, dashpot = step**2 * contact.tangential, step * contact.tangential_damping
            rolling = weight * (step**2 * contact.rolling + 2.0 * step * contact.rolling_damping)
            translation += normal * along + weight * (spring + 4.0 * dashpot) * (number - along)
            rotation += 2.5 * (weight * (spring + 2.25 * dashpot) * axis + rolling * number)
            cross += math.sqrt(2.5) * weight * (spring + 3.0 * dashpot) * lopsided
        bonded = 0.0 if bonds is None else mass * bonds(step)
        return 0.5 * (translation + rotation) + math.hypot(0.5 * (translation - rotation), cross) + bonded

    stiffness = sum(kind.weight * kind.contact.normal * kind.along for kind in kinds)
    if stiffness == 0.0:
        return math.inf
    low, high = 0.0, 2.0 * math.sqrt(mass / stiffness)
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if largest(middle) <= 4.0 * mass else (low, middle)
    return low


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
