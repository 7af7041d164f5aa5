"""From signed distances of surfaces to the open parts of the mesh of the fluid."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jax import Array
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from jaxdem.coupling.open_parts import corner_points, cut_cells, open_faces_of_cells
from jaxdem.coupling.surface_velocity import with_velocity
from jaxdem.errors import required
from jaxdem.fluid.boundary import Boundary, open_fraction
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.grid import FaceField, Grid, along
from jaxdem.numerics.placement import Placement


class FluidSurface(NamedTuple):
    """A surface that the fluid sees.

    Attributes:
        distance: points (..., D) [m] -> (...) [m], positive in the fluid.
        no_slip: whether the fluid sticks to it; else it slips freely.
        placed: how it moves; None for one at rest.
    """

    distance: Callable[[np.ndarray], np.ndarray]
    no_slip: bool = True
    placed: Placement | None = None


def cut_cells_of(
    grid: Grid, surfaces: Sequence[FluidSurface], boundary: Boundary | None = None, coupled: bool = False
) -> tuple[CutCells, int]:
    """The open parts of a mesh between surfaces where they are, and the number of cells left out. Host.

    Fluid in a pocket without a way out is at rest but for what drags it along. Beside particles, whose kernels may
    reach through a thin wall, it could not take up a change of their volume: such pockets are left out.

    Args:
        grid: the grid.
        surfaces: that the fluid sees.
        boundary: sides of the box; None where pockets are not looked for.
        coupled: whether there are particles too.
    """
    corners, enclosed = corner_points(grid), 0

    def pockets(open_part: FaceField, cells: Array) -> Array:
        nonlocal enclosed
        left_out = without_a_way_out(grid, required(boundary, "sides of the box"), open_part, np.asarray(cells))
        # Solid cells have no way out either, but they have no fluid: they are no pockets.
        has_fluid = np.asarray(open_faces_of_cells(grid, open_part)) > 0.0
        enclosed = int(np.sum(left_out & has_fluid))
        return left_out  # type: ignore[return-value]

    distances = [surface.distance(corners) for surface in surfaces]
    sticks = [surface.no_slip for surface in surfaces]
    found = cut_cells(grid, distances, sticks, pockets if coupled and boundary is not None else None)  # type: ignore[arg-type]
    if any(surface.placed is not None for surface in surfaces):
        found = with_velocity(grid, found, distances, [surface.placed for surface in surfaces])  # type: ignore[arg-type]
    return found, enclosed


def without_a_way_out(grid: Grid, boundary: Boundary, open_part: FaceField, cells: np.ndarray) -> np.ndarray:
    """The cells that are not connected with an outlet; in a box without one, with the largest space."""
    space, kept = spaces_of(grid, boundary, open_part)
    if not kept:
        kept = {int(np.argmax(np.bincount(space.ravel(), np.ravel(cells))))}
    return ~np.isin(space, list(kept))


def spaces_of(grid: Grid, boundary: Boundary, open_part: FaceField) -> tuple[np.ndarray, set[int]]:
    """The number of the space that every cell is in, and the spaces that an outlet of the box reaches."""
    count = math.prod(grid.cells)
    number = np.arange(count).reshape(grid.cells)
    pairs = []
    for axis, a in enumerate(open_part):
        last = grid.cells[axis] - (0 if grid.periodic[axis] else 1)
        place = (*(slice(None),) * axis, slice(0, last))
        joined = (np.asarray(along(a, axis, 1, None)) > 0.0)[place]
        pairs.append(np.stack([number[place][joined], np.roll(number, -1, axis)[place][joined]]))
    edges = np.concatenate(pairs, axis=1)
    matrix = csr_matrix((np.ones(edges.shape[1]), tuple(edges)), shape=(count, count))
    space = connected_components(matrix, directed=False)[1].reshape(grid.cells)
    reached = set()
    for side in boundary.sides:
        if side.condition.sets_pressure:
            place = (*(slice(None),) * side.axis, slice(-1, None) if side.upper else slice(0, 1))
            faces = np.asarray(open_part[side.axis])[place]
            is_open = (np.broadcast_to(open_fraction(grid, side), faces.shape) > 0.0) & (faces > 0.0)
            reached |= set(space[place][is_open].tolist())
    return space, reached
