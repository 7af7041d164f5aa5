"""Weights of particles by their place: a kernel, or equal points.

The kernel is a triangle of half-width w per axis,
    k(x) = (1 - |x|/w) / w,  |x| <= w,
integrated exactly over every cell it reaches. What falls beyond a wall is mirrored into the box, beyond a
periodic side it re-enters; so the weights of a particle always add up to one, and volume is conserved at
walls too.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import jax.numpy as jnp
from jax import Array

from jaxdem.coupling.halo import Halo, halo_of
from jaxdem.coupling.interpolation import Weights
from jaxdem.fluid.grid import Grid
from jaxdem.numerics.host import namespace
from jaxdem.numerics.static import static


@static
class KernelWidth:
    """Half-width of the kernel, max(diameters d, cells h) per axis; static.

    Attributes:
        diameters: multiple of the particle diameter [-].
        cells: multiple of the cell side [-].
    """

    diameters: float
    cells: float

    def half_widths(self, grid: Grid, diameter: float) -> tuple[float, ...]:
        """Half-width along every axis [m]."""
        return tuple(max(self.diameters * diameter, self.cells * h) for h in grid.spacing)


def kernel_weights(
    grid: Grid, half_width: tuple[float, ...], position: Array, own: tuple[Array, ...] | None = None
) -> Weights:
    """Weights of particles at `position` (N, D) [m].

    Args:
        grid: the grid.
        half_width: of the widest kernel along every axis [m].
        position: (N, D) [m].
        own: half-width of each particle's kernel along every axis, (N,), at most `half_width` [m]; None: all have that.
    """
    xp, halo = namespace(position), halo_of(grid, half_width)
    per_axis = tuple(
        _axis_weights(grid, axis, half_width[axis], position[:, axis], halo, None if own is None else own[axis])
        for axis in range(grid.dimension)
    )
    index, weight = xp.zeros((len(position), 1), xp.int32), xp.ones((len(position), 1), position.dtype)
    for count, (cells, own_weight) in zip(grid.cells if halo is None else halo.cells, per_axis, strict=True):
        index = _of_both(index * count, cells, xp.add)
        weight = _of_both(weight, own_weight, xp.multiply)
    return Weights(index, weight, halo=halo, along_axes=per_axis)


def _of_both(one: Array, other: Array, function: Callable[[Array, Array], Array]) -> Array:
    """Of every pair of columns, (N, A) and (N, B), those of `other` fastest: (N, A B)."""
    return function(one[:, :, None], other[:, None, :]).reshape(len(one), one.shape[1] * other.shape[1])


def each_cell_once(weights: Weights) -> Weights:
    """The same weights with all that a particle puts into a cell in the first entry of it, and zero in others.

    What a wall mirrors comes into cells that have an entry already. For kernels; weights of one point have one entry.
    """
    if weights.along_axes is None:
        return weights
    rows = []
    for cells, weight in weights.along_axes:
        same = cells[:, :, None] == cells[:, None, :]
        first = jnp.argmax(same, axis=2) == jnp.arange(cells.shape[1])[None]
        rows.append(jnp.where(first, jnp.sum(jnp.where(same, weight[:, None, :], 0.0), axis=2), 0.0))
    return weights._replace(weight=functools.reduce(lambda one, other: _of_both(one, other, jnp.multiply), rows))


def cells_under(half_width: float, spacing: float) -> int:
    """Most cells of a size that a kernel reaches along an axis."""
    return math.ceil(2.0 * half_width / spacing - 1e-9) + 1


def point_weights(grid: Grid, half_width: tuple[float, ...], points: Array) -> Weights:
    """Weights of particles that are P points of equal weight each; P = 1: the cell of the centre.

    Args:
        grid: the grid.
        half_width: how far the points are from the centre at most, along every axis [m].
        points: (N, P, D) [m].
    """
    xp, halo = namespace(points), halo_of(grid, half_width)
    flat, inside = xp.zeros((), xp.int32), None
    for axis in range(grid.dimension):
        cell = xp.floor(points[..., axis] / grid.spacing[axis]).astype(xp.int32)
        column = _into_box(cell, grid.whole_cells[axis], grid.periodic[axis])
        if halo is not None and halo.blocks.axis == axis:
            column, inside = halo.place(column)
        flat = flat * (grid.cells if halo is None else halo.cells)[axis] + column
    weight = xp.full(flat.shape, 1.0 / flat.shape[1], points.dtype)
    return Weights(flat, weight if inside is None else weight * inside, halo=halo)


def _axis_weights(
    grid: Grid, axis: int, half_width: float, position: Array, halo: Halo | None, own: Array | None
) -> tuple[Array, Array]:
    """Cell indices and weights along one axis, (N, reach) each; see `kernel_weights`."""
    count, spacing = grid.whole_cells[axis], grid.spacing[axis]
    reach, xp = cells_under(half_width, spacing), namespace(position)
    scaled = position / spacing
    half = half_width if own is None else own
    width = half_width / spacing if own is None else own[:, None] / spacing
    # Compilers compute this once for the indices and once for the weights. Subtracting before dividing leaves
    # them no product to fuse with a sum, so that both round alike where the kernel ends on a cell's side.
    first = xp.floor((position - half) / spacing).astype(xp.int32)
    columns = first[:, None] + xp.arange(reach, dtype=xp.int32)[None]
    # Distances from the first cell, not from the box, keep the digits of positions far from the origin.
    offset = (scaled - first)[:, None] - xp.arange(reach + 1, dtype=position.dtype)[None]
    passed = _cumulative_triangle(-offset / width)
    weight = passed[:, 1:] - passed[:, :-1]
    # Rounding leaves the sum a few ulp off one: volume is to be exact.
    weight = weight / xp.sum(weight, axis=1, keepdims=True)
    columns = _into_box(columns, count, grid.periodic[axis])
    if halo is None or halo.blocks.axis != axis:
        return columns, weight
    columns, inside = halo.place(columns)
    return columns, weight * inside


def _cumulative_triangle(x: Array) -> Array:
    """Integral of the triangle of half-width 1 from -1 to x; once continuously differentiable."""
    xp = namespace(x)
    x = xp.clip(x, -1.0, 1.0)
    return xp.where(x < 0, 0.5 * (1.0 + x) ** 2, 1.0 - 0.5 * (1.0 - x) ** 2)


def _into_box(index: Array, count: int, periodic: bool) -> Array:
    """Cell indices beyond the box wrapped, or mirrored at its walls as often as needed."""
    if periodic:
        return index % count
    folded = index % (2 * count)
    return namespace(index).minimum(folded, 2 * count - 1 - folded)
