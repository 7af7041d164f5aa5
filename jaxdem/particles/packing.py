"""Where particles start: polygon and lattice packs, and the check that nothing overlaps. Host side, numpy."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree


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


def inside_polygon(points: np.ndarray, vertices: np.ndarray, margin: float) -> np.ndarray:
    """Which points (M, 2) lie inside a polygon (V, 2) and at least `margin` [m] from its edges."""
    inside = np.zeros(len(points), bool)
    distance = np.full(len(points), np.inf)
    for a, b in zip(vertices, np.roll(vertices, -1, axis=0), strict=True):
        crosses = (a[1] > points[:, 1]) != (b[1] > points[:, 1])
        rise = b[1] - a[1] if b[1] != a[1] else 1.0
        inside ^= crosses & (points[:, 0] < (b[0] - a[0]) * (points[:, 1] - a[1]) / rise + a[0])
        edge = b - a
        along = np.clip(((points - a) @ edge) / max(edge @ edge, 1e-300), 0.0, 1.0)
        distance = np.minimum(distance, np.linalg.norm(points - a - along[:, None] * edge, axis=1))
    return inside & (distance >= margin - 1e-12)


def polygon_pack(
    vertices: np.ndarray, box: tuple[float, ...], radius: float, spacing: float, jitter: float
) -> np.ndarray:
    """Centres that fill a polygon of the x-vertical plane, in rows from below.

    In 3-D the polygon is extruded: layers fill the second axis, each shifted against the last so that its
    spheres lie over the gaps of the one before.

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
    if len(box) == 2:
        points = hexagonal_rows(start, stop, spacing)
        return points[inside_polygon(points, vertices, margin)]
    layers = int(np.floor((box[1] - 2.0 * margin) / spacing + 1e-9)) + 1
    gap = (box[1] - 2.0 * margin) / max(layers - 1, 1)
    collected = []
    for layer in range(layers):
        points = hexagonal_rows(start, stop, spacing)
        points = points[inside_polygon(points, vertices, margin)]
        across = margin + layer * gap if layers > 1 else 0.5 * box[1]
        collected.append(np.insert(points, 1, across, axis=1))
    points = np.concatenate(collected) if collected else np.zeros((0, 3))
    return points[np.argsort(points[:, 2], kind="stable")]


def lattice_pack(
    start: np.ndarray, stop: np.ndarray, radius: float, spacing: float, jitter: float
) -> np.ndarray:
    """Centres of a square or cubic lattice in the box start ... stop (D,), lowest first; (M, D)."""
    margin = radius + jitter
    axes = []
    for low, high in zip(start, stop, strict=True):
        count = int(np.floor((high - low - 2.0 * margin) / spacing + 1e-9)) + 1
        axes.append(low + margin + spacing * np.arange(max(count, 0)))
    grid = np.meshgrid(*axes, indexing="ij")
    points = np.stack([g.ravel() for g in grid], axis=1)
    return points[np.argsort(points[:, -1], kind="stable")]


def jittered(points: np.ndarray, size: float, seed: int) -> np.ndarray:
    """Points displaced at random by at most `size` [m] in any direction."""
    if size == 0.0:
        return points
    generator = np.random.default_rng(seed)
    return points + generator.uniform(-size, size, points.shape) / np.sqrt(points.shape[1])


def deepest_overlap(
    position: np.ndarray, radius: np.ndarray, box: tuple[float, ...], periodic: tuple[bool, ...]
) -> tuple[float, int, int]:
    """The largest overlap of two particles over the smaller diameter, and which two; (0, -1, -1) for none.

    Args:
        position: (N, D) [m].
        radius: (N,) [m].
        box: side lengths [m].
        periodic: whether each axis is periodic.
    """
    if len(position) < 2:
        return 0.0, -1, -1
    shifted, size = position.copy(), np.zeros(len(box))
    for axis, wraps in enumerate(periodic):
        if wraps:
            shifted[:, axis] = np.mod(shifted[:, axis], box[axis])
            size[axis] = box[axis]
    pairs = cKDTree(shifted, boxsize=size).query_pairs(2.0 * radius.max(), output_type="ndarray")
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
