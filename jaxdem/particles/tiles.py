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
Kept = TypeVar("Kept")
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


def in_tiles(
    rows: int, compute: Callable[[Cut, Kept], tuple[Result, Kept]], kept: Kept, values: int = 1
) -> tuple[Result, Kept]:
    """What `compute` gives of all rows: tile by tile on a CPU where there are many, else at once.

    Args:
        rows: number of them.
        compute: from a tile and what is kept of its rows to a pytree of arrays whose last axis has those rows, and what
            is kept of them from now on. What it gives of a row must not depend on other rows.
        kept: pytree of arrays whose last axis has the rows. It is changed where it stands in memory, if nothing else
            asks for what it was.
        values: of a row, such as one for each wall.
    """
    if rows < 2 * ROWS or rows * values < LEAST * ROWS or jax.default_backend() != "cpu":
        return compute(ALL, kept)

    def tile(number: Array | int, before: Kept) -> tuple[Array, tuple[Result, Kept]]:
        start = jnp.minimum(jnp.asarray(number, jnp.int32) * ROWS, rows - ROWS)
        cut = Cut(start)
        return start, compute(cut, cut(before))

    def add(number: Array | int, whole: tuple[Result, Kept]) -> tuple[Result, Kept]:
        start, part = tile(number, whole[1])
        # The last two tiles overlap, and what is kept must not be changed twice.
        fresh = start + jnp.arange(ROWS, dtype=jnp.int32) >= number * ROWS

        def put(all_rows: Array, own: Array) -> Array:
            own = jnp.where(fresh, own, Cut(start)(all_rows))
            return lax.dynamic_update_slice_in_dim(all_rows, own, start, axis=-1)

        found: tuple[Result, Kept] = jax.tree.map(put, whole, part)
        return found

    shapes = jax.eval_shape(lambda: tile(0, kept)[1][0])
    whole = zeros_of(jax.tree.map(lambda x: jax.ShapeDtypeStruct((*x.shape[:-1], rows), x.dtype), shapes))
    return lax.fori_loop(0, -(-rows // ROWS), add, (whole, kept))
