"""Which cells of a surface share which edges: its connectivity, made once. Host, numpy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jaxdem.solids.surface_mesh import SurfaceMesh


class Edges(NamedTuple):
    """Edges of a surface in 3-D, its points in 2-D: where cells meet.

    Attributes:
        ends: (E, D - 1) numbers of the corners of each edge, ascending.
        start: (E + 1,) where the sides of each edge begin in the next two.
        cell: (S,) the cell of each side.
        opposite: (S,) which corner of that cell is not on the edge: 0 to D - 1.
        forward: (S,) whether the cell goes along the edge from its lower to its higher corner; in 2-D, whether its
            second point is this one.
    """

    ends: np.ndarray
    start: np.ndarray
    cell: np.ndarray
    opposite: np.ndarray
    forward: np.ndarray

    @property
    def cells(self) -> np.ndarray:
        """(E,) number of cells that meet at each edge: 1 at a hole, 2 within a surface."""
        return np.diff(self.start)

    @property
    def between_two(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The edges of exactly two cells; and (I,) number of their first and second side."""
        edge = np.flatnonzero(self.cells == 2)
        return edge, self.start[edge], self.start[edge] + 1


def edges_of(mesh: SurfaceMesh) -> Edges:
    """The edges of a surface whose corners are welded."""
    cells, dimension = mesh.cells, mesh.dimension
    opposite = np.repeat(np.arange(dimension), len(cells))
    cell = np.tile(np.arange(len(cells)), dimension)
    if dimension == 2:
        ends = np.concatenate([cells[:, 1], cells[:, 0]])[:, None]
        forward = opposite == 0
    else:
        ways = np.concatenate([cells[:, [(k + 1) % 3, (k + 2) % 3]] for k in range(3)])
        ends, forward = np.sort(ways, axis=1), ways[:, 0] < ways[:, 1]
    unique, number = np.unique(ends, axis=0, return_inverse=True)
    number = number.reshape(-1)
    order = np.argsort(number, kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(number, minlength=len(unique)))])
    return Edges(unique, start, cell[order], opposite[order], forward[order])
