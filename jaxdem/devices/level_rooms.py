"""Room for the lists of slabs by levels of size. Host, numpy."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from jaxdem.particles.level_room import further_rows, occupancy, owns_first, pairs_in_reach, rows_of_entries
from jaxdem.particles.neighbor_search import NeighborSearch
from jaxdem.particles.neighbors import Room, RowRoom
from jaxdem.particles.usual_room import EXTRA_CAPACITY, EXTRA_PAIRS, USUAL_SLOTS


def room_by_levels(
    search: NeighborSearch,
    position: tuple[np.ndarray, ...],
    radius: np.ndarray,
    active: np.ndarray | None,
    slab: np.ndarray,
    pairs: int,
    rows: int,
) -> Room:
    """Room for the list of any slab, with a margin.

    A slab lists the pairs of its particles, with each other and with ghosts. So its rows of entries, too, are those of
    its particles and of the others that these pairs have.

    Args:
        search: by levels.
        position: D arrays (N,) [m].
        radius: (N,) [m].
        active: (N,) bool, which particles there are; all if None.
        slab: (M,) of those that there are.
        pairs: that there is room for at least.
        rows: of a slab, those of ghosts too.
    """
    levels, geometry, dimension = search.levels, search.geometry, len(position)
    assert levels is not None, "of a list by levels"
    there = np.full(len(radius), True) if active is None else active
    present, size = tuple(x[there] for x in position), radius[there]
    first, second = pairs_in_reach(geometry, present, size + 0.5 * search.spare_reach)
    owner = np.where(owns_first(size, first, second), first, second)
    width, _ = rows_of_entries(_number_of_each((first, second), len(size)), dimension)
    slots, further, most, cell, across = 0, 0, 0, 1, 1
    for number in range(int(slab.max(initial=0)) + 1):
        own = slab == number
        listed = own[first] | own[second]
        ends = first[listed], second[listed]
        degree = _number_of_each(ends, len(size))
        here = own | (degree > 0)
        slots = max(slots, int(_number_of_each((owner[listed],), len(size)).max(initial=0)))
        most, further = max(most, len(ends[0])), max(further, further_rows(degree[here], width))
        held = occupancy(levels, geometry, tuple(x[here] for x in present), size[here], radius, rows)
        cell, across = max(cell, held[0]), max(across, held[1])
    slots = max(math.ceil(EXTRA_CAPACITY * slots), USUAL_SLOTS[dimension])
    return Room(slots, max(math.ceil(EXTRA_PAIRS * most), pairs) + 1, cell, rows=RowRoom(width, further, across))


def _number_of_each(ends: tuple[np.ndarray, ...], count: int) -> Any:
    """(N,) how often each of N particles is among the ends."""
    return np.bincount(np.concatenate(ends), minlength=count)
