"""From signed distances of surfaces to the open parts of the mesh of the fluid; arrays of NumPy or JAX."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import DTypeLike

from jaxdem.errors import required
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.cut_friction import friction_of
from jaxdem.fluid.grid import FaceField, Grid, along
from jaxdem.fluid.mesh import end_faces
from jaxdem.fluid.open_faces import LEAST_OPEN, links_of
from jaxdem.numerics.host import namespace
from jaxdem.numerics.vectors import Vector
from jaxdem.solids.clipping import positive_part

ON_SURFACE = 1e-9
"""A corner nearer to a surface than this part of a cell is on it [-]."""

DEAD_ENDS = 2
"""Faces one behind the other that are closed where nothing can flow."""


def corner_points(grid: Grid) -> np.ndarray:
    """(n + 1, m + 1, ..., D) corners of the cells [m]."""
    return _points(grid, _numbers(grid, None))


def face_points(grid: Grid, axis: int) -> np.ndarray:
    """(..., D) middles of the faces of an axis [m]."""
    return _points(grid, _numbers(grid, axis))


def places_in_box(grid: Grid, axis: int | None, dtype: DTypeLike) -> Vector:
    """D arrays of `face_points`, or without an axis of `corner_points`; of a slab where it lies in the box [m]."""
    numbers, cut = _numbers(grid, axis), grid.blocks
    if cut is None:
        points: Any = _points(grid, numbers).astype(dtype)
        return tuple(points[..., k] for k in range(grid.dimension))
    # Whole numbers before they are multiplied: both slabs have the same places on their border, bit for bit.
    begin = (cut.index() * grid.cells[cut.axis]).astype(dtype)
    own = [jnp.asarray(k, dtype) + begin if a == cut.axis else jnp.asarray(k, dtype) for a, k in enumerate(numbers)]
    return tuple(jnp.meshgrid(*(k * h for k, h in zip(own, grid.spacing, strict=True)), indexing="ij"))


def _numbers(grid: Grid, axis: int | None) -> list[np.ndarray]:
    return [np.arange(n + 1.0) if axis in (None, a) else np.arange(n) + 0.5 for a, n in enumerate(grid.cells)]


def _points(grid: Grid, numbers: Sequence[np.ndarray]) -> np.ndarray:
    return np.stack(np.meshgrid(*(k * h for k, h in zip(numbers, grid.spacing, strict=True)), indexing="ij"), axis=-1)


class _Faces(NamedTuple):
    """Lists by axis of what is known of the faces."""

    open_part: list[Array]
    distance: list[Array]
    nearest: list[Array]

    def close(self, axis: int, closed: Array) -> None:
        """Closes some faces of an axis."""
        xp = namespace(closed)
        self.open_part[axis] = xp.where(closed, 0.0, self.open_part[axis])
        self.distance[axis] = xp.where(closed, 0.0, self.distance[axis])


def cut_cells(
    grid: Grid,
    distances: Sequence[Array],
    no_slip: Sequence[bool] | Array,
    leave_out: Callable[[FaceField, Array], Array] | None = None,
) -> CutCells:
    """The open parts of a mesh between surfaces at rest, from distances on its corners.

    With arrays of JAX it is differentiable by the distances where no face or cell opens or closes.

    Args:
        grid: the grid.
        distances: of every surface, at the corners (n + 1, m + 1, ...), positive in the fluid [m].
        no_slip: of every surface; else it slips freely.
        leave_out: on the host, from the open parts of faces and cells to the cells whose faces are closed too.
    """
    xp, axes = namespace(distances[0]), tuple(range(grid.dimension))
    stacked = xp.stack([on_corners(grid, d) for d in distances])
    nearest = xp.min(stacked, axis=0)
    faces = _Faces([], [], [])
    for axis in axes:
        others = tuple(a for a in axes if a != axis)
        part = positive_part(nearest, others)
        is_open = part.fraction >= LEAST_OPEN
        faces.open_part.append(xp.where(is_open, part.fraction, 0.0))
        faces.distance.append(xp.where(is_open, part.integral / xp.where(is_open, part.fraction, 1.0), 0.0))
        faces.nearest.append(_nearest(stacked, others))
    cells = positive_part(nearest, axes).fraction
    _close_dead_ends(grid, faces, cells)
    if leave_out is not None:
        _close_around(grid, faces, leave_out(tuple(faces.open_part), cells))
    sticks, friction = xp.asarray(no_slip), []
    whole = tuple(mean_of_corners(nearest, tuple(a for a in axes if a != axis)) for axis in axes)
    rough = friction_of(grid, tuple(faces.open_part), tuple(faces.distance), whole)
    for label, r in zip(faces.nearest, rough, strict=True):
        friction.append(xp.where(sticks[label], r, 0.0))
    has_open = open_faces_of_cells(grid, faces.open_part) > 0.0
    still = tuple(xp.zeros_like(a) for a in faces.open_part)
    return CutCells(
        tuple(faces.open_part), xp.where(has_open, cells, 0.0), links_of(grid, tuple(faces.open_part)),
        tuple(friction), still, tuple(faces.nearest), _nearest(stacked, axes),
    )  # fmt: skip


def on_corners(grid: Grid, distance: Array) -> Array:
    """A distance at the corners, zero where it is rounding [m]."""
    return namespace(distance).where(abs(distance) < ON_SURFACE * min(grid.spacing), 0.0, distance)


def open_faces_of_cells(grid: Grid, open_faces: Sequence[Array]) -> Array:
    """Number of open faces of every cell."""
    count = None
    for axis, a in enumerate(open_faces):
        is_open = (a > 0.0).astype(a.dtype)
        both = along(is_open, axis, None, -1) + along(is_open, axis, 1, None)
        count = both if count is None else count + both
    return required(count, "axes of the grid")


def _close_dead_ends(grid: Grid, faces: _Faces, cells: Array) -> None:
    """Closes the only open face of cells that are more solid than open: nothing flows through it.

    Left open, it would hold the fluid at rest before a surface that moves along itself.
    """
    for _ in range(DEAD_ENDS):
        _close_around(grid, faces, (open_faces_of_cells(grid, faces.open_part) <= 1.0) & (cells < 0.5))


def _close_around(grid: Grid, faces: _Faces, cells: Array) -> None:
    """Closes all faces of some cells."""
    xp = namespace(cells)
    for axis in range(grid.dimension):
        inner = along(cells, axis, None, -1) | along(cells, axis, 1, None)
        ends = end_faces(grid, axis, cells, lambda below, above: below | above, lambda first, last: (first, last))
        faces.close(axis, xp.concatenate((ends[0], inner, ends[1]), axis))


def mean_of_corners(corners: Array, axes: tuple[int, ...]) -> Array:
    """Means over the corners along some axes: of a value at the corners, those of edges, faces or cells."""
    for axis in axes:
        corners = 0.5 * (along(corners, axis, None, -1) + along(corners, axis, 1, None))
    return corners


def _nearest(stacked: Array, axes: tuple[int, ...]) -> Array:
    """Number of the surface with the least mean distance from the corners of a face or cell."""
    for axis in axes:
        stacked = 0.5 * (along(stacked, 1 + axis, None, -1) + along(stacked, 1 + axis, 1, None))
    return namespace(stacked).argmin(stacked, axis=0).astype(np.int32)
