"""Friction of the fluid on surfaces within the mesh, see `cut_cells`."""

from __future__ import annotations

from jax import Array

from jaxdem.fluid.grid import FaceField, Grid, along
from jaxdem.fluid.open_faces import padded
from jaxdem.numerics.host import namespace

SHARPEST = 0.25
"""Curvature of a surface times the cell size, above which it counts for this much [-]."""


def friction_of(grid: Grid, open_faces: FaceField, distance: FaceField, whole: FaceField) -> FaceField:
    """R of every face next to a surface, see `cut_cells` [1/m2]; also for arrays of NumPy.

    It is at least 1/h^2 for each neighbour that is closed, which holds in gaps of few cells, where the distance has its
    ridge.

    Args:
        grid: the grid.
        open_faces: a.
        distance: mean over the open part of every face, 0 of closed ones [m].
        whole: mean over the whole of every face, negative in a wall [m].
    """
    result = []
    for which, (a, d, m) in enumerate(zip(open_faces, distance, whole, strict=True)):
        xp, bend = namespace(a), 0.0 * m
        total, least, near = xp.zeros_like(d), xp.zeros_like(d), a < 1.0
        for axis in range(grid.dimension):
            beside, wide = padded(grid, open_faces, which, axis), _with_distance_beyond(grid, d, which, axis)
            for upper in (False, True):
                ends = (2, None) if upper else (None, -2)
                next_a, next_d = along(beside, axis, *ends), along(wide, axis, *ends)
                total = total + xp.minimum(a, next_a) * (next_d - d) / grid.spacing[axis] ** 2
                least = least + xp.where(next_a <= 0.0, a, 0.0) / grid.spacing[axis] ** 2
                near = near | (next_a < 1.0)
            wide = _with_distance_beyond(grid, m, which, axis)
            bend = bend + (along(wide, axis, 2, None) - 2.0 * m + along(wide, axis, None, -2)) / grid.spacing[axis] ** 2
        # A kink, where two surfaces meet, is no curvature.
        limit = SHARPEST / min(grid.spacing)
        total = total - a * xp.clip(bend, -limit, limit)
        has_distance = (a > 0.0) & (d > 0.0)
        friction = xp.maximum(total / xp.where(has_distance, d, 1.0), least)
        result.append(xp.where(has_distance & near, friction, 0.0))
    return tuple(result)


def _with_distance_beyond(grid: Grid, distance: Array, which: int, axis: int) -> Array:
    """Distances with one layer more on either end of an axis; beyond a side they go on linearly."""
    xp, count = namespace(distance), grid.cells[axis]
    if grid.periodic[axis]:
        first = 1 if which == axis else 0
        ends = along(distance, axis, count - 1, count), along(distance, axis, first, first + 1)
        return xp.concatenate((ends[0], distance, ends[1]), axis)
    beyond = []
    for end, inner in (((0, 1), (1, 2)), ((-1, None), (-2, -1))):
        own, before = along(distance, axis, *end), along(distance, axis, *inner)
        if before.shape[axis] == 0:
            before = own
        beyond.append(2.0 * own - xp.where(before > 0.0, before, own))
    return xp.concatenate((beyond[0], distance, beyond[1]), axis)
