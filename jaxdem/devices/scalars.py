"""Temperatures and other scalars of a box in slabs, and back. Host, numpy."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from jaxdem.devices.mesh import on_host
from jaxdem.fluid.slabs import cells_in_slabs, cells_of_slabs
from jaxdem.numerics.blocks import Blocks
from jaxdem.scalars.scalar_state import ScalarState, Supplied


def scalars_in_slabs(blocks: Blocks, scalars: ScalarState, identity: Any, inlets: bool) -> ScalarState:
    """The scalars of every slab, arrays of NumPy, from those of the whole box; the first slab has counted all so far.

    Args:
        blocks: the slabs.
        scalars: of the whole box.
        identity: (B, R) of the rows of the grains; None without grains.
        inlets: whether grains come in.
    """
    scalars = on_host(scalars)
    grains: Any = None
    coming: Any = None
    if scalars.grains is not None:
        number = on_host(identity)
        grains = np.where(number >= 0, scalars.grains[np.maximum(number, 0)], 0.0).astype(scalars.grains.dtype)
        coming = np.stack([scalars.grains] * blocks.number) if inlets else None
    fields: Any = tuple(cells_in_slabs(blocks, field) for field in scalars.fields)
    supplied: Supplied = jax.tree.map(
        lambda array: np.stack([array, *[np.zeros_like(array)] * (blocks.number - 1)]), scalars.supplied
    )
    capacity: Any = None if scalars.capacity is None else cells_in_slabs(blocks, scalars.capacity)
    return ScalarState(fields, grains, supplied, coming, capacity)


def scalars_of_slabs(blocks: Blocks, scalars: ScalarState, identity: Any, count: int) -> ScalarState:
    """The scalars of the whole box, arrays of NumPy: the inverse of `scalars_in_slabs`.

    Grains that are not present have the temperature at which they were to come in, or zero.

    Args:
        blocks: the slabs.
        scalars: distributed.
        identity: (B, R) of the rows of the grains; None without grains.
        count: N, of all grains that there ever are.
    """
    scalars = on_host(scalars)
    grains: Any = None
    if scalars.grains is not None:
        number = on_host(identity)
        there = number >= 0
        grains = np.zeros(count, scalars.grains.dtype) if scalars.coming is None else scalars.coming[0].copy()
        grains[number[there]] = scalars.grains[there]
    fields: Any = tuple(cells_of_slabs(blocks, field) for field in scalars.fields)
    supplied: Supplied = jax.tree.map(lambda array: np.sum(array, axis=0), scalars.supplied)
    capacity: Any = None if scalars.capacity is None else cells_of_slabs(blocks, scalars.capacity)
    return ScalarState(fields, grains, supplied, capacity=capacity)
