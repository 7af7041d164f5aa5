"""The cells beyond a slab of the box that its particles reach, on several devices.

What particles deposit there is sent to the neighbour and added, and before an interpolation the halo is filled with the
neighbour's cells.
"""

from __future__ import annotations

import math

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.grid import Grid, along
from jaxdem.numerics.blocks import Blocks
from jaxdem.numerics.static import static


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
