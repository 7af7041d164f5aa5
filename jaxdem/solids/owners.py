"""To which cell of a surface its edges, its corners and its images across periodic sides belong. Host, numpy."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from scipy.spatial import KDTree

from jaxdem.solids.features import Features
from jaxdem.solids.surface_mesh import SurfaceMesh


def owners(
    mesh: SurfaceMesh, whole: SurfaceMesh, features: Features, box: Sequence[float], periodic: Sequence[bool]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(F,), (E,) and (C,) int, the cell of `mesh` that every face, edge and corner of `features` belongs to.

    An edge and a corner belong to one of the cells that meet there.

    Args:
        mesh: the surface.
        whole: with its images across periodic sides, from which the features are made.
        features: of it.
        box: side lengths [m].
        periodic: whether each axis is periodic.
    """
    cell = _originals(mesh, whole, box, periodic)
    corners = whole.corners.reshape(-1, whole.dimension)
    tree, edges = KDTree(corners), features.edges
    of_corners = np.zeros(0, int)
    if len(features.corners.anchor):
        of_corners = cell[tree.query(features.corners.anchor)[1] // whole.dimension]
    if not len(edges.anchor):
        return cell, np.zeros(0, int), of_corners
    # The sides of cells, by their middles: that of an edge is one of them.
    ways = whole.corners
    middles = np.concatenate([0.5 * (ways[:, k] + ways[:, (k + 1) % 3]) for k in range(3)])
    middle = edges.anchor + 0.5 * edges.length[:, None] * edges.along
    of_edges = KDTree(middles).query(middle)[1] % len(whole.cells)
    return cell, cell[of_edges], of_corners


def _originals(mesh: SurfaceMesh, whole: SurfaceMesh, box: Sequence[float], periodic: Sequence[bool]) -> np.ndarray:
    """(F,) int, the cell of the surface of which every cell of the whole is an image: that with the same middle."""
    if not any(periodic):
        return np.arange(len(mesh.cells))
    shifts = itertools.product(*((-1, 0, 1) if wraps else (0,) for wraps in periodic))
    middle = mesh.corners.mean(axis=1)
    images = np.concatenate([middle + np.asarray(shift) * np.asarray(box) for shift in shifts])
    found: np.ndarray = KDTree(images).query(whole.corners.mean(axis=1))[1] % len(middle)
    return found
