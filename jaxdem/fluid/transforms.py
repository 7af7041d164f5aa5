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

from typing import Literal

import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxdem.numerics.products import along_axis
from jaxdem.numerics.static import static

FAST_FROM = 128
"""Cells from which a fast transform takes less time than a product with the matrix of eigenvectors."""

End = Literal["no_flux", "zero"]


@static
class Row:
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
            return along_axis(self.eigenvectors.T, array, axis)
        rows = jnp.moveaxis(array, axis, -1)
        if self.ends is None:
            rows = _hartley(rows)
        elif self.ends == ("no_flux", "no_flux"):
            rows = _cosine_two(rows)
        elif self.ends == ("zero", "zero"):
            rows = jnp.flip(_cosine_two(rows * self._alternating(rows)), -1)
        else:
            rows = _cosine_four(jnp.flip(rows, -1) if self.ends[0] == "zero" else rows)
        return jnp.moveaxis(rows, -1, axis)

    def to_cells(self, modes: Array, axis: int) -> Array:
        """The inverse of `to_modes`."""
        if not self._fast:
            return along_axis(self.eigenvectors, modes, axis)
        rows = jnp.moveaxis(modes, axis, -1)
        if self.ends is None:
            rows = _hartley(rows)
        elif self.ends == ("no_flux", "no_flux"):
            rows = _cosine_two_inverse(rows)
        elif self.ends == ("zero", "zero"):
            rows = _cosine_two_inverse(jnp.flip(rows, -1)) * self._alternating(rows)
        else:
            rows = _cosine_four(rows)
            rows = jnp.flip(rows, -1) if self.ends[0] == "zero" else rows
        return jnp.moveaxis(rows, -1, axis)

    @property
    def _fast(self) -> bool:
        # The transform of type IV is made of complex pairs of cells.
        paired = self.ends is not None and self.ends[0] != self.ends[1]
        return self.cells >= max(FAST_FROM, 2) and not (paired and self.cells % 2)

    def _alternating(self, rows: Array) -> Array:
        signs = jnp.asarray((-1.0) ** np.arange(self.cells), rows.dtype)
        return signs.reshape((1,) * (rows.ndim - 1) + (-1,))


def _hartley(rows: Array) -> Array:
    """Orthonormal Hartley transform along the last axis, its own inverse: real less imaginary part of Fourier's."""
    count = rows.shape[-1]
    modes = jnp.fft.rfft(rows, norm="ortho")
    # The second half is the first, mirrored, with the other sign of the sines.
    mirrored = (modes.real + modes.imag)[..., 1 : (count + 1) // 2]
    return jnp.concatenate((modes.real - modes.imag, jnp.flip(mirrored, -1)), -1)


def _cosine_two(rows: Array) -> Array:
    """Orthonormal cosine transform of type II along the last axis.

    Fourier's of the even cells followed by the odd ones backwards, turned by exp(-i pi k / (2 N)): its real part is
    the first half of the modes, minus its imaginary part the second half backwards. (`jax.scipy.fft.dct` takes the
    complex transform of full length, in two to four times the time.)

    Source: J. Makhoul, IEEE Trans. Acoust. Speech Signal Process. 28 (1980) 27-34.
    """
    count = rows.shape[-1]
    folded = jnp.concatenate((rows[..., 0::2], jnp.flip(rows[..., 1::2], -1)), -1)
    turned = jnp.fft.rfft(folded, norm="ortho") * _quarter_turns(rows, -1.0)
    second = jnp.flip(-turned.imag[..., 1 : (count + 1) // 2], -1)
    modes = jnp.concatenate((turned.real, second), -1)
    return modes * _weights_of_modes(rows)


def _cosine_two_inverse(modes: Array) -> Array:
    """The inverse of `_cosine_two`."""
    count = modes.shape[-1]
    modes = modes / _weights_of_modes(modes)
    half = count // 2 + 1
    # The mode N - k is minus the imaginary part of mode k; that of mode 0 is zero.
    backwards = jnp.flip(modes[..., count - half + 1 :], -1)
    imaginary = -jnp.concatenate((jnp.zeros_like(modes[..., :1]), backwards), -1)
    turned = lax.complex(modes[..., :half], imaginary) * _quarter_turns(modes, 1.0)
    folded = jnp.fft.irfft(turned, count, norm="ortho")
    even, odd = folded[..., : (count + 1) // 2], jnp.flip(folded[..., (count + 1) // 2 :], -1)
    if count % 2:
        odd = jnp.concatenate((odd, jnp.zeros_like(even[..., :1])), -1)
    return jnp.stack((even, odd), -1).reshape(*modes.shape[:-1], -1)[..., :count]


def _weights_of_modes(rows: Array) -> Array:
    """sqrt(2), and 1 for the mean."""
    weights = np.full(rows.shape[-1], np.sqrt(2.0))
    weights[0] = 1.0
    return jnp.asarray(weights, rows.dtype).reshape((1,) * (rows.ndim - 1) + (-1,))


def _quarter_turns(rows: Array, sign: float) -> Array:
    """exp(sign i pi k / (2 N)), k = 0 ... N/2."""
    count = rows.shape[-1]
    angle = sign * np.pi * np.arange(count // 2 + 1) / (2 * count)
    return _rotation(angle, rows)


def _rotation(angle: np.ndarray, rows: Array) -> Array:
    shape = (1,) * (rows.ndim - 1) + (-1,)
    real, imaginary = (jnp.asarray(f(angle), rows.dtype).reshape(shape) for f in (np.cos, np.sin))
    return lax.complex(real, imaginary)


def _cosine_four(rows: Array) -> Array:
    """Orthonormal cosine transform of type IV along the last axis of even length N, its own inverse.

    From the cells two by two, one from either end, as complex numbers: one Fourier transform of N/2 between two
    rotations by exp(-i pi (n + 1/8) / N).
    """
    count = rows.shape[-1]
    angle = -np.pi * (np.arange(count // 2) + 0.125) / count
    turn = _rotation(angle, rows)
    pairs = lax.complex(rows[..., 0::2], jnp.flip(rows[..., 1::2], -1)) * turn
    modes = jnp.fft.fft(pairs, norm="ortho") * turn
    both = jnp.stack((modes.real, -jnp.flip(modes.imag, -1)), -1)
    return both.reshape(rows.shape)
