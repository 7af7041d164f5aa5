"""The liquid of two fluids in cells that surfaces within the mesh cut, see `cut_cells`.

The liquid's part c of the open volume v g of a cell is carried by the flux F = a g u through the open parts of its
faces as in a whole one: d(v g c)/dt + div(c F) = 0. v is the open part of the cell, which may have borrowed from a
larger neighbour: then no cell is so small that the flux through its faces limits the step, and the sum of v is that of
the open volume (`setup.cut_liquid`).

Weight and density on the faces need another fraction: that of the whole cell, walls included, with the surface of the
liquid where it is. Two cells of one row whose liquid stands at one height then have one density, whatever the wall
leaves open of either, so that layers of both fluids at rest are at rest to rounding beside any wall. It is the height
up to which liquid that has come to rest fills the cell: a cell is Q layers, of which layer k has the part s_k of the
open volume, and

    e = 1/Q sum_k min(max((c - s_1 - ... - s_(k-1)) / s_k, 0), 1).

A layer within the wall has a small s_k in place of none, so that a trace of liquid on a wall is not as heavy as what
the wall displaces. e(c) is continuous, from 0 to 1, and c in whole cells. Derived here.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.cut_eddy import beside_whole_cells
from jaxdem.fluid.grid import CellOrOne, FaceField, Grid, along, face_average
from jaxdem.fluid.open_faces import next_to
from jaxdem.fluid.volume_of_fluid import Inflow, surface_courant
from jaxdem.numerics.host import namespace

DEPTH = 2
"""Closed cells, one behind the other along an axis, into which a field goes on."""


def open_volume(cut: CutCells, void_fraction: CellOrOne) -> Array:
    """v g of the cells; 1 in closed ones, through which nothing passes [-]."""
    return jnp.where(cut.open_cells > 0.0, cut.open_cells * void_fraction, 1.0)


def level_of(cut: CutCells, fraction: Array) -> Array:
    """e of the cells of a fraction c [-]."""
    shares = required(cut.layers, "layers of the cut cells")
    number, below, filled = shares.shape[0], jnp.zeros_like(fraction), jnp.zeros_like(fraction)
    for k in range(number):
        filled = filled + jnp.clip((fraction - below) / shares[k], 0.0, 1.0)
        below = below + shares[k]
    # That of even layers is c but for rounding, which whole cells shall not have.
    even = jnp.max(jnp.abs(shares - 1.0 / number), axis=0) < 1e-6
    return jnp.where(even, fraction, filled / number)


def fraction_of_level(layers: Array, level: Array) -> Array:
    """c of the cells, the inverse of `level_of`; arrays of NumPy or JAX."""
    xp, number = namespace(level), layers.shape[0]
    return sum(layers[k] * xp.clip(number * level - k, 0.0, 1.0) for k in range(number))


def inflow_between_walls(cut: CutCells, inflow: Inflow) -> Inflow:
    """Liquid's part of what comes in through the open parts of the faces of every side, from that of whole faces.

    The layers of a face are those of the cell at it: so a stream along walls that run straight on through a side brings
    what cells at rest with its level hold.
    """
    shares, found = required(cut.layers, "layers of the cut cells"), []
    for number, level in enumerate(inflow):
        ends = (-1, None) if number % 2 else (0, 1)
        own = along(shares, 1 + number // 2, *ends)
        found.append(None if level is None else fraction_of_level(own, jnp.asarray(level)))
    return tuple(found)


def beyond_walls(grid: Grid, cut: CutCells, cells: Array) -> Array:
    """A field of the open cells that goes on into closed ones, first within a row: the mean of the neighbours."""
    known = (cut.open_cells > 0.0).astype(cells.dtype)
    cells = cells * known
    across = tuple(range(grid.dimension - 1))
    for axes in (*(across,) * DEPTH, (grid.dimension - 1,)):
        values = sum(next_to(grid, cells, axis) for axis in axes)
        count = sum(next_to(grid, known, axis) for axis in axes)
        new = (known == 0.0) & (count > 0.0)
        cells = jnp.where(new, values / jnp.where(count > 0.0, count, 1.0), cells)
        known = jnp.where(new, 1.0, known)
    return cells


def surface_courant_beside(grid: Grid, cut: CutCells, velocity: FaceField, void_fraction: Array | None) -> Array:
    """() `surface_courant` of a step of 1 s between surfaces [1/s]."""
    gaps: CellOrOne = 1.0 if void_fraction is None else void_fraction
    flux = tuple(f * u for f, u in zip(cut.opened(face_average(grid, gaps)), velocity, strict=True))
    return surface_courant(grid, flux, jnp.ones((), velocity[0].dtype), open_volume(cut, gaps))


def whole_control_volumes(grid: Grid, cut: CutCells) -> FaceField:
    """1 on the faces whose control volume no surface cuts, 0 on others."""
    whole = cut.open_cells == 1.0
    beside = (beside_whole_cells(grid, whole, axis) for axis in range(grid.dimension))
    return tuple(((a == 1.0) & b).astype(a.dtype) for a, b in zip(cut.open_faces, beside, strict=True))
