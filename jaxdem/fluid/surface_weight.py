"""What the weight of two fluids is on faces that their surface passes, so that a plane surface at rest is at rest.

Weight alone, of the mean density of two cells, has a curl where the surface lies across the mesh, and no pressure
balances a curl. With c the liquid fraction, x_f the middle of a face and overbars for means of its two cells,

    (rho_1 - rho_2) mean(c) g.e = (rho_1 - rho_2) { d[c g.x]/dx - g.x_f dc/dx },

in which the first term is the gradient of a pressure. The second one acts at the surface alone, but at the middle of
the face in place of the surface's own place x_s. So what is added is

    -(rho_1 - rho_2) g.(x_s - x_f) dc/dx,

with the gradient of the pressure. Weight and pressure then leave -(rho_1 - rho_2) g.x_s dc/dx, a gradient where
g.x_s is the same all along the surface: there it is at rest to rounding, at any angle to the mesh.

x_s is the end of a column of cells across the surface, as in `curvature`: the liquid of the column from where it is
full to where it is empty. That is exact for planes. On a face x_s is the mean of those of its two cells, of columns
along the axis of the face where they have both ends in the box, and of others where not. What is added then has no sum
along the columns, because all faces of one have its height, nor across them, because mean(H) dH is the difference of
H^2/2. With columns along one axis before others on all faces, the H^2/2 where columns along one axis meet those along
another left the weight of some two cells on a drop of any size.

Source: reduced gravity as a force of the surface with its gradient, as in the Basilisk solver (S. Popinet, Annu. Rev.
Fluid Mech. 50 (2018) 49-75, section 3); the form above, which keeps weight where no column is found, is derived here.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import Array, lax

from jaxdem.fluid.curvature import between, surface_there
from jaxdem.fluid.grid import FaceField, Grid, along, sum_of
from jaxdem.fluid.mesh import Ends, beyond, layers
from jaxdem.fluid.volume_of_fluid import surface_normal
from jaxdem.numerics.stages import stage

REACH = 4
"""Cells that a column reaches to either side of the cell in its middle: the columns of a plane that are not `STEEP` are
full and empty within four cells of the ones that it cuts and of their neighbours."""

SLIVER = 1e-3
"""A cell that lacks less than this of being full or empty ends a column: a plane that leaves so little of it does not
reach the next cell of the column [-]."""

STEEP = 0.5
"""A surface is taken for a height over the plane across an axis while this component of its normal, in cells, is at
least this part of the largest one [-]."""

_WALL = 2.0
"""Stands for cells beyond the sides of the box, and within walls."""

_BESIDE_FULL, _BESIDE_EMPTY, _AGAINST = 1, 2, 4
"""Marks of cells: a neighbour across the columns is full, or empty; the surface lies too steeply along the columns."""


class _Column(NamedTuple):
    """The surface in the columns along an axis, seen from the cells.

    Attributes:
        offset: of the surface from the middle of the cell [m].
        known: bool, whether the column has an end.
        touches: bool, whether the surface meets the wall at its end within the cell.
        free: bool, whether it is known without a wall: the column is full and empty within the box.
    """

    offset: Array
    known: Array
    touches: Array
    free: Array


def surface_weight(
    grid: Grid, fraction: Array, gravity: Array, difference: Array, closed: Array | None = None
) -> FaceField:
    """-(rho_1 - rho_2) g.(x_s - x_f) dc/dx on the faces [N/m3]; zero on the sides of the box, and where no column is
    full at one end and empty at the other.

    Args:
        grid: the grid.
        fraction: c of the liquid on the cells, of whole ones where walls cut them [-].
        gravity: (D,) [m/s2].
        difference: () of the densities, rho_1 - rho_2 [kg/m3].
        closed: bool, cells that walls fill; None without walls. A column ends there as at a side of the box.
    """
    cells = fraction if closed is None else jnp.where(closed, _WALL, fraction)
    needed = surface_there(grid, fraction) & jnp.any(gravity != 0.0)
    normal = stage(needed, lambda: surface_normal(grid, fraction))
    # Along an axis across gravity a column has no head.
    columns = [
        stage(needed & (gravity[axis] != 0.0), functools.partial(_columns, grid, cells, normal, axis))
        for axis in range(grid.dimension)
    ]
    head = stage(needed, lambda: _heads(grid, gravity, columns))
    # A closed surface has no sum along its columns then, along any axis.
    heads = [jnp.where(c.free, gravity[axis] * c.offset, head) for axis, c in enumerate(columns)]
    return tuple(
        -0.5 * difference * between(grid, axis, heads[axis], False) * between(grid, axis, fraction, True) / h
        for axis, h in enumerate(grid.spacing)
    )


def _heads(grid: Grid, gravity: Array, columns: Sequence[_Column]) -> Array:
    """g.(x_s - x) of every cell, x its middle; zero where no column is known [m2/s2].

    Of columns along the last axis before others, where several are known.
    Where the surface meets a wall, and its column holds less than up to the plane there, that of the next cells.
    """
    head = jnp.zeros_like(columns[0].offset)
    known = touches = jnp.zeros(head.shape, bool)
    for axis in reversed(range(grid.dimension)):
        found = columns[axis]
        head = jnp.where(found.known & ~known, gravity[axis] * found.offset, head)
        known, touches = known | found.known, touches | found.touches

    def filled(carry: tuple[Array, Array, Array], _: None) -> tuple[tuple[Array, Array, Array], None]:
        head, known, touches = carry
        total, count, beside = _of_neighbours(grid, gravity, head, known, touches)
        new = touches & ~known & (count > 0.0)
        head = jnp.where(new, total / jnp.maximum(count, 1.0), head)
        return (head, known | new, touches | beside), None

    # Also of a cell with a trace of it, and of the dry one beside: each is the next one's neighbour.
    return lax.scan(filled, (head, known, touches), None, 3)[0][0]


def _of_neighbours(grid: Grid, gravity: Array, head: Array, known: Array, touches: Array) -> tuple[Array, Array, Array]:
    """Sum over the neighbours that know it of what they know of a cell's head, their number, and whether the surface
    meets a wall in one of them."""
    total, count, beside = jnp.zeros_like(head), jnp.zeros_like(head), jnp.zeros(head.shape, bool)
    for axis, h in enumerate(grid.spacing):
        numbers = known.astype(head.dtype)
        wide = [_widened(grid, x, axis, 1, 0.0) for x in (head, numbers, touches.astype(head.dtype))]
        for sign, ends in ((-1.0, (None, -2)), (1.0, (2, None))):
            heads, there, touched = (along(w, axis, *ends) for w in wide)
            total = total + there * (heads + sign * h * gravity[axis])
            count, beside = count + there, beside | (touched > 0.0)
    return total, count, beside


def _columns(grid: Grid, cells: Array, normal: tuple[Array, ...], axis: int) -> _Column:
    """The surface by columns along an axis; `cells` are the liquid fraction, or `_WALL`."""
    count, liquid_below = cells.shape[axis], normal[axis] > 0.0
    marks = _marks(grid, cells, normal, axis)
    wide = _widened(grid, cells, axis, REACH, _WALL), _widened(grid, marks, axis, REACH, 0)
    own = jnp.where(liquid_below, cells, 1.0 - cells)
    height, known, touches, free = own, marks < _AGAINST, jnp.zeros(cells.shape, bool), cells < 1.5

    for sign, end in ((-1, 1.0), (1, 0.0)):
        dry = jnp.where(liquid_below == (end == 1.0), _BESIDE_EMPTY, _BESIDE_FULL)

        def further(carry: _Search, k: Array, sign: int = sign, end: float = end, dry: Array = dry) -> Any:
            height, known, touches, free, reached, last, last_mark = carry
            there, mark = (lax.dynamic_slice_in_dim(w, REACH + sign * k, count, axis) for w in wide)
            wall = there > 1.5
            free = free & (reached | ~wall)
            # Of the fluid that fills the lower ends of the columns.
            there = jnp.where(wall, end, jnp.where(liquid_below, there, 1.0 - there))
            height = height + jnp.where(reached, end, there)
            # What rises again belongs to another surface.
            known = known & (reached | ((sign * (there - last) < SLIVER) & (mark < _AGAINST)))
            # At a wall a column ends that has the fluid that belongs there, unless its surface meets the wall in it.
            held, meets = jnp.abs(last - end), (last_mark & dry) > 0
            touches = touches | (wall & ~reached & meets & (held < 1.0))
            ends = jnp.where(wall, ~meets & (held < 1.0 - SLIVER), jnp.abs(there - end) < SLIVER)
            last = jnp.where(wall, 1.0 - end, there)
            return _Search(height, known, touches, free, reached | ends, last, mark), None

        start = _Search(height, known, touches, free, jnp.abs(own - end) < SLIVER, own, marks)
        found, _ = lax.scan(further, start, jnp.arange(1, REACH + 1))
        height, known, touches, free = found.height, found.known & found.reached, found.touches, found.free
    offset = (height - (REACH + 0.5)) * grid.spacing[axis]
    return _Column(offset, known, touches & (marks < _AGAINST), known & free)


class _Search(NamedTuple):
    """Where the search for the end of a column has got to.

    Attributes:
        height: of the lower fluid so far, in cells.
        known, touches: see `_Column`, so far.
        free: bool, whether there was no wall before the end.
        reached: bool, whether the end is reached.
        last, mark: fraction of the lower fluid and marks of the last cell.
    """

    height: Array
    known: Array
    touches: Array
    free: Array
    reached: Array
    last: Array
    mark: Array


def _marks(grid: Grid, cells: Array, normal: tuple[Array, ...], axis: int) -> Array:
    """Marks of the cells for columns along an axis: `_BESIDE_FULL` + `_BESIDE_EMPTY` + `_AGAINST`; int8.

    Cells beside walls are against nothing: what is known of the normal there is that of the surface mirrored.
    """
    walls = (cells > 1.5).astype(cells.dtype)
    fullest, emptiest = jnp.where(cells > 1.5, 0.0, cells), jnp.where(cells > 1.5, 1.0, cells)
    for other in range(grid.dimension):
        walls = _of_three(_widened(grid, walls, other, 1, 1.0), other, jnp.maximum)
        if other != axis:
            fullest = _of_three(_continued(grid, fullest, other), other, jnp.maximum)
            emptiest = _of_three(_continued(grid, emptiest, other), other, jnp.minimum)
    largest = jnp.max(jnp.stack([jnp.abs(n) for n in normal]), axis=0)
    cut = (cells > SLIVER) & (cells < 1.0 - SLIVER)
    against = cut & (walls == 0.0) & (jnp.abs(normal[axis]) < STEEP * largest)
    marks = ((fullest > 1.0 - SLIVER, _BESIDE_FULL), (emptiest < SLIVER, _BESIDE_EMPTY), (against, _AGAINST))
    return sum_of(jnp.where(there, mark, 0).astype(jnp.int8) for there, mark in marks)


def _of_three(wide: Array, axis: int, which: Callable[[Array, Array], Array]) -> Array:
    """The largest or smallest of each cell and its two neighbours along an axis."""
    return which(which(along(wide, axis, None, -2), along(wide, axis, 1, -1)), along(wide, axis, 2, None))


def _continued(grid: Grid, cells: Array, axis: int) -> Array:
    """Cells with a layer beyond either end of an axis, in a straight line at the sides of the box: there a fraction of
    a plane is no less than full, or no more than empty, than it would be."""
    second = min(1, cells.shape[axis] - 1)

    def outside() -> Ends:
        first, last = (
            2.0 * layers(cells, axis, (k,)) - layers(cells, axis, (n,)) for k, n in ((0, second), (-1, -1 - second))
        )
        return first, last

    ends = beyond(grid, axis, cells, (-1,), (0,), outside)
    return jnp.concatenate((ends[0], cells, ends[1]), axis)


def _widened(grid: Grid, cells: Array, axis: int, count: int, outside: float) -> Array:
    """Cells with layers beyond either end of an axis, of a value beyond the sides of the box."""
    ends = beyond(
        grid, axis, cells, tuple(range(-count, 0)), tuple(range(count)),
        lambda: (jnp.full_like(along(cells, axis, 0, 1), outside).repeat(count, axis),) * 2,
    )  # fmt: skip
    return jnp.concatenate((ends[0], cells, ends[1]), axis)
