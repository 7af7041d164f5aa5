"""Exact parts of cells that discs, spheres and half-spaces fill, and errors of a surface that has moved."""

import jax.numpy as jnp
import numpy as np

from jaxdem.fluid.plane_cut import volume_below


def disc(cells, size, centre, radius):
    """Part of every cell within a disc, by the closed form of circular segments."""
    x, y = (np.linspace(0.0, length, n + 1) - c for length, n, c in zip(size, cells, centre, strict=True))
    return _discs(x, y, np.array([radius]))[0] / (np.diff(x)[:, None] * np.diff(y)[None])


def sphere(cells, size, centre, radius, points=12):
    """Part of every cell within a sphere: discs, by Gauss's formula of so many points over a cell's second axis."""
    x, y, z = (np.linspace(0.0, length, n + 1) - c for length, n, c in zip(size, cells, centre, strict=True))
    nodes, weights = np.polynomial.legendre.leggauss(points)
    places = 0.5 * (y[1:] + y[:-1])[:, None] + 0.5 * np.diff(y)[:, None] * nodes[None]
    slices = _discs(x, z, np.sqrt(np.maximum(radius**2 - places**2, 0.0)).ravel())
    mean = np.einsum("jkxz,k->xjz", slices.reshape(*places.shape, *slices.shape[1:]), 0.5 * weights)
    return mean / (np.diff(x)[:, None, None] * np.diff(z)[None, None])


def half_space(grid, up, through):
    """Part of every cell below the plane through a point; `up` is its normal."""
    normal = np.asarray(up) * np.asarray(grid.spacing)
    size = np.abs(normal).sum()
    middles = np.meshgrid(
        *((np.arange(n) + 0.5) * h for n, h in zip(grid.cells, grid.spacing, strict=True)), indexing="ij"
    )
    depth = sum(u * (p - m) for u, p, m in zip(up, through, middles, strict=True))
    sizes = tuple(jnp.full(grid.cells, abs(n) / size) for n in normal)
    return np.asarray(volume_below(sizes, jnp.asarray(depth / size + 0.5)))


def _discs(x, y, radii):
    """(K, ., .) areas of K discs about the origin within the cells between the edges x and y."""

    def under(s):
        """(K, .) areas between the upper arcs and the line y = s >= 0 in every column."""
        half = np.sqrt(np.maximum(radii**2 - s**2, 0.0))[:, None]
        edges = np.clip(x[None], -half, half)
        chord = np.sqrt(np.maximum(radii[:, None] ** 2 - edges**2, 0.0))
        arc = 0.5 * (edges * chord + radii[:, None] ** 2 * np.arctan2(edges, chord))
        return np.diff(arc) - s * np.diff(edges)

    whole = 2.0 * under(0.0)
    below = np.stack([whole - under(t) if t >= 0.0 else under(-t) for t in y], axis=-1)
    return np.maximum(np.diff(below, axis=-1), 0.0)  # of a rounding error of 1e-9 where an arc touches an edge
