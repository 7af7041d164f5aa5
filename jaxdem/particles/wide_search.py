"""Who is near whom, farther out than contacts reach: particles of a cell look together.

`cells` fetches what is in the cells around for each particle by itself, which suits the reach of contacts, with few
particles in a cell. Within a reach of several diameters there are tens to hundreds in a cell. Here up to `BLOCK`
particles of a cell are a block, what is in the cells around is fetched once for a block, and all of its particles are
compared with it by plain arithmetic.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array, lax

from jaxdem.numerics.vectors import Vector
from jaxdem.particles.cells import WORD, CellGrid
from jaxdem.particles.pairs import at

BLOCK = 8
"""Particles of a block. Larger ones have more empty rows, smaller ones fetch more often."""
BLOCKS_AT_ONCE = 64
"""Blocks that look at once: what they look at then stays in the cache."""
LISTED_AT_ONCE = 256
"""Particles whose neighbours are listed at once."""
UNROLLED = 16
"""Words that are gone through without a look at the memory."""


class Region(NamedTuple):
    """An ellipsoid about a particle with an axis of symmetry.

    Attributes:
        along: half of its length along the axis [m].
        across: half of its width [m].
    """

    along: float
    across: float

    @property
    def reach(self) -> float:
        """Distance of its farthest points [m]."""
        return max(self.along, self.across)


class _Blocks(NamedTuple):
    """Particles that look together; T blocks of B rows.

    Attributes:
        member: (T, B) int32, the particle of each row; the number of those who look where there is none.
        row: (L,) int32, t B + b of each who looks; T B for one that is not there.
        around: (M, T) int32, columns of the cells around, own first.
    """

    member: Array
    row: Array
    around: Array


class _Sorted(NamedTuple):
    """Particles by columns, those of one in a row.

    Attributes:
        order: (N,) int32, the particles.
        start: (columns + 1,) int32, place of the first of a column; the last is of those that are not there.
        held: (columns + 1,) int32, their numbers.
        rank: (N,) int32, place of each particle in its column.
    """

    order: Array
    start: Array
    held: Array
    rank: Array


def neighbors_in_regions(
    grid: CellGrid,
    position: Vector,
    axis: Vector,
    regions: Sequence[Region],
    slots: int,
    cell_slots: int,
    active: Array | None = None,
) -> tuple[Array, Array]:
    """Who is in one of the regions about each of the first L particles.

    Args:
        grid: cells as wide as the longest region at least.
        position: three arrays (N,) [m].
        axis: of the regions of each particle that looks, a unit vector, three arrays (L,).
        regions: about each.
        slots: K, room for neighbours of a particle.
        cell_slots: C, room for particles in a column.
        active: (N,) bool, which particles there are; all if None.

    Returns:
        (L, K) int32 with the particle itself in empty slots, and (L,) bool: there was not enough room.
    """
    cells = grid.cells(position)
    home = grid.flat(cells)
    if active is not None:
        home = jnp.where(active, home, grid.columns)
    listed = _sorted(home, grid.columns)
    blocks = _blocks(grid, cells, home, listed, len(axis[0]))
    words = _words(grid, position, axis, regions, cell_slots, listed, blocks)
    others, total = _listed(words, listed, blocks, slots, cell_slots)
    crowded = jnp.any(listed.held[blocks.around] > cell_slots, axis=0)
    crowded = crowded.at[blocks.row // blocks.member.shape[1]].get(mode="fill", fill_value=False)
    return others, crowded | (total > slots)


def _sorted(home: Array, columns: int) -> _Sorted:
    """Particles by their columns (N,); the order of those in a column is that of their numbers."""
    order = jnp.argsort(home, stable=True).astype(jnp.int32)
    held = jnp.zeros(columns + 1, jnp.int32).at[home].add(1)
    start = jnp.cumsum(held) - held
    place = jnp.zeros_like(order).at[order].set(jnp.arange(len(order), dtype=jnp.int32), unique_indices=True)
    return _Sorted(order, start, held, place - start[home])


def _blocks(grid: CellGrid, cells: Vector, home: Array, listed: _Sorted, looking: int) -> _Blocks:
    """Blocks of the particles that look, the first ones of all."""
    # Of two cells that share a column, one beside a periodic side has other cells around.
    size = 1 if grid.shares else BLOCK
    most = (looking + (size - 1) * min(grid.columns, looking)) // size
    home, rank = home[:looking], listed.rank[:looking]
    held = jnp.zeros(grid.columns, jnp.int32).at[home].add(1, mode="drop")
    number = -(-held // size)
    first = (jnp.cumsum(number) - number).at[home].get(mode="fill", fill_value=most)
    row = jnp.minimum((first + rank // size) * size + rank % size, most * size)
    own = jnp.arange(looking, dtype=jnp.int32)
    member = jnp.full(most * size, looking, jnp.int32).at[row].set(own, mode="drop").reshape(most, size)
    leader = jnp.minimum(member[:, 0], looking - 1)
    return _Blocks(member, row, grid.around(tuple(cell[leader] for cell in cells)))


def _words(
    grid: CellGrid,
    position: Vector,
    axis: Vector,
    regions: Sequence[Region],
    cell_slots: int,
    listed: _Sorted,
    blocks: _Blocks,
) -> Array:
    """(L, W) uint32, bit by bit which particles of the cells around are in a region: bit b of word w is of b W + w, the
    number of cell and slot in a row."""
    nobody, size = len(position[0]), blocks.member.shape[1]
    seen = len(blocks.around) * cell_slots
    words = -(-seen // WORD)
    far = jnp.full((1,), jnp.nan, position[0].dtype)  # in reach of nothing
    places = tuple(jnp.concatenate((x[listed.order], far)) for x in position)
    owners = tuple(jnp.concatenate((x[: len(e)], far)) for x, e in zip(position, axis, strict=True))
    axes = tuple(jnp.concatenate((e, far)) for e in axis)
    slot = jnp.arange(cell_slots, dtype=jnp.int32)[None, None]

    def looked(rows: tuple[Array, Array]) -> Array:
        member, around = rows
        there = slot < listed.held[around][:, :, None]
        index = jnp.where(there, listed.start[around][:, :, None] + slot, nobody).reshape(len(member), seen)
        index = jnp.pad(index, ((0, 0), (0, words * WORD - seen)), constant_values=nobody)
        fetched = lax.optimization_barrier(at(places, lax.optimization_barrier(index)))
        others = [x.reshape(len(member), WORD, 1, words) for x in fetched]
        own, along = at(owners, member[:, :, None]), at(axes, member[:, :, None])
        found = jnp.zeros((len(member), size, words), jnp.uint32)
        for bit in range(WORD):
            apart = []
            for x, other, length, wraps in zip(own, others, grid.box, grid.periodic, strict=True):
                way = other[:, bit] - x
                apart.append(way - length * jnp.round(way * (1.0 / length)) if wraps else way)
            found = found | jnp.where(_inside(regions, apart, along), jnp.uint32(1 << bit), jnp.uint32(0))
        return found

    def block_words(rows: tuple[Array, Array]) -> Array:
        # Blocks that are not needed are the last ones.
        empty = jnp.zeros((*rows[0].shape, words), jnp.uint32)
        return lax.cond(rows[0][0, 0] < len(axis[0]), looked, lambda _: empty, rows)

    nobody_looks = len(axis[0])
    member = _in_parts(blocks.member, BLOCKS_AT_ONCE, nobody_looks)
    found = lax.map(block_words, (member, _in_parts(blocks.around.T, BLOCKS_AT_ONCE, 0)))
    found = found.reshape(-1, words).at[blocks.row].get(mode="fill", fill_value=0)
    # Its own cell is the first.
    itself = listed.rank[: len(axis[0]), None]
    mark = jnp.left_shift(jnp.uint32(1), (itself // words).astype(jnp.uint32))
    return jnp.where(jnp.arange(words)[None] == itself % words, found & ~mark, found)


def _inside(regions: Sequence[Region], apart: Sequence[Array], axis: Sequence[Array]) -> Array:
    """Whether an offset is in one of the regions."""
    squared = apart[0] ** 2 + apart[1] ** 2 + apart[2] ** 2
    along = (apart[0] * axis[0] + apart[1] * axis[1] + apart[2] * axis[2]) ** 2
    found = jnp.zeros(squared.shape, bool)
    for region in regions:
        shrunk = squared
        if region.along != region.across:
            shrunk = squared - (1.0 - (region.across / region.along) ** 2) * along
        found = found | (shrunk < region.across**2)
    return found


def _listed(words: Array, listed: _Sorted, blocks: _Blocks, slots: int, cell_slots: int) -> tuple[Array, Array]:
    """(L, K) neighbours, the particle itself in empty slots, and (L,) how many there are."""
    count, (cells, size) = len(words), (len(blocks.around), blocks.member.shape[1])
    begin = listed.start[blocks.around].T.reshape(-1)

    def of_some(rows: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        marks, own, row = rows
        seen, total = _marked(marks, slots)
        filled = jnp.arange(slots)[None] < total[:, None]
        cell = jnp.where(filled, (row // size)[:, None] * cells + seen // cell_slots, 0)
        first = lax.optimization_barrier(at((begin,), cell)[0])
        found = at((listed.order,), jnp.where(filled, first + seen % cell_slots, 0))[0]
        return jnp.where(filled, found, own[:, None]), total

    given = (words, jnp.arange(count, dtype=jnp.int32), blocks.row)
    others, total = lax.map(of_some, tuple(_in_parts(array, LISTED_AT_ONCE, 0) for array in given))
    return others.reshape(-1, slots)[:count], total.reshape(-1)[:count]


def _marked(words: Array, slots: int) -> tuple[Array, Array]:
    """Numbers b W + w of the first set bits of each row of words (L, W), any number in slots beyond; (L, slots), and
    (L,) how many bits are set.

    Each step is finished before the next: as one loop they would be done again for every use, in three times the time.
    """
    counts = lax.population_count(words).astype(jnp.int32)
    upto = jnp.cumsum(counts, axis=1, dtype=jnp.int32)
    before, slot = upto - counts, jnp.arange(slots, dtype=jnp.int32)[None]

    def passed(k: int | Array, number: Array) -> Array:
        return number + (before[:, k, None] <= slot).astype(jnp.int32)

    number = jnp.full((len(words), slots), -1, jnp.int32)
    number = lax.optimization_barrier(lax.fori_loop(0, words.shape[1], passed, number, unroll=UNROLLED))
    place = jnp.arange(len(words), dtype=jnp.int32)[:, None] * words.shape[1] + number
    word, first = at((words.reshape(-1), before.reshape(-1)), place)
    bit = _bit_of_rank(*lax.optimization_barrier((word, slot - first)))
    return lax.optimization_barrier(bit) * words.shape[1] + number, upto[:, -1]


def _bit_of_rank(word: Array, rank: Array) -> Array:
    """Place of the set bit of a word that has so many set ones below it, by halving."""
    bit = jnp.zeros_like(rank)
    for half in (16, 8, 4, 2, 1):
        low = word & jnp.uint32((1 << half) - 1)
        below = lax.population_count(low).astype(jnp.int32)
        higher = rank >= below
        bit, rank = jnp.where(higher, bit + half, bit), jnp.where(higher, rank - below, rank)
        word = jnp.where(higher, word >> half, low)
    return bit


def _in_parts(array: Array, at_once: int, empty: int) -> Array:
    """Rows (R, ...) as (parts, at_once or less, ...); those that fill the last part are `empty`."""
    parts = -(-len(array) // at_once)
    length = -(-len(array) // parts)
    padding = [(0, parts * length - len(array))] + [(0, 0)] * (array.ndim - 1)
    return jnp.pad(array, padding, constant_values=empty).reshape(parts, length, *array.shape[1:])
