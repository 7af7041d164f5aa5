"""Open fractions of faces: beyond the sides of the box, and fields continued from open faces to closed ones."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.grid import FaceField, Grid, along
from jaxdem.numerics.host import namespace

LEAST_OPEN = 0.01
"""Open fraction under which a face is closed [-]."""


def continued(open_faces: FaceField, faces: FaceField) -> FaceField:
    """A face field whose closed faces have the mean of the open ones next to them along their axis, or zero."""
    found = []
    for axis, (a, f) in enumerate(zip(open_faces, faces, strict=True)):
        is_open = (a > 0.0).astype(f.dtype)
        f = jnp.where(a > 0.0, f, 0.0)
        weight = next_to(is_open, axis)
        mean = next_to(f, axis) / jnp.where(weight > 0.0, weight, 1.0)
        found.append(jnp.where(a > 0.0, f, mean))
    return tuple(found)


def next_to(faces: Array, axis: int) -> Array:
    """Sum of the two neighbours along an axis, zero beyond the ends."""
    nothing = jnp.zeros_like(along(faces, axis, 0, 1))
    before = jnp.concatenate((nothing, along(faces, axis, None, -1)), axis)
    return before + jnp.concatenate((along(faces, axis, 1, None), nothing), axis)


def padded(grid: Grid, open_faces: FaceField, which: int, axis: int) -> Array:
    """Open fractions of component `which` with one layer more on either end of an axis; beyond a side what is open of
    it."""
    faces, count = open_faces[which], grid.cells[axis]
    xp = namespace(faces)
    if not grid.periodic[axis]:
        ends = _open_side(grid, open_faces, which, axis, False), _open_side(grid, open_faces, which, axis, True)
    elif which == axis:
        ends = along(faces, axis, count - 1, count), along(faces, axis, 1, 2)
    else:
        ends = along(faces, axis, count - 1, count), along(faces, axis, 0, 1)
    return xp.concatenate((ends[0], faces, ends[1]), axis)


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
    first, last = along(side, which, 0, 1), along(side, which, -1, None)
    inner = 0.5 * (along(side, which, None, -1) + along(side, which, 1, None))
    if grid.periodic[which]:
        first = last = 0.5 * (first + last)
    return namespace(side).concatenate((first, inner, last), which)
