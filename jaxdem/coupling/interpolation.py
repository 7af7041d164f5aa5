"""Between particles and cells, by given weights (`kernel`): deposit and interpolation are adjoint, faces go by way of
the cells.

A face value reaches a particle through the mean of the cell's two faces, and a force on the fluid is given half to
either face of a cell: with that the solid fraction of a face is the mean of its two cells, and pressure forces on
particles and fluid add up to the gradient in the mixture.
"""

from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.coupling.cut_diffusion import CutDiffusion
from jaxdem.coupling.halo import Halo
from jaxdem.fluid.grid import FaceField, Grid, cell_average, share_to_faces
from jaxdem.fluid.rows import with_whole_rows
from jaxdem.numerics.host import namespace
from jaxdem.numerics.products import PRECISION, along_axis


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
