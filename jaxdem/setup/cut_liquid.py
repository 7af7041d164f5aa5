"""The liquid of two fluids in cells that walls cut: the volumes of the cells and their layers. Host, numpy."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from jaxdem.coupling.open_parts import corner_points, on_corners
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.cut_liquid import fraction_of_level
from jaxdem.fluid.grid import Grid, along
from jaxdem.setup.lent_capacity import lent_capacity
from jaxdem.solids.clipping import positive_part

LAYERS = 8
"""Of a cell, between whose ends the open volume below a height is linear."""

IN_WALL = 0.02
"""Part of an even layer that one within the wall has, see `fluid.cut_liquid` [-]."""

LENT = 0.25
"""Part of its volume that a cell lends to smaller ones [-]."""


def with_layers(grid: Grid, cut: CutCells, distances: Sequence[Callable[[np.ndarray], np.ndarray]]) -> CutCells:
    """The open parts of a mesh for two fluids: with the volumes that small cells have borrowed, and the layers.

    Args:
        grid: the grid.
        cut: the open parts, arrays of NumPy.
        distances: of the surfaces, points (..., D) [m] -> (...) [m], positive in the fluid.
    """
    nearest = np.min([distance(corner_points(grid)) for distance in distances], axis=0)
    corners = np.asarray(on_corners(grid, nearest))
    faces = tuple(np.asarray(a) for a in cut.open_faces)
    lent, _ = lent_capacity(grid, faces, np.asarray(cut.open_cells), LENT, least_volume(faces))
    return cut._replace(open_cells=cut.open_cells + lent, layers=layers_of(grid, corners, np.asarray(cut.open_cells)))  # type: ignore[arg-type]


def least_volume(faces: tuple[np.ndarray, ...]) -> np.ndarray:
    """Half of what may come into a cell through its open faces, of what may pass a whole one [-].

    As much goes out as comes in, and the largest face passes no more than all others: what comes in is at most the sum
    of these, and along each axis half of what both faces pass. A flow along a wall lets in half of that.

    Args:
        faces: open fractions.
    """
    ends = [(along(a, axis, None, -1), along(a, axis, 1, None)) for axis, a in enumerate(faces)]  # type: ignore[arg-type]
    all_faces = np.stack([np.asarray(a) for pair in ends for a in pair])
    others = np.sum(all_faces, axis=0) - np.max(all_faces, axis=0)
    through = np.max(np.stack([0.5 * (np.asarray(lower) + np.asarray(upper)) for lower, upper in ends]), axis=0)
    least: np.ndarray = 0.5 * np.minimum(others, through)
    return least


def layers_of(grid: Grid, corners: np.ndarray, open_cells: np.ndarray) -> np.ndarray:
    """(Q, cells) part of the open volume of every cell in each of its layers, from below; they add up to 1.

    Args:
        grid: the grid.
        corners: distance from the nearest surface at the corners, positive in the fluid [m].
        open_cells: open part of every cell.
    """
    last, axes = grid.dimension - 1, tuple(range(grid.dimension))
    below, above = along(corners, last, None, -1), along(corners, last, 1, None)  # type: ignore[arg-type]
    ends = [below + (k / LAYERS) * (above - below) for k in range(LAYERS + 1)]
    parts = []
    for lower, upper in zip(ends[:-1], ends[1:], strict=True):
        # Cells one by one: the corners between two of them along the last axis are not those of one mesh.
        stacked = np.stack([lower, upper], axis=-1)
        part = np.stack(
            [positive_part(stacked[..., k, :], axes).fraction[..., 0] for k in range(grid.cells[last])],  # type: ignore[arg-type]
            axis=-1,
        )
        parts.append(part)
    stacked_parts = np.stack(parts)
    found = np.maximum(stacked_parts, IN_WALL * np.mean(stacked_parts, axis=0))
    found = np.where(open_cells > 0.0, found, 1.0)
    shares: np.ndarray = found / np.sum(found, axis=0)
    return shares


def liquid_beside_walls(cut: CutCells, fraction: np.ndarray) -> np.ndarray:
    """The liquid's part of the open volume of every cell, of whose whole volume it fills `fraction` from below."""
    layers = np.asarray(cut.layers, float)
    found: np.ndarray = fraction_of_level(layers, np.asarray(fraction, float))  # type: ignore[arg-type,assignment]
    even = np.max(np.abs(layers - 1.0 / len(layers)), axis=0) < 1e-6
    return np.where(np.asarray(cut.open_cells) > 0.0, np.where(even, fraction, found), 0.0)
