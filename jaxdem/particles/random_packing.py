"""Random packs: particles put anywhere in a region where there is room, and pushed apart. Host, numpy."""

from __future__ import annotations

import itertools

import numpy as np
from scipy.spatial import cKDTree

from jaxdem.particles.packing import near_pairs
from jaxdem.particles.regions import Region, ball_size

ADDED = {2: 0.5, 3: 0.33}
"""Solid fraction up to which random sequential addition takes seconds.

Equal discs or spheres find no more room at 0.547 and 0.384, and towards that the time grows without bound. Source: S.
Torquato, O. U. Uche, F. H. Stillinger, Phys. Rev. E 74 (2006) 061308, table I.
"""

REACHABLE = {2: 0.65, 3: 0.5}
"""Solid fraction up to which a pack is made in seconds, the last particles by pushing others apart.

In boxes from five diameters wide. Equal discs or spheres begin to crystallise at 0.70 and 0.49, and
a disordered pack of them jams at 0.84 and 0.64.
"""

TRIES_PER_PARTICLE = 2_000
"""Points tried for a particle, on average, before those without room are pushed in."""

TRIES_WHEN_CROWDED = 20
"""The same where addition alone cannot end: above `ADDED`."""

MOST_PUSHES = 2_000
"""Pushes by which particles that overlap are moved apart, before a pack is given up."""

PUSH_MARGIN = 1e-4
"""Part of a reach by which they are pushed further than they must: the last part of an overlap would take for ever."""

PUSH_MEMORY = 0.5
"""Part of a push that is added to the next."""

TRIES_PER_ROUND = 8_192
"""Points tried at once, at least."""


def random_solid_fraction(region: Region, radius: np.ndarray, spacing: float) -> float:
    """Area or volume of the discs or spheres, each enlarged by `spacing`, over that of the region [-].

    Args:
        region: that holds them.
        radius: (N,) [m].
        spacing: least distance of two centres over the sum of their radii [-].
    """
    return float(ball_size(region.dimension) * np.sum((spacing * radius) ** region.dimension) / region.volume)


def random_pack(
    region: Region, radius: np.ndarray, spacing: float, seed: int | list[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Centres of particles put one after the other anywhere in a region where there is room, the largest first.

    Random sequential addition: a point is drawn, and kept if it is not too near to an earlier one. The particles
    are taken in bins of a factor of two in size, each with cells of its own, so that a point looks into 3^D
    cells of every bin, whatever the sizes. Those that find no room, in a narrow box or a dense pack, are put in
    anywhere, and all that overlap are pushed apart.

    Args:
        region: that holds the particles with their whole radius.
        radius: (N,) [m].
        spacing: least distance of two centres over the sum of their radii [-].
        seed: of the points.

    Returns:
        (N, D) centres; and (N,) bool, which particles have room: all of them, or too few were free of others after
        `MOST_PUSHES`.
    """
    generator = np.random.default_rng(seed)
    reach, (start, stop) = spacing * radius, (np.asarray(corner) for corner in region.bounds)
    position, placed = np.zeros((len(radius), len(start))), np.zeros(len(radius), bool)
    crowded = random_solid_fraction(region, radius, spacing) > ADDED[len(start)]
    tries, grids = (TRIES_WHEN_CROWDED if crowded else TRIES_PER_PARTICLE) * len(radius), []
    # Points are drawn from the box around the region.
    tries = int(tries * round(float(np.prod(stop - start)) / region.volume, 6))
    bins = np.floor(np.log2(reach.max(initial=1.0) / reach) + 1e-9)
    for number in np.unique(bins):
        members = np.flatnonzero(bins == number)
        grids.append(_Grid(start, stop, 2.0 * float(reach[members].max()), len(members)))
        while len(members) and tries > 0:
            each = -(-TRIES_PER_ROUND // len(members))
            drawn = np.repeat(members, each)
            tries -= len(drawn)
            low, high = start + radius[drawn, None], stop - radius[drawn, None]
            points = generator.uniform(low, np.maximum(low, high))
            room = (high >= low).all(axis=1)
            room[room] = region.inside(points[room], radius[drawn[room]])
            for grid in grids:
                room[room] = grid.free(points[room], reach[drawn[room]], position, reach)
            kept, first = np.unique(drawn[room], return_index=True)
            points = points[room][first]
            clear = _clear_in_turn(points, reach[kept])
            position[kept[clear]], placed[kept[clear]] = points[clear], True
            grids[-1].add(kept[clear], position)
            members = members[~placed[members]]
    low, high = start + radius[:, None], stop - radius[:, None]
    if placed.all() or (low > high).any():
        return position, placed
    left = np.flatnonzero(~placed)
    position[left] = region.kept(generator.uniform(low[left], high[left]), radius[left])
    return _pushed_apart(position, reach, radius, region)


def _pushed_apart(
    position: np.ndarray, reach: np.ndarray, radius: np.ndarray, region: Region
) -> tuple[np.ndarray, np.ndarray]:
    """Centres moved until none is nearer to another than both reach, and which are free of others by then.

    Each push moves the two of every pair that overlap apart, by half of what is lacking each, with a part of the last
    push added (gradient descent with momentum on the sum of squared overlaps). Below the density at which a disordered
    pack jams (0.64 of spheres, 0.84 of discs) this ends without overlaps.

    Args:
        position: (N, D) [m].
        reach: (N,) [m].
        radius: (N,) that stays inside the region [m].
        region: that holds the particles.
    """
    wanted, skin = reach * (1.0 + PUSH_MARGIN), 0.2 * float(reach.min())
    none, move, listed, pairs = (
        np.zeros(position.shape[1]),
        np.zeros_like(position),
        None,
        np.zeros((0, 2), int),
    )
    for _ in range(MOST_PUSHES):
        if listed is None or np.abs(position - listed).max() > 0.5 * skin / np.sqrt(len(none)):
            listed, pairs = position.copy(), near_pairs(position, reach + 0.5 * skin, none)
        first, second = pairs.T
        apart = position[first] - position[second]
        distance = np.maximum(np.linalg.norm(apart, axis=1), 1e-9 * reach[first])
        if (distance >= reach[first] + reach[second]).all() and region.inside(position, radius).all():
            return position, np.ones(len(position), bool)
        lacking = np.maximum(wanted[first] + wanted[second] - distance, 0.0)
        push = (0.5 * lacking / distance)[:, None] * apart
        move *= PUSH_MEMORY
        for axis in range(len(none)):
            move[:, axis] += np.bincount(first, push[:, axis], len(position))
            move[:, axis] -= np.bincount(second, push[:, axis], len(position))
        position = region.kept(position + move, radius)
    clear = region.inside(position, radius)
    clear[pairs[distance < reach[first] + reach[second]].ravel()] = False
    return position, clear


class _Grid:
    """Cells of particles that stand, for those of one bin of sizes."""

    def __init__(self, start: np.ndarray, stop: np.ndarray, width: float, count: int):
        # No more than a few cells per particle, however small the particles are in the box.
        self._width = max(width, float(np.prod(stop - start) / (4 * max(count, 1))) ** (1.0 / len(start)))
        self._start = start
        # An empty cell beyond either side.
        self._shape = np.floor((stop - start) / self._width).astype(int) + 3
        self._count = np.zeros(np.prod(self._shape), int)
        self._table = np.full((len(self._count), 4), -1)
        around = np.array(list(itertools.product((-1, 0, 1), repeat=len(start))))
        self._around = around[np.argsort(np.abs(around).sum(axis=1), kind="stable")]  # the likeliest first

    def free(self, points: np.ndarray, reach: np.ndarray, position: np.ndarray, other_reach: np.ndarray) -> np.ndarray:
        """Which of the points (M, D), of particles that reach (M,) [m], overlap none that stands here."""
        left, cells = np.arange(len(points)), self._cells(points)
        for step in self._around:
            cell = self._flat(cells[left] + step)
            for slot in range(int(self._count[cell].max(initial=0))):
                other = self._table[cell, slot]
                apart = points[left] - position[other]
                least = reach[left] + other_reach[other]
                clear = (other < 0) | (np.einsum("md,md->m", apart, apart) >= least**2)
                left, cell = left[clear], cell[clear]
        free = np.zeros(len(points), bool)
        free[left] = True
        return free

    def add(self, index: np.ndarray, position: np.ndarray) -> None:
        """Enters particles by their index."""
        cell = self._flat(self._cells(position[index]))
        order = np.argsort(cell, kind="stable")
        index, cell = index[order], cell[order]
        slot = self._count[cell] + np.arange(len(cell)) - np.searchsorted(cell, cell)
        lacking = int(slot.max(initial=-1)) + 1 - self._table.shape[1]
        if lacking > 0:
            self._table = np.pad(self._table, ((0, 0), (0, lacking)), constant_values=-1)
        self._table[cell, slot] = index
        np.add.at(self._count, cell, 1)

    def _cells(self, points: np.ndarray) -> np.ndarray:
        return np.floor((points - self._start) / self._width).astype(int) + 1

    def _flat(self, cells: np.ndarray) -> np.ndarray:
        return np.ravel_multi_index(tuple(cells.T), tuple(self._shape))


def _clear_in_turn(points: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """Which of the points (M, D) stay if they are put down in turn and may not overlap those that stay."""
    clear = np.ones(len(points), bool)
    if len(points) < 2:
        return clear
    pairs = cKDTree(points).query_pairs(2.0 * float(reach.max()), output_type="ndarray")
    apart = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    pairs = pairs[apart < reach[pairs[:, 0]] + reach[pairs[:, 1]]]
    for first, second in pairs[np.argsort(pairs[:, 1], kind="stable")]:  # whether `first` stays is known by then
        clear[second] &= not clear[first]
    return clear
