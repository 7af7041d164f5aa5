"""Transforms to the eigenvectors of the 1-D Laplacian on cells, in which the constant-coefficient problem is diagonal.

A row of N cells of unit width, minus second differences, with one of three conditions at either end: no flux (the
value beyond the end is that of the last cell), zero on the end's face (it is minus that), or periodic. The
eigenvectors are those of a discrete cosine or sine transform of type II or IV, or of the Hartley transform:

    no flux, no flux    cos(pi k (j + 1/2) / N)              k = 0 ... N - 1     2 - 2 cos(pi k / N)
    zero, zero          sin(pi (k + 1) (j + 1/2) / N)                            2 - 2 cos(pi (k + 1) / N)
    no flux, zero       cos(pi (k + 1/2) (j + 1/2) / N)                          2 - 2 cos(pi (k + 1/2) / N)
    zero, no flux       the same from the other end
    periodic            cos(2 pi j k / N) + sin(2 pi j k / N)                    2 - 2 cos(2 pi k / N)

Source: G. Strang, The discrete cosine transform, SIAM Review 41 (1999) 135-147; for the last, R. N. Bracewell,
J. Opt. Soc. Am. 73 (1983) 1832-1835.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.scipy.fft import dct, idct

FAST_FROM = 128
"""Cells from which a fast transform takes less time than a product with the matrix of eigenvectors; twice as many for
type II, which `jax.scipy.fft` makes of a complex transform of full length."""

End = Literal["no_flux", "zero"]


class Row(NamedTuple):
    """One axis of cells; static.

    Attributes:
        cells: N, their number.
        ends: conditions at the lower and the upper end; None for periodic.
    """

    cells: int
    ends: tuple[End, End] | None

    @property
    def eigenvalues(self) -> np.ndarray:
        """(N,) of minus the second differences, over the spacing squared if that is not one [-]."""
        k = np.arange(self.cells)
        if self.ends is None:
            return 2.0 - 2.0 * np.cos(2.0 * np.pi * k / self.cells)
        shift = 0.5 * self.ends.count("zero")
        return 2.0 - 2.0 * np.cos(np.pi * (k + shift) / self.cells)

    @property
    def eigenvectors(self) -> np.ndarray:
        """(N, N), orthonormal columns."""
        j, k = np.arange(self.cells)[:, None], np.arange(self.cells)[None]
        if self.ends is None:
            angle = 2.0 * np.pi * j * k / self.cells
            columns = np.cos(angle) + np.sin(angle)
        elif self.ends == ("zero", "zero"):
            columns = np.sin(np.pi * (k + 1) * (j + 0.5) / self.cells)
        else:
            columns = np.cos(np.pi * (k + 0.5 * self.ends.count("zero")) * (j + 0.5) / self.cells)
            if self.ends[0] == "zero":
                columns = columns[::-1]
        return columns / np.linalg.norm(columns, axis=0)

    def to_modes(self, array: Array, axis: int) -> Array:
        """Coefficients along an axis of N cells: the transposed `eigenvectors` times the array."""
        if not self._fast:
            return _product(self.eigenvectors.T, array, axis)
        rows = jnp.moveaxis(array, axis, -1)
        if self.ends is None:
            rows = _hartley(rows)
        elif self.ends == ("no_flux", "no_flux"):
            rows = dct(rows, norm="ortho")
        elif self.ends == ("zero", "zero"):
            rows = jnp.flip(dct(rows * self._alternating(rows), norm="ortho"), -1)
        else:
            rows = _cosine_four(jnp.flip(rows, -1) if self.ends[0] == "zero" else rows)
        return jnp.moveaxis(rows, -1, axis)

    def to_cells(self, modes: Array, axis: int) -> Array:
        """The inverse of `to_modes`."""
        if not self._fast:
            return _product(self.eigenvectors, modes, axis)
        rows = jnp.moveaxis(modes, axis, -1)
        if self.ends is None:
            rows = _hartley(rows)
        elif self.ends == ("no_flux", "no_flux"):
            rows = idct(rows, norm="ortho")
        elif self.ends == ("zero", "zero"):
            rows = idct(jnp.flip(rows, -1), norm="ortho") * self._alternating(rows)
        else:
            rows = _cosine_four(rows)
            rows = jnp.flip(rows, -1) if self.ends[0] == "zero" else rows
        return jnp.moveaxis(rows, -1, axis)

    @property
    def _fast(self) -> bool:
        if self.ends is None:
            return self.cells >= FAST_FROM
        if self.ends[0] == self.ends[1]:
            return self.cells >= 2 * FAST_FROM
        return self.cells >= FAST_FROM and self.cells % 2 == 0  # made of complex pairs of cells

    def _alternating(self, rows: Array) -> Array:
        signs = jnp.asarray((-1.0) ** np.arange(self.cells), rows.dtype)
        return signs.reshape((1,) * (rows.ndim - 1) + (-1,))


def _product(matrix: np.ndarray, array: Array, axis: int) -> Array:
    # HIGHEST: some accelerators would multiply float32 in 10 bits otherwise.
    factor = jnp.asarray(matrix, array.dtype)
    product = jnp.tensordot(factor, array, axes=(1, axis), precision=lax.Precision.HIGHEST)
    return jnp.moveaxis(product, 0, axis)


def _hartley(rows: Array) -> Array:
    """Orthonormal Hartley transform along the last axis, its own inverse: real less imaginary part of Fourier's."""
    count = rows.shape[-1]
    modes = jnp.fft.rfft(rows, norm="ortho")
    # The second half is the first, mirrored, with the other sign of the sines.
    mirrored = (modes.real + modes.imag)[..., 1 : (count + 1) // 2]
    return jnp.concatenate((modes.real - modes.imag, jnp.flip(mirrored, -1)), -1)


def _cosine_four(rows: Array) -> Array:
    """Orthonormal cosine transform of type IV along the last axis of even length N, its own inverse.

    From the cells two by two, one from either end, as complex numbers: one Fourier transform of N/2 between two
    rotations by exp(-i pi (n + 1/8) / N).
    """
    count = rows.shape[-1]
    angle = -np.pi * (np.arange(count // 2) + 0.125) / count
    shape = (1,) * (rows.ndim - 1) + (-1,)
    turn = lax.complex(
        jnp.asarray(np.cos(angle), rows.dtype).reshape(shape),
        jnp.asarray(np.sin(angle), rows.dtype).reshape(shape),
    )
    pairs = lax.complex(rows[..., 0::2], jnp.flip(rows[..., 1::2], -1)) * turn
    modes = jnp.fft.fft(pairs, norm="ortho") * turn
    both = jnp.stack((modes.real, -jnp.flip(modes.imag, -1)), -1)
    return both.reshape(rows.shape)
