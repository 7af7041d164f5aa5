"""The surfaces that the fluid sees: from signed distances to the open parts of its mesh."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jax import Array

from jaxdem.fluid.cut_cells import LEAST_OPEN, CutCells, friction_of
from jaxdem.fluid.grid import FaceField, Grid, along
from jaxdem.numerics.host import namespace
from jaxdem.solids.clipping import positive_part

ON_SURFACE = 1e-9
"""A corner nearer to a surface than this part of a cell is on it [-]."""

DEAD_ENDS = 2
"""Faces one behind the other that are closed where nothing can flow."""

Velocity = Callable[[np.ndarray], np.ndarray]


class FluidSurface(NamedTuple):
    """A surface that the fluid sees.

    Attributes:
        distance: points (..., D) [m] -> (...) [m], positive in the fluid.
        no_slip: whether the fluid sticks to it; else it slips freely.
        velocity: points (..., D) [m] -> (..., D) of the surface [m/s]; None for one at rest.
    """

    distance: Callable[[np.ndarray], np.ndarray]
    no_slip: bool = True
    velocity: Velocity | None = None


def corner_points(grid: Grid) -> np.ndarray:
    """(n + 1, m + 1, ..., D) corners of the cells [m]."""
    return _points(grid, [np.arange(n + 1.0) for n in grid.cells])


def face_points(grid: Grid, axis: int) -> np.ndarray:
    """(..., D) middles of the faces of an axis [m]."""
    return _points(grid, [np.arange(n + 1.0) if a == axis else np.arange(n) + 0.5 for a, n in enumerate(grid.cells)])


def _points(grid: Grid, numbers: Sequence[np.ndarray]) -> np.ndarray:
    return np.stack(np.meshgrid(*(k * h for k, h in zip(numbers, grid.spacing, strict=True)), indexing="ij"), axis=-1)


def cut_cells(
    grid: Grid, distances: Sequence[Array], no_slip: Sequence[bool], velocity: FaceField | None = None
) -> CutCells:
    """The open parts of a mesh, from distances on its corners; of NumPy's arrays or JAX's.

    Args:
        grid: the grid.
        distances: of every surface, at the corners (n + 1, m + 1, ...), positive in the fluid [m].
        no_slip: of every surface; else it slips freely.
        velocity: of the nearest surface, on the faces; None for surfaces at rest [m/s].
    """
    xp, axes = namespace(distances[0]), tuple(range(grid.dimension))
    tiny = ON_SURFACE * min(grid.spacing)
    stacked = xp.stack([xp.where(abs(d) < tiny, 0.0 * d, d) for d in distances])
    nearest = xp.min(stacked, axis=0)
    faces, mean, labels = [], [], []
    sticks = xp.asarray(no_slip)
    for axis in axes:
        others = tuple(a for a in axes if a != axis)
        part = positive_part(nearest, others)
        is_open = part.fraction >= LEAST_OPEN
        faces.append(xp.where(is_open, part.fraction, 0.0))
        mean.append(xp.where(is_open, part.integral / xp.where(is_open, part.fraction, 1.0), 0.0))
        labels.append(_nearest(stacked, others))
    _close_dead_ends(grid, faces, mean, positive_part(nearest, axes).fraction)
    friction = tuple(
        xp.where(sticks[label], r, 0.0)
        for label, r in zip(labels, friction_of(grid, tuple(faces), tuple(mean)), strict=True)
    )
    has_open = xp.zeros(grid.cells, bool)
    for axis, a in enumerate(faces):
        has_open = has_open | (along(a, axis, None, -1) > 0.0) | (along(a, axis, 1, None) > 0.0)
    cells = xp.where(has_open, positive_part(nearest, axes).fraction, 0.0)
    still = tuple(xp.zeros_like(a) for a in faces) if velocity is None else velocity
    return CutCells(tuple(faces), cells, friction, still, tuple(labels), _nearest(stacked, axes))


def _close_dead_ends(grid: Grid, faces: list[Array], mean: list[Array], cells: Array) -> None:
    """Closes the only open face of cells that are more solid than open: nothing flows through it.

    Left open, it would hold the fluid at rest before a surface that moves along itself.
    """
    xp = namespace(cells)
    for _ in range(DEAD_ENDS):
        count = xp.zeros_like(cells)
        for axis, a in enumerate(faces):
            is_open = (a > 0.0).astype(cells.dtype)
            count = count + along(is_open, axis, None, -1) + along(is_open, axis, 1, None)
        dead = (count <= 1.0) & (cells < 0.5)
        for axis in range(grid.dimension):
            seam = along(dead, axis, 0, 1), along(dead, axis, -1, None)
            if grid.periodic[axis]:
                both = seam[0] | seam[1]
                seam = both, both
            above = xp.concatenate((dead, seam[1]), axis)
            closed = above | xp.concatenate((seam[0], dead), axis)
            faces[axis] = xp.where(closed, 0.0, faces[axis])
            mean[axis] = xp.where(closed, 0.0, mean[axis])


def _nearest(stacked: Array, axes: tuple[int, ...]) -> Array:
    """Number of the surface with the least mean distance from the corners of a face or cell."""
    for axis in axes:
        stacked = 0.5 * (along(stacked, 1 + axis, None, -1) + along(stacked, 1 + axis, 1, None))
    return namespace(stacked).argmin(stacked, axis=0).astype(np.int32)


def cut_cells_of(grid: Grid, surfaces: Sequence[FluidSurface]) -> CutCells:
    """The open parts of a mesh between surfaces at rest, or that move along themselves; on the host."""
    corners = corner_points(grid)
    distances = [surface.distance(corners) for surface in surfaces]
    found = cut_cells(grid, distances, [surface.no_slip for surface in surfaces])
    if all(surface.velocity is None for surface in surfaces):
        return found
    velocity = []
    for axis, (label, like) in enumerate(zip(found.nearest_to_faces, found.velocity, strict=True)):
        points, own = face_points(grid, axis), np.zeros(like.shape)
        for k, surface in enumerate(surfaces):
            if surface.velocity is not None:
                own = np.where(np.asarray(label) == k, surface.velocity(points)[..., axis], own)
        velocity.append(own)
    return found._replace(velocity=tuple(velocity))  # type: ignore[arg-type]
