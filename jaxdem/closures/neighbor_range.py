"""Which flows a closure of neighbours was trained on, how it sees a flow, and how it fades beyond its data."""

from __future__ import annotations

import math

import jax.numpy as jnp
from jax import Array

REYNOLDS = (2.0, 40.0)
"""Reynolds numbers of the superficial slip that the data have."""
SOLID_FRACTION = (0.1, 0.3)
"""Solid fractions that the data have."""
FADING = ((1.0, 80.0), (0.05, 0.4))
"""Reynolds numbers and solid fractions beyond the data at which nothing but the mean law is left."""
DENSEST = FADING[1][1]
"""Solid fraction from which on the mean law acts alone."""
CONDITIONS = 3
"""Inputs of the network beside the neighbours: ln Re, its square, and the solid fraction."""


def quartic(known: Array) -> Array:
    """(N, 8) terms 1, a, s, a^2, a s, s^2, s^3, s^4, with a and s the first and last of `conditions` (N, 3)."""
    a, s = known[:, 0], known[:, 2]
    return jnp.stack([jnp.ones_like(a), a, s, a * a, a * s, s * s, s**3, s**4], axis=1)


def presence(crowd: Array) -> Array:
    """Weight of what the neighbours do, 0 without any and 1 among as many as the data have, (N,) [-]."""
    return 1.0 - jnp.exp(-crowd)


def conditions(reynolds: Array, solid_fraction: Array) -> Array:
    """(N, 3) what the network sees of the flow: ln Re and solid fraction, taken into the range of the data, -1 to 1 in
    it; the second is the square of the first."""
    low, high = math.log(REYNOLDS[0]), math.log(REYNOLDS[1])
    inside = jnp.clip(reynolds, *REYNOLDS)
    a = 2.0 * (jnp.log(inside) - low) / (high - low) - 1.0
    middle = 0.5 * (SOLID_FRACTION[0] + SOLID_FRACTION[1])
    s = 2.0 * (jnp.clip(solid_fraction, *SOLID_FRACTION) - middle) / (SOLID_FRACTION[1] - SOLID_FRACTION[0])
    return jnp.stack([a, a * a, s], axis=1)


def range_weight(reynolds: Array, solid_fraction: Array) -> Array:
    """1 for Re and solid fraction in the range of the data, 0 beyond `FADING`, a smooth step between in ln Re and in
    the solid fraction [-]."""
    (slowest, fastest), (thinnest, densest) = FADING
    logarithm = jnp.log(jnp.clip(reynolds, 0.5 * slowest, 2.0 * fastest))
    bounds = [math.log(value) for value in (slowest, *REYNOLDS, fastest)]
    flow = _step((logarithm - bounds[0]) / (bounds[1] - bounds[0])) * _step(
        (bounds[3] - logarithm) / (bounds[3] - bounds[2])
    )
    lower = _step((solid_fraction - thinnest) / (SOLID_FRACTION[0] - thinnest))
    return flow * lower * _step((densest - solid_fraction) / (densest - SOLID_FRACTION[1]))


def _step(x: Array) -> Array:
    """3 x^2 - 2 x^3 between 0 and 1, constant beyond."""
    x = jnp.clip(x, 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)
