"""The neighbour list against all pairs, by numpy."""

from __future__ import annotations

import numpy as np

from tests.cases.registry import Figure, at_least, below, case
from tests.cases.worlds import world


def pairs_within(position, reach, box, periodic):
    """Set of (i, j), i != j, nearer than `reach`, a number or (N, N); by brute force."""
    difference = position[:, None] - position[None]
    for axis, wraps in enumerate(periodic):
        if wraps:
            difference[..., axis] -= box[axis] * np.round(difference[..., axis] / box[axis])
    near = np.linalg.norm(difference, axis=2) < reach
    return {(int(i), int(j)) for i, j in zip(*np.nonzero(near), strict=True) if i != j}


def listed_pairs(neighbors):
    index = np.stack([np.asarray(row) for row in neighbors.index])
    pairs = [(i, int(j)) for slot in index for i, j in enumerate(slot) if i != j]
    return pairs


def entries_of(neighbors):
    """How many entries are not what the slot's index says: the pair of the two, from the side of the particle."""
    first, second = np.asarray(neighbors.pairs.first), np.asarray(neighbors.pairs.second)
    room, wrong = len(first), 0
    for others, entries in zip(np.asarray(neighbors.index), np.asarray(neighbors.pairs.entry), strict=True):
        for i, (j, entry) in enumerate(zip(others.tolist(), entries.tolist(), strict=True)):
            p, side = entry % room, entry // room
            if i == j:
                wrong += entry != room - 1
            else:
                wrong += (first[p], second[p]) != ((i, j) if side == 0 else (j, i))
    return wrong


COUNT = 120
"""Points in a box."""

BOXES = {
    "square": ((0.4, 0.3), (False, False)),
    "periodic across": ((0.4, 0.3), (True, False)),
    "periodic both": ((0.4, 0.3), (True, True)),
    "slab under three cutoffs": ((0.4, 0.03), (False, False)),
    "cube": ((0.15, 0.15, 0.15), (False, False, False)),
    "slab across, periodic along": ((0.4, 0.03, 0.2), (True, False, False)),
}


@case(
    "neighbour list against all pairs", "invariance", "all pairs by numpy",
    fast={"names": ("periodic across", "slab under three cutoffs", "slab across, periodic along")},
)  # fmt: skip
def list_is_all_pairs(names: tuple[str, ...] = tuple(BOXES)) -> list[Figure]:
    """Every pair whose gap is below the skin stands in the list once from either side, and no other; random points.

    With separations (nearest image) and overlaps at the build as numpy has them, to the round-off of a subtraction
    of numbers up to 0.4. A corner, the opposite one, and a place beyond a periodic side are among the points.
    """
    figures = []
    for number, (name, (box, periodic)) in enumerate(BOXES.items()):
        if name not in names:
            continue
        generator = np.random.default_rng(len(name))
        position = generator.uniform(0, 1, (COUNT, len(box))) * np.array(box)
        position[0], position[1] = 0.0, np.array(box)
        # Beyond a periodic side by a hair, as a moving particle is: never wrapped by the solver.
        position[2] = np.where(periodic, np.array(box) * 1.02, position[2])
        sizes = np.full(COUNT, 0.01) if number % 2 == 0 else generator.uniform(0.001, 0.01, COUNT)
        scene = world(position, radius=0.01 if number % 2 == 0 else sizes, box=box, periodic=periodic)
        neighbors, largest = scene.neighbors, np.max(sizes)
        listed = listed_pairs(neighbors)
        reach = np.add.outer(sizes, sizes) + 0.2 * 2 * largest
        expected = pairs_within(position, reach, box, periodic)
        pairs = neighbors.pairs
        first, second = np.asarray(pairs.first), np.asarray(pairs.second)
        full = first != second
        difference = position[first] - position[second]
        for axis, wraps in enumerate(periodic):
            if wraps:
                difference[:, axis] -= box[axis] * np.round(difference[:, axis] / box[axis])
        ours = np.stack([np.asarray(x) for x in neighbors.separation], 1)
        overlap = np.asarray(neighbors.overlap)
        exact = sizes[first] + sizes[second] - np.linalg.norm(difference, axis=1)
        errors = [np.abs(ours - difference)[full], np.abs(overlap - exact)[full], [0.0]]
        distance = max(np.max(e, initial=0.0) for e in errors)
        touching_empty = np.count_nonzero(overlap[~full] >= -largest)
        once = list(zip(first[full].tolist(), second[full].tolist(), strict=True))
        found = entries_of(neighbors)
        figures += [
            at_least(f"{name}: pairs", 50, len(expected)),
            below(f"{name}: pairs missed or too many", len(expected ^ set(listed)), 0.0),
            below(f"{name}: pairs twice", len(listed) - len(set(listed)), 0.0),
            below(
                f"{name}: pairs of the flat list off",
                len({p for p in expected if p[0] < p[1]} ^ set(once)),
                0.0,
            ),
            below(f"{name}: pairs of the flat list twice", len(once) - len(set(once)), 0.0),
            below(f"{name}: entries of a particle that lead elsewhere", found, 0.0),
            below(f"{name}: overflow", float(neighbors.overflow), 0.0),
            below(f"{name}: separation and overlap", distance, 2e-16, "m"),
            below(f"{name}: empty slots that might touch", touching_empty, 0.0),
        ]
    return figures
