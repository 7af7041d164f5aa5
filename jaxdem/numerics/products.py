"""Matrix products with all digits of their numbers, on every device."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jax import Array, lax

PRECISION = lax.Precision.HIGHEST
"""For every product of matrices: graphics processors would multiply float32 with 10 bits of mantissa otherwise."""


def along_axis(matrix: Array | np.ndarray, field: Array, axis: int) -> Array:
    """A matrix applied to one axis of a field, in the field's dtype.

    Args:
        matrix: (M, N).
        field: with N entries along `axis`.
        axis: its number.

    Returns:
        The field with M entries along `axis`.
    """
    if isinstance(matrix, np.ndarray) and isinstance(field, np.ndarray):
        return np.moveaxis(np.tensordot(np.asarray(matrix, field.dtype), field, axes=(1, axis)), 0, axis)
    product = jnp.tensordot(jnp.asarray(matrix, field.dtype), field, axes=(1, axis), precision=PRECISION)
    return jnp.moveaxis(product, 0, axis)
