"""A scalar that the fluid carries between surfaces within the mesh, see `cut_cells`.

A cell balances what passes its open faces and its surface, with V the volume of a whole one:

    d(W c)/dt V = - sum a F c + sum a w D (c_n - c)/h^2 V + w D R (c_w - c) V + q A

a is the open fraction of a face, q a flux that is given on the surface, A the surface of the cell. R is the exchange
with a surface that has a value c_w. It is such that c = d is kept exactly, with d the mean distance of a cell's open
part from the surface, as for the friction of the fluid:

    R d = sum a (d_n - d)/h^2 - v lap(d)

It is implicit in time. W = v g + l is the capacity of a cell for the scalar: its open part v times the void fraction g,
and l what larger cells have lent to small ones, which explicit steps could not change otherwise. The sum of l is zero.
What comes in through an opening brings its own scalar, what leaves takes that of the cell, implicit in time too.
So the sum of W c changes by what passes sides and surfaces alone, a uniform scalar stays uniform, and steady states do
not know of l; while the scalar changes, it is off its place by a cell at most. Derived here.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.grid import CellOrOne, FaceField


class ScalarWalls(NamedTuple):
    """What surfaces are to all scalars; traced.

    Attributes:
        lent: l of the cells [-].
        exchange: R of the cells [1/m2].
        area: A/V of the cells [1/m].
        value: (F, S) of every field at every surface, where it has one [unit].
        flux: (F, S) of every field from every surface; of the temperature [W/m2], else [unit m/s].
        brought: (F,) of every field in what comes in, of every opening, None of one that nothing comes in through; None
            without openings [unit].
    """

    lent: Array
    exchange: Array
    area: Array
    value: Array
    flux: Array
    brought: tuple[Array | None, ...] | None = None


class ScalarSurfaces(NamedTuple):
    """What surfaces are to one scalar over an interval.

    Attributes:
        open_faces: a of the faces [-].
        open_cells: v of the cells [-].
        lent: l of the cells [-].
        rate: w D R of the cells, zero where the surface has no value [1/s].
        value: c_w of the cells [unit].
        supply: q A/V of the cells [unit/s].
        nearest: int32, number of the surface of every cell.
        number: of surfaces; static.
        drain: volume that leaves the cells through openings, over that of a whole one; None without openings [1/s].
    """

    open_faces: FaceField
    open_cells: Array
    lent: Array
    rate: Array
    value: Array
    supply: Array
    nearest: Array
    number: int
    drain: Array | None = None

    def capacity(self, void_fraction: CellOrOne) -> Array:
        """W of the cells; 1 in those without fluid [-]."""
        return capacity_of(self.open_cells, self.lent, void_fraction)

    def after(self, content: Array, capacity: Array, step: Array) -> tuple[Array, Array]:
        """The scalar after a step, and what the surfaces have given in it, over the volume of a cell [unit].

        Args:
            content: W c with what has passed the faces [unit].
            capacity: W [-].
            step: [s].
        """
        lost = self.rate if self.drain is None else self.rate + self.drain
        value = (content + step * (self.rate * self.value + self.supply)) / (capacity + step * lost)
        given = self.rate * (self.value - value) + self.supply
        return value, step * (given if self.drain is None else given - self.drain * value)

    def by_surface(self, cells: Array) -> Array:
        """(S,) sums over the cells of every surface."""
        return jnp.zeros(self.number, cells.dtype).at[self.nearest.reshape(-1)].add(cells.reshape(-1))


def capacity_of(open_cells: Array, lent: Array, void_fraction: CellOrOne) -> Array:
    """W of the cells; 1 in those without fluid [-]."""
    return jnp.where(open_cells > 0.0, open_cells * void_fraction + lent, 1.0)
