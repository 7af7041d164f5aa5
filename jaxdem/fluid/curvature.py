"""Curvature of a surface between two fluids by height functions, and surface tension in balance with the pressure.

The liquid of a column of cells across the surface, from where it is full to where it is empty, is the height H of the
surface over the column. With H over the two axes across (in 2-D over one),

    kappa = -[H_xx (1 + H_y^2) + H_yy (1 + H_x^2) - 2 H_xy H_x H_y] / (1 + H_x^2 + H_y^2)^(3/2),

positive where the liquid bulges out, by central differences of 3^(D-1) columns; of second order.

Source: S. J. Cummins, M. M. Francois, D. B. Kothe, Comput. Struct. 83 (2005) 425-434; S. Popinet, J. Comput. Phys. 228
(2009) 5838-5866, section 5. The force has the gradient of the pressure, so that a drop of constant curvature is at
rest: M. M. Francois et al., J. Comput. Phys. 213 (2006) 141-173.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.grid import FaceField, Grid, along, end_faces, sum_of
from jaxdem.fluid.mesh import beyond, layers
from jaxdem.fluid.plane_cut import is_cut
from jaxdem.fluid.volume_of_fluid import surface_normal
from jaxdem.numerics.blocks import any_of
from jaxdem.numerics.stages import stage

REACH = 4
"""Cells that a column reaches to either side of the cell in its middle: a sphere's column in the direction of a corner
of the cells is three cells off. Longer ones stand so steeply on the surface that the neighbours' mean is better."""


class _Found(NamedTuple):
    """Curvature where it is known.

    Attributes:
        value: on the cells, zero where it is not known [1/m].
        known: bool, on the cells.
    """

    value: Array
    known: Array

    def or_else(self, other: _Found) -> _Found:
        """The other one where this one is not known."""
        return _Found(jnp.where(self.known, self.value, other.value), self.known | other.known)


def curvature(grid: Grid, fraction: Array) -> Array:
    """Curvature of the surface on the cells that it cuts or touches; zero elsewhere [1/m].

    By the heights of columns along the axis that stands most steeply on the surface. Where a column does not reach
    from full to empty within `REACH` cells: of columns along the other axes; else the mean of those of the neighbours
    that have one; else -div (grad c / |grad c|) of the fraction smoothed twice. At a side of the box the surface meets
    the wall at a right angle.

    Args:
        grid: the grid.
        fraction: c of the liquid on the cells [-].
    """
    return _curvature(grid, jnp.clip(fraction, 0.0, 1.0), near_surface(grid, fraction))


def _curvature(grid: Grid, fraction: Array, near: Array) -> Array:
    """See `curvature`; `near` are the cells that the surface cuts or touches.

    In stages, see `numerics.stages`: XLA would compute the heights anew for every difference, which takes ten times as
    long.
    """
    there = surface_there(grid, fraction)
    normal = stage(there, lambda: surface_normal(grid, fraction))
    # Where the surface stands most steeply on an axis by its slope in lengths, not in cells.
    slopes = [jnp.abs(m) / h for m, h in zip(normal, grid.spacing, strict=True)]
    by_axis = [stage(there, functools.partial(_of_heights, grid, fraction, axis)) for axis in range(grid.dimension)]
    largest = jnp.max(jnp.stack(slopes), axis=0)
    nothing = _Found(jnp.zeros_like(fraction), jnp.zeros(fraction.shape, bool))
    found = nothing
    for steep, (value, known) in zip(slopes, by_axis, strict=True):
        found = found.or_else(_Found(value, known & (steep >= largest)))
    for other in by_axis:
        found = found.or_else(other)
    found = _Found(jnp.where(near, found.value, 0.0), found.known & near)
    found = found.or_else(_of_neighbours(grid, found))
    found = found.or_else(_Found(_of_gradient(grid, fraction), near))
    return jnp.where(near, found.value, 0.0)


def surface_tension_gradient(grid: Grid, fraction: Array, tension: Array) -> FaceField:
    """sigma kappa grad c on the faces, the force of surface tension on a volume [N/m3]; zero on the sides of the box.

    The gradient is the one of the pressure; the curvature of a face is the mean of those of its cells that the surface
    cuts or touches.

    Args:
        grid: the grid.
        fraction: c of the liquid on the cells [-].
        tension: () sigma [N/m].
    """
    cells = stage(surface_there(grid, fraction), lambda: near_surface(grid, fraction))
    kappa, near = _curvature(grid, jnp.clip(fraction, 0.0, 1.0), cells), cells.astype(fraction.dtype)
    force = []
    for axis, h in enumerate(grid.spacing):
        slope, value, weight = (
            between(grid, axis, values, difference)
            for values, difference in ((fraction, True), (kappa * near, False), (near, False))
        )
        force.append(tension * (slope / h) * value / jnp.maximum(weight, 1.0))
    return tuple(force)


def surface_there(grid: Grid, fraction: Array) -> Array:
    """() bool, whether there are both fluids."""
    return any_of(grid.blocks, jnp.any(fraction > 0.0)) & any_of(grid.blocks, jnp.any(fraction < 1.0))


def near_surface(grid: Grid, fraction: Array) -> Array:
    """Whether the surface cuts a cell, or lies between it and a neighbour across a face; bool on the cells."""
    liquid = (fraction > 0.5).astype(fraction.dtype)
    near = is_cut(fraction)
    for axis in range(grid.dimension):
        wide = _widened(grid, liquid, axis, 1)
        near = near | (along(wide, axis, None, -2) != liquid) | (along(wide, axis, 2, None) != liquid)
    return near


def between(grid: Grid, axis: int, cells: Array, difference: bool) -> Array:
    """Difference, or sum, of the two cells of every face of an axis; zero on the sides of the box."""
    sign = -1.0 if difference else 1.0

    def of_two(below: Array, above: Array) -> Array:
        return above + sign * below

    inner = of_two(along(cells, axis, None, -1), along(cells, axis, 1, None))
    ends = end_faces(grid, axis, cells, of_two, lambda first, last: (jnp.zeros_like(first), jnp.zeros_like(last)))
    return jnp.concatenate((ends[0], inner, ends[1]), axis)


def _widened(grid: Grid, cells: Array, axis: int, count: int) -> Array:
    """Cells with layers beyond either end of an axis, mirrored at the sides of the box."""
    size = cells.shape[axis]
    below, above = tuple(range(-count, 0)), tuple(range(count))
    mirror = [min(i, size - 1) for i in above]
    ends = beyond(
        grid, axis, cells, below, above,
        lambda: (layers(cells, axis, tuple(mirror[::-1])), layers(cells, axis, tuple(-1 - i for i in mirror))),
    )  # fmt: skip
    return jnp.concatenate((ends[0], cells, ends[1]), axis)


def _of_heights(grid: Grid, fraction: Array, axis: int) -> _Found:
    """Curvature by columns along an axis: by the height of the fluid that lies below."""
    below, above = _of_lower_fluid(grid, fraction, axis), _of_lower_fluid(grid, 1.0 - fraction, axis)
    return below.or_else(above._replace(value=-above.value))


def _of_lower_fluid(grid: Grid, fraction: Array, axis: int) -> _Found:
    """Curvature of the surface of a fluid that fills the lower ends of the columns along an axis."""
    height, known = stage(surface_there(grid, fraction), lambda: _heights(grid, fraction, axis))
    height = grid.spacing[axis] * height
    across = [a for a in range(grid.dimension) if a != axis]
    first = {a: _differenced(grid, height, a, False) for a in across}
    second = {a: _differenced(grid, height, a, True) for a in across}
    square = 1.0 + sum_of(s**2 for s in first.values())
    if len(across) == 1:
        bend = second[across[0]]
    else:
        a, b = across
        mixed = _differenced(grid, first[a], b, False)
        bend = second[a] * (1.0 + first[b] ** 2) + second[b] * (1.0 + first[a] ** 2)
        bend = bend - 2.0 * mixed * first[a] * first[b]
    for a in across:
        wide = _widened(grid, known, a, 1)
        known = along(wide, a, None, -2) & known & along(wide, a, 2, None)
    value = -bend / square**1.5
    return _Found(jnp.where(known, value, 0.0), known)


def _heights(grid: Grid, fraction: Array, axis: int) -> tuple[Array, Array]:
    """Height of the fluid over the foot of the column of every cell, in cells, and whether the column is full at one
    end and empty at the other; beyond these ends it is not looked at."""
    rounding = float(jnp.finfo(fraction.dtype).eps) ** 0.75
    count = fraction.shape[axis]
    wide = _widened(grid, fraction, axis, REACH)
    height, ends = fraction, []
    for upward in (False, True):
        reached = (fraction <= rounding) if upward else (fraction >= 1.0 - rounding)
        beyond_end = 0.0 if upward else 1.0
        for k in range(1, REACH + 1):
            start = REACH + k if upward else REACH - k
            there = along(wide, axis, start, start + count)
            height = height + jnp.where(reached, beyond_end, there)
            reached = reached | ((there <= rounding) if upward else (there >= 1.0 - rounding))
        ends.append(reached)
    return height, ends[0] & ends[1]


def _differenced(grid: Grid, cells: Array, axis: int, second: bool) -> Array:
    """First or second central difference along an axis, over lengths."""
    h, wide = grid.spacing[axis], _widened(grid, cells, axis, 1)
    below, above = along(wide, axis, None, -2), along(wide, axis, 2, None)
    return (above - 2.0 * cells + below) / h**2 if second else (above - below) / (2.0 * h)


def _smoothed(grid: Grid, cells: Array, middle: float) -> Array:
    """Sum over the 3^D cells around each; its own layers count `middle` times, the next ones once."""
    for axis in range(grid.dimension):
        wide = _widened(grid, cells, axis, 1)
        cells = along(wide, axis, None, -2) + middle * cells + along(wide, axis, 2, None)
    return cells


def _of_neighbours(grid: Grid, found: _Found) -> _Found:
    """Mean over the neighbours of which it is known."""
    weight = _smoothed(grid, found.known.astype(found.value.dtype), 1.0)
    value = _smoothed(grid, found.value, 1.0)
    return _Found(value / jnp.maximum(weight, 1.0), weight > 0.0)


def _of_gradient(grid: Grid, fraction: Array) -> Array:
    """-div (grad c / |grad c|) of the smoothed fraction: of first order at best."""
    smooth = fraction
    for _ in range(2):
        smooth = _smoothed(grid, smooth, 2.0) / 4.0**grid.dimension
    slope = [_differenced(grid, smooth, axis, False) for axis in range(grid.dimension)]
    square = sum_of(s**2 for s in slope)
    there = square > 1e-20 / max(grid.spacing) ** 2
    size = jnp.sqrt(jnp.where(there, square, 1.0))
    normal = [jnp.where(there, s / size, 0.0) for s in slope]
    return -sum_of(_differenced(grid, n, axis, False) for axis, n in enumerate(normal))
