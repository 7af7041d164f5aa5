"""Powers whose slope is infinite at zero: there it is taken as zero, so that gradients stay finite."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array


def power(values: Array, exponent: float) -> Array:
    """A positive power; 0 where the value is not positive."""
    positive = values > 0
    return jnp.where(positive, jnp.where(positive, values, 1.0) ** exponent, 0.0)
