"""Dense disordered packs: particles begin small at random places and grow, and push each other apart. Host, numpy.

As in the compression of B. D. Lubachevsky, F. H. Stillinger, J. Stat. Phys. 60 (1990) 561, the radii grow from small
ones; in place of collisions the overlaps are removed by minimising the sum of their squares, as in C. S. O'Hern, L. E.
Silbert, A. J. Liu, S. R. Nagel, Phys. Rev. E 68 (2003) 011306, who find that equal spheres jam at 0.639 +- 0.003 and
discs of two sizes at 0.842. The minimiser is FIRE: E. Bitzek et al., Phys. Rev. Lett. 97 (2006) 170201.

Particles of very different sizes come level by level of size, the largest first: those of a level begin in the voids
between all larger ones, which go on moving. Grown together, small ones would be caught between large ones that still
have far to go. A large particle, which thousands of small ones push, has a mass that grows with their number: the
minimiser would otherwise need steps so short that nothing arrives.
"""

from __future__ import annotations

import numpy as np

from jaxdem.particles.packing import Seed, near_pairs
from jaxdem.particles.regions import Region, into_period

DISORDERED = {2: 0.84, 3: 0.64}
"""Solid fraction above which equal discs or spheres have no disordered pack without overlaps."""

STAGES, STEPS_OF_A_STAGE = 10, 100
"""Of the growth to the full radii, evenly in solid fraction, and the most steps of the minimiser in each."""

MOST_STEPS = 10_000
"""Of the minimiser at the full radii, before a pack is given up."""

MARGIN = 1e-5
"""Part of a radius by which particles are pushed further than they must."""

PULLS, STEPS_OF_A_PULL = (0.1, 0.01, 1e-3, 1e-4), 300
"""Stiffnesses of springs that hold particles in their places, over that of a contact, and steps with each."""

FIRST_STEP, LONGEST_STEP = 0.1, 0.4
"""Of the minimiser, in units of mass and stiffness of a contact; twelve contacts are stable up to 0.57."""

CROWD = {2: 8, 3: 16}
"""Neighbours, by dimension, beyond which the mass of a particle grows with their number: equal ones have fewer."""

LEVEL_RATIO = 2.0
"""Largest over smallest radius within a level."""

POINT = 1e-3
"""Radius of a point, over that of the smallest particle, by which it is looked for."""


def grown_pack(region: Region, radius: np.ndarray, spacing: float, seed: Seed) -> tuple[np.ndarray, float]:
    """Centres of particles that fill a region densely, and the part of their reach at which they do not overlap.

    Args:
        region: that holds the particles with their whole radius; along axes that it spans they are periodic.
        radius: (N,) [m].
        spacing: least distance of two centres over the sum of their radii [-].
        seed: of the first positions.

    Returns:
        (N, D) centres; and the factor on all radii at which none overlaps: 1 where the pack was made.
    """
    generator = np.random.default_rng(seed)
    level, grown = _levels(radius), np.zeros(len(radius), bool)
    position = np.zeros((len(radius), region.dimension))
    for number in range(int(level.max(initial=0)) + 1):
        coming = level == number
        position[coming] = _in_voids(region, position[grown], radius[grown], int(coming.sum()), generator)
        grown |= coming
        for stage in range(1, STAGES):
            part = np.where(coming, (stage / STAGES) ** (1.0 / region.dimension), 1.0)
            position[grown], _ = _relaxed(region, position[grown], (part * radius)[grown], spacing, STEPS_OF_A_STAGE)
    return _relaxed(region, position, radius, spacing, MOST_STEPS)


def moved_apart(region: Region, position: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, bool]:
    """Centres moved until none overlaps another or the boundary of the region, and whether there was room for it.

    Args:
        region: that holds the particles with their whole radius; along axes that it spans they are periodic.
        position: (N, D) [m].
        radius: (N,) [m].
    """
    position, part = _relaxed(region, position, radius, 1.0, MOST_STEPS)
    return position, part == 1.0


def pushed_apart(region: Region, position: np.ndarray, radius: np.ndarray, pushes: int) -> tuple[np.ndarray, float]:
    """As `moved_apart`, by at most so many pushes; and the part of their reach at which none overlaps, 1 for all."""
    return _relaxed(region, position, radius, 1.0, pushes)


def moved_apart_nearby(region: Region, position: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, bool]:
    """As `moved_apart`, of particles that overlap much: weaker and weaker springs hold each to where it was.

    Without them particles that push each other apart do not come back together, and a pack ends looser than it must.
    """
    near = position
    for pull in PULLS:
        near, _ = _relaxed(region, near, radius, 1.0, STEPS_OF_A_PULL, (position, pull))
    return moved_apart(region, near, radius)


def _levels(radius: np.ndarray) -> np.ndarray:
    """(N,) number of the level of size that each is in, 0 for the largest; each has particles of `LEVEL_RATIO`."""
    level, left, number = np.zeros(len(radius), int), np.full(len(radius), True), 0
    while left.any():
        here = left & (radius >= radius[left].max() / LEVEL_RATIO)
        level[here], left, number = number, left & ~here, number + 1
    return level


def _in_voids(
    region: Region, position: np.ndarray, radius: np.ndarray, count: int, generator: np.random.Generator
) -> np.ndarray:
    """(count, D) points anywhere in a region, but in none of the particles at (N, D) with radii (N,) [m]."""
    low, high = (np.asarray(corner) for corner in region.bounds)
    found, missing = [np.zeros((0, region.dimension))], count
    while missing > 0:
        points = generator.uniform(low, high, (2 * missing, region.dimension))
        points = points[region.inside(points)]
        if len(position):
            points = points[_outside(region, points, position, radius)]
        found.append(points[:missing])
        missing -= len(found[-1])
    return np.concatenate(found)


def _outside(region: Region, points: np.ndarray, position: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """(M,) bool, which points are in no particle."""
    everything = np.concatenate((points, position))
    size = np.concatenate((np.full(len(points), POINT * radius.min()), radius))
    pairs = np.sort(near_pairs(everything, size, _periods(region)), axis=1)
    point, particle = pairs[(pairs[:, 0] < len(points)) & (pairs[:, 1] >= len(points))].T
    apart = _nearest_image(region, everything[point] - everything[particle])
    free = np.full(len(points), True)
    free[point[np.einsum("pd,pd->p", apart, apart) < size[particle] ** 2]] = False
    return free


def _relaxed(
    region: Region,
    position: np.ndarray,
    radius: np.ndarray,
    spacing: float,
    most: int,
    held: tuple[np.ndarray, float] | None = None,
) -> tuple[np.ndarray, float]:
    """Centres after `most` steps of the minimiser, or as soon as nothing overlaps; and the part that has room.

    `held` has places (N, D) to which springs hold the particles [m], and their stiffness over that of a contact.
    """
    given, radius = radius, radius * (1.0 + MARGIN)
    reach, skin = spacing * radius, 0.3 * spacing * float(radius.min())
    unit = float(radius.mean())
    velocity, step, mixing, downhill = np.zeros_like(position), FIRST_STEP, 0.1, 0
    listed, pairs, mass, part = None, np.zeros((0, 2), int), np.ones((len(position), 1)), 0.0
    for _ in range(most):
        if listed is None or np.linalg.norm(position - listed, axis=1).max() > 0.5 * skin:
            position = _into_periods(region, position)
            listed, pairs = position.copy(), _in_reach(region, position, reach + 0.5 * skin)
            neighbors = np.bincount(pairs.ravel(), minlength=len(position))[:, None]
            mass = np.maximum(neighbors / CROWD[region.dimension], 1.0)
        force, part = _pushes(region, position, radius, reach, pairs)
        if part >= 1.0 / (1.0 + MARGIN):
            break
        if held is not None:
            force += held[1] * _nearest_image(region, held[0] - position)
        power, pull = float(np.sum(force * velocity)), force / mass
        if power > 0.0:
            downhill += 1
            ahead = _length(velocity, mass) / max(_length(pull, mass), 1e-300 * unit)
            velocity = (1.0 - mixing) * velocity + mixing * ahead * pull
            if downhill > 5:
                step, mixing = min(1.1 * step, LONGEST_STEP), 0.99 * mixing
        else:
            velocity, step, mixing, downhill = np.zeros_like(position), 0.5 * step, 0.1, 0
        velocity += step * pull
        position = position + step * velocity
    position = _into_periods(region, position)
    inside = bool(region.inside(position, given).all())
    return position, min(part * (1.0 + MARGIN), 1.0) if inside else min(part, 1.0 - 1e-6)


def _length(vectors: np.ndarray, mass: np.ndarray) -> float:
    """Of all vectors (N, D) as one, each times the root of its mass (N, 1). Not by the library of `np.linalg.norm`,
    which gives large sums to several threads: its bits, and so the pack, would depend on their number, and it waits for
    cores that other programs have."""
    return float(np.sqrt(np.sum(vectors * vectors * mass)))


def _in_reach(region: Region, position: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """(P, 2) the pairs nearer than the reach (N,) of both [m]."""
    pairs = near_pairs(position, reach, _periods(region))
    apart = _nearest_image(region, position[pairs[:, 0]] - position[pairs[:, 1]])
    return pairs[np.einsum("pd,pd->p", apart, apart) < np.sum(reach[pairs], axis=1) ** 2]


def _pushes(
    region: Region, position: np.ndarray, radius: np.ndarray, reach: np.ndarray, pairs: np.ndarray
) -> tuple[np.ndarray, float]:
    """(N, D) by how much each particle is pushed by its neighbours and by the boundary [m]; and the part that has room.

    The part is the least distance of two centres over their reach, or of a centre from the boundary over its radius.
    """
    first, second = pairs.T
    apart = _nearest_image(region, position[first] - position[second])
    distance, wanted = np.sqrt(np.einsum("pd,pd->p", apart, apart)), reach[first] + reach[second]
    part = float((distance / wanted).min(initial=1.0))
    touching = distance < wanted
    first, second, apart = first[touching], second[touching], apart[touching]
    distance, wanted = distance[touching], wanted[touching]
    push = ((wanted - distance) / np.maximum(distance, 1e-9 * wanted))[:, None] * apart
    force = np.zeros_like(position)
    for axis in range(region.dimension):
        force[:, axis] += np.bincount(first, push[:, axis], len(position))
        force[:, axis] -= np.bincount(second, push[:, axis], len(position))
    depth = -region.signed_distance(position)
    near = depth < radius
    force[near] += region.kept(position[near], radius[near]) - position[near]
    return force, min(part, float((depth[near] / radius[near]).min(initial=1.0)))


def _periods(region: Region) -> np.ndarray:
    """(D,) length of the region along axes that it spans, zero along the others [m]."""
    low, high = (np.asarray(corner) for corner in region.bounds)
    return np.where(region.wraps, high - low, 0.0)


def _nearest_image(region: Region, apart: np.ndarray) -> np.ndarray:
    """Differences of positions, the shortest along axes that the region spans."""
    periods = _periods(region)
    wraps = periods > 0.0
    apart[:, wraps] -= periods[wraps] * np.round(apart[:, wraps] / periods[wraps])
    return apart


def _into_periods(region: Region, position: np.ndarray) -> np.ndarray:
    """The same places within one period."""
    if not any(region.wraps):
        return position
    low, periods = np.asarray(region.bounds[0]), _periods(region)
    wrapped = low + into_period(position - low, np.where(periods > 0.0, periods, 1.0))
    return np.where(periods > 0.0, wrapped, position)
