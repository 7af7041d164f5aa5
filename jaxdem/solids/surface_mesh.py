"""A surface made of triangles in 3-D, or of straight segments in 2-D. Host, numpy, float64."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

WELD = 2e-7
"""Corners nearer to each other than this part of the mesh's extent are one corner: what float32 rounds in files [-]."""


@dataclasses.dataclass(frozen=True)
class SurfaceMesh:
    """Cells of a surface, triangles in 3-D and segments in 2-D, and their corners.

    Attributes:
        points: (V, D) corners [m].
        cells: (F, D) their numbers. The front of a triangle is where its corners appear counter-clockwise; that of a
            segment is to the right of the way from its first to its second point.
    """

    points: np.ndarray
    cells: np.ndarray

    @property
    def dimension(self) -> int:
        """D."""
        return int(self.points.shape[1])

    @property
    def corners(self) -> np.ndarray:
        """(F, D, D) corners of every cell [m]."""
        found: np.ndarray = self.points[self.cells]
        return found

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """(D,) lowest and highest coordinates of its cells [m]."""
        used = self.points[np.unique(self.cells)]
        return used.min(axis=0), used.max(axis=0)

    @property
    def extent(self) -> float:
        """Longest side of the box around it [m]."""
        lower, upper = self.bounds
        return float((upper - lower).max())

    @property
    def area_vectors(self) -> np.ndarray:
        """(F, D) normals towards the front, as long as the cell is large [m2], in 2-D [m]."""
        corners = self.corners
        along = corners[:, 1] - corners[:, 0]
        if self.dimension == 2:
            return np.stack([along[:, 1], -along[:, 0]], axis=1)
        return 0.5 * np.cross(along, corners[:, 2] - corners[:, 0])

    @property
    def area(self) -> float:
        """Of all cells [m2], in 2-D the length [m]."""
        return float(np.linalg.norm(self.area_vectors, axis=1).sum())

    def flipped(self) -> SurfaceMesh:
        """With front and back exchanged."""
        return SurfaceMesh(self.points, self.cells[:, ::-1])

    def placed(self, scale: float, rotation: np.ndarray, shift: Sequence[float] | np.ndarray) -> SurfaceMesh:
        """Scaled, then turned about the origin, then shifted [m]: x -> rotation (scale x) + shift."""
        return SurfaceMesh(scale * self.points @ rotation.T + np.asarray(shift), self.cells)

    def only(self, kept: np.ndarray) -> SurfaceMesh:
        """With these of its cells."""
        return SurfaceMesh(self.points, self.cells[kept])

    def welded(self, tolerance: float = WELD) -> SurfaceMesh:
        """With one corner where several are: cells that share an edge then name the same corners.

        Args:
            tolerance: over the extent, up to which corners are one [-].
        """
        points, inverse = np.unique(self.points, axis=0, return_inverse=True)
        cells = inverse.reshape(-1)[self.cells]
        pairs = KDTree(points).query_pairs(tolerance * self.extent, output_type="ndarray")
        if len(pairs):
            ones = np.ones(len(pairs))
            graph = coo_matrix((ones, (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points)))
            _, group = connected_components(graph, directed=False)
            first = np.unique(group, return_index=True)[1]
            points, cells = points[first], group[cells]
        return SurfaceMesh(points, cells)

    def repeated(self, box: Sequence[float], periodic: Sequence[bool], reach: float) -> SurfaceMesh:
        """With its images across the periodic sides that are within reach of the box, and as one surface with them.

        Args:
            box: side lengths [m].
            periodic: whether each axis is periodic.
            reach: how far beyond the box cells count [m].
        """
        mesh = self
        for axis, (length, wraps) in enumerate(zip(box, periodic, strict=True)):
            if not wraps:
                continue
            shifts = np.zeros((3, mesh.dimension))
            shifts[:, axis] = (0.0, -length, length)
            count = len(mesh.points)
            points = np.concatenate([mesh.points + shift for shift in shifts])
            cells = np.concatenate([mesh.cells + k * count for k in range(3)])
            along = points[cells][..., axis]
            near = (along.max(axis=1) >= -reach) & (along.min(axis=1) <= length + reach)
            mesh = SurfaceMesh(points, cells[near]).welded()
            same = np.sort(mesh.cells, axis=1)
            mesh = mesh.only(np.sort(np.unique(same, axis=0, return_index=True)[1]))
        return mesh


def rotation_of(angles: Sequence[float] | None, dimension: int) -> np.ndarray:
    """(D, D) of angles about x, y and z in this order, in 2-D of one angle [degrees]."""
    found = np.eye(dimension)
    for axis, angle in enumerate(angles or ()):
        c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
        first, second = (0, 1) if dimension == 2 else [(1, 2), (2, 0), (0, 1)][axis]
        turn = np.eye(dimension)
        turn[[first, second, first, second], [first, second, second, first]] = c, c, -s, s
        found = turn @ found
    return found
