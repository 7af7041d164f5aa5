"""Friction of the fluid on surfaces within the mesh and exchange of scalars; see `cut_cells` and `cut_scalar`."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

from jax import Array

from jaxdem.fluid.grid import FaceField, Grid, along
from jaxdem.fluid.mesh import Ends, beyond
from jaxdem.fluid.open_faces import padded
from jaxdem.numerics.host import namespace

SHARPEST = 0.25
"""Curvature of a surface times the cell size, above which it counts for this much [-]."""


class Volumes(NamedTuple):
    """Control volumes and their distances from surfaces; arrays of NumPy or JAX.

    Attributes:
        open_part: of each [-].
        distance: d, mean over the open part, 0 of closed ones [m].
        whole: mean over the whole, negative in a wall [m].
        near: bool, whether a surface is in it or in a neighbour.
        links: by axis, of the lower and then the upper neighbour: the weight of the exchange with it [-], and whether
            that is closed.
    """

    open_part: Array
    distance: Array
    whole: Array
    near: Array
    links: tuple[tuple[tuple[Array, Array], tuple[Array, Array]], ...]


def friction_of(grid: Grid, open_faces: FaceField, distance: FaceField, whole: FaceField) -> FaceField:
    """R of every face next to a surface, see `cut_cells` [1/m2]; also for arrays of NumPy.

    Args:
        grid: the grid.
        open_faces: a.
        distance: mean over the open part of every face, 0 of closed ones [m].
        whole: mean over the whole of every face, negative in a wall [m].
    """
    result = []
    for which, (a, d, m) in enumerate(zip(open_faces, distance, whole, strict=True)):
        xp, links, near = namespace(a), [], a < 1.0
        for axis in range(grid.dimension):
            wide = padded(grid, open_faces, which, axis)
            beside = along(wide, axis, None, -2), along(wide, axis, 2, None)
            lower, upper = ((xp.minimum(a, b), b <= 0.0) for b in beside)
            links.append((lower, upper))
            near = near | (beside[0] < 1.0) | (beside[1] < 1.0)
        result.append(exchange_with_surface(grid, which, Volumes(a, d, m, near, tuple(links))))
    return tuple(result)


def exchange_of_cells(grid: Grid, open_faces: FaceField, open_cells: Array, distance: Array, whole: Array) -> Array:
    """R of every cell next to a surface, see `cut_scalar` [1/m2]; also for arrays of NumPy.

    Args:
        grid: the grid.
        open_faces: a.
        open_cells: v.
        distance: mean over the open part of every cell, 0 of closed ones [m].
        whole: mean over the whole of every cell, negative in a wall [m].
    """
    xp, links, cut = namespace(open_cells), [], open_cells < 1.0
    near = cut
    for axis, a in enumerate(open_faces):
        lower, upper = along(a, axis, None, -1), along(a, axis, 1, None)
        links.append(((lower, lower <= 0.0), (upper, upper <= 0.0)))
        none = xp.zeros_like(along(cut, axis, 0, 1))
        before, after = beyond(grid, axis, cut, (-1,), (0,), partial(_both, none))
        near = near | xp.concatenate((before, along(cut, axis, None, -1)), axis)
        near = near | xp.concatenate((along(cut, axis, 1, None), after), axis)
    return exchange_with_surface(grid, None, Volumes(open_cells, distance, whole, near, tuple(links)))


def _both(layer: Array) -> Ends:
    return layer, layer


def exchange_with_surface(grid: Grid, which: int | None, volumes: Volumes) -> Array:
    """R of control volumes, R d = sum b (d_n - d)/h^2 - a lap(d) with b the weights of the links [1/m2].

    It is at least 1/h^2 for each neighbour that is closed, which holds in gaps of few cells, where the distance has its
    ridge.

    Args:
        grid: the grid.
        which: axis of the faces whose volumes these are; None of cells.
        volumes: these.
    """
    a, d, m, near, links = volumes
    xp, bend = namespace(a), 0.0 * m
    total, least = xp.zeros_like(d), xp.zeros_like(d)
    for axis in range(grid.dimension):
        wide = _with_distance_beyond(grid, d, which, axis)
        for (weight, closed), ends in zip(links[axis], ((None, -2), (2, None)), strict=True):
            next_d = along(wide, axis, *ends)
            total = total + weight * (next_d - d) / grid.spacing[axis] ** 2
            least = least + xp.where(closed, a, 0.0) / grid.spacing[axis] ** 2
        wide = _with_distance_beyond(grid, m, which, axis)
        bend = bend + (along(wide, axis, 2, None) - 2.0 * m + along(wide, axis, None, -2)) / grid.spacing[axis] ** 2
    # A kink, where two surfaces meet, is no curvature.
    limit = SHARPEST / min(grid.spacing)
    total = total - a * xp.clip(bend, -limit, limit)
    has_distance = (a > 0.0) & (d > 0.0)
    friction = xp.maximum(total / xp.where(has_distance, d, 1.0), least)
    return xp.where(has_distance & near, friction, 0.0)


def _with_distance_beyond(grid: Grid, distance: Array, which: int | None, axis: int) -> Array:
    """Distances with one layer more on either end of an axis; beyond a side they go on linearly."""
    xp, shared = namespace(distance), int(which == axis)

    def outside() -> Ends:
        found = []
        for end, inner in (((0, 1), (1, 2)), ((-1, None), (-2, -1))):
            own, before = along(distance, axis, *end), along(distance, axis, *inner)
            if before.shape[axis] == 0:
                before = own
            found.append(2.0 * own - xp.where(before > 0.0, before, own))
        return found[0], found[1]

    ends = beyond(grid, axis, distance, (-1 - shared,), (shared,), outside)
    return xp.concatenate((ends[0], distance, ends[1]), axis)
