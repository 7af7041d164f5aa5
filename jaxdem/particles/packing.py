"""Where particles start: polygon, lattice and random packs, and the check that nothing overlaps. Host, numpy."""

from __future__ import annotations

import itertools

import numpy as np
from scipy.spatial import cKDTree

from jaxdem.particles import regions
from jaxdem.particles.regions import Region, into_period

Seed = int | list[int]
"""Of random numbers: one number, or several."""


def hexagonal_rows(start: np.ndarray, stop: np.ndarray, spacing: float) -> np.ndarray:
    """Centres of a hexagonal lattice that fills a rectangle in rows from below, lowest row first.

    Args:
        start: (2,) lower corner available to centres [m].
        stop: (2,) upper corner [m].
        spacing: distance of neighbours [m].

    Returns:
        (M, 2) centres.
    """
    rows = int(np.floor((stop[1] - start[1]) / (spacing * np.sqrt(0.75)) + 1e-9)) + 1
    points = []
    for row in range(max(rows, 0)):
        first = start[0] + 0.5 * spacing * (row % 2)
        count = int(np.floor((stop[0] - first) / spacing + 1e-9)) + 1
        if count > 0:
            x = first + spacing * np.arange(count)
            points.append(np.stack([x, np.full(count, start[1] + row * spacing * np.sqrt(0.75))], axis=1))
    return np.concatenate(points) if points else np.zeros((0, 2))


def polygon_pack(
    vertices: np.ndarray, box: tuple[float, ...], radius: float, spacing: float, jitter: float
) -> np.ndarray:
    """Centres that fill a polygon of the x-vertical plane, in rows from below.

    In 3-D the polygon is extruded: equal layers fill the second axis, one behind the other, evenly spaced.

    Args:
        vertices: (V, 2) corners (x, vertical) [m].
        box: side lengths of the domain [m].
        radius: of the (largest) particle [m].
        spacing: distance of neighbours [m].
        jitter: room that each centre keeps for a random displacement [m].

    Returns:
        (M, D) centres, lowest first.
    """
    margin = radius + jitter
    start, stop = vertices.min(axis=0) + margin, vertices.max(axis=0) - margin
    area = regions.polygon(vertices.tolist(), None)
    if len(box) == 2:
        points = hexagonal_rows(start, stop, spacing)
        return points[area.inside(points, margin)]
    layers = int(np.floor((box[1] - 2.0 * margin) / spacing + 1e-9)) + 1
    gap = (box[1] - 2.0 * margin) / max(layers - 1, 1)
    collected = []
    for layer in range(layers):
        points = hexagonal_rows(start, stop, spacing)
        points = points[area.inside(points, margin)]
        across = margin + layer * gap if layers > 1 else 0.5 * box[1]
        collected.append(np.insert(points, 1, across, axis=1))
    points = np.concatenate(collected) if collected else np.zeros((0, 3))
    return points[np.argsort(points[:, 2], kind="stable")]


def lattice_pack(region: Region, radius: float, spacing: float, jitter: float) -> np.ndarray:
    """Centres of a square or cubic lattice that fills a region, from the corner of its bounds, lowest first; (M, D)."""
    margin = radius + jitter
    axes = []
    for low, high in zip(*region.bounds, strict=True):
        count = int(np.floor((high - low - 2.0 * margin) / spacing + 1e-9)) + 1
        axes.append(low + margin + spacing * np.arange(max(count, 0)))
    grid = np.meshgrid(*axes, indexing="ij")
    points = np.stack([g.ravel() for g in grid], axis=1)
    points = points[region.inside(points, margin)]
    return points[np.argsort(points[:, -1], kind="stable")]


def jittered(points: np.ndarray, size: float, seed: Seed) -> np.ndarray:
    """Points displaced at random by at most `size` [m] in any direction."""
    if size == 0.0:
        return points
    generator = np.random.default_rng(seed)
    return points + generator.uniform(-size, size, points.shape) / np.sqrt(points.shape[1])


def deepest_overlap(
    position: np.ndarray,
    radius: np.ndarray,
    box: tuple[float, ...],
    periodic: tuple[bool, ...],
    some: np.ndarray | None = None,
    body: np.ndarray | None = None,
) -> tuple[float, int, int]:
    """The largest overlap of two particles over the smaller diameter, and which two; (0, -1, -1) for none.

    Args:
        position: (N, D) [m].
        radius: (N,) [m].
        box: side lengths [m].
        periodic: whether each axis is periodic.
        some: (N,) bool, particles of which at least one is in a pair; all if None.
        body: (N,) number of the body that each is a part of, within which there are no pairs.
    """
    if len(position) < 2:
        return 0.0, -1, -1
    shifted, size = position.copy(), np.zeros(len(box))
    for axis, wraps in enumerate(periodic):
        if wraps:
            shifted[:, axis] = into_period(shifted[:, axis], box[axis])
            size[axis] = box[axis]
    pairs = near_pairs(shifted, radius, size)
    pairs = pairs if some is None else pairs[some[pairs].any(axis=1)]
    pairs = pairs if body is None else pairs[body[pairs[:, 0]] != body[pairs[:, 1]]]
    if len(pairs) == 0:
        return 0.0, -1, -1
    separation = shifted[pairs[:, 0]] - shifted[pairs[:, 1]]
    for axis, wraps in enumerate(periodic):
        if wraps:
            separation[:, axis] -= box[axis] * np.round(separation[:, axis] / box[axis])
    a, b = radius[pairs[:, 0]], radius[pairs[:, 1]]
    overlap = (a + b - np.linalg.norm(separation, axis=1)) / (2.0 * np.minimum(a, b))
    worst = int(np.argmax(overlap))
    if overlap[worst] <= 0.0:
        return 0.0, -1, -1
    return float(overlap[worst]), int(pairs[worst, 0]), int(pairs[worst, 1])


def near_pairs(position: np.ndarray, radius: np.ndarray, box: np.ndarray) -> np.ndarray:
    """(P, 2) all pairs that may overlap; spheres within a factor of two in size are looked for together.

    With one reach for all, a few large spheres would put every small one beside hundreds of others.

    Args:
        position: (N, D), within the box along axes that are periodic [m].
        radius: (N,) [m].
        box: (D,) side lengths, zero along axes that are not periodic [m].
    """
    if len(radius) == 0:
        return np.zeros((0, 2), int)
    classes = np.floor(np.log2(radius / radius.min())).astype(int)
    members = [np.flatnonzero(classes == one) for one in np.unique(classes)]
    trees = [cKDTree(position[rows], boxsize=box) for rows in members]
    found = []
    for a, b in itertools.combinations_with_replacement(range(len(members)), 2):
        reach = radius[members[a]].max() + radius[members[b]].max()
        if a == b:
            near = trees[a].query_pairs(reach, output_type="ndarray")
            found.append(members[a][near])
        else:
            across = trees[a].sparse_distance_matrix(trees[b], reach, output_type="ndarray")
            found.append(np.stack((members[a][across["i"]], members[b][across["j"]]), axis=1))
    return np.concatenate(found)
