"""Fields on the staggered grid: how they are averaged, differenced and summed. The grid itself is in `mesh`."""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import DTypeLike

from jaxdem.fluid.mesh import CellOrOne as CellOrOne
from jaxdem.fluid.mesh import Ends, beyond, end_faces, of_slab
from jaxdem.fluid.mesh import FaceField as FaceField
from jaxdem.fluid.mesh import Grid as Grid
from jaxdem.fluid.mesh import along as along
from jaxdem.numerics.blocks import largest, total


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
    first, last = end_faces(
        grid, axis, cell, lambda below, above: 0.5 * (above + below), lambda first, last: (first, last)
    )
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
        ends = end_faces(grid, axis, cell, slope_over(grid.spacing[axis]), continued_from(inner, axis))
        result.append(jnp.concatenate((ends[0], inner, ends[1]), axis))
    return tuple(result)


def slope_over(spacing: float) -> Callable[[Array, Array], Array]:
    """The slope between a lower and an upper layer of cells, for `end_faces`."""
    return lambda below, above: (above - below) / spacing


def no_ends(first: Array, last: Array) -> Ends:
    """Nothing on the sides of the box, for `end_faces`."""
    return jnp.zeros_like(first), jnp.zeros_like(last)


def continued_from(inner: Array, axis: int) -> Callable[[Array, Array], Ends]:
    """Values of the nearest inner faces on the sides of the box, for `end_faces`."""
    return lambda first, last: nearest_inner(inner, axis, first)


def nearest_inner(inner: Array, axis: int, like: Array) -> Ends:
    """Values of the inner faces that are nearest to either end; zeros where there are none, of one cell alone."""
    if inner.shape[axis] == 0:
        return jnp.zeros_like(like), jnp.zeros_like(like)
    return along(inner, axis, 0, 1), along(inner, axis, -1, None)


def second_differences(grid: Grid, cell: Array) -> Array:
    """Sum over the axes of h^2 d2/dx2 of a cell field, by second differences; at a side the last value is continued."""
    parts = []
    for axis in range(grid.dimension):
        before, after = beyond(grid, axis, cell, (-1,), (0,), own_layers(cell, axis))
        wide = jnp.concatenate((before, cell, after), axis)
        parts.append(along(wide, axis, 2, None) - 2.0 * cell + along(wide, axis, None, -2))
    return sum_of(parts)


def mean_over_three(grid: Grid, cell: Array) -> Array:
    """Mean of a cell field over three cells along every axis; at a side the last value is continued."""
    for axis in range(grid.dimension):
        before, after = beyond(grid, axis, cell, (-1,), (0,), own_layers(cell, axis))
        wide = jnp.concatenate((before, cell, after), axis)
        cell = (along(wide, axis, None, -2) + cell + along(wide, axis, 2, None)) / 3.0
    return cell


def own_layers(array: Array, axis: int) -> Callable[[], Ends]:
    """The first and the last layer, as what lies beyond the sides of the box, for `beyond`."""
    return lambda: (along(array, axis, 0, 1), along(array, axis, -1, None))


def face_control_volume(grid: Grid, axis: int) -> Array:
    """Volume of the fluid that each face of an axis stands for: half a cell on a boundary face [m3].

    The array has size 1 along the other axes.
    """
    return of_slab(grid, _control_width(grid, axis) * (grid.cell_volume / grid.spacing[axis]))


def control_width(grid: Grid, axis: int, dtype: DTypeLike) -> Array:
    """Length of the control volume of each face of an axis along it: half a cell on a boundary; size 1 elsewhere
    [m]."""
    return of_slab(grid, _control_width(grid, axis), dtype)


def _control_width(grid: Grid, axis: int) -> np.ndarray:
    """The same of the whole box."""
    width = np.full(grid.whole_cells[axis] + 1, grid.spacing[axis])
    if not grid.periodic[axis]:
        width[[0, -1]] *= 0.5
    return width.reshape([-1 if a == axis else 1 for a in range(grid.dimension)])


def face_total(grid: Grid, faces: FaceField) -> tuple[Array, ...]:
    """Sum over all faces of each component, those that are stored twice counted once."""
    doubled = [wraps and not grid.collocated for wraps in grid.periodic]
    counted = [along(f, a, None, -1) if doubled[a] else f for a, f in enumerate(faces)]
    cut = grid.blocks
    if cut is not None and not cut.periodic and not grid.collocated:
        own = counted[cut.axis]
        last = jnp.where(cut.is_last(), along(own, cut.axis, -1, None), 0.0)
        counted[cut.axis] = jnp.concatenate((along(own, cut.axis, None, -1), last), cut.axis)
    return total(cut, tuple(jnp.sum(f) for f in counted))


def box_mean(grid: Grid, values: Array) -> Array:
    """() mean over the box of values on the cells, or on faces of which none is stored twice."""
    mean, cut = jnp.mean(values), grid.blocks
    return mean if cut is None else cut.total(mean) / cut.number


def box_largest(grid: Grid, values: Array) -> Array:
    """() largest value in the box."""
    return largest(grid.blocks, jnp.max(values))


def box_smallest(grid: Grid, values: Array) -> Array:
    """() smallest value in the box."""
    lowest = jnp.min(values)
    return lowest if grid.blocks is None else -largest(grid.blocks, -lowest)


def agreed(grid: Grid, faces: FaceField) -> FaceField:
    """The faces, where two slabs store one face with the value of the upper slab in both."""
    cut = grid.blocks
    if cut is None:
        return faces
    own = faces[cut.axis]
    theirs = cut.from_upper(along(own, cut.axis, 0, 1))
    last = jnp.where(cut.is_last(), along(own, cut.axis, -1, None), theirs)
    shared = jnp.concatenate((along(own, cut.axis, None, -1), last), cut.axis)
    return tuple(shared if axis == cut.axis else f for axis, f in enumerate(faces))


def sum_of(terms):  # type: ignore[no-untyped-def]
    """Sum of arrays without the integer zero that `sum` starts with."""
    found = None
    for term in terms:
        found = term if found is None else found + term
    return found


def sum_of_fields(a: FaceField, b: FaceField) -> FaceField:
    """Sum of two face fields."""
    return tuple(x + y for x, y in zip(a, b, strict=True))


def _share_along(grid: Grid, cell: Array, axis: int) -> Array:
    inner = 0.5 * (along(cell, axis, None, -1) + along(cell, axis, 1, None))
    first, last = end_faces(
        grid, axis, cell, lambda below, above: 0.5 * above + 0.5 * below, lambda first, last: (0.5 * first, 0.5 * last)
    )
    return jnp.concatenate((first, inner, last), axis)
