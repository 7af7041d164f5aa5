"""From signed distances of surfaces to the open parts of the mesh of the fluid."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jax import Array
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from jaxdem.errors import required
from jaxdem.fluid.boundary import Boundary, open_fraction
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
        spin: (A,) angular velocity [rad/s]; None for one that does not turn.
    """

    distance: Callable[[np.ndarray], np.ndarray]
    no_slip: bool = True
    velocity: Velocity | None = None
    spin: tuple[float, ...] | None = None


def corner_points(grid: Grid) -> np.ndarray:
    """(n + 1, m + 1, ..., D) corners of the cells [m]."""
    return _points(grid, [np.arange(n + 1.0) for n in grid.cells])


def face_points(grid: Grid, axis: int) -> np.ndarray:
    """(..., D) middles of the faces of an axis [m]."""
    return _points(grid, [np.arange(n + 1.0) if a == axis else np.arange(n) + 0.5 for a, n in enumerate(grid.cells)])


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
    no_slip: Sequence[bool],
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
    tiny = ON_SURFACE * min(grid.spacing)
    stacked = xp.stack([xp.where(abs(d) < tiny, 0.0, d) for d in distances])
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
    whole = tuple(_mean_of_corners(nearest, tuple(a for a in axes if a != axis)) for axis in axes)
    rough = friction_of(grid, tuple(faces.open_part), tuple(faces.distance), whole)
    for label, r in zip(faces.nearest, rough, strict=True):
        friction.append(xp.where(sticks[label], r, 0.0))
    has_open = _open_faces_of_cells(grid, faces) > 0.0
    still = tuple(xp.zeros_like(a) for a in faces.open_part)
    return CutCells(
        tuple(faces.open_part), xp.where(has_open, cells, 0.0), tuple(friction), still, tuple(faces.nearest),
        _nearest(stacked, axes),
    )  # fmt: skip


def _open_faces_of_cells(grid: Grid, faces: _Faces) -> Array:
    """Number of open faces of every cell."""
    count = None
    for axis, a in enumerate(faces.open_part):
        is_open = (a > 0.0).astype(a.dtype)
        both = along(is_open, axis, None, -1) + along(is_open, axis, 1, None)
        count = both if count is None else count + both
    return required(count, "axes of the grid")


def _close_dead_ends(grid: Grid, faces: _Faces, cells: Array) -> None:
    """Closes the only open face of cells that are more solid than open: nothing flows through it.

    Left open, it would hold the fluid at rest before a surface that moves along itself.
    """
    for _ in range(DEAD_ENDS):
        _close_around(grid, faces, (_open_faces_of_cells(grid, faces) <= 1.0) & (cells < 0.5))


def _close_around(grid: Grid, faces: _Faces, cells: Array) -> None:
    """Closes all faces of some cells."""
    xp = namespace(cells)
    for axis in range(grid.dimension):
        first, last = along(cells, axis, 0, 1), along(cells, axis, -1, None)
        if grid.periodic[axis]:
            first = last = first | last
        closed = xp.concatenate((cells, last), axis) | xp.concatenate((first, cells), axis)
        faces.close(axis, closed)


def _mean_of_corners(corners: Array, axes: tuple[int, ...]) -> Array:
    for axis in axes:
        corners = 0.5 * (along(corners, axis, None, -1) + along(corners, axis, 1, None))
    return corners


def _nearest(stacked: Array, axes: tuple[int, ...]) -> Array:
    """Number of the surface with the least mean distance from the corners of a face or cell."""
    for axis in axes:
        stacked = 0.5 * (along(stacked, 1 + axis, None, -1) + along(stacked, 1 + axis, 1, None))
    return namespace(stacked).argmin(stacked, axis=0).astype(np.int32)


def cut_cells_of(
    grid: Grid, surfaces: Sequence[FluidSurface], boundary: Boundary | None = None, coupled: bool = False
) -> tuple[CutCells, int]:
    """The open parts of a mesh between surfaces at rest, or that move along themselves; and the cells left out. Host.

    Fluid in a pocket without a way out is at rest but for what drags it along. Beside particles, whose kernels may
    reach through a thin wall, it could not take up a change of their volume: such pockets are left out.

    Args:
        grid: the grid.
        surfaces: that the fluid sees.
        boundary: sides of the box; None where pockets are not looked for.
        coupled: whether there are particles too.
    """
    corners, enclosed = corner_points(grid), 0

    def pockets(open_part: FaceField, cells: Array) -> Array:
        nonlocal enclosed
        left_out = _without_a_way_out(grid, required(boundary, "sides of the box"), open_part, np.asarray(cells))
        # Solid cells have no way out either, but they have no fluid: they are no pockets.
        has_fluid = np.asarray(_open_faces_of_cells(grid, _Faces(list(open_part), [], []))) > 0.0
        enclosed = int(np.sum(left_out & has_fluid))
        return left_out  # type: ignore[return-value]

    distances = [surface.distance(corners) for surface in surfaces]
    sticks = [surface.no_slip for surface in surfaces]
    found = cut_cells(grid, distances, sticks, pockets if coupled and boundary is not None else None)  # type: ignore[arg-type]
    if any(surface.velocity is not None for surface in surfaces):
        found = _with_velocity(grid, surfaces, found)
    return found, enclosed


def _with_velocity(grid: Grid, surfaces: Sequence[FluidSurface], cut: CutCells) -> CutCells:
    velocity, turning = [], 1 if grid.dimension == 2 else 3
    for axis, (label, like) in enumerate(zip(cut.nearest_to_faces, cut.velocity, strict=True)):
        points, own = face_points(grid, axis), np.zeros(like.shape)
        for k, surface in enumerate(surfaces):
            if surface.velocity is not None:
                on_surface = _foot(surface, points, grid)
                own = np.where(np.asarray(label) == k, surface.velocity(on_surface)[..., axis], own)
        velocity.append(own)
    spin = np.array([surface.spin or (0.0,) * turning for surface in surfaces])
    return cut._replace(velocity=tuple(velocity), spin=spin if spin.any() else None)  # type: ignore[arg-type]


def _foot(surface: FluidSurface, points: np.ndarray, grid: Grid) -> np.ndarray:
    """The points of a surface that are nearest to these, by its slope; the points themselves where it has none."""
    step, slopes = 1e-4 * min(grid.spacing), []
    for axis in range(grid.dimension):
        way = step * np.eye(grid.dimension)[axis]
        slopes.append((surface.distance(points + way) - surface.distance(points - way)) / (2.0 * step))
    slope = np.stack(slopes, axis=-1)
    usable = np.abs(np.linalg.norm(slope, axis=-1, keepdims=True) - 1.0) < 0.1
    return points - np.where(usable, surface.distance(points)[..., None] * slope, 0.0)


def _without_a_way_out(grid: Grid, boundary: Boundary, open_part: FaceField, cells: np.ndarray) -> np.ndarray:
    """The cells that are not connected with an outlet; in a box without one, with the largest space."""
    number = np.arange(cells.size).reshape(grid.cells)
    pairs = []
    for axis, a in enumerate(open_part):
        last = grid.cells[axis] - (0 if grid.periodic[axis] else 1)
        place = (*(slice(None),) * axis, slice(0, last))
        joined = (np.asarray(along(a, axis, 1, None)) > 0.0)[place]
        pairs.append(np.stack([number[place][joined], np.roll(number, -1, axis)[place][joined]]))
    edges = np.concatenate(pairs, axis=1)
    matrix = csr_matrix((np.ones(edges.shape[1]), tuple(edges)), shape=(cells.size, cells.size))
    space = connected_components(matrix, directed=False)[1].reshape(grid.cells)
    kept = set()
    for side in boundary.sides:
        if side.condition.sets_pressure:
            place = (*(slice(None),) * side.axis, slice(-1, None) if side.upper else slice(0, 1))
            faces = np.asarray(open_part[side.axis])[place]
            is_open = (np.broadcast_to(open_fraction(grid, side), faces.shape) > 0.0) & (faces > 0.0)
            kept |= set(space[place][is_open].tolist())
    if not kept:
        kept = {int(np.argmax(np.bincount(space.ravel(), np.ravel(cells))))}
    return ~np.isin(space, list(kept))
