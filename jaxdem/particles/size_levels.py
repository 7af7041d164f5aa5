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

import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxdem.numerics.host import namespace
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.cells import CellGrid, column_table, picked

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
    ) -> tuple[Array, Array]:
        """The other of all pairs that every particle owns; jittable.

        Args:
            position: D arrays (N,), in the box [m].
            radius: (N,) [m].
            skin: of the list [m].
            slots: K, room for pairs that a particle owns.
            rows: room for particles in a column, of the tables of both kinds.
            active: (N,) bool, which particles there are; all if None.

        Returns:
            (K, N) int32 with the particle itself in empty slots, the last ones; and () bool: there was not enough room.
        """
        own, level = jnp.arange(self.particles, dtype=jnp.int32), self.levels.of_radius(radius)
        homes, around = self.homes(position, level), self.around(position, level)
        if active is not None:
            position = tuple(jnp.where(active, x, jnp.nan) for x in position)
        reach = radius + (self.levels.gap + skin)
        crowded, words, tables = jnp.zeros((), bool), [], []
        for kind, (grids, home, cells) in enumerate(zip(self.kinds, homes, around, strict=True)):
            if not grids:
                continue
            nobody = columns_of(grids)
            table, full = column_table(nobody, home if active is None else jnp.where(active, home, nobody), rows[kind])
            table = jnp.pad(table, ((0, 0), (0, 1)), constant_values=self.particles)
            words.append(self._words(position, radius, reach, table, cells, same_level=kind == 0))
            crowded = crowded | full
            tables.append((table, cells))
        slot, number, bit, total = picked(jnp.concatenate(words), own, slots, 3 ** len(self.box))
        found, begin = jnp.broadcast_to(own, number.shape), 0
        for table, cells in tables:
            groups, most, _ = cells.shape
            inside = jnp.clip(number - begin, 0, len(table) * groups - 1)
            column = cells[inside % groups, jnp.minimum(bit, most - 1), own[None]]
            found = jnp.where(number >= begin, table[inside // groups, column], found)
            begin += len(table) * groups
        return jnp.where(slot < total[None], found, own[None]), crowded | (jnp.max(total) > slots)

    def _words(
        self, position: Vector, radius: Array, reach: Array, table: Array, around: Array, same_level: bool
    ) -> Array:
        """(R G, N) uint32, of every row of the table and group of cells around, cell by cell: is the particle owned."""
        own, far = jnp.arange(self.particles, dtype=jnp.int32), jnp.full((1,), jnp.nan, radius.dtype)
        bit = jnp.left_shift(jnp.uint32(1), jnp.arange(around.shape[1], dtype=jnp.uint32))[None, :, None]

        def of_row(row: Array) -> Array:
            squared = jnp.zeros(around.shape, radius.dtype)
            for x, length, wraps in zip(position, self.box, self.periodic, strict=True):
                apart = x[None, None] - jnp.concatenate((x, far))[row][around]
                if wraps:
                    apart = apart - length * jnp.round(apart / length)
                squared = squared + apart * apart
            size = jnp.concatenate((radius, far))[row][around]
            near = squared < (reach[None, None] + size) ** 2
            if same_level:
                later = row[around] > own[None, None]
                near = near & ((size > radius[None, None]) | ((size == radius[None, None]) & later))
            return jnp.sum(jnp.where(near, bit, jnp.uint32(0)), axis=1, dtype=jnp.uint32)

        return lax.map(of_row, table).reshape(-1, self.particles)


def columns_of(grids: list[CellGrid]) -> int:
    """Columns of all tables."""
    return sum(grid.columns for grid in grids)
