"""Diffusion of what particles deposit, through the open parts of a mesh that surfaces cut.

With c what is in a cell over its open part v, in time s^2/2

    v dc/dt = sum_axes d/dx (a' dc/dx),   a' = min(a, v of the two cells)

with a the open fraction of a face. So nothing passes through surfaces, what is there is kept, an even c stays even, and
between whole cells it is the diffusion of a box. a' is what keeps cells of small open part from being stiff: they get
less, never more than there is. exp(s^2/2 A) c, with A of this equation, is a series of Chebyshev polynomials to
rounding. For fields at particles the same is applied to the fields, which is the adjoint of what is applied to the
amounts v c.

Source of the series: H. Tal-Ezer, R. Kosloff, J. Chem. Phys. 81 (1984) 3967-3971.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from scipy.special import ive

from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.grid import FaceField, Grid, along, sum_of
from jaxdem.fluid.mesh import end_faces
from jaxdem.numerics.host import namespace


class CutDiffusion(NamedTuple):
    """exp(s^2/2 A) between surfaces.

    Attributes:
        grid: static.
        conductance: s^2/2 a'/h^2 of every axis on its faces, 0 on closed ones and on sides of the box [-].
        open_cells: v, 1 for cells without fluid [-].
        series: (K,) coefficients of the polynomials in 1 + 2 s^2/2 A / `bound` [-].
        bound: of the eigenvalues of -s^2/2 A [-].
    """

    grid: Grid
    conductance: FaceField
    open_cells: Array
    series: np.ndarray
    bound: float

    def of_fields(self, field: Array) -> Array:
        """A field on the cells, smoothed."""
        previous, last = field, field + self._scaled(field)
        total = self.series[0] * previous + self.series[1] * last

        def further(carry: tuple[Array, Array, Array], coefficient: Array) -> tuple[tuple[Array, Array, Array], None]:
            previous, last, total = carry
            following = 2.0 * (last + self._scaled(last)) - previous
            return (last, following, total + coefficient * following), None

        carry = previous, last, total
        if isinstance(field, np.ndarray):
            for coefficient in self.series[2:]:
                carry, _ = further(carry, coefficient)
        else:
            carry, _ = lax.scan(further, carry, jnp.asarray(self.series[2:]))
        return carry[2]

    def of_amounts(self, amount: Array) -> Array:
        """What is in the cells, smoothed; the sum is kept."""
        return self.open_cells * self.of_fields(amount / self.open_cells)

    def _scaled(self, c: Array) -> Array:
        """2 s^2/2 A c / bound."""
        xp, parts = namespace(c), []
        for axis, k in enumerate(self.conductance):
            # On sides of the box the conductance is zero.
            ends = end_faces(self.grid, axis, c, _step, lambda first, last: (0.0 * first, 0.0 * last))
            flux = k * xp.concatenate(
                (ends[0], _step(along(c, axis, None, -1), along(c, axis, 1, None)), ends[1]), axis
            )
            parts.append(along(flux, axis, 1, None) - along(flux, axis, None, -1))
        return (2.0 / self.bound) * sum_of(parts) / self.open_cells


def cut_diffusion(grid: Grid, cut: CutCells, deviation: tuple[float, ...]) -> CutDiffusion:
    """The diffusion between surfaces.

    Args:
        grid: the grid.
        cut: the open parts.
        deviation: s along every axis, of the Gaussian that a point becomes far from surfaces [m].
    """
    xp, v = namespace(cut.open_cells), cut.open_cells
    conductance: list[Array] = []
    bound = 0.0
    for axis, (a, s, h) in enumerate(zip(cut.open_faces, deviation, grid.spacing, strict=True)):
        least = xp.minimum(along(v, axis, None, -1), along(v, axis, 1, None))
        ends = end_faces(grid, axis, v, xp.minimum, lambda first, last: (0.0 * first, 0.0 * last))
        factor = 0.5 * (s / h) ** 2
        conductance.append(factor * xp.minimum(a, xp.concatenate((ends[0], least, ends[1]), axis)))
        bound += 4.0 * factor
    return CutDiffusion(grid, tuple(conductance), xp.where(v > 0.0, v, 1.0), exponential_series(bound, v.dtype), bound)


def _step(below: Array, above: Array) -> Array:
    return above - below


def exponential_series(bound: float, dtype: np.dtype) -> np.ndarray:
    """Coefficients of exp(-bound/2 (1 - x)) in Chebyshev polynomials of x, to the rounding of a dtype [-]."""
    half, accuracy = 0.5 * bound, float(np.finfo(dtype).eps)
    most = math.ceil(math.sqrt(2.0 * half * math.log(1.0 / accuracy))) + 40
    found = 2.0 * ive(np.arange(most), half)
    found[0] *= 0.5
    needed = max(2, int(np.max(np.nonzero(found > 0.1 * accuracy)[0])) + 1)
    return found[:needed].astype(dtype)
