"""Work over many rows in tiles, whose intermediate values stay in the cache of the processor.

A contact step writes some thirty arrays of all pairs to memory before it adds them up. Of a hundred thousand grains
they are more than a cache holds, and the step waits for the memory. In tiles only what comes out is written, and a tile
in which nothing touches is left out by itself.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxdem.numerics.shapes import zeros_of

ROWS = 2048
"""Rows of a tile: thirty arrays of them take 250 KB."""

LEAST = 16
"""Tiles of values that there must be: fewer stay in the cache anyway."""

Result = TypeVar("Result")
Part = TypeVar("Part")


class Cut:
    """Takes the rows of a tile out of arrays whose last axis has the rows; scalars and Nones stay as they are."""

    def __init__(self, start: Array | None) -> None:
        self.start = start

    def __call__(self, tree: Part) -> Part:
        """The same pytree of the rows of the tile."""
        start = self.start
        if start is None:
            return tree

        def own(array: Array) -> Array:
            return array if array.ndim == 0 else lax.dynamic_slice_in_dim(array, start, ROWS, axis=-1)

        found: Part = jax.tree.map(own, tree)
        return found


ALL = Cut(None)
"""All rows at once."""


def in_tiles(rows: int, compute: Callable[[Cut], Result], values: int = 1) -> Result:
    """What `compute` gives of all rows: tile by tile on a CPU where there are many, else at once.

    Args:
        rows: number of them.
        compute: from the rows of a tile to a pytree of arrays whose last axis has those rows. What it gives of a row
            must not depend on other rows: the last two tiles overlap.
        values: of a row, such as one for each wall.
    """
    if rows < 2 * ROWS or rows * values < LEAST * ROWS or jax.default_backend() != "cpu":
        return compute(ALL)

    def tile(number: Array | int) -> tuple[Array, Result]:
        start = jnp.minimum(jnp.asarray(number, jnp.int32) * ROWS, rows - ROWS)
        return start, compute(Cut(start))

    def add(number: Array | int, whole: Result) -> Result:
        start, part = tile(number)
        found: Result = jax.tree.map(
            lambda all_rows, own: lax.dynamic_update_slice_in_dim(all_rows, own, start, axis=-1), whole, part
        )
        return found

    shapes = jax.eval_shape(lambda: tile(0)[1])
    whole = zeros_of(jax.tree.map(lambda x: jax.ShapeDtypeStruct((*x.shape[:-1], rows), x.dtype), shapes))
    return lax.fori_loop(0, -(-rows // ROWS), add, whole)
