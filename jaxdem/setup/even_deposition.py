"""Weights of cells beside walls that the fluid sees: grains that stand evenly shall give an even solid fraction.

The weights w of a particle are those of the kernel times a factor of each cell, v, over their sum. With v = 1 a kernel
that a wall cuts would leave the cells at the wall with too little and those behind them with too much. Sought are
factors with which an even cloud of points in the fluid gives every cell what its open part holds,

    sum_p w_pc / (sum_c' w_pc' v_c') = points of a whole cell / v_c    with v_c = (open part) b_c,

by turns: the sums over the cells of a point, and those over the points of a cell.

Source of the turns: R. Sinkhorn, Ann. Math. Stat. 35 (1964) 876-879.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.ndimage import binary_dilation

from jaxdem.coupling.deposition import Centre, Deposition, OwnKernel
from jaxdem.errors import InputError
from jaxdem.fluid.grid import Grid

TURNS = 30
POINTS = {2: 4, 3: 2}
"""Along each side of a cell, by dimension."""

MOST_ENTRIES = 1e8
"""Products of points and cells that the memory has room for; beyond, a cell has one point."""


def even_factors(
    grid: Grid,
    deposition: Deposition,
    open_cells: np.ndarray,
    distance: Callable[[np.ndarray], np.ndarray],
    radius: float,
) -> np.ndarray:
    """b of every cell, 1 far from walls [-]. Host side.

    Args:
        grid: the grid.
        deposition: of the particles.
        open_cells: open part of every cell.
        distance: points (..., D) [m] -> (...) [m], positive in the fluid.
        radius: of the largest particle [m].

    Raises:
        InputError: grains have kernels of different widths, and each would need factors of its own.
    """
    if isinstance(deposition, OwnKernel):
        limit = "beside walls that the fluid sees, where cells have one factor for the kernel of all grains"
        remedy = 'set it to "largest", or coupling.void_fraction = "divided" or "diffusion"'
        raise InputError("coupling.kernel_diameter", "own", limit, remedy)
    factors = np.ones(grid.cells)
    if isinstance(deposition, Centre):
        return factors
    reach = [math.ceil(half / h) + 1 for half, h in zip(deposition.half_width, grid.spacing, strict=True)]
    near = _dilated(grid, open_cells < 1.0, reach)
    cells = np.argwhere(_dilated(grid, near, reach))
    entries = len(cells) * POINTS[grid.dimension] ** grid.dimension * math.prod(2 * r for r in reach)
    points = _points(grid, cells, POINTS[grid.dimension] if entries < MOST_ENTRIES else 1)
    whole = len(points) / len(cells)
    points = points[distance(points) > 0.0]
    weights = deposition.weights(grid, points, np.asarray(radius))  # type: ignore[arg-type]
    index, weight = np.asarray(weights.index), np.asarray(weights.weight) * open_cells.ravel()[weights.index]
    flat, counted = factors.ravel(), (near & (open_cells > 0.0)).ravel()
    for _ in range(TURNS):
        sums = np.sum(weight * flat[index], axis=1, keepdims=True)
        shares = weight / np.where(sums > 0.0, sums, 1.0)
        given = np.bincount(index.ravel(), shares.ravel(), flat.size) / whole
        wanted = open_cells.ravel() / np.where(given > 0.0, given, 1.0)
        flat = np.where(counted & (given > 0.0), wanted, flat)
    return flat.reshape(grid.cells)


def _dilated(grid: Grid, cells: np.ndarray, reach: list[int]) -> np.ndarray:
    """The cells and those up to so many beside them along each axis."""
    for axis, (count, wraps) in enumerate(zip(reach, grid.periodic, strict=True)):
        width = [(count, count) if a == axis else (0, 0) for a in range(grid.dimension)]
        wide = np.pad(cells, width, mode="wrap") if wraps else np.pad(cells, width, mode="constant")
        shape = [2 * count + 1 if a == axis else 1 for a in range(grid.dimension)]
        grown = binary_dilation(wide, np.ones(shape, bool))
        cells = grown[tuple(slice(count, -count) if a == axis else slice(None) for a in range(grid.dimension))]
    return cells


def _points(grid: Grid, cells: np.ndarray, count: int) -> np.ndarray:
    """Points that stand evenly in some cells [m]."""
    steps = (np.arange(count) + 0.5) / count
    offsets = np.stack([x.ravel() for x in np.meshgrid(*[steps] * grid.dimension, indexing="ij")], axis=-1)
    places: np.ndarray = (cells[:, None] + offsets[None]) * np.asarray(grid.spacing)
    return places.reshape(-1, grid.dimension)
