"""Open fractions of faces: beyond the sides of the box, and fields continued from open faces to closed ones."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.grid import FaceField, Grid, along
from jaxdem.fluid.mesh import Ends, beyond, end_faces
from jaxdem.numerics.host import namespace

LEAST_OPEN = 0.01
"""Open fraction under which a face is closed [-]."""


def continued(grid: Grid, open_faces: FaceField, faces: FaceField) -> FaceField:
    """A face field whose closed faces have the mean of the open ones next to them along their axis, or zero."""
    found = []
    for axis, (a, f) in enumerate(zip(open_faces, faces, strict=True)):
        is_open = (a > 0.0).astype(f.dtype)
        f = jnp.where(a > 0.0, f, 0.0)
        weight = next_to(grid, is_open, axis)
        mean = next_to(grid, f, axis) / jnp.where(weight > 0.0, weight, 1.0)
        found.append(jnp.where(a > 0.0, f, mean))
    return tuple(found)


def next_to(grid: Grid, values: Array, axis: int) -> Array:
    """Sum of the two neighbours along an axis, of cells or faces, zero beyond the sides of the box."""
    nothing = jnp.zeros_like(along(values, axis, 0, 1))
    # A face on a border or on a periodic side is stored twice: its neighbour is the one next to the other copy.
    shared = values.shape[axis] - grid.cells[axis]
    below, above = beyond(grid, axis, values, (-1 - shared,), (shared,), lambda: (nothing, nothing))
    before = jnp.concatenate((below, along(values, axis, None, -1)), axis)
    return before + jnp.concatenate((along(values, axis, 1, None), above), axis)


def padded(grid: Grid, open_faces: FaceField, which: int, axis: int) -> Array:
    """Open fractions of component `which` with one layer more on either end of an axis; beyond a side what is open of
    it."""
    faces = open_faces[which]

    def outside() -> Ends:
        return _open_side(grid, open_faces, which, axis, False), _open_side(grid, open_faces, which, axis, True)

    shared = int(which == axis)
    ends = beyond(grid, axis, faces, (-1 - shared,), (shared,), outside)
    return namespace(faces).concatenate((ends[0], faces, ends[1]), axis)


def links_of(grid: Grid, open_faces: FaceField) -> tuple[FaceField, ...]:
    """b = min(a, a_n) of the control volumes on either side of the surfaces between them, of every component and along
    every axis, with what is beyond the sides of the box: 0 where the lower one alone is open, -1 where the upper one
    alone is, or none."""
    found = []
    for which in range(grid.dimension):
        row = []
        for axis in range(grid.dimension):
            wide = padded(grid, open_faces, which, axis)
            below, above = along(wide, axis, None, -1), along(wide, axis, 1, None)
            xp = namespace(below)
            row.append(xp.where(below > 0.0, xp.minimum(below, above), -1.0).astype(below.dtype))
        found.append(tuple(row))
    return tuple(found)


def _open_side(grid: Grid, open_faces: FaceField, which: int, axis: int, upper: bool) -> Array:
    """What is open of a side of the box beside every face of a component."""
    side = along(open_faces[axis], axis, *((-1, None) if upper else (0, 1)))
    if which == axis:
        return side
    inner = 0.5 * (along(side, which, None, -1) + along(side, which, 1, None))
    ends = end_faces(grid, which, side, lambda below, above: 0.5 * (below + above), lambda first, last: (first, last))
    return namespace(side).concatenate((ends[0], inner, ends[1]), which)
