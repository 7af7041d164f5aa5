"""Pairs in reach, found by sorting the particles into cells; jittable, with fixed capacities.

The pairs are those of jax-md's list, found in a fifth of its time: a cell keeps its particles in a column of a small
table, filled by one scatter-minimum per row; a particle marks those of the cells around it that are in reach
as bits of a word per cell; and slot k of its list is the k-th bit that is set. Nothing is sorted, and only as
many numbers are scattered as there are particles.

In a large box that is nearly empty there are far more cells than particles. There the table has fewer columns, and
far cells share one: the distance tells their particles apart. A cell finds its column by a sum of its indices
times multipliers, modulo the number of columns (a lattice as of N. M. Korobov, Dokl. Akad. Nauk SSSR 124 (1959)
1207-1210), which is as quick as a row-major index and keeps cells apart that are near each other.
"""

from __future__ import annotations

import functools
import itertools
import math
import operator

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxdem.numerics.host import namespace
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.pairs import WRITTEN_OUT, at, last_up_to

WORD = 32
"""Bits of a word; a cell with more slots takes several words."""

MOST_PER_AXIS = 2**16
"""Cells along an axis; beyond, the rounding of a position in float32 would be a part of a cell that matters."""

OWN_COLUMNS = 2**17
"""Up to so many cells each has a column of its own, ..."""

COLUMNS_PER_PARTICLE = 8
"""... and up to so many times the number of particles; with more, cells share columns."""

SHARED_COLUMN_ROOM = 2
"""Room for particles of other cells where cells share columns."""

NEAR_CELLS = 12
"""Two cells nearer than so many cells along every axis never share a column; across a periodic side two around one."""


@static
class CellGrid:
    """Cells at least as wide as the reach, over a box; static.

    Attributes:
        box: side lengths [m].
        periodic: whether each axis is periodic.
        reach: pairs nearer than this are listed [m].
        particles: their number, which says how many columns of the table are worth their memory.
        per_axis: number of cells along each axis; as many as the reach allows if None. With it the reach may be traced.
    """

    box: tuple[float, ...]
    periodic: tuple[bool, ...]
    reach: float
    particles: int
    per_axis: tuple[int, ...] | None = None

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of cells along each axis."""
        if self.per_axis is not None:
            return self.per_axis
        return tuple(min(MOST_PER_AXIS, max(1, math.floor(length / self.reach))) for length in self.box)

    @property
    def columns(self) -> int:
        """Number of columns of the table: that of the cells, or a power of two where cells share them."""
        cells = math.prod(self.padded_shape)
        most = max(OWN_COLUMNS, COLUMNS_PER_PARTICLE * self.particles)
        return cells if cells <= most else min(cells, 2 ** math.ceil(math.log2(most)))

    @property
    def shares(self) -> bool:
        """Whether far cells share columns."""
        return self.columns < math.prod(self.padded_shape)

    @property
    def padded_shape(self) -> tuple[int, ...]:
        """The same with an empty cell beyond either side that is not periodic."""
        return tuple(n if wraps else n + 2 for n, wraps in zip(self.shape, self.periodic, strict=True))

    def cells(self, position: Vector) -> Vector:
        """Indices (N,) along each axis, in the padded grid, of the cells that the particles are in.

        A particle outside of a side that is not periodic counts to the cell at the side: that brings no
        particle further from another, so that no pair is missed.
        """
        found = []
        for x, length, n, wraps in zip(position, self.box, self.shape, self.periodic, strict=True):
            xp = namespace(x)
            cell = xp.floor(x * (n / length)).astype(xp.int32)
            found.append(xp.mod(cell, n) if wraps else xp.clip(cell, 0, n - 1) + 1)
        return tuple(found)

    def around(self, cells: Vector) -> Array:
        """(M, N) columns of the M cells in which neighbours are looked for; the own cell is the first."""
        # Along an axis of the result for every axis of the box: cells are moved once an axis, not once for each of M.
        dimension, moved = len(cells), []
        for axis, (cell, n, wraps) in enumerate(zip(cells, self.shape, self.periodic, strict=True)):
            offsets = np.array(_offsets(n, wraps), np.int32)
            step = offsets.reshape([-1 if k == axis else 1 for k in range(dimension + 1)])
            along = cell.reshape((1,) * dimension + cell.shape) + step
            moved.append(jnp.mod(along, n) if wraps else along)
        found = self.flat(tuple(moved))
        return found.reshape(math.prod(found.shape[:-1]), found.shape[-1])

    def flat(self, cells: Vector) -> Array:
        """(N,) column of the table: the row-major index in the padded grid, or one shared with far cells."""
        if self.shares:
            periods = tuple(n if wraps else 0 for n, wraps in zip(self.shape, self.periodic, strict=True))
            multipliers = _multipliers(periods, self.columns)
            terms = [cell.astype(np.uint32) * np.uint32(m) for cell, m in zip(cells, multipliers, strict=True)]
            # Of a power of two the overflow of 32 bits is a multiple.
            return (functools.reduce(operator.add, terms) & np.uint32(self.columns - 1)).astype(np.int32)
        index = cells[0]
        for cell, n in zip(cells[1:], self.padded_shape[1:], strict=True):
            index = index * n + cell
        return index

    def largest_occupancy(self, position: Vector) -> int:
        """Largest number of particles in a column; not jittable."""
        position = jax.tree.map(np.asarray, position)
        return int(np.bincount(np.asarray(self.flat(self.cells(position)))).max(initial=0))

    def dense_occupancy(self, spacing: float) -> int:
        """Number of particles in a column where they fill a square lattice of this spacing [m]."""
        widths = (length / n for length, n in zip(self.box, self.shape, strict=True))
        dense = math.prod(math.floor(width / spacing) + 1 for width in widths)
        return dense + SHARED_COLUMN_ROOM if self.shares else dense


def neighbors_in_cells(
    grid: CellGrid,
    position: Vector,
    slots: int,
    cell_slots: int,
    active: Array | None = None,
    members: int = 1,
    reaches: Array | None = None,
) -> tuple[Array, Array]:
    """Indices of all particles in reach of every particle.

    Args:
        grid: the cells.
        position: D arrays (N,) [m].
        slots: K, room for neighbours of a particle.
        cell_slots: room for particles in a column.
        active: (N,) bool, which particles there are; all if None. The others are in no cell and reach nobody.
        members: m, rows of a body, every N/m-th; they do not reach each other.
        reaches: (N,) how far each reaches: two are in reach of each other if they are nearer than both together, at
            most the reach of the grid; None for that of the grid [m].

    Returns:
        (K, N) int32 with the particle itself in empty slots, and () bool: there was not enough room.
    """
    own = jnp.arange(position[0].shape[0], dtype=jnp.int32)
    cells = grid.cells(position)
    home = grid.flat(cells)
    if active is not None:
        home = jnp.where(active, home, grid.columns)  # beyond the last one
        position = tuple(jnp.where(active, x, jnp.nan) for x in position)
    table, crowded = column_table(grid.columns, home, cell_slots)
    around = grid.around(cells)
    words = _words(grid, position, own, table, around, members, reaches)
    slot, number, bit, total = picked(words, own, slots, min(cell_slots, WORD))
    block, cell = number // len(around), number % len(around)
    row = jnp.minimum(block * WORD + bit, cell_slots - 1)  # where no bit is set, anything inside the table
    found = table[row, around[cell, own[None]]]
    return jnp.where(slot < total[None], found, own[None]), crowded | (jnp.max(total) > slots)


def picked(words: Array, own: Array, slots: int, bits: int) -> tuple[Array, Array, Array, Array]:
    """Word and bit of the first `slots` set bits of every column of words.

    Args:
        words: (W, N) uint32.
        own: (N,) int32, 0 ... N - 1.
        slots: K.
        bits: that a word has at most.

    Returns:
        (K, 1) int32, 0 ... K - 1; (K, N) int32 the word and the bit, anything where fewer bits are set; and (N,) how
        many are set.
    """
    counts = lax.population_count(words).astype(jnp.int32)
    slot = jnp.arange(slots, dtype=jnp.int32)[:, None]
    if len(words) > WRITTEN_OUT:
        upto = jnp.cumsum(counts, axis=0, dtype=jnp.int32)
        before, total = upto - counts, upto[-1]
        wanted = jnp.broadcast_to(slot, (slots, len(own)))
        number = last_up_to(before, own[None], wanted)
        found, first = at((words.reshape(-1), before.reshape(-1)), number * len(own) + own[None])
        word, rank = found, wanted - first
    else:
        word = jnp.zeros((slots, len(own)), jnp.uint32)
        number, rank = jnp.zeros(word.shape, jnp.int32), jnp.zeros(word.shape, jnp.int32)
        total = jnp.zeros_like(own)
        for k, (bits_of, count) in enumerate(zip(words, counts, strict=True)):
            here = (slot >= total[None]) & (slot < (total + count)[None])
            word, number = jnp.where(here, bits_of[None], word), jnp.where(here, k, number)
            rank = jnp.where(here, slot - total[None], rank)
            total = total + count
    for k in range(bits - 1):
        word = jnp.where(rank > k, word & (word - 1), word)  # takes the lowest bit away
    return slot, number, lax.population_count((word & -word) - 1).astype(jnp.int32), total


def _offsets(cells: int, periodic: bool) -> tuple[int, ...]:
    """Steps to the cells around, own first; fewer where the period is under three cells."""
    if not periodic:
        return (0, -1, 1)
    return (0, -1, 1)[:cells]


@functools.cache
def _multipliers(periods: tuple[int, ...], columns: int) -> tuple[int, ...]:
    """1, a, a^2 modulo the columns, of the first odd a from the golden section down that keeps near cells apart.

    Args:
        periods: cells along every periodic axis, 0 for the others. Cells around one at a side are a period apart, less
            the steps between them.
        columns: a power of two.
    """
    dimension = len(periods)
    near = [range(-2, 3), range(-NEAR_CELLS, NEAR_CELLS + 1)]
    across = [
        {*near[0], *(sign * (n - k) for n in [period] if n for k in (1, 2) for sign in (-1, 1))} for period in periods
    ]
    steps = np.array([*itertools.product(near[1], repeat=dimension), *itertools.product(*across)]).T
    steps = steps[:, np.any(steps != 0, axis=0)]
    for a in range(2 * round(columns * (math.sqrt(5.0) - 1.0) / 4.0) + 1, 1, -2):
        multipliers = tuple(pow(a, power, columns) for power in range(dimension))
        if np.all(np.mod(np.array(multipliers) @ steps, columns)):
            return multipliers
    raise AssertionError(f"no multipliers for {columns} columns")  # pragma: no cover


def column_table(columns: int, home: Array, cell_slots: int) -> tuple[Array, Array]:
    """(cell_slots, columns) the particles of every column, in order, N where there is none; and whether all fit.

    `home` (N,) is the column of each; one beyond the last is none.
    """
    count = home.shape[0]
    own = jnp.arange(count, dtype=jnp.int32)

    # `left` are those without a place yet; the others are sent to a column beyond the last.
    def fill_row(left: Array, _: None) -> tuple[Array, Array]:
        row = jnp.full((columns + 1,), count, jnp.int32).at[left].min(own)
        return jnp.where(row[left] == own, columns, left), row[:columns]

    left, rows = lax.scan(fill_row, home, None, length=cell_slots, unroll=min(cell_slots, WRITTEN_OUT))
    return rows, jnp.any(left < columns)


def _words(
    grid: CellGrid, position: Vector, own: Array, table: Array, around: Array, members: int, reaches: Array | None
) -> Array:
    """(words, N) uint32, bit by bit which particles of the cells around are in reach; the cells first."""
    far = jnp.full((1,), jnp.nan, position[0].dtype)  # in reach of nothing

    def of_rows(rows: Array) -> Array:
        """(M, N) the words of up to `WORD` rows of the table."""
        columns = [jnp.concatenate((x, far))[rows] for x in position]
        others = None if reaches is None else jnp.concatenate((reaches, far))[rows]
        word = jnp.zeros(around.shape, jnp.uint32)
        itself = jnp.zeros(own.shape, jnp.uint32)
        for bit, row in enumerate(rows):
            squared = jnp.zeros(around.shape, position[0].dtype)
            for x, column, length, wraps in zip(position, columns, grid.box, grid.periodic, strict=True):
                apart = x[None] - column[bit][around]
                if wraps:
                    apart = apart - length * jnp.round(apart / length)
                squared = squared + apart * apart
            mark = jnp.uint32(1 << bit)
            reach = grid.reach if reaches is None or others is None else reaches[None] + others[bit][around]
            near = squared < reach**2
            if members > 1:
                bodies = len(own) // members
                near = near & (row[around] % bodies != own[None] % bodies)
            word = word | jnp.where(near, mark, jnp.uint32(0))
            itself = itself | jnp.where(row[around[0]] == own, mark, jnp.uint32(0))
        return word.at[0].set(word[0] & ~itself)

    if len(table) <= WORD:
        return of_rows(table)
    # One word after the other by one piece of program; rows that fill the last one are empty.
    full = jnp.pad(table, ((0, -len(table) % WORD), (0, 0)), constant_values=len(own))
    blocks = lax.map(of_rows, full.reshape(-1, WORD, full.shape[1]))
    return blocks.reshape(-1, *own.shape)
