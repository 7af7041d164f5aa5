"""Which parts of a surface are near a point: bins, of which only those with something in them take memory.

Each part is put into all bins that it can be met from, so that a look into one bin finds all. Parts of about one size
share a level of bins that are as wide as they are, so that a large triangle has no more entries than a small one. A
level keeps its bins by a hash of their indices: bins that share a place share their entries, which the distance tells
apart. Host, numpy.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

LARGE = 4
"""A part is at most so many bins long."""

PRIMES = (73856093, 19349663, 83492791)
"""Multipliers of the hash, after M. Teschner et al., Optimized spatial hashing, Proc. VMV (2003) 47-54."""


class Level(NamedTuple):
    """Bins of one width.

    Attributes:
        width: of a bin [m].
        start: (B + 1,) int32, where the entries of each place begin; B is a power of two.
        entry: (E,) int32, numbers of the parts.
    """

    width: float
    start: np.ndarray
    entry: np.ndarray


Planes = tuple[np.ndarray, np.ndarray]
"""Of flat parts: (P, D) a point [m], and (P, D) the unit normal."""


def levels_of(
    lower: np.ndarray,
    upper: np.ndarray,
    reach: float,
    margin: np.ndarray | float,
    planes: Planes | None = None,
    owner: np.ndarray | None = None,
) -> tuple[Level, ...]:
    """Bins of parts.

    Args:
        lower, upper: (P, D) corners of the box around each part [m].
        reach: distance from a part at which it must be found [m].
        margin: () or (P, D) the same from the box around it along each axis, where it need not be found all around.
        planes: in which the parts lie; None where they lie in none.
        owner: (P,) ascending, the part that each of these is a piece of; None where each is a part. All pieces of a
            part are in one level, so that it is found once.
    """
    if not len(lower):
        return ()
    size = (upper - lower).max(axis=1)
    if owner is not None:
        begin = np.flatnonzero(np.diff(owner, prepend=-1))
        size = np.repeat(np.maximum.reduceat(size, begin), np.diff(begin, append=len(owner)))
    level = np.ceil(np.log2(np.maximum(size / (LARGE * reach), 1.0))).astype(int)
    found = []
    for number in np.unique(level):
        own = np.flatnonzero(level == number)
        width = reach * 2.0 ** int(number)
        wide = np.broadcast_to(margin, lower.shape)[own]
        place, part = _entries(lower[own] - wide, upper[own] + wide, width)
        if planes is not None:
            # The box around a tilted plane is thick, the plane is not.
            anchor, normal = planes[0][own][part], planes[1][own][part]
            across = np.abs(np.einsum("ed,ed->e", (place + 0.5) * width - anchor, normal))
            near = across <= reach + 0.501 * width * np.abs(normal).sum(axis=1)
            place, part = place[near], part[near]
        occupied = len(np.unique(place, axis=0))
        count = 2 ** int(np.ceil(np.log2(max(2 * occupied, 2))))
        key = hashed(tuple(place[:, k].astype(np.int32) for k in range(place.shape[1])), count)
        number_of = own[part] if owner is None else owner[own[part]]
        pairs = np.unique(np.stack([key.astype(np.int64), number_of], axis=1), axis=0)
        start = np.concatenate([[0], np.cumsum(np.bincount(pairs[:, 0], minlength=count))])
        found.append(Level(width, start.astype(np.int32), pairs[:, 1].astype(np.int32)))
    return tuple(found)


def hashed(place: tuple[np.ndarray, ...], count: int) -> np.ndarray:
    """Where a bin is kept.

    Args:
        place: D arrays of int32, indices of the bins.
        count: B, a power of two.
    """
    total = np.zeros_like(place[0], dtype=np.uint32)
    for index, prime in zip(place, PRIMES, strict=False):
        total = total ^ (index.astype(np.uint32) * np.uint32(prime))
    return (total & np.uint32(count - 1)).astype(np.int32)


def _entries(lower: np.ndarray, upper: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
    """(E, D) indices of the bins that boxes touch, and (E,) the number of the box."""
    border = 1e-3 * width  # a point on the border of two bins may be counted to either
    first = np.floor((lower - border) / width).astype(np.int64)
    many = np.floor((upper + border) / width).astype(np.int64) - first + 1
    total = many.prod(axis=1)
    part = np.repeat(np.arange(len(lower)), total)
    rest = np.arange(len(part)) - np.repeat(np.cumsum(total) - total, total)
    place = np.empty((len(part), lower.shape[1]), np.int64)
    for axis in reversed(range(lower.shape[1])):
        place[:, axis] = first[part, axis] + rest % many[part, axis]
        rest = rest // many[part, axis]
    return place, part
