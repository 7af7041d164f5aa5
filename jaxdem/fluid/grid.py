"""The staggered grid: where cell and face quantities live, and how they are averaged and differenced.

Cell arrays have the shape `cells`, indexed [ix, iz] or [ix, iy, iz], the last axis up. A face field is a
tuple of D arrays; the one of axis a has one entry more along a, both boundary faces included. On a
periodic axis the first and the last face are the same face, stored twice.

Source: F. H. Harlow, J. E. Welch, Phys. Fluids 8 (1965) 2182-2189.
"""

from __future__ import annotations

import math

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.numerics.static import static

FaceField = tuple[Array, ...]
CellOrOne = Array | float


@static
class Grid:
    """A box of equal cells; static.

    Attributes:
        cells: number of cells per axis.
        size: side lengths of the box [m].
        depth: extent of the third direction in 2-D; 1 in 3-D, where it does not count [m].
        periodic: whether each axis is periodic.
        collocated: the "face" fields stand in the cells, D arrays of the shape `cells`, as in a fluid that a collocated
            solver of someone else gives; jaxdem's own solver is staggered.
    """

    cells: tuple[int, ...]
    size: tuple[float, ...]
    depth: float
    periodic: tuple[bool, ...]
    collocated: bool = False

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return len(self.cells)

    @property
    def spacing(self) -> tuple[float, ...]:
        """Cell sides [m]."""
        return tuple(length / count for length, count in zip(self.size, self.cells, strict=True))

    @property
    def cell_volume(self) -> float:
        """[m3]."""
        return math.prod(self.spacing) * self.depth

    @property
    def filter_size(self) -> float:
        """Geometric mean of the cell sides: the width over which the fluid fields are averages [m]."""
        return math.prod(self.spacing) ** (1.0 / self.dimension)

    def face_shape(self, axis: int) -> tuple[int, ...]:
        """Shape of the face array of one axis."""
        return tuple(n + (a == axis and not self.collocated) for a, n in enumerate(self.cells))


def along(array: Array, axis: int, start: int | None, stop: int | None) -> Array:
    """`array` cut to [start:stop] along one axis."""
    return array[(slice(None),) * axis + (slice(start, stop),)]


def divergence(grid: Grid, flux: FaceField) -> Array:
    """Divergence of a face field in every cell."""
    return sum_of((along(f, a, 1, None) - along(f, a, None, -1)) / grid.spacing[a] for a, f in enumerate(flux))


def cell_average(faces: FaceField) -> FaceField:
    """Mean of the two faces of every cell, for each component: D arrays of the shape of the cells.

    Fields that stand in the cells already have one shape for all components, and stay as they are.
    """
    if len({f.shape for f in faces}) == 1:
        return faces
    return tuple(0.5 * (along(f, a, None, -1) + along(f, a, 1, None)) for a, f in enumerate(faces))


def face_average(grid: Grid, cell: CellOrOne) -> tuple[CellOrOne, ...]:
    """Mean of the two cells of every face; on a boundary face the value of its cell. 1 stays 1."""
    if isinstance(cell, float):
        return (cell,) * grid.dimension
    return tuple(face_average_along(grid, cell, axis) for axis in range(grid.dimension))


def face_average_along(grid: Grid, cell: Array, axis: int) -> Array:
    """`face_average` for the faces of one axis; the other axes may hold cells or faces."""
    inner = 0.5 * (along(cell, axis, None, -1) + along(cell, axis, 1, None))
    first, last = along(cell, axis, 0, 1), along(cell, axis, -1, None)
    if grid.periodic[axis]:
        first = last = 0.5 * (first + last)
    return jnp.concatenate((first, inner, last), axis)


def share_to_faces(grid: Grid, cells: tuple[Array, ...]) -> FaceField:
    """Half of each cell's content given to either face: the adjoint of `cell_average`."""
    if grid.collocated:
        return cells
    return tuple(_share_along(grid, cell, axis) for axis, cell in enumerate(cells))


def gradient(grid: Grid, cell: Array) -> FaceField:
    """Gradient on the faces; on a boundary face that of the nearest inner face."""
    result = []
    for axis in range(grid.dimension):
        inner = (along(cell, axis, 1, None) - along(cell, axis, None, -1)) / grid.spacing[axis]
        if grid.periodic[axis]:
            seam = (along(cell, axis, 0, 1) - along(cell, axis, -1, None)) / grid.spacing[axis]
            ends = (seam, seam)
        elif inner.shape[axis] == 0:
            ends = (jnp.zeros_like(cell), jnp.zeros_like(cell))
        else:
            ends = (along(inner, axis, 0, 1), along(inner, axis, -1, None))
        result.append(jnp.concatenate((ends[0], inner, ends[1]), axis))
    return tuple(result)


def second_differences(grid: Grid, cell: Array) -> Array:
    """Sum over the axes of h^2 d2/dx2 of a cell field, by second differences; at a side the last value is continued."""
    parts = []
    for axis, periodic in enumerate(grid.periodic):
        first, last = along(cell, axis, 0, 1), along(cell, axis, -1, None)
        before, after = (last, first) if periodic else (first, last)
        wide = jnp.concatenate((before, cell, after), axis)
        parts.append(along(wide, axis, 2, None) - 2.0 * cell + along(wide, axis, None, -2))
    return sum_of(parts)


def face_control_volume(grid: Grid, axis: int) -> Array:
    """Volume of the fluid that each face of an axis stands for: half a cell on a boundary face [m3].

    The array has size 1 along the other axes.
    """
    return jnp.asarray(control_width(grid, axis) * (grid.cell_volume / grid.spacing[axis]))


def control_width(grid: Grid, axis: int) -> np.ndarray:
    """Length of the control volume of each face of an axis along it: half a cell on a boundary; size 1 elsewhere
    [m]."""
    width = np.full(grid.cells[axis] + 1, grid.spacing[axis])
    if not grid.periodic[axis]:
        width[[0, -1]] *= 0.5
    return width.reshape([-1 if a == axis else 1 for a in range(grid.dimension)])


def face_total(grid: Grid, faces: FaceField) -> tuple[Array, ...]:
    """Sum over all faces of each component, periodic doubles counted once."""
    doubled = [wraps and not grid.collocated for wraps in grid.periodic]
    return tuple(jnp.sum(along(f, a, None, -1) if doubled[a] else f) for a, f in enumerate(faces))


def sum_of(terms):  # type: ignore[no-untyped-def]
    """Sum of arrays without the integer zero that `sum` starts with."""
    total = None
    for term in terms:
        total = term if total is None else total + term
    return total


def _share_along(grid: Grid, cell: Array, axis: int) -> Array:
    inner = 0.5 * (along(cell, axis, None, -1) + along(cell, axis, 1, None))
    first, last = 0.5 * along(cell, axis, 0, 1), 0.5 * along(cell, axis, -1, None)
    if grid.periodic[axis]:
        first = last = first + last
    return jnp.concatenate((first, inner, last), axis)
