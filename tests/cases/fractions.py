"""Exact parts of cells that discs and spheres fill, and errors of a surface that has moved."""

import numpy as np


def disc(cells, size, centre, radius):
    """Part of every cell within a disc, by the closed form of circular segments; a negative radius is an empty one."""
    x, y = (np.linspace(0.0, length, n + 1) - c for length, n, c in zip(size, cells, centre, strict=True))
    return _disc(x, y, radius) / (np.diff(x)[:, None] * np.diff(y)[None])


def sphere(cells, size, centre, radius, points=12):
    """Part of every cell within a sphere: discs, by Gauss's formula over the second axis."""
    x, y, z = (np.linspace(0.0, length, n + 1) - c for length, n, c in zip(size, cells, centre, strict=True))
    nodes, weights = np.polynomial.legendre.leggauss(points)
    result = np.zeros(cells)
    for j in range(cells[1]):
        for node, weight in zip(nodes, weights, strict=True):
            there = 0.5 * (y[j] + y[j + 1]) + 0.5 * (y[j + 1] - y[j]) * node
            if abs(there) < radius:
                result[:, j] += 0.5 * weight * _disc(x, z, np.sqrt(radius**2 - there**2))
    return result / (np.diff(x)[:, None, None] * np.diff(z)[None, None])


def _disc(x, y, radius):
    """Areas of a disc about the origin within the cells between the edges x and y."""

    def under(s):
        """Area between the upper arc and the line y = s >= 0 in every column."""
        half = np.sqrt(max(radius**2 - s**2, 0.0))
        edges = np.clip(x, -half, half)
        arc = 0.5 * (edges * np.sqrt(radius**2 - edges**2) + radius**2 * np.arcsin(edges / radius))
        return np.diff(arc) - s * np.diff(edges)

    whole = 2.0 * under(0.0)
    below = np.stack([whole - under(t) if t >= 0.0 else under(-t) for t in y], axis=1)
    return np.maximum(np.diff(below, axis=1), 0.0)  # of a rounding error of 1e-9 where an arc touches an edge
