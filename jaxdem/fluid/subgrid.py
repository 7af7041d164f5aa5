"""Eddy viscosity: what eddies that the mesh does not resolve do to the flow."""

from __future__ import annotations

from jax import Array

from jaxdem.fluid.grid import CellOrOne, along, sum_of
from jaxdem.numerics.vectors import safe_sqrt

StrainRates = dict[tuple[int, int], Array]
"""du_i/dx_j + du_j/dx_i by (i, j), i <= j: in the cells for i = j, else on the edges of both axes [1/s]."""


def eddy_viscosity(rates: StrainRates, length: CellOrOne) -> Array:
    """nu_t = l^2 sqrt(2 S:S) in the cells [m2/s].

    S = (grad u + grad u^T)/2. The squares of the shear rates reach a cell as the mean of its four edges. Smagorinsky's
    mixing length is l = C_s Delta with C_s 0.1 to 0.2 usually and Delta the filter size, the cube root of the cell's
    volume (2-D: the square root of its area). It has no damping at walls, where nu_t should vanish: use it where the
    wall's layer is not what matters. `mixing_length_over_bed` is that of a stream over a bed.

    Args:
        rates: of strain, twice S.
        length: l, () or in the cells [m].

    Source: J. Smagorinsky, Mon. Weather Rev. 91 (1963) 99-164.
    """
    return length**2 * strain_magnitude(rates)


def strain_magnitude(rates: StrainRates) -> Array:
    """sqrt(2 S:S) in the cells, the squares on edges as the mean of a cell's four [1/s]."""
    squares = []
    for (i, j), rate in rates.items():
        square = rate**2
        squares.append(0.5 * square if i == j else cell_mean(square, i, j))
    return safe_sqrt(sum_of(squares))


def cell_mean(edge: Array, first: int, second: int) -> Array:
    """Mean of the four edges of every cell, of those between the faces of two axes."""
    return mean_along(mean_along(edge, first), second)


def mean_along(array: Array, axis: int) -> Array:
    """Mean of neighbours along an axis: from faces to the cells between them."""
    return 0.5 * (along(array, axis, None, -1) + along(array, axis, 1, None))
