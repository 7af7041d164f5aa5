"""Conservative remapping of fields to a coarser grid of the same box, of NumPy and of JAX arrays.

Cell averages are weighted by the lengths of overlap, axis by axis. A flux through a coarse face is summed
over its area; where the face lies between two fine ones it is interpolated linearly, which is what a
uniform divergence inside the fine cell gives: so the divergence of a coarse cell is the mean of that of
the fine cells it covers, to round-off, for any ratio of the grids.
"""

from __future__ import annotations

import dataclasses
from typing import TypeVar

import numpy as np
from jax import Array

from jaxdem.fluid.grid import Grid
from jaxdem.numerics.products import along_axis

Field = TypeVar("Field", np.ndarray, Array)


def coarsened(grid: Grid, factor: int) -> Grid:
    """The grid with `factor` times fewer cells per axis, rounded to whole cells, at least one."""
    return dataclasses.replace(grid, cells=tuple(max(1, round(count / factor)) for count in grid.cells))


def remap_cells(fine: Grid, coarse: Grid, field: Field) -> Field:
    """Mean of a cell field over the cells of a coarser grid.

    Args:
        fine: grid of `field`.
        coarse: grid of the same box.
        field: shape `fine.cells`.
    """
    for axis in range(fine.dimension):
        field = _apply(_overlap_matrix(fine.cells[axis], coarse.cells[axis]), field, axis)
    return field


def remap_flux(fine: Grid, coarse: Grid, flux: tuple[Field, ...]) -> tuple[Field, ...]:
    """Mean flux through the faces of a coarser grid [m/s]; `flux` are D face arrays of the fine grid."""
    result = []
    for which, field in enumerate(flux):
        for axis in range(fine.dimension):
            counts = fine.cells[axis], coarse.cells[axis]
            matrix = _face_matrix(*counts) if axis == which else _overlap_matrix(*counts)
            field = _apply(matrix, field, axis)
        result.append(field)
    return tuple(result)


def _overlap_matrix(fine: int, coarse: int) -> np.ndarray:
    """(coarse, fine): part of each coarse cell that each fine cell covers."""
    fine_edges, coarse_edges = np.linspace(0.0, 1.0, fine + 1), np.linspace(0.0, 1.0, coarse + 1)
    low = np.maximum(coarse_edges[:-1, None], fine_edges[None, :-1])
    high = np.minimum(coarse_edges[1:, None], fine_edges[None, 1:])
    return np.maximum(high - low, 0.0) * coarse


def _face_matrix(fine: int, coarse: int) -> np.ndarray:
    """(coarse + 1, fine + 1): linear interpolation from fine faces to coarse faces."""
    position = np.arange(coarse + 1) * (fine / coarse)
    below = np.minimum(np.floor(position + 1e-9).astype(int), fine - 1)
    fraction = position - below
    matrix = np.zeros((coarse + 1, fine + 1))
    rows = np.arange(coarse + 1)
    matrix[rows, below] += 1.0 - fraction
    matrix[rows, below + 1] += fraction
    return matrix


def _apply(matrix: np.ndarray, field: Field, axis: int) -> Field:
    if isinstance(field, np.ndarray):
        return np.moveaxis(np.tensordot(matrix, field, axes=(1, axis)), 0, axis)
    return along_axis(matrix, field, axis)
