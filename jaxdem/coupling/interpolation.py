"""Weights between particles and cells: deposit and interpolation are adjoint, faces go by way of the cells.

By default a particle's content is spread by a triangular kernel of half-width w per axis,
    k(x) = (1 - |x|/w) / w,  |x| <= w,
integrated exactly over every cell it reaches. What falls beyond a wall is mirrored into the box, beyond a
periodic side it re-enters; so the weights of a particle always add up to one, and volume is conserved at
walls too. A face value reaches a particle through the mean of the cell's two faces, and a force on the
fluid is given half to either face of a cell: with that the solid fraction of a face is the mean of its two
cells, and pressure forces on particles and fluid add up to the gradient in the mixture.

On several devices the particles of a slab reach into a halo of cells on either side of it: what they deposit there is
sent to the neighbour and added, and before an interpolation the halo is filled with the neighbour's cells.
"""

from __future__ import annotations

import itertools
import math
from functools import partial
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.coupling.cut_diffusion import CutDiffusion
from jaxdem.fluid.grid import FaceField, Grid, along, cell_average, share_to_faces
from jaxdem.fluid.rows import with_whole_rows
from jaxdem.numerics.blocks import Blocks
from jaxdem.numerics.host import namespace
from jaxdem.numerics.products import PRECISION, along_axis
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


@static
class Halo:
    """A slab of the box with layers of cells on either side that its particles reach; static.

    Attributes:
        grid: of the slab.
        blocks: the slabs.
        layers: of cells on either side, at most as many as the slab has.
    """

    grid: Grid
    blocks: Blocks
    layers: int

    @property
    def cells(self) -> tuple[int, ...]:
        """Number of cells per axis, with the halo."""
        return tuple(n + 2 * self.layers * (a == self.blocks.axis) for a, n in enumerate(self.grid.cells))

    def filled(self, fields: list[Array]) -> list[Array]:
        """Cell arrays of the slab with the neighbours' cells in the halo; beyond a side of the box without a meaning.
        One message each way carries the layers of all."""
        axis = self.blocks.axis
        lowest = jnp.stack([along(field, axis, 0, self.layers) for field in fields])
        highest = jnp.stack([along(field, axis, -self.layers, None) for field in fields])
        before, after = self.blocks.from_both(lowest, highest)
        return [jnp.concatenate(parts, axis) for parts in zip(before, fields, after, strict=True)]

    def folded(self, fields: list[Array]) -> list[Array]:
        """Cell arrays of the slab, with what all particles have put there: the adjoint of `filled`."""
        axis, width, count = self.blocks.axis, self.layers, self.grid.cells[self.blocks.axis]
        lowest = jnp.stack([along(field, axis, 0, width) for field in fields])
        highest = jnp.stack([along(field, axis, count + width, None) for field in fields])
        first, last = self.blocks.from_both(lowest, highest)
        rest = jnp.zeros_like(along(first[0], axis, 0, 1), shape=self._with_layers(count - width))
        return [
            along(field, axis, width, width + count)
            + jnp.concatenate((lower, rest), axis)
            + jnp.concatenate((rest, upper), axis)
            for field, lower, upper in zip(fields, first, last, strict=True)
        ]

    def _with_layers(self, number: int) -> tuple[int, ...]:
        return tuple(number if a == self.blocks.axis else n for a, n in enumerate(self.grid.cells))

    def place(self, columns: Array) -> tuple[Array, Array]:
        """Number within slab and halo of layers of cells of the whole box along the cut axis, and whether each lies
        there.

        The slab and its halo may lie across a periodic end of the box.

        Args:
            columns: int32, in the box where it has sides, anywhere where it is periodic.
        """
        axis, cut = self.blocks.axis, self.blocks
        count, whole, width = self.grid.cells[axis], self.grid.whole_cells[axis], self.layers
        local = columns - cut.index() * count
        if cut.periodic:
            middle = (whole - count) // 2
            local = (local + middle) % whole - middle
        return jnp.clip(local + width, 0, count + 2 * width - 1), (local >= -width) & (local < count + width)


def halo_of(grid: Grid, half_width: tuple[float, ...]) -> Halo | None:
    """The halo that particles of this reach need [m]; None for a box on one device."""
    if grid.blocks is None:
        return None
    return Halo(grid, grid.blocks, halo_layers(grid, half_width, grid.blocks.axis))


def halo_layers(grid: Grid, half_width: tuple[float, ...], axis: int) -> int:
    """Cells beyond a slab across an axis that its particles may reach [-].

    One at least: rounding puts a particle on the border into either cell.
    """
    return math.ceil((half_width[axis] + grid.drift) / grid.spacing[axis] + 1e-9)


class Weights(NamedTuple):
    """Interpolation weights of N particles over S cells each.

    Attributes:
        index: (N, S) int32 flat cell index; with a halo, among the cells of slab and halo.
        weight: (N, S), each row adds up to one [-].
        smoothing: a symmetric matrix for every axis, which fields are multiplied by after a deposit and before an
            interpolation; between surfaces a diffusion; None for none [-].
        halo: static; None for a box on one device.
        along_axes: of a kernel, cells and weights along every axis, (N, R) each, whose products these are in the order
            of `itertools.product`, before surfaces leave open parts of cells; None for others.
    """

    index: Array  # type: ignore[assignment]
    weight: Array
    smoothing: tuple[Array, ...] | CutDiffusion | None = None
    halo: Halo | None = None
    along_axes: tuple[tuple[Array, Array], ...] | None = None


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
    index, weight, counts = [], [], grid.cells if halo is None else halo.cells
    for combination in itertools.product(*(range(i.shape[1]) for i, _ in per_axis)):
        flat, product = xp.zeros((), xp.int32), xp.ones((), position.dtype)
        for axis, column in enumerate(combination):
            flat = flat * counts[axis] + per_axis[axis][0][:, column]
            product = product * per_axis[axis][1][:, column]
        index.append(flat)
        weight.append(product)
    return Weights(xp.stack(index, axis=1), xp.stack(weight, axis=1), halo=halo, along_axes=per_axis)


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
    columns = itertools.product(*(range(row.shape[1]) for row in rows))
    products = [math.prod(row[:, k] for row, k in zip(rows, own, strict=True)) for own in columns]
    return weights._replace(weight=jnp.stack(products, axis=1))


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


def deposit(grid: Grid, weights: Weights, quantity: Array) -> Array:
    """Particle quantities (N,) spread over the cells: sum_p w_pc q_p, in the unit of the quantity."""
    return _deposited(grid, weights, [quantity])[0]


def _deposited(grid: Grid, weights: Weights, quantities: list[Array]) -> list[Array]:
    """Several quantities (N,), each as by `deposit`."""
    fields = [_spread(grid, weights, quantity) for quantity in quantities]
    if weights.halo is not None:
        fields = weights.halo.folded(fields)
    if isinstance(weights.smoothing, CutDiffusion):
        return [weights.smoothing.of_amounts(field) for field in fields]
    return [_smoothed(weights, field) for field in fields]


def _spread(grid: Grid, weights: Weights, quantity: Array) -> Array:
    """A quantity (N,) on the cells that the particles reach, with the halo."""
    shares = weights.weight * quantity[:, None]
    cells = grid.cells if weights.halo is None else weights.halo.cells
    size = math.prod(cells)
    if isinstance(shares, np.ndarray) and isinstance(weights.index, np.ndarray):
        spread = np.bincount(np.ravel(weights.index), np.ravel(shares), size).astype(shares.dtype)
    else:
        flat = jnp.zeros(size, quantity.dtype)
        spread = flat.at[weights.index].add(shares, mode="promise_in_bounds")
    return spread.reshape(cells)


def interpolate(weights: Weights, cells: tuple[Array, ...]) -> Array:
    """Cell fields at the particles, sum_c w_pc f_c: (N, number of fields)."""
    fields = [_smoothed(weights, c) for c in cells]
    if weights.halo is not None:
        fields = weights.halo.filled(fields)
    table = jnp.stack([field.reshape(-1) for field in fields], axis=1)
    return jnp.einsum("ns,nsk->nk", weights.weight, table[weights.index], precision=PRECISION)


def in_reach(weights: Weights, cells: Array) -> Array:
    """A cell field in the cells that each particle reaches, (N, S)."""
    if weights.halo is not None:
        (cells,) = weights.halo.filled([cells])
    return namespace(weights.weight).ravel(cells)[weights.index]


def deposit_on_faces(grid: Grid, weights: Weights, quantity: Array) -> FaceField:
    """Particle quantities (N,) or (N, D) spread over the faces; (N,) goes to the faces of every axis alike."""
    if quantity.ndim == 1:
        cells = (deposit(grid, weights, quantity),) * grid.dimension
    else:
        cells = tuple(_deposited(grid, weights, [quantity[:, a] for a in range(grid.dimension)]))
    return share_to_faces(grid, cells)


def interpolate_faces(weights: Weights, faces: FaceField) -> Array:
    """A face field at the particles, (N, D): the adjoint of `deposit_on_faces`."""
    return interpolate(weights, cell_average(faces))


def _smoothed(weights: Weights, field: Array) -> Array:
    halo = weights.halo
    if isinstance(weights.smoothing, CutDiffusion):
        return weights.smoothing.of_fields(field)
    for axis, matrix in enumerate(weights.smoothing or ()):
        if halo is not None and halo.blocks.axis == axis:
            field = with_whole_rows(halo.grid, field, partial(along_axis, matrix, axis=axis))
        else:
            field = along_axis(matrix, field, axis)
    return field


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
