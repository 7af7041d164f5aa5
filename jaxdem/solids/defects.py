"""What is wrong with a mesh, with counts, and what can be mended. Host, numpy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components

from jaxdem.solids.edges import Edges, edges_of
from jaxdem.solids.surface_mesh import SurfaceMesh

FLAT = 1e-10
"""A triangle whose height is below this part of the mesh's extent has no normal [-]."""


class Defects(NamedTuple):
    """Counts of what may be wrong with a mesh.

    Attributes:
        degenerate: cells without a size: corners that coincide or lie on one line.
        duplicate: cells that have the corners of an earlier one.
        flipped: cells whose front is on the other side than that of most of their surface.
        open_edges: edges of one cell, at holes and rims; in 2-D, ends.
        crowded_edges: edges of more than two cells.
        pieces: surfaces that do not hang together.
    """

    degenerate: int
    duplicate: int
    flipped: int
    open_edges: int
    crowded_edges: int
    pieces: int

    @property
    def is_closed(self) -> bool:
        """Whether it has no hole."""
        return self.open_edges == 0


def defects_of(mesh: SurfaceMesh) -> Defects:
    """What is wrong with a mesh whose corners are welded."""
    degenerate, duplicate = _degenerate(mesh), _duplicate(mesh)
    sound = mesh.only(~degenerate & ~duplicate)
    if not len(sound.cells):
        return Defects(int(degenerate.sum()), int(duplicate.sum()), 0, 0, 0, 0)
    edges = edges_of(sound)
    flipped, pieces = _flipped(sound, edges)
    return Defects(
        degenerate=int(degenerate.sum()),
        duplicate=int(duplicate.sum()),
        flipped=int(flipped.sum()),
        open_edges=int((edges.cells == 1).sum()),
        crowded_edges=int((edges.cells > 2).sum()),
        pieces=pieces,
    )


def mended(mesh: SurfaceMesh) -> SurfaceMesh:
    """Without cells that have no size or that are there already, and with all fronts of a surface on one side.

    The side is that of most of its cells; of a closed surface it is the outside.
    """
    mesh = mesh.only(~_degenerate(mesh) & ~_duplicate(mesh))
    if not len(mesh.cells):
        return mesh
    edges = edges_of(mesh)
    turned, pieces = _flipped(mesh, edges)
    cells = np.where(turned[:, None], mesh.cells[:, ::-1], mesh.cells)
    if defects_of(SurfaceMesh(mesh.points, cells)).is_closed:
        label = _pieces(len(cells), edges)
        outwards = SurfaceMesh(mesh.points, cells)
        volume = np.einsum("fd,fd->f", outwards.area_vectors, outwards.corners.mean(axis=1) - mesh.points.mean(axis=0))
        inside_out = np.bincount(label, volume, minlength=pieces) < 0.0
        cells = np.where(inside_out[label][:, None], cells[:, ::-1], cells)
    return SurfaceMesh(mesh.points, cells)


def _degenerate(mesh: SurfaceMesh) -> np.ndarray:
    """(F,) bool."""
    corners = mesh.corners
    longest = np.max([np.linalg.norm(corners[:, k] - corners[:, k - 1], axis=1) for k in range(mesh.dimension)], axis=0)
    size = np.linalg.norm(mesh.area_vectors, axis=1)
    height = size if mesh.dimension == 2 else 2.0 * size / np.where(longest > 0.0, longest, 1.0)
    found: np.ndarray = height <= FLAT * mesh.extent
    return found


def _duplicate(mesh: SurfaceMesh) -> np.ndarray:
    """(F,) bool, all but the first of the cells with the same corners."""
    first = np.unique(np.sort(mesh.cells, axis=1), axis=0, return_index=True)[1]
    found = np.ones(len(mesh.cells), bool)
    found[first] = False
    return found


def _pieces(count: int, edges: Edges) -> np.ndarray:
    """(F,) number of the connected surface of each cell."""
    _, one, other = edges.between_two
    graph = coo_matrix((np.ones(len(one)), (edges.cell[one], edges.cell[other])), shape=(count, count))
    label: np.ndarray = connected_components(graph, directed=False)[1]
    return label


def _flipped(mesh: SurfaceMesh, edges: Edges) -> tuple[np.ndarray, int]:
    """(F,) bool, cells that look another way than most of their surface; and the number of surfaces."""
    count = len(mesh.cells)
    label = _pieces(count, edges)
    pieces = int(label.max()) + 1
    _, one, other = edges.between_two
    # Two cells look the same way where they go along their edge in opposite directions.
    differs = edges.forward[one] == edges.forward[other]
    if not differs.any():
        return np.zeros(count, bool), pieces
    a, b = edges.cell[one], edges.cell[other]
    graph = coo_matrix((np.ones(2 * len(a)), (np.r_[a, b], np.r_[b, a])), shape=(count, count)).tocsr()
    unlike = set(map(tuple, np.sort(np.stack([a, b], axis=1)[differs], axis=1).tolist()))
    parity = np.zeros(count, bool)
    for piece in np.unique(label[a[differs]]):
        order, before = breadth_first_order(graph, int(np.flatnonzero(label == piece)[0]), directed=False)
        for cell in order[1:].tolist():
            parent = int(before[cell])
            parity[cell] = parity[parent] ^ ((min(cell, parent), max(cell, parent)) in unlike)
        if 2 * parity[order].sum() > len(order):
            parity[order] = ~parity[order]
    return parity, pieces
