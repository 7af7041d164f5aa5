"""Pressure: a variable-coefficient Poisson problem, solved by preconditioned conjugate gradients.

The preconditioner inverts the problem with constant coefficient exactly, in the eigenvectors of the 1-D
operators (R. E. Lynch, J. R. Rice, D. H. Thomas, Numer. Math. 6 (1964) 185-199), so that the number of
iterations depends on how much the void fraction varies and not on the mesh. On several devices the rows along the axis
that is cut are made whole for their transform, and another axis is cut meanwhile.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxdem.fluid.boundary import Boundary, open_fraction
from jaxdem.fluid.grid import FaceField, Grid, along, box_largest, box_mean, divergence, nearest_inner, slope_over
from jaxdem.fluid.mesh import Ends, end_faces, of_slab, with_ends
from jaxdem.fluid.rows import share_of_rows, with_whole_rows
from jaxdem.fluid.transforms import End, Row
from jaxdem.numerics.blocks import total
from jaxdem.numerics.products import PRECISION

MAXIMUM_ITERATIONS = 200
OF_SMALL = 0.5
"""Weight of what one over the diagonal is in a cut cell beyond that of a whole one [-]."""


class SolverReport(NamedTuple):
    """How a solve went.

    Attributes:
        iterations: () number of conjugate-gradient iterations.
        residual: () largest remaining divergence [1/s].
        converged: () bool.
    """

    iterations: Array
    residual: Array
    converged: Array


def pressure_gradient(grid: Grid, boundary: Boundary, pressure: Array, continued: bool = False) -> FaceField:
    """Gradient on the faces; on an outlet towards the zero outside.

    Args:
        grid: the grid.
        boundary: sides.
        pressure: on the cells.
        continued: on closed boundary faces the gradient is that of the nearest inner face, as particles
            near a wall see it; without it zero, as the flow is driven.
    """
    result = []
    for axis in range(grid.dimension):
        spacing = grid.spacing[axis]
        inner = (along(pressure, axis, 1, None) - along(pressure, axis, None, -1)) / spacing

        def of_sides(first: Array, last: Array, axis: int = axis, inner: Array = inner) -> Ends:
            spacing, ends = grid.spacing[axis], []
            for upper, outward in ((False, 2.0 * first / spacing), (True, -2.0 * last / spacing)):
                is_open = of_slab(grid, open_fraction(grid, boundary.side(axis, upper)), pressure.dtype)
                end = is_open * outward
                if continued and inner.shape[axis] > 0:
                    end = end + (1.0 - is_open) * nearest_inner(inner, axis, first)[upper]
                ends.append(end)
            return ends[0], ends[1]

        ends = end_faces(grid, axis, pressure, slope_over(spacing), of_sides)
        result.append(jnp.concatenate((ends[0], inner, ends[1]), axis))
    return tuple(result)


def solve_pressure(
    grid: Grid,
    boundary: Boundary,
    coefficient: tuple[Array | float, ...],
    source: Array,
    tolerance: Array,
    fluid_cells: Array | None = None,
) -> tuple[Array, SolverReport]:
    """p with div(coefficient grad p) = source, differentiated implicitly.

    Args:
        grid: the grid.
        boundary: sides; p = 0 on outlets, no flux through the others.
        coefficient: positive, on the faces.
        source: on the cells.
        tolerance: () largest residual allowed, in the unit of `source`.
        fluid_cells: bool, where surfaces close faces: the cells with an open face; None without surfaces. The
            coefficient of a closed face is zero.

    Returns:
        p on the cells, of mean zero where there is no outlet, zero in cells without fluid; and the report.
    """
    inverse = fast_inverse(grid, boundary)
    if fluid_cells is not None:
        inverse = with_cut_cells(grid, boundary, inverse, coefficient)
    problem = PressureProblem(grid, boundary, coefficient, fluid_cells)
    return solve_preconditioned(problem, source, tolerance, inverse)


class PressureProblem(NamedTuple):
    """What is inverted, see `solve_pressure`.

    Attributes:
        grid, boundary, coefficient, fluid_cells: as there.
    """

    grid: Grid
    boundary: Boundary
    coefficient: tuple[Array | float, ...]
    fluid_cells: Array | None = None


def solve_preconditioned(
    problem: PressureProblem, source: Array, tolerance: Array, inverse: Callable[[Array], Array]
) -> tuple[Array, SolverReport]:
    """`solve_pressure` with a preconditioner of one's own.

    Args:
        problem: to be solved.
        source, tolerance: as there.
        inverse: of minus the operator, roughly; symmetric and positive.
    """
    grid, boundary, coefficient, fluid_cells = problem
    singular = not boundary.has_outlet
    dtype = source.dtype

    def operator(p: Array) -> Array:
        slope = pressure_gradient(grid, boundary, p)
        return -divergence(grid, tuple(c * s for c, s in zip(coefficient, slope, strict=True)))

    def centred(x: Array) -> Array:
        if fluid_cells is not None:
            return _centred_on(grid, fluid_cells, x, singular)
        return x - box_mean(grid, x) if singular else x

    def solve(_, b: Array) -> tuple[Array, SolverReport]:  # type: ignore[no-untyped-def]
        return _conjugate_gradients(grid, operator, inverse, centred(b), tolerance, centred)

    def transpose_solve(_, b: Array) -> tuple[Array, SolverReport]:  # type: ignore[no-untyped-def]
        relative = 1e-6 if dtype == jnp.float32 else 1e-13
        return _conjugate_gradients(
            grid, operator, inverse, centred(b), relative * box_largest(grid, jnp.abs(b)), centred
        )

    return lax.custom_linear_solve(
        operator, -source, solve, transpose_solve=transpose_solve, symmetric=False, has_aux=True
    )


def _centred_on(grid: Grid, cells: Array, x: Array, singular: bool) -> Array:
    """x on some cells, zero on the others; less its mean where only differences have a meaning."""
    x = jnp.where(cells, x, 0.0)
    if not singular:
        return x
    content, number = total(grid.blocks, (jnp.sum(x), jnp.sum(cells.astype(x.dtype))))
    return jnp.where(cells, x - content / number, 0.0)


def with_cut_cells(grid: Grid, boundary: Boundary, inverse, coefficient):  # type: ignore[no-untyped-def]
    """A preconditioner for a coefficient that surfaces make small or zero on some faces: the inverse with a constant
    coefficient, over the mean of that on open faces, plus one over the diagonal in cells where this is small.

    Args:
        grid: the grid.
        boundary: sides.
        inverse: of minus the Laplacian.
        coefficient: on the faces, zero on closed ones.
    """
    diagonal, whole = jnp.zeros((), coefficient[0].dtype), 0.0
    for axis, c in enumerate(coefficient):
        factor = 1.0 / grid.spacing[axis] ** 2
        if not grid.periodic[axis]:
            ends = []
            for upper in (False, True):
                is_open = of_slab(grid, open_fraction(grid, boundary.side(axis, upper)), c.dtype)
                ends.append(2.0 * is_open * along(c, axis, *((-1, None) if upper else (0, 1))))
            c = with_ends(grid, axis, c, (ends[0], ends[1]))
        diagonal = diagonal + factor * (along(c, axis, None, -1) + along(c, axis, 1, None))
        whole = whole + 2.0 * factor
    has_fluid = diagonal > 0.0
    content, number = total(grid.blocks, (jnp.sum(diagonal), jnp.sum(has_fluid.astype(diagonal.dtype))))
    mean = content / number / whole
    own = 1.0 / jnp.where(has_fluid, diagonal, mean * whole)
    local = OF_SMALL * jnp.maximum(own - 1.0 / (mean * whole), 0.0)
    return lambda r: inverse(r) / mean + local * r


def _conjugate_gradients(grid, operator, inverse, b, tolerance, centred):  # type: ignore[no-untyped-def]
    """Preconditioned conjugate gradients from zero until the largest residual is under the tolerance.

    In units of a power of two near the largest entry of b, which rounds nothing: the products of a right-hand side
    under 1e-20 would underflow in float32, and 0/0 is what a fluid that comes to rest would be given.
    """
    exponent = jnp.frexp(box_largest(grid, jnp.abs(b)))[1]
    tolerance = jnp.asarray(tolerance, b.dtype)
    b, tolerance = _times_power_of_two(b, -exponent), _times_power_of_two(tolerance, -exponent)

    def proceed(carry):  # type: ignore[no-untyped-def]
        _, r, _, _, count = carry
        return (box_largest(grid, jnp.abs(r)) > tolerance) & (count < MAXIMUM_ITERATIONS)

    def iterate(carry):  # type: ignore[no-untyped-def]
        x, r, p, rz, count = carry
        # The inverse costs most of an iteration, so it is taken at the start: none is left over at the end.
        z = inverse(r)
        new = total(grid.blocks, jnp.vdot(r, z, precision=PRECISION))
        p = z + (new / rz) * p
        ap = operator(p)
        alpha = new / total(grid.blocks, jnp.vdot(p, ap, precision=PRECISION))
        return x + alpha * p, r - alpha * ap, p, new, count + 1

    zero = jnp.zeros_like(b)
    start = (zero, b, zero, jnp.asarray(jnp.inf, b.dtype), jnp.zeros((), jnp.int32))
    x, _, _, _, count = lax.while_loop(proceed, iterate, start)
    # The recurrence drifts from the truth in float32: what is reported is the residual itself.
    residual = box_largest(grid, jnp.abs(centred(b - operator(x))))
    report = SolverReport(count, _times_power_of_two(residual, exponent), residual <= 10.0 * tolerance)
    return _times_power_of_two(centred(x), exponent), report


def _times_power_of_two(array: Array, exponent: Array) -> Array:
    """`jnp.ldexp`, which takes a power for every entry, with two powers in all: one alone may be out of range."""
    half = exponent // 2
    one = jnp.ones((), array.dtype)
    return array * jnp.ldexp(one, half) * jnp.ldexp(one, exponent - half)


def fast_inverse(grid: Grid, boundary: Boundary | None):  # type: ignore[no-untyped-def]
    """The inverse of minus the Laplacian on the cells, as a function of a cell array.

    Args:
        grid: the grid.
        boundary: a side that is outlet on most of its faces has p = 0, all others no flux; with None, no
            side has an outlet. Where nothing fixes the level the mean is dropped, and where only smaller
            outlets do it is divided by what they make of it on average.
    """

    def condition(axis: int, upper: bool) -> End:
        share = 0.0 if boundary is None else np.mean(open_fraction(grid, boundary.side(axis, upper)))
        return "zero" if share > 0.5 else "no_flux"

    rows = tuple(
        Row(count, None if grid.periodic[axis] else (condition(axis, False), condition(axis, True)))
        for axis, count in enumerate(grid.whole_cells)
    )
    level = 0.0
    for side in () if boundary is None else boundary.sides:
        # An outlet face turns a constant p = 1 into 2 / h^2 in its cell.
        share = float(np.sum(open_fraction(grid, side)))
        level += 2.0 * share / grid.spacing[side.axis] ** 2 / math.prod(grid.whole_cells)
    weights = _inverse_eigenvalues(rows, grid.spacing, level)

    cut = None if grid.blocks is None else grid.blocks.axis
    own = [axis for axis in range(grid.dimension) if axis != cut]

    def scaled(b: Array) -> Array:
        if cut is not None:
            b = rows[cut].to_modes(b, cut)
        b = b * share_of_rows(grid, weights, b.dtype)
        return b if cut is None else rows[cut].to_cells(b, cut)

    def inverse(b: Array) -> Array:
        for axis in own:
            b = rows[axis].to_modes(b, axis)
        b = with_whole_rows(grid, b, scaled)
        for axis in own:
            b = rows[axis].to_cells(b, axis)
        return b

    return inverse


@lru_cache(maxsize=32)
def _inverse_eigenvalues(rows: tuple[Row, ...], spacing: tuple[float, ...], level: float) -> np.ndarray:
    """One over the sum of eigenvalues, on the modes [m2].

    Where that sum is zero, for the mean of a box without outlet sides, `level` stands in (0: the mean is dropped).
    """
    total = np.zeros([1] * len(rows))
    for axis, (row, h) in enumerate(zip(rows, spacing, strict=True)):
        shape = [-1 if a == axis else 1 for a in range(len(rows))]
        total = total + (row.eigenvalues / h**2).reshape(shape)
    null = total < 1e-10 * total.max()
    of_mean = 1.0 / level if level > 0.0 else 0.0
    return np.where(null, of_mean, 1.0 / np.where(null, 1.0, total))
