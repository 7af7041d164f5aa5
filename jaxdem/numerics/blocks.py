"""A box cut into slabs, one a device: who the neighbours are, and what is combined over all of them.

The methods are for the inside of a `jax.shard_map` over a mesh with the axis `MESH_AXIS`, where each device has the
arrays of its own slab. The functions take None for a box on one device and then give back what they are given, so that
code for both has no branches, and one device compiles the program without them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxdem.numerics.static import static

MESH_AXIS = "blocks"
"""Name of the mesh's axis along which arrays are distributed."""

Tree = TypeVar("Tree")


@static
class Blocks:
    """Slabs of a box along one axis, one a device; static.

    Attributes:
        number: of slabs.
        axis: of the box that is cut.
        periodic: whether the last and the first slab are neighbours.
    """

    number: int
    axis: int
    periodic: bool

    def index(self) -> Array:
        """() int32, the number of this slab, counted from the lower end of the axis."""
        return lax.axis_index(MESH_AXIS).astype(jnp.int32)

    def from_lower(self, tree: Tree) -> Tree:
        """The tree of the neighbour below; zeros in the first slab where the axis is not periodic."""
        return self._shifted(tree, 1)

    def from_upper(self, tree: Tree) -> Tree:
        """The tree of the neighbour above; zeros in the last slab where the axis is not periodic."""
        return self._shifted(tree, -1)

    def from_both(
        self, lowest: Array, highest: Array, packed: Callable[[Array], Array] = lambda given: given
    ) -> tuple[Array, Array]:
        """What the neighbour below sends of its `highest`, and the one above of its `lowest`; zeros where none is.

        Two slabs have one neighbour each, and exchange arrays of one shape in one message. What is sent is `packed` of
        them: of two slabs at the ends of an axis that is not periodic, of one of them.
        """
        if self.number != 2 or lowest.shape != highest.shape:
            return self.from_lower(packed(highest)), self.from_upper(packed(lowest))
        other = [(0, 1), (1, 0)]
        if self.periodic:
            come = lax.ppermute(jnp.stack((packed(highest), packed(lowest))), MESH_AXIS, other)
            return come[0], come[1]
        first = self.index() == 0
        come = lax.ppermute(packed(jnp.where(first, highest, lowest)), MESH_AXIS, other)
        none = jnp.zeros_like(come)
        return jnp.where(first, none, come), jnp.where(first, come, none)

    def _shifted(self, tree: Tree, steps: int) -> Tree:
        if self.number == 1:
            return tree if self.periodic else jax.tree.map(jnp.zeros_like, tree)
        ring = [(i, (i + steps) % self.number) for i in range(self.number)]
        sent = ring if self.periodic else [(i, k) for i, k in ring if k == i + steps]
        return jax.tree.map(lambda x: lax.ppermute(x, MESH_AXIS, sent), tree)

    def turned(self, array: Array, whole: int, cut: int) -> Array:
        """The same values with another axis cut among the devices: every device has axis `whole` in full, and its share
        of axis `cut`, whose length must be a multiple of the number of slabs."""
        return lax.all_to_all(array, MESH_AXIS, split_axis=cut, concat_axis=whole, tiled=True)

    def is_first(self) -> Array:
        """() bool: the lower end of the axis is the end of this slab, not a neighbour; never where it is periodic."""
        return (self.index() == 0) & (not self.periodic)

    def is_last(self) -> Array:
        """() bool: the upper end of the axis is the end of this slab, not a neighbour."""
        return (self.index() == self.number - 1) & (not self.periodic)

    def total(self, tree: Tree) -> Tree:
        """Sums over all slabs, of every array of the tree."""
        return lax.psum(tree, MESH_AXIS)  # type: ignore[no-any-return]

    def largest(self, tree: Tree) -> Tree:
        """Maxima over all slabs, of every array of the tree; no derivative goes through them.

        Between processes on CPUs a maximum may hide a NaN: ask for finite values by `any`.
        """
        return lax.pmax(lax.stop_gradient(tree), MESH_AXIS)  # type: ignore[no-any-return]

    def any(self, condition: Array) -> Array:
        """Bool of the same shape: whether the condition holds in any slab."""
        return lax.pmax(condition.astype(jnp.int32), MESH_AXIS) > 0


def total(blocks: Blocks | None, tree: Tree) -> Tree:
    """Sums over all slabs; the tree itself on one device."""
    return tree if blocks is None else blocks.total(tree)


def largest(blocks: Blocks | None, tree: Tree) -> Tree:
    """Maxima over all slabs, without a derivative; the tree itself on one device."""
    return tree if blocks is None else blocks.largest(tree)


def any_of(blocks: Blocks | None, condition: Array) -> Array:
    """Whether the condition holds in any slab; the condition itself on one device."""
    return condition if blocks is None else blocks.any(condition)


def all_of(blocks: Blocks | None, condition: Array) -> Array:
    """Whether the condition holds in all slabs; the condition itself on one device."""
    return condition if blocks is None else ~blocks.any(~condition)
