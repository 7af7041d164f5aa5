"""A multigrid cycle as the preconditioner of a pressure problem whose coefficient jumps by orders of magnitude.

The fast inverse of `pressure` knows one coefficient. With two fluids whose densities differ by a thousand it needs a
hundred iterations and more; the cycle here needs as many as with equal densities. On every level

    (A p)_i = sum over the faces of cell i of g (p_i - p_j),

with g the coefficient over the square of the distance of the cells, p_j = 0 beyond an outlet and g = 0 on other sides.
A coarse cell is made of two cells along an axis, or of the last one where their number is odd. Its conductance to
the next is half the sum of those of the faces between: the sum would be that of a constant correction in either cell,
which is twice as stiff as one that is smooth. Axes along which cells are longer than along others wait until these are
as long: a Jacobi step damps waves along the axis of the large conductances alone. Two damped Jacobi steps before and
after a correction make the cycle symmetric, as conjugate gradients ask for. The coarsest level is inverted.

On several devices the cells are those of a slab as long as two of them lie in one slab. From the first level with few
cells, or with an odd number of them in a slab, every device has the whole level. The levels are those of one device.

Source: O. Tatebe, Proc. 6th Copper Mountain Conf. on Multigrid Methods, NASA CP-3224 (1993) 621-634; D. Braess,
Computing 55 (1995) 379-393 (the factor of constant corrections); U. Trottenberg, C. W. Oosterlee, A. Schueller,
Multigrid (2001), section 5.1 (axes that wait).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxdem.fluid.boundary import Boundary, open_fraction
from jaxdem.fluid.grid import FaceField, Grid, along, sum_of
from jaxdem.fluid.mesh import of_slab, with_ends
from jaxdem.numerics.blocks import Blocks
from jaxdem.numerics.products import PRECISION
from jaxdem.numerics.stages import stage

COARSEST = 40
"""Cells of a level that is inverted."""

FEW = 256
"""Cells of a level that every device has as a whole: less work than messages."""

STEPS = 2
"""Jacobi steps before, and after, a correction."""

STRETCHED = 1.5
"""Length of a cell along an axis, over that along the shortest one, from which on the axis waits."""

DAMPING = 0.8
"""Of a Jacobi step: it damps waves of two cells as well as those of four."""


class _Level(NamedTuple):
    """A mesh of the hierarchy.

    Attributes:
        faces: conductances, on the faces of every axis; those of sides included.
        periodic: whether each axis is; static.
        spacing: sides of a cell; static [m].
        blocks: slabs that it is cut into; None of a whole one; static.
        open_somewhere: () bool, where cells may be closed; None where all are open.
    """

    faces: FaceField
    periodic: tuple[bool, ...]
    spacing: tuple[float, ...]
    blocks: Blocks | None = None
    open_somewhere: Array | None = None

    @property
    def cells(self) -> tuple[int, ...]:
        """Number of cells per axis, of the slab."""
        return tuple(g.shape[axis] - 1 for axis, g in enumerate(self.faces))

    @property
    def whole_cells(self) -> tuple[int, ...]:
        """Number of cells of the box per axis."""
        cut = self.blocks
        return tuple(n * (cut.number if cut and axis == cut.axis else 1) for axis, n in enumerate(self.cells))

    @property
    def diagonal(self) -> Array:
        """Of the matrix, on the cells."""
        found: Array = sum_of(along(g, a, None, -1) + along(g, a, 1, None) for a, g in enumerate(self.faces))
        return found

    def off_diagonal(self, p: Array) -> Array:
        """Sum of conductance times neighbour."""
        wide, terms = _with_halo(p, self.periodic, self.blocks), []
        inner = [slice(1, -1)] * p.ndim
        for axis, g in enumerate(self.faces):
            below, above = list(inner), list(inner)
            below[axis], above[axis] = slice(None, -2), slice(2, None)
            terms.append(along(g, axis, None, -1) * wide[tuple(below)] + along(g, axis, 1, None) * wide[tuple(above)])
        found: Array = sum_of(terms)
        return found

    @property
    def halved(self) -> tuple[bool, ...]:
        """Along which axes the next level has half as many cells: where these are short, and more than one."""
        cells = self.whole_cells
        shortest = min(h for h, n in zip(self.spacing, cells, strict=True) if n > 1)
        return tuple(n > 1 and h < STRETCHED * shortest for h, n in zip(self.spacing, cells, strict=True))

    def coarser(self) -> _Level:
        """The next level."""
        halved, faces = self.halved, []
        for axis, g in enumerate(self.faces):
            for other, halves in enumerate(halved):
                if halves and other != axis:
                    g = _in_pairs(g, other)
            if halved[axis]:
                count = g.shape[axis] - 1
                inner = along(g, axis, None, -1)[(slice(None),) * axis + (slice(None, None, 2),)]
                g = 0.5 * jnp.concatenate((inner, along(g, axis, count, None)), axis)
            faces.append(g)
        spacing = tuple(2.0 * h if halves else h for h, halves in zip(self.spacing, halved, strict=True))
        return _Level(tuple(faces), self.periodic, spacing, self.blocks).whole_if_needed()

    def whole_if_needed(self) -> _Level:
        """The level, whole where it has few cells or the next one cannot be made in slabs."""
        cut = self.blocks
        if cut is None:
            return self
        straddles = self.halved[cut.axis] and self.cells[cut.axis] % 2 == 1
        if not straddles and math.prod(self.whole_cells) > FEW:
            return self
        faces = tuple(_whole(cut, g, int(axis == cut.axis)) for axis, g in enumerate(self.faces))
        return self._replace(faces=faces, blocks=None)


def multigrid(
    grid: Grid, boundary: Boundary, coefficient: tuple[Array | float, ...], closed: bool = False
) -> Callable[[Array], Array]:
    """An approximate inverse of -div(coefficient grad), as a function of a cell array.

    Args:
        grid: the grid.
        boundary: sides; p = 0 on outlets, no flux through the others.
        coefficient: positive, on the faces.
        closed: whether it may be zero on all faces of a cell, which is then left as it is. The others hang together.
    """
    faces = []
    for axis, c in enumerate(coefficient):
        g = jnp.broadcast_to(jnp.asarray(c), grid.face_shape(axis)) / grid.spacing[axis] ** 2
        if not grid.periodic[axis]:
            ends = []
            for upper in (False, True):
                is_open = of_slab(grid, open_fraction(grid, boundary.side(axis, upper)), g.dtype)
                ends.append(2.0 * is_open * along(g, axis, *((-1, None) if upper else (0, 1))))
            g = with_ends(grid, axis, g, (ends[0], ends[1]))
        faces.append(g)
    levels = [_Level(tuple(faces), grid.periodic, grid.spacing, grid.blocks).whole_if_needed()]
    while math.prod(levels[-1].whole_cells) > COARSEST:
        levels.append(levels[-1].coarser())
    damped = [_damping(level.diagonal, closed) for level in levels[:-1]]
    lowest = _inverse(levels[-1], singular=not boundary.has_outlet, closed=closed)
    if closed:  # the first cell too
        levels = [level._replace(open_somewhere=jnp.any(level.diagonal > 0.0)) for level in levels]
    return lambda residual: _cycle(levels, damped, lowest, residual, grid.blocks)


def _damping(diagonal: Array, closed: bool) -> Array:
    """Of a Jacobi step over the diagonal; zero in closed cells."""
    if not closed:
        return DAMPING / diagonal
    there = diagonal > 0.0
    return jnp.where(there, DAMPING / jnp.where(there, diagonal, 1.0), 0.0)


def _cycle(
    levels: list[_Level], damped: list[Array], lowest: Array, residual: Array, blocks: Blocks | None = None
) -> Array:
    """One cycle from zero on the first of some levels; `blocks` are the slabs of the residual."""
    if blocks is not None and levels[0].blocks is None:
        found = _cycle(levels, damped, lowest, _whole(blocks, residual))
        count = residual.shape[blocks.axis]
        return lax.dynamic_slice_in_dim(found, blocks.index() * count, count, blocks.axis)
    if len(levels) == 1:
        flat = jnp.matmul(lowest, residual.reshape(-1), precision=PRECISION)
        return flat.reshape(residual.shape)
    level, step = levels[0], damped[0]

    def smoothed(_: int, p: Array) -> Array:
        # p + step (residual - A p), whose diagonal part is known.
        return (1.0 - DAMPING) * p + step * (residual + level.off_diagonal(p))

    # Loops and stages, and not one expression: XLA would fuse that into one loop over cells, which computes every step
    # anew for each neighbour that asks for it, six times as long in all. The first step is from zero.
    def begun() -> Array:
        return lax.fori_loop(1, STEPS, smoothed, step * residual)

    # In slabs no stage: messages end what XLA fuses, and in a branch that one slab takes alone they would never come.
    needed = step[(0,) * step.ndim] > 0.0 if level.open_somewhere is None else level.open_somewhere
    p = begun() if level.blocks is not None else stage(needed, begun)
    coarse = residual - level.diagonal * p + level.off_diagonal(p)
    for axis, halves in enumerate(level.halved):
        coarse = _in_pairs(coarse, axis) if halves else coarse
    more = _cycle(levels[1:], damped[1:], lowest, coarse, blocks)
    for axis, halves in enumerate(level.halved):
        more = along(jnp.repeat(more, 2, axis), axis, 0, level.cells[axis]) if halves else more
    return lax.fori_loop(0, STEPS, smoothed, p + more)


def _with_halo(p: Array, periodic: tuple[bool, ...], blocks: Blocks | None) -> Array:
    """The array with one layer more on either end of every axis: those of the other end or slab, or zeros."""
    if blocks is None and not any(periodic):
        return jnp.pad(p, 1)
    for axis, wraps in enumerate(periodic):
        if blocks is not None and axis == blocks.axis:
            below, above = blocks.from_both(along(p, axis, 0, 1), along(p, axis, -1, None))
            p = jnp.concatenate((below, p, above), axis)
            continue
        width = [(1, 1) if a == axis else (0, 0) for a in range(p.ndim)]
        p = jnp.pad(p, width, mode="wrap") if wraps else jnp.pad(p, width)
    return p


def _whole(blocks: Blocks, own: Array, more: int = 0) -> Array:
    """An array of the cells of all slabs, or with one `more` of the faces across the axis that is cut."""
    axis, last = blocks.axis, blocks.index() == blocks.number - 1
    count = own.shape[axis] - more
    shape = tuple(count * blocks.number + more if a == axis else n for a, n in enumerate(own.shape))
    placed = lax.dynamic_update_slice_in_dim(
        jnp.zeros(shape, own.dtype), along(own, axis, 0, count), blocks.index() * count, axis
    )
    if more:
        end = jnp.where(last, along(own, axis, -1, None), 0.0)
        placed = jnp.concatenate((along(placed, axis, None, -1), end), axis)
    found: Array = blocks.total(placed)
    return found


def _in_pairs(array: Array, axis: int) -> Array:
    """Sums of two layers along an axis; the last one alone where their number is odd."""
    if array.shape[axis] % 2:
        array = jnp.pad(array, [(0, 1) if a == axis else (0, 0) for a in range(array.ndim)])
    first, second = ((slice(None),) * axis + (slice(k, None, 2),) for k in (0, 1))
    return array[first] + array[second]


def _inverse(level: _Level, singular: bool, closed: bool = False) -> Array:
    """(N, N) inverse of the matrix of a level; of one whose constants are its null space, on what has mean zero. Closed
    cells have a row of their own."""
    cells, dtype = level.cells, level.faces[0].dtype
    count = math.prod(cells)
    basis = jnp.eye(count, dtype=dtype).reshape(count, *cells)
    rows = jax.vmap(lambda p: level.diagonal * p - level.off_diagonal(p))(basis).reshape(count, count)
    if closed:
        alone = jnp.where(level.diagonal > 0.0, 0.0, jnp.trace(rows) / count).reshape(count)
        rows = rows + jnp.diag(alone)
    if singular:
        rows = rows + jnp.trace(rows) / count**2
    return jnp.linalg.inv(rows)
