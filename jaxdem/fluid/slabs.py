"""The fluid of the whole box as that of its slabs, and back; on the host.

The fluid of the slabs has one axis more in front, of the length of the number of slabs. Cells are in one slab each; a
face between two slabs is in both. What is one for the whole box every slab has.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from jax import Array

from jaxdem.fluid.fluid_state import FluidState
from jaxdem.numerics.blocks import Blocks


def cells_in_slabs(blocks: Blocks, field: Array, more: int = 0) -> np.ndarray:
    """A field of every slab of a box, from that of the whole box.

    Args:
        blocks: the slabs.
        field: on cells, whose number along the cut axis is a multiple of the number of slabs; or on faces.
        more: 1 for faces across the cut axis.
    """
    rows = np.moveaxis(np.asarray(field), blocks.axis, 0)
    count = (len(rows) - more) // blocks.number
    parts = [rows[k * count : (k + 1) * count + more] for k in range(blocks.number)]
    return np.stack([np.moveaxis(part, 0, blocks.axis) for part in parts])


def cells_of_slabs(blocks: Blocks, field: Array, more: int = 0) -> np.ndarray:
    """The field of the whole box: the inverse of `cells_in_slabs`."""
    rows = np.moveaxis(np.asarray(field), 1 + blocks.axis, 1)
    parts = [part[: len(part) - more] for part in rows]
    return np.moveaxis(np.concatenate([*parts, rows[-1][len(rows[-1]) - more :]]), 0, blocks.axis)


def fluid_in_slabs(blocks: Blocks, fluid: FluidState) -> FluidState:
    """The fluid of every slab of a box, arrays of NumPy, from that of the whole box."""

    def cut(field: Array, more: int = 0) -> Any:
        return cells_in_slabs(blocks, field, more)

    def everywhere(array: Array) -> Any:
        return np.stack([np.asarray(array)] * blocks.number)

    return _each_part(blocks, fluid, cut, everywhere)


def fluid_of_slabs(blocks: Blocks, fluid: FluidState) -> FluidState:
    """The fluid of the whole box, arrays of NumPy: the inverse of `fluid_in_slabs`."""

    def joined(field: Array, more: int = 0) -> Any:
        return cells_of_slabs(blocks, field, more)

    return _each_part(blocks, fluid, joined, lambda array: np.asarray(array)[0])


def _each_part(
    blocks: Blocks, fluid: FluidState, of_field: Callable[..., Any], of_box: Callable[[Array], Any]
) -> FluidState:
    void_fraction, gradient = fluid.void_fraction, fluid.mean_gradient
    return FluidState(
        tuple(of_field(f, int(axis == blocks.axis)) for axis, f in enumerate(fluid.face_velocity)),
        of_field(fluid.pressure),
        None if void_fraction is None else of_field(void_fraction),
        None if gradient is None else of_box(gradient),
    )
