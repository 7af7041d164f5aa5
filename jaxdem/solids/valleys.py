"""How many faces of a surface a sphere touches at once, and how much they face one way. Host, numpy, float64."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from jaxdem.solids.surface_mesh import SurfaceMesh

SAME = 1e-9
"""Sum of cos^2 above 1 that counts as rounding [-]."""


class Valley(NamedTuple):
    """Contacts of a sphere with faces that meet at a point.

    Attributes:
        number: of them, at most.
        along: largest sum of cos^2 between their normals and a line: 1 of walls at right angles, 2 of two that face
            nearly the same way [-].
    """

    number: int
    along: float

    @property
    def lopsided(self) -> float:
        """What |sum of the normals| is at most: the sum of all products of two is below number times along [-]."""
        return math.sqrt(self.number * self.along)


def valley_of(mesh: SurfaceMesh, normal: np.ndarray, patch: np.ndarray) -> Valley | None:
    """The most faces, and the most that face one way, among those that meet at a point; None where they are at right
    angles everywhere.

    Faces of a smooth patch are one contact. Points that stick out count too: a sphere may lie at the other side.

    Args:
        mesh: the surface.
        normal: (F, D) of its cells.
        patch: (F,) number of the smooth patch of each.
    """
    cells, dimension = mesh.cells, mesh.dimension
    point, owner = cells.ravel(), np.repeat(np.arange(len(cells)), dimension)
    _, first = np.unique(point * (int(patch.max(initial=0)) + 1) + patch[owner], return_index=True)
    point, way = point[first], normal[owner[first]]
    total = np.zeros((len(mesh.points), dimension, dimension))
    np.add.at(total, point, way[:, :, None] * way[:, None, :])
    along = np.linalg.eigvalsh(total)[:, -1]
    steep = along > 1.0 + SAME
    if not steep.any():
        return None
    number = np.bincount(point, minlength=len(mesh.points))
    return Valley(int(number[steep].max()), float(along.max()))
