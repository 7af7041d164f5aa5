"""Values that a scene gives at several times."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array


def at_time(times: tuple[float, ...] | None, values: Array, time: Array) -> Array:
    """(D,) values at a time: linear between the times of a table, constant before the first and after the last.

    Args:
        times: T of them, increasing [s]; None for values that do not change.
        values: (T, D), or (D,) without times.
        time: () [s].
    """
    if times is None:
        return values
    given = jnp.asarray(times, values.dtype)
    return jnp.stack([jnp.interp(time, given, column) for column in values.T])
