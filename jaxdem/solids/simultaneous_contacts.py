"""How many walls a sphere touches at once, and how much they face one way. Host, numpy, float64."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from jaxdem.solids.edges import edges_of
from jaxdem.solids.surface_mesh import SurfaceMesh

SAME = 1e-9
"""Sum of cos^2 above 1, and cosine above 0, that count as rounding [-]."""

STEEPEST = 20.0
"""Distance of a centre from a concave edge over the radius, above which no sphere is taken to touch it [-]."""


class SimultaneousContacts(NamedTuple):
    """Contacts of a sphere with faces that meet at a point, or with walls that it touches at once.

    Attributes:
        number: of them, at most.
        along: largest sum of cos^2 between their normals and a line: 1 of walls at right angles, 2 of two that face
            nearly the same way or opposite ways [-].
        rank: dimensions that their normals span, at least.
    """

    number: int
    along: float
    rank: int = 1

    @property
    def lopsided(self) -> float:
        """What |sum of the normals| is at most: the sum of all products of two is below number times along [-]."""
        return math.sqrt(self.number * self.along)

    def within(self, other: SimultaneousContacts) -> bool:
        """Whether the other one is as bad in everything."""
        return self.number <= other.number and self.along <= other.along and self.rank >= other.rank


def worst_of(contacts: Iterable[SimultaneousContacts]) -> tuple[SimultaneousContacts, ...]:
    """Those that no other one is as bad as."""
    found: list[SimultaneousContacts] = []
    for one in sorted(set(contacts), reverse=True):
        if not any(one.within(other) for other in found):
            found = [other for other in found if not other.within(one)] + [one]
    return tuple(found)


def simultaneous_contacts_of(mesh: SurfaceMesh, normal: np.ndarray, patch: np.ndarray) -> SimultaneousContacts | None:
    """The most faces, and the most that face one way, among those that meet at a point; None where they are at right
    angles everywhere.

    Faces of a smooth patch are one contact. Points that stick out count too: a sphere may lie at the other side.

    Args:
        mesh: the surface.
        normal: (F, D) of its cells.
        patch: (F,) number of the smooth patch of each.
    """
    owner = np.repeat(np.arange(len(mesh.cells)), mesh.dimension)
    around = faces_at(mesh.cells.ravel(), owner, normal, patch, len(mesh.points))
    along = np.linalg.eigvalsh(around.total)[:, -1]
    steep = along > 1.0 + SAME
    if not steep.any():
        return None
    return SimultaneousContacts(int(around.number[steep].max()), float(along.max()))


class FacesAt(NamedTuple):
    """The faces at each of P places, one of each smooth patch.

    Attributes:
        number: (P,) of them.
        total: (P, D, D) sum of n n^T.
        summed: (P, D) sum of n.
    """

    number: np.ndarray
    total: np.ndarray
    summed: np.ndarray


def faces_at(place: np.ndarray, owner: np.ndarray, normal: np.ndarray, patch: np.ndarray, count: int) -> FacesAt:
    """The faces at each of `count` places.

    Args:
        place, owner: (Q,) numbers of a place and of a cell there.
        normal, patch: see `simultaneous_contacts_of`.
        count: number of places.
    """
    _, first = np.unique(place * (int(patch.max(initial=0)) + 1) + patch[owner], return_index=True)
    place, way = place[first], normal[owner[first]]
    dimension = normal.shape[1]
    total, summed = np.zeros((count, dimension, dimension)), np.zeros((count, dimension))
    np.add.at(total, place, way[:, :, None] * way[:, None, :])
    np.add.at(summed, place, way)
    return FacesAt(np.bincount(place, minlength=count), total, summed)


class Piece(NamedTuple):
    """Faces, edges or corners of a mesh, E of them, and the faces that a sphere touches there.

    Attributes:
        corners: (E, K, D) of each, K = 3, 2 or 1 [m].
        centre: (E, D) from there to the centre of a sphere of radius 1 that touches all faces in front [-].
        faces: there.
    """

    corners: np.ndarray
    centre: np.ndarray
    faces: FacesAt


def pieces_of(mesh: SurfaceMesh, normal: np.ndarray, patch: np.ndarray) -> tuple[Piece, ...]:
    """Faces of a mesh, and edges and corners at which smooth patches meet; see `simultaneous_contacts_of`."""
    one = FacesAt(np.ones(len(normal), int), normal[:, :, None] * normal[:, None, :], normal)
    found, edges = [Piece(mesh.corners, normal, one)], edges_of(mesh)
    owner = np.repeat(np.arange(len(mesh.cells)), mesh.dimension)
    places = [(mesh.points[:, None], mesh.cells.ravel(), owner)]
    if mesh.dimension == 3:
        number = np.repeat(np.arange(len(edges.ends)), edges.cells)
        places.append((mesh.points[edges.ends], number, edges.cell))
    for corners, place, cell in places:
        faces = faces_at(place, cell, normal, patch, len(corners))
        several = np.flatnonzero(faces.number > 1)
        faces = FacesAt(*(column[several] for column in faces))
        centre = np.einsum("pde,pe->pd", np.linalg.pinv(faces.total, hermitian=True), faces.summed)
        fits = np.linalg.norm(centre, axis=1) < STEEPEST
        found.append(Piece(corners[several[fits]], centre[fits], FacesAt(*(column[fits] for column in faces))))
    return tuple(found)


def joined_sets(touched: np.ndarray, joined: np.ndarray) -> list[np.ndarray]:
    """The sets into which walls that are touched at once fall, if those of one set are at right angles to the others.

    Args:
        touched: (n,) bool.
        joined: (n, n) bool, pairs that are not at right angles.
    """
    left, found = set(np.flatnonzero(touched).tolist()), []
    while left:
        own, new = set(), {left.pop()}
        while new:
            own |= new
            new = {j for i in new for j in left if joined[i, j]}
            left -= new
        found.append(np.array(sorted(own)))
    return found


def simultaneous_contacts_among(normal: np.ndarray) -> SimultaneousContacts | None:
    """Of walls with these normals (n, D), touched at once; None if they are at right angles."""
    along = float(np.linalg.eigvalsh(normal.T @ normal)[-1])
    if along <= 1.0 + SAME:
        return None
    return SimultaneousContacts(len(normal), along, int(np.linalg.matrix_rank(normal, tol=1e-6)))
