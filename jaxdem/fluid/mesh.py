"""The staggered grid: where cell and face quantities live, and what lies beyond the ends of its arrays.

Cell arrays have the shape `cells`, indexed [ix, iz] or [ix, iy, iz], the last axis up. A face field is a
tuple of D arrays; the one of axis a has one entry more along a, both boundary faces included. On a
periodic axis the first and the last face are the same face, stored twice.

On several devices a grid is that of one slab of the box (see `numerics.blocks`). Its arrays are those of the slab, and
the face between two slabs is stored in both. What a stencil needs from beyond the ends of an array comes from here
alone: `beyond`, `next_cells`, `end_faces`, `with_ends` and `at_side` know whether an end is a side of the box, the
other end of a periodic axis, or a border, across which the neighbour's layer is fetched.

Source: F. H. Harlow, J. E. Welch, Phys. Fluids 8 (1965) 2182-2189.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import DTypeLike

from jaxdem.numerics.blocks import Blocks
from jaxdem.numerics.host import namespace
from jaxdem.numerics.static import static

FaceField = tuple[Array, ...]
CellOrOne = Array | float


@static
class Grid:
    """A box of equal cells; static.

    Attributes:
        cells: number of cells per axis; of the slab, where the box is cut into slabs.
        size: side lengths of the whole box [m].
        depth: extent of the third direction in 2-D; 1 in 3-D, where it does not count [m].
        periodic: whether each axis is periodic.
        collocated: the "face" fields stand in the cells, D arrays of the shape `cells`, as in a fluid that a collocated
            solver of someone else gives; jaxdem's own solver is staggered.
        blocks: slabs that the box is cut into, one a device; None for a box on one device.
        drift: how far a particle of a slab may stand outside of it [m].
    """

    cells: tuple[int, ...]
    size: tuple[float, ...]
    depth: float
    periodic: tuple[bool, ...]
    collocated: bool = False
    blocks: Blocks | None = None
    drift: float = 0.0

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return len(self.cells)

    @property
    def spacing(self) -> tuple[float, ...]:
        """Cell sides [m]."""
        return tuple(length / count for length, count in zip(self.size, self.whole_cells, strict=True))

    @property
    def whole_cells(self) -> tuple[int, ...]:
        """Number of cells of the whole box per axis."""
        cut = self.blocks
        return self.cells if cut is None else tuple(n * (cut.number if a == cut.axis else 1) for a, n in self._counts)

    @property
    def whole(self) -> Grid:
        """The grid of the whole box; it knows of no slabs."""
        return dataclasses.replace(self, cells=self.whole_cells, blocks=None, drift=0.0)

    def in_blocks(self, blocks: Blocks, drift: float = 0.0) -> Grid:
        """The grid of one slab of this box, whose cells along the cut axis are a multiple of the number of slabs."""
        cells = tuple(n // (blocks.number if a == blocks.axis else 1) for a, n in self._counts)
        return dataclasses.replace(self, cells=cells, blocks=blocks, drift=drift)

    def cut_along(self, axis: int) -> Blocks | None:
        """The slabs, if they follow each other along this axis."""
        return self.blocks if self.blocks is not None and self.blocks.axis == axis else None

    @property
    def _counts(self) -> list[tuple[int, int]]:
        return list(enumerate(self.cells))

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


def layers(array: Array, axis: int, indices: tuple[int, ...]) -> Array:
    """Some layers of an array along an axis; negative numbers count from its end."""
    count = array.shape[axis]
    return namespace(array).concatenate([along(array, axis, i % count, i % count + 1) for i in indices], axis)  # type: ignore[no-any-return]


Ends = tuple[Array, Array]
"""Layers at the lower and at the upper end of an axis."""


def at_side(grid: Grid, axis: int, upper: bool, value: Array, otherwise: Array | float) -> Array:
    """`value` where this end of the axis is a side of the box, `otherwise` where it is a border between slabs."""
    cut = grid.cut_along(axis)
    return value if cut is None else jnp.where(cut.is_last() if upper else cut.is_first(), value, otherwise)


def beyond(
    grid: Grid, axis: int, array: Array, below: tuple[int, ...], above: tuple[int, ...], outside: Callable[[], Ends]
) -> Ends:
    """Layers of an array beyond the lower and the upper end of an axis.

    Args:
        grid: the grid.
        axis: of the ends.
        array: cells or faces.
        below: layers of this array that lie next below the box or slab that follows along the axis.
        above: layers that lie next above the one before.
        outside: gives what there is beyond the sides of the box; asked only where the axis has sides.
    """
    cut = grid.cut_along(axis)
    if cut is None:
        if not grid.periodic[axis]:
            return outside()
        return layers(array, axis, below), layers(array, axis, above)
    ends = cut.from_both(layers(array, axis, above), layers(array, axis, below))
    return _at_sides(grid, axis, ends, outside)


def next_cells(grid: Grid, axis: int, array: Array, upwards: bool = True) -> Array:
    """What every cell's neighbour above along an axis has, or below. There is none beyond a side of the box: whatever
    stands there, see `has_next`, is to be left out.

    Args:
        grid: the grid.
        axis: to go along.
        array: on cells, with any number of axes in front.
        upwards: to the neighbour above.
    """
    place, cut = array.ndim - grid.dimension + axis, grid.cut_along(axis)
    if cut is None:
        return jnp.roll(array, -1 if upwards else 1, place)
    if upwards:
        return jnp.concatenate((along(array, place, 1, None), cut.from_upper(along(array, place, 0, 1))), place)
    return jnp.concatenate((cut.from_lower(along(array, place, -1, None)), along(array, place, None, -1)), place)


def has_next(grid: Grid, axis: int) -> Array | np.ndarray:
    """Bool, whether a cell has a neighbour above along an axis; it broadcasts."""
    inner = np.arange(grid.cells[axis]) < grid.cells[axis] - (0 if grid.periodic[axis] else 1)
    inner, cut = inner.reshape([-1 if k == axis else 1 for k in range(grid.dimension)]), grid.cut_along(axis)
    return inner if cut is None else inner | ~cut.is_last()


def end_faces(
    grid: Grid,
    axis: int,
    cell: Array,
    between: Callable[[Array, Array], Array],
    of_sides: Callable[[Array, Array], Ends],
) -> Ends:
    """Values on the first and on the last face of an axis.

    Args:
        grid: the grid.
        axis: of the faces.
        cell: on the cells along this axis.
        between: the value on a face between a lower and an upper layer of cells.
        of_sides: the values on the sides of the box, of the first and the last layer of cells.
    """
    first, last = along(cell, axis, 0, 1), along(cell, axis, -1, None)
    cut = grid.cut_along(axis)
    if cut is not None:
        before, after = cut.from_both(first, last)
        ends = between(before, first), between(last, after)
        return _at_sides(grid, axis, ends, lambda: of_sides(first, last))
    if grid.periodic[axis]:
        seam = between(last, first)
        return seam, seam
    return of_sides(first, last)


def with_ends(grid: Grid, axis: int, array: Array, ends: Ends) -> Array:
    """An array of faces with other values on the sides of the box across an axis."""
    inner, (first, last) = along(array, axis, 1, -1), ends
    if grid.cut_along(axis) is not None:
        first = at_side(grid, axis, False, first, along(array, axis, 0, 1))
        last = at_side(grid, axis, True, last, along(array, axis, -1, None))
    return jnp.concatenate((first, inner, last), axis)


def _at_sides(grid: Grid, axis: int, ends: Ends, of_sides: Callable[[], Ends]) -> Ends:
    """`ends`, and those of the sides where the ends are sides of the box."""
    if grid.periodic[axis]:
        return ends
    first, last = of_sides()
    return at_side(grid, axis, False, first, ends[0]), at_side(grid, axis, True, last, ends[1])


def of_slab(grid: Grid, whole: np.ndarray, dtype: DTypeLike | None = None) -> Array:
    """The slab's part of an array on cells or faces of the whole box, or of one that is constant along the cut axis."""
    array, cut = jnp.asarray(whole, dtype), grid.blocks
    if cut is None or whole.shape[cut.axis] == 1:
        return array
    more = whole.shape[cut.axis] - grid.whole_cells[cut.axis]
    count = grid.cells[cut.axis]
    return lax.dynamic_slice_in_dim(array, cut.index() * count, count + more, cut.axis)


def face_places(grid: Grid, axis: int, dtype: DTypeLike) -> Array:
    """Coordinates of the faces across an axis, of the slab's where the box is cut along it [m]."""
    number, cut = jnp.arange(grid.cells[axis] + 1, dtype=dtype), grid.cut_along(axis)
    if cut is not None:
        number = number + (cut.index() * grid.cells[axis]).astype(dtype)
    return grid.spacing[axis] * number


def layer_number(grid: Grid, axis: int, cells: Array) -> Array:
    """Number in the whole box of every layer of a cell array along an axis, in its dtype."""
    number, cut = jnp.arange(cells.shape[axis], dtype=cells.dtype), grid.cut_along(axis)
    return number if cut is None else number + (cut.index() * grid.cells[axis]).astype(cells.dtype)
