"""Work on the host before a run, where nothing is compiled: formulas that take arrays of NumPy too, and arrays from it.

Outside of `jit` every operation of JAX is a program of its own for each shape, `jnp.asarray` and `jnp.zeros` too.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import DTypeLike
from numpy.typing import ArrayLike


def namespace(array: ArrayLike) -> ModuleType:
    """`numpy` for its arrays, `jax.numpy` for all others."""
    return np if isinstance(array, np.ndarray | np.generic) else jnp


def least_of(arrays: Sequence[Array]) -> Array:
    """The smallest of arrays of one shape, element by element; its slope is that of one of them.

    That of `jnp.min` is shared among those that are equal to the result. XLA may compute these anew with another
    rounding than the result, so that none is equal, and the slope NaN.
    """
    xp, found = namespace(arrays[0]), arrays[0]
    for one in arrays[1:]:
        found = xp.where(one < found, one, found)
    return found


def on_device(values: ArrayLike, dtype: DTypeLike) -> Array:
    """An array of JAX with these values, which must not change any more."""
    return jax.device_put(np.asarray(values, dtype))
