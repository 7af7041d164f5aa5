"""Powers whose slope is infinite at zero: there it is taken as zero, so that gradients stay finite."""

from __future__ import annotations

from jax import Array

from jaxdem.numerics.host import namespace


def power(values: Array, exponent: float) -> Array:
    """A positive power; 0 where the value is not positive."""
    xp, positive = namespace(values), values > 0
    return xp.where(positive, xp.where(positive, values, 1.0) ** exponent, 0.0)
