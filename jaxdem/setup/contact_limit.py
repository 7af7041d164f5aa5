"""The stability limit of the contact step for a particle among others and walls. Host side, plain numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from jaxdem.setup.stability import LinearContact
from jaxdem.solids.simultaneous_contacts import SimultaneousContacts

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


class Neighbours(NamedTuple):
    """Particles of one kind that a particle may touch.

    Attributes:
        contact: with each of them.
        weight: 1 + q of `contact_stability_limit`, times by how much more than one of its size each counts.
        number: of them, at most.
        group: kinds of one group are extremes of the same particles, which are there once.
    """

    contact: LinearContact
    weight: float
    number: int
    group: int


def contact_stability_limit(
    mass: float,
    dimension: int,
    pairs: Sequence[Neighbours],
    wall: LinearContact,
    walls: int,
    thin: int = 0,
    bonds: Callable[[float], float] | None = None,
    at_once: Sequence[SimultaneousContacts] = (),
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
    contacts, times 1 + q, which is 2 between equal particles and 1 at a wall. With k_n = dt^2 S_n + 4 dt c_n and
    k_t(D) = dt^2 S_t + D dt c_t, Z contacts of which at most n_Z act along one line and t_Z on one axis of rotation
    (inertia 2/5 m r^2), and s_Z = |sum of their normals|,

        T = k_n n_Z + k_t(4) (Z - n_Z),   R = 5/2 k_t(9/4) t_Z,   X = sqrt(5/2) k_t(3) s_Z,
        dt at which  (T + R)/2 + sqrt((T - R)^2/4 + X^2) = 4 m.

    Without dashpots that is 2/omega_max: omega_max^2 is 2 S_n/m for a smooth pair, 6 and 8 S_n/m for a smooth
    hexagonal and a smooth close-packed lattice, 30 and 40 S_t/m for rough ones, in which all grains spin alike: there
    the bound is met exactly. `benchmarks/stability.py` compares with limits found by trial.

    Args:
        mass: of the particle [kg].
        dimension: 2 or 3.
        pairs: kinds of particles that it may touch.
        wall: contact with a wall.
        walls: number of axes with walls, each of which a particle may touch.
        thin: number of these axes along which a particle may touch both walls.
        bonds: largest eigenvalue that bonds have by themselves over the mass, by the step: it adds to that of the
            contacts at most.
        at_once: walls that are not at right angles, or faces of a mesh, that a particle may touch in the place of one
            wall.

    Source: derived here, as element bounds are for finite elements (B. M. Irons, Int. J. Numer. Methods Eng. 2
    (1970) 5-12).
    """
    free = dimension - thin
    limit = math.inf
    for touching in range(min(walls - thin, free) + 1):
        at_walls = [_at_walls(wall, touching, thin)]
        for contacts in at_once:
            # What spans several dimensions leaves fewer for further walls.
            if touching == 1 or 1 < touching <= free + 1 - contacts.rank:
                at_walls.append(_with_more(at_walls[0], contacts))
        for kinds in _neighbourhoods(mass, pairs, ROOM[free][touching], free):
            limit = min(limit, *(_limit_of(mass, (*kinds, held), bonds) for held in at_walls))
    return limit


def _neighbourhoods(mass: float, pairs: Sequence[Neighbours], room: int, free: int) -> list[list[_Touching]]:
    """The neighbours that a particle may have at once, of which one of these is the worst.

    The largest eigenvalue of a sum of contacts is convex in the numbers of each. So it is largest where all the room is
    taken by one kind, after those that are worse and too few to take it. Which are worse must not depend on the line of
    motion: all of them have friction, or none.
    """
    if room == 0 or not pairs:
        return [[]]
    worst_first = sorted(pairs, key=lambda one: _limit_of(mass, [_among_particles(one, room, room, free)], None))
    found = []
    for k, last in enumerate(worst_first):
        few: list[Neighbours] = []
        for one in worst_first[:k]:
            if one.number < room and one.group not in [last.group, *(other.group for other in few)]:
                few.append(one)
        kinds, left = [], room
        for one in (*few, last):
            count = min(one.number, left)
            left -= count
            kinds.append(_among_particles(one, count, room, free))
        found.append(kinds)
    return found


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


def _among_particles(near: Neighbours, count: int, room: int, free: int) -> _Touching:
    """With `count` neighbours of a kind, of as many as there is room for, in so many free dimensions.

    Neighbours are 60 degrees apart. So few of them act along one line by 2 of 1, 4 of 3/4 or 6 of 2/3: by up to half
    for each beyond two, up to what all for which there is room do.
    """
    full = min(2.0 + 0.25 * max(room - 2, 0), 4.0 if free == 3 else 3.0)
    along = min(count, 2.0 + 0.5 * max(count - 2, 0), full)
    axis = min(count, 6.0 + max(count - 6, 0) / 3.0)
    return _Touching(near.contact, near.weight, count, along, axis, LOPSIDED[free][count])


def _at_walls(wall: LinearContact, touching: int, thin: int) -> _Touching:
    """At `touching` single walls and between `thin` pairs of them."""
    held = touching + 2 * thin
    return _Touching(wall, 1.0, held, 2.0 if thin else min(held, 1.0), held, math.sqrt(touching))


def _with_more(held: _Touching, contacts: SimultaneousContacts) -> _Touching:
    """With these contacts in the place of one of the walls."""
    number = held.number - 1 + contacts.number
    lopsided = math.sqrt(held.lopsided**2 - 1.0 + contacts.lopsided**2)
    return held._replace(number=number, along=max(held.along, contacts.along), axis=number, lopsided=lopsided)


def _limit_of(mass: float, kinds: Sequence[_Touching], bonds: Callable[[float], float] | None) -> float:
    """The limit for a particle with these contacts [s]."""

    def parts(square: float, step: float) -> tuple[float, float, float]:
        """T, R and X of `contact_stability_limit` for so much of dt^2 and of dt, in which they are linear."""
        translation = rotation = cross = 0.0
        for contact, weight, number, along, axis, lopsided in kinds:
            normal = weight * (square * contact.normal + 4.0 * step * contact.normal_damping)
            spring, dashpot = square * contact.tangential, step * contact.tangential_damping
            rolling = weight * (square * contact.rolling + 2.0 * step * contact.rolling_damping)
            translation += normal * along + weight * (spring + 4.0 * dashpot) * (number - along)
            rotation += 2.5 * (weight * (spring + 2.25 * dashpot) * axis + rolling * number)
            cross += math.sqrt(2.5) * weight * (spring + 3.0 * dashpot) * lopsided
        return translation, rotation, cross

    # Of each once: with many kinds of particles there are thousands of neighbourhoods.
    springs, dashpots = parts(1.0, 0.0), parts(0.0, 1.0)

    def largest(step: float) -> float:
        t, r, x = (step * (step * spring + dashpot) for spring, dashpot in zip(springs, dashpots, strict=True))
        bonded = 0.0 if bonds is None else mass * bonds(step)
        return 0.5 * (t + r) + math.hypot(0.5 * (t - r), x) + bonded

    stiffness = sum(kind.weight * kind.contact.normal * kind.along for kind in kinds)
    if stiffness == 0.0:
        return math.inf
    low, high = 0.0, 2.0 * math.sqrt(mass / stiffness)
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if largest(middle) <= 4.0 * mass else (low, middle)
    return low
