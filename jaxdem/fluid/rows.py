"""Whole rows of cells along the axis that is cut among devices, for what couples the cells of a row.

All devices exchange parts (`all_to_all`), so that each has its share of another axis and the cut axis in full; and back
afterwards. Where the number of cells of that other axis is no multiple of the number of devices it is filled up with
zeros.
"""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import DTypeLike

from jaxdem.fluid.grid import Grid, along


def with_whole_rows(grid: Grid, cells: Array, work: Callable[[Array], Array]) -> Array:
    """`work` done on a cell array in which no row along the cut axis is divided.

    Args:
        grid: the grid; one of a whole box has all its rows.
        cells: on the cells of the slab.
        work: on an array of the same kind, each row along the cut axis for itself; see `share_of_rows`.
    """
    cut = grid.blocks
    if cut is None:
        return work(cells)
    other, more = _cut_meanwhile(grid)
    turned = work(cut.turned(_filled(cells, other, more), cut.axis, other))
    return along(cut.turned(turned, other, cut.axis), other, 0, grid.cells[other])


def share_of_rows(grid: Grid, whole: np.ndarray, dtype: DTypeLike) -> Array:
    """Of an array on the cells of the whole box, the part that `work` of `with_whole_rows` deals with."""
    cut = grid.blocks
    if cut is None:
        return jnp.asarray(whole, dtype)
    other, more = _cut_meanwhile(grid)
    filled = _filled(jnp.asarray(whole, dtype), other, more)
    count = filled.shape[other] // cut.number
    return lax.dynamic_slice_in_dim(filled, cut.index() * count, count, other)


def _cut_meanwhile(grid: Grid) -> tuple[int, int]:
    """The axis that is cut instead, and the layers of zeros that it needs for equal shares: the fewest."""
    cut = grid.blocks
    if cut is None:
        return 0, 0
    others = [axis for axis in range(grid.dimension) if axis != cut.axis]
    other = min(others, key=lambda axis: (-grid.cells[axis] % cut.number) / grid.cells[axis])
    return other, -grid.cells[other] % cut.number


def _filled(array: Array, axis: int, more: int) -> Array:
    if more == 0:
        return array
    return jnp.pad(array, [(0, more if a == axis else 0) for a in range(array.ndim)])
