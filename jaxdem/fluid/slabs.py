"""The fluid of the whole box as that of its slabs, and back; on the host.

The fluid of the slabs has one axis more in front, of the length of the number of slabs. Cells are in one slab each; a
face between two slabs is in both. What is one for the whole box every slab has.
"""

from __future__ import annotations

import numpy as np
from jax import Array

from jaxdem.fluid.fluid_state import FluidState
from jaxdem.fluid.grid import Grid
from jaxdem.numerics.blocks import Blocks


def fluid_in_slabs(grid: Grid, blocks: Blocks, fluid: FluidState) -> FluidState:
    """The fluid of every slab of a box, arrays of NumPy.

    Args:
        grid: of the whole box; its cells along the cut axis are a multiple of the number of slabs.
        blocks: the slabs.
        fluid: of the whole box.
    """
    count = grid.cells[blocks.axis] // blocks.number

    def cut(field: Array, more: int = 0) -> np.ndarray:
        rows = np.moveaxis(np.asarray(field), blocks.axis, 0)
        parts = [rows[k * count : (k + 1) * count + more] for k in range(blocks.number)]
        return np.stack([np.moveaxis(part, 0, blocks.axis) for part in parts])

    faces = tuple(cut(f, int(axis == blocks.axis)) for axis, f in enumerate(fluid.face_velocity))
    void_fraction, gradient = fluid.void_fraction, fluid.mean_gradient
    return FluidState(
        faces,  # type: ignore[arg-type]
        cut(fluid.pressure),  # type: ignore[arg-type]
        None if void_fraction is None else cut(void_fraction),  # type: ignore[arg-type]
        None if gradient is None else np.stack([np.asarray(gradient)] * blocks.number),  # type: ignore[arg-type]
    )


def fluid_of_slabs(blocks: Blocks, fluid: FluidState) -> FluidState:
    """The fluid of the whole box, arrays of NumPy: the inverse of `fluid_in_slabs`."""

    def joined(field: Array, more: int = 0) -> np.ndarray:
        rows = np.moveaxis(np.asarray(field), 1 + blocks.axis, 1)
        parts = [part[: len(part) - more] for part in rows]
        return np.moveaxis(np.concatenate([*parts, rows[-1][len(rows[-1]) - more :]]), 0, blocks.axis)

    faces = tuple(joined(f, int(axis == blocks.axis)) for axis, f in enumerate(fluid.face_velocity))
    void_fraction, gradient = fluid.void_fraction, fluid.mean_gradient
    return FluidState(
        faces,  # type: ignore[arg-type]
        joined(fluid.pressure),  # type: ignore[arg-type]
        None if void_fraction is None else joined(void_fraction),  # type: ignore[arg-type]
        None if gradient is None else np.asarray(gradient)[0],  # type: ignore[arg-type]
    )
