"""Search by levels of size: tables of cells for every level, for grains of very different sizes.

With one table of cells as wide as the largest grain, a small grain would look at all small grains in such a cell. So
the grains are sorted into levels of size. A level has two tables. In the one, with cells as wide as its largest grain,
its own grains look for each other. In the other, whose cells are narrower, the smaller grains of all finer levels look
for its grains. So a pair is looked for by its smaller grain, its owner (of two equal ones by that of the lower index),
and found once. Few grains as large as itself have room about a grain, so an owner has few pairs, and a large grain
among thousands of small ones looks for none of them.

A pair is listed if the gap between the two is below that at which they attract each other, and a skin.

Source: V. Ogarko, S. Luding, Comput. Phys. Commun. 183 (2012) 931-936 (cells by levels of size, searched from the
finer to the coarser level).
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxdem.numerics.host import namespace
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.cells import CellGrid, column_table
from jaxdem.particles.pairs import at

ROUNDING = 1e-6
"""Of a radius, so that a grain in float32 is in its level."""


@static
class SizeLevels:
    """Levels of size; static.

    Attributes:
        radii: largest radius of each level, ascending [m].
        gap: at which two grains attract each other, 0 without cohesion [m].
        own: number of cells along each axis, of every level, in which its own grains look for each other.
        across: the same, of every level but the finest, in which the grains of finer levels look for its grains.
        single_skin: skin of a list without levels [m].
    """

    radii: tuple[float, ...]
    gap: float
    own: tuple[tuple[int, ...], ...]
    across: tuple[tuple[int, ...], ...]
    single_skin: float

    @classmethod
    def of(
        cls, radii: tuple[float, ...], gap: float, skin: float, box: tuple[float, ...], single_skin: float
    ) -> SizeLevels:
        """Levels up to these radii; `skin` is that of their list [m]."""

        def cells(touching: float) -> tuple[int, ...]:
            return CellGrid(box, (False,) * len(box), touching * (1.0 + ROUNDING) + gap + skin, 0).shape

        own = tuple(cells(2.0 * radius) for radius in radii)
        across = tuple(cells(finer + radius) for finer, radius in zip(radii, radii[1:], strict=False))
        return cls(radii, gap, own, across, single_skin)

    def of_radius(self, radius: Array) -> Array:
        """(N,) int32 number of the level that grains of radius (N,) [m] are in, 0 for the finest."""
        xp = namespace(radius)
        level = xp.zeros(radius.shape, np.int32)
        for largest in self.radii[:-1]:
            level = level + (radius > largest * (1.0 + ROUNDING)).astype(np.int32)
        return level


@static
class LevelTables:
    """The tables of all levels over a box; static.

    Attributes:
        levels: of size.
        box: side lengths [m].
        periodic: whether each axis is periodic.
        particles: their number.
    """

    levels: SizeLevels
    box: tuple[float, ...]
    periodic: tuple[bool, ...]
    particles: int

    @property
    def kinds(self) -> tuple[list[CellGrid], list[CellGrid]]:
        """In which grains look for those of their own level; and for those of coarser ones, of all levels but one."""
        own, across = (
            [CellGrid(self.box, self.periodic, 0.0, self.particles, shape) for shape in shapes]
            for shapes in (self.levels.own, self.levels.across)
        )
        return own, across

    def homes(self, position: Vector, level: Array) -> tuple[Array, Array]:
        """(N,) column that each grain is in, of the tables of both kinds; beyond the last for none."""
        xp, found = namespace(position[0]), []
        for grids, first in zip(self.kinds, (0, 1), strict=True):
            home, begin = xp.full(level.shape, columns_of(grids), np.int32), 0
            for number, grid in enumerate(grids):
                home = xp.where(level == first + number, begin + grid.flat(grid.cells(position)), home)
                begin += grid.columns
            found.append(home)
        return found[0], found[1]

    def around(self, position: Vector, level: Array) -> tuple[Array, Array]:
        """(1, M, N) and (L - 1, M, N) columns of both kinds in which each grain looks; beyond the last for none."""
        most, (own, across) = 3 ** len(self.box), self.kinds

        def columns(grid: CellGrid, begin: int, nothing: int) -> Array:
            found = begin + grid.around(grid.cells(position))
            return jnp.pad(found, ((0, most - len(found)), (0, 0)), constant_values=nothing)

        begin, nothing = 0, columns_of(own)
        among_own = jnp.full((most, self.particles), nothing, jnp.int32)
        for number, grid in enumerate(own):
            among_own = jnp.where(level[None] == number, columns(grid, begin, nothing), among_own)
            begin += grid.columns
        begin, nothing, others = 0, columns_of(across), []
        for number, grid in enumerate(across):
            others.append(jnp.where(level[None] <= number, columns(grid, begin, nothing), nothing))
            begin += grid.columns
        return among_own[None], jnp.stack(others) if others else jnp.zeros((0, most, self.particles), jnp.int32)

    def owned(
        self,
        position: Vector,
        radius: Array,
        skin: Array | float,
        slots: int,
        rows: tuple[int, int],
        active: Array | None = None,
        who: Array | None = None,
    ) -> tuple[Array, Array]:
        """The other of all pairs that every particle owns; jittable.

        Args:
            position: D arrays (N,), in the box [m].
            radius: (N,) [m].
            skin: of the list [m].
            slots: K, room for pairs that a particle owns.
            rows: room for particles in a column, of the tables of both kinds.
            active: (N,) bool, which particles there are; all if None.
            who: (N,) int32, in a slab the identity i of its own particles and -1 - i of ghosts. Of two equal particles
                that of the lower identity owns the pair, so that all slabs agree, and two ghosts are no pair. On one
                device, None, the identity is the index.

        Returns:
            (K, N) int32 with the particle itself in empty slots, the last ones; and () bool: there was not enough room.
        """
        level = self.levels.of_radius(radius)
        homes, around = self.homes(position, level), self.around(position, level)
        if active is not None:
            position = tuple(jnp.where(active, x, jnp.nan) for x in position)
        reach = radius + (self.levels.gap + skin)
        crowded, words, tables = jnp.zeros((), bool), [], []
        for kind, (grids, home, cells) in enumerate(zip(self.kinds, homes, around, strict=True)):
            if not grids:
                continue
            nobody = columns_of(grids)
            there = home if active is None else jnp.where(active, home, nobody)
            rows_of, full = column_table(nobody, there, rows[kind])
            sizes = (nobody,) if kind == 0 else tuple(grid.columns for grid in grids)
            filled = _filled_rows(rows_of < self.particles, sizes)
            table = _Table(jnp.pad(rows_of, ((0, 0), (0, 1)), constant_values=self.particles), cells, filled)
            words.append(self._words(position, radius, reach, table, kind == 0, who))
            crowded = crowded | full
            tables.append(table)
        index, most = self._picked(jnp.concatenate(words), tables, slots)
        return index, crowded | (most > slots)

    def _picked(self, words: Array, tables: list[_Table], slots: int) -> tuple[Array, Array]:
        """(K, N) the particles of the first bits that are set in each column of words, its own in empty slots; and ()
        the most that are set.

        Slot by slot: a particle owns few, and there are many words, nearly all of them empty.
        """
        own = jnp.arange(self.particles, dtype=jnp.int32)
        most = jnp.max(jnp.sum(lax.population_count(words), axis=0)).astype(jnp.int32)

        def fill(slot: Array, both: tuple[Array, Array]) -> tuple[Array, Array]:
            words, index = both
            number = jnp.argmax(words > 0, axis=0).astype(jnp.int32)
            word = words[number, own]
            bit = lax.population_count((word & -word) - 1).astype(jnp.int32)
            found, begin = own, 0
            for table in tables:
                groups, cells, _ = table.around.shape
                inside = jnp.clip(number - begin, 0, len(table.rows) * groups - 1)
                column = table.around[inside % groups, jnp.minimum(bit, cells - 1), own]
                found = jnp.where(number >= begin, table.rows[inside // groups, column], found)
                begin += len(table.rows) * groups
            index = index.at[slot].set(jnp.where(word > 0, found, own))
            return words.at[number, own].set(word & (word - 1)), index

        index = jnp.broadcast_to(own, (slots, self.particles))
        return lax.fori_loop(0, jnp.minimum(most, slots), fill, (words, index))[1], most

    def _words(
        self, position: Vector, radius: Array, reach: Array, table: _Table, same_level: bool, who: Array | None
    ) -> Array:
        """(R G, N) uint32, of every row of the table and group of cells around, cell by cell: is the particle owned."""
        own, far = jnp.arange(self.particles, dtype=jnp.int32), jnp.full((1,), jnp.nan, radius.dtype)
        groups, cells, _ = table.around.shape
        bit = jnp.left_shift(jnp.uint32(1), jnp.arange(cells, dtype=jnp.uint32))[:, None]
        with_far, ends = tuple(jnp.concatenate((x, far)) for x in (*position, radius)), jnp.cumsum(table.filled)

        def look(number: Array, words: Array) -> Array:
            group = jnp.sum(number >= ends, dtype=jnp.int32)
            row = number - (ends - table.filled)[group]
            holds, columns = table.rows[row], table.around[group]
            *places, size = at(at(with_far, holds), columns)
            squared = jnp.zeros(columns.shape, radius.dtype)
            for x, place, length, wraps in zip(position, places, self.box, self.periodic, strict=True):
                apart = x[None] - place
                if wraps:
                    apart = apart - length * jnp.round(apart / length)
                squared = squared + apart * apart
            near = squared < (reach[None] + size) ** 2
            if who is not None:
                other = at(at((jnp.pad(who, (0, 1)),), holds), columns)[0]
                near = near & ((who >= 0)[None] | (other >= 0))
            if same_level:
                later = at((holds,), columns)[0] > own[None] if who is None else _later(other, who[None])
                near = near & ((size > radius[None]) | ((size == radius[None]) & later))
            word = jnp.sum(jnp.where(near, bit, jnp.uint32(0)), axis=0, dtype=jnp.uint32)
            return words.at[row * groups + group].set(word)

        blank = jnp.zeros((len(table.rows) * groups, self.particles), jnp.uint32)
        return lax.fori_loop(0, ends[-1], look, blank)


def _later(other: Array, who: Array) -> Array:
    """Whether the identity of the other is higher, see `LevelTables.owned`."""
    one, another = (jnp.where(x < 0, -1 - x, x) for x in (who, other))
    return another > one


class _Table(NamedTuple):
    """A table of columns, and who looks where.

    Attributes:
        rows: (R, C + 1) the particles of every column, N where there is none; the last column is empty.
        around: (G, M, N) columns in which each particle looks, group by group.
        filled: (G,) int32, rows that hold anybody in the columns of each group. There is room for more, which nobody
            need look at.
    """

    rows: Array
    around: Array
    filled: Array


def _filled_rows(there: Array, sizes: tuple[int, ...]) -> Array:
    """(G,) int32 rows that hold anybody, of (R, C) columns in groups of these sizes; a column fills from the first."""
    groups = jnp.split(there, np.cumsum(sizes)[:-1], axis=1)
    return jnp.stack([jnp.sum(jnp.any(group, axis=1), dtype=jnp.int32) for group in groups])


def columns_of(grids: list[CellGrid]) -> int:
    """Columns of all tables."""
    return sum(grid.columns for grid in grids)
