"""Room for a list by levels of size; on the host, by NumPy and SciPy's trees."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from jaxdem.particles.neighbors import NeighborGeometry, Room, RowRoom
from jaxdem.particles.packing import near_pairs
from jaxdem.particles.regions import into_period
from jaxdem.particles.size_levels import LevelTables, SizeLevels
from jaxdem.particles.usual_room import EXTRA_CAPACITY, EXTRA_PAIRS, USUAL_PAIRS, USUAL_SLOTS

SPARE_ROWS = 16
"""Further rows of entries that there is room for beyond those found, and as many as one for so many particles: what
gathers about a large grain later."""

NARROWEST_ROW = {2: 6, 3: 8}
"""Entries of a row at least, by dimension: what a grain has in a dense pack in the mean."""


def level_room(
    levels: SizeLevels,
    geometry: NeighborGeometry,
    position: tuple[np.ndarray, ...],
    radius: np.ndarray,
    active: np.ndarray | None = None,
) -> Room:
    """Room for these positions and for a dense pack, with a margin.

    Args:
        levels: of size.
        geometry: of the list.
        position: D arrays (N,) [m].
        radius: (N,) [m].
        active: (N,) bool, which particles there are; all if None.
    """
    count, dimension = len(radius), len(position)
    there = np.full(count, True) if active is None else active
    present, size = tuple(np.asarray(x, float)[there] for x in position), radius[there]
    first, second = pairs_in_reach(geometry, present, size + 0.5 * (levels.gap + geometry.skin))
    owner = np.where(owns_first(size, first, second), first, second)
    owned = int(np.bincount(owner, minlength=1).max()) if len(owner) else 0
    degree = np.zeros(count, int)
    degree[: len(size)] = np.bincount(np.concatenate((first, second)), minlength=len(size))
    pairs = max(math.ceil(EXTRA_PAIRS * len(first)), math.ceil(USUAL_PAIRS[dimension] * count))
    pairs = min(pairs, count * (count - 1) // 2)
    cell, across = occupancy(levels, geometry, present, size, radius)
    slots = min(max(math.ceil(EXTRA_CAPACITY * owned), USUAL_SLOTS[dimension]), count - 1)
    return Room(slots, pairs + 1, cell, rows=RowRoom(*rows_of_entries(degree, dimension), across))


def owns_first(size: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(P,) bool, whether the first of two particles owns the pair: the smaller one, of two equal ones the lower.

    Args:
        size: (N,) radii.
        first, second: (P,) of each pair.
    """
    owned: np.ndarray = (size[second] > size[first]) | ((size[second] == size[first]) & (second > first))
    return owned


def pairs_in_reach(
    geometry: NeighborGeometry, position: tuple[np.ndarray, ...], reaches: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The pairs, (P,) each, that are nearer than the reaches (N,) of both together [m]."""
    stacked = np.stack(position, axis=1)
    box = np.where(geometry.periodic, geometry.box, 0.0)  # a period of zero is none
    stacked = np.where(geometry.periodic, into_period(stacked, np.asarray(geometry.box)), stacked)
    one, other = near_pairs(stacked, reaches, box).T
    squared = np.zeros(len(one))
    for k, length in enumerate(box):
        apart = stacked[one, k] - stacked[other, k]
        squared += (apart - length * np.round(apart / length) if length else apart) ** 2
    near = squared < (reaches[one] + reaches[other]) ** 2
    return one[near], other[near]


def rows_of_entries(degree: np.ndarray, dimension: int) -> tuple[int, int]:
    """Width of the rows of entries and number of further rows that take the fewest entries in all.

    `degree` (N,) is the number of pairs of each particle.
    """
    count, best = len(degree), None
    for width in range(NARROWEST_ROW[dimension], 2 * USUAL_SLOTS[dimension] + 1):
        further = further_rows(degree, width)
        if best is None or width * (count + further) < best[0] * (count + best[1]):
            best = width, further
    assert best is not None
    return best


def further_rows(degree: np.ndarray, width: int) -> int:
    """Room for rows beyond the first of every particle, of this width, with a margin."""
    further = int(np.sum(np.maximum(degree - 1, 0) // width))
    return math.ceil(EXTRA_CAPACITY * further) + len(degree) // SPARE_ROWS + SPARE_ROWS


def occupancy(
    levels: SizeLevels,
    geometry: NeighborGeometry,
    position: tuple[np.ndarray, ...],
    size: np.ndarray,
    radius: np.ndarray,
    rows: int | None = None,
) -> tuple[int, int]:
    """Room for particles in a column of the tables of both kinds: as many as there are, and as a dense pack has.

    Args:
        levels, geometry: of the list.
        position: D arrays (M,) of those present [m].
        size: (M,) of these [m].
        radius: (N,) of all that there ever are [m].
        rows: particles that the tables are for; M if None.
    """
    tables = LevelTables(levels, geometry.box, geometry.periodic, len(size) if rows is None else rows)
    everyone, found = np.asarray(levels.of_radius(_as_array(radius))), []
    homes = tables.homes(_as_array(position), levels.of_radius(_as_array(size)))
    for kind, (home, grids) in enumerate(zip(map(np.asarray, homes), tables.kinds, strict=True)):
        columns = sum(grid.columns for grid in grids)
        most = int(np.bincount(home[home < columns]).max(initial=1))
        for number, grid in enumerate(grids, kind):
            own = radius[everyone == number]
            if len(own):
                typical = float(np.mean(own ** len(position))) ** (1.0 / len(position))
                most = max(most, min(grid.dense_occupancy(2.0 * typical), len(own)))
        found.append(math.ceil(EXTRA_CAPACITY * most))
    return found[0], found[1]


def _as_array(values: Any) -> Any:
    """NumPy's arrays in place of JAX's, where a function takes either."""
    return values
