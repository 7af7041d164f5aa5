"""Sums, products, sine and cosine of numbers that are unevaluated sums of two floats (see `compensated`).

In float32 the relative error of a product is about 1e-14. In float64 a pair has no trailing part and everything here
is plain arithmetic. Elementwise on arrays of any shapes that broadcast.
"""

from __future__ import annotations

import math
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import DTypeLike
from numpy.typing import ArrayLike

from jaxdem.numerics.compensated import Pair, halves, two_sum
from jaxdem.numerics.host import namespace

TERMS = 8
"""Terms of the series of sine and cosine: below pi/4 the next is less than 1e-15 of the first."""


def pair_of(value: ArrayLike, dtype: DTypeLike) -> Pair:
    """Numbers known in float64 as a pair of constants, as arrays of NumPy."""
    leading: Any = np.asarray(value).astype(dtype)
    if leading.dtype != np.float32:
        return leading, None
    return leading, _of_host(np.asarray(value) - leading.astype(np.float64), dtype)


def _of_host(array: np.ndarray, dtype: DTypeLike) -> Any:
    return array.astype(dtype)


def as_pair(value: Array) -> Pair:
    """A float as a pair."""
    return value, jnp.zeros_like(value) if jnp.result_type(value) == jnp.float32 else None


def total(a: Pair, b: Pair) -> Pair:
    """a + b; a constant must be the second, for XLA reassociates (c + x) - c."""
    if a[1] is None or b[1] is None:
        return a[0] + b[0], None
    high, error = two_sum(a[0], b[0])
    return two_sum(high, error + (a[1] + b[1]))


def negative(a: Pair) -> Pair:
    """-a."""
    return -a[0], None if a[1] is None else -a[1]


def product(a: Pair, b: Pair) -> Pair:
    """a b, of halves of 12 bits, whose products are exact in float32."""
    if a[1] is None or b[1] is None:
        return a[0] * b[0], None
    (first, second), (third, fourth) = halves(a[0]), halves(b[0])
    high, error = two_sum(first * third, first * fourth)
    high, further = two_sum(high, second * third)
    small = second * fourth + (a[0] * b[1] + a[1] * b[0])
    return two_sum(high, error + (further + small))


def value(a: Pair) -> Array:
    """The nearest float."""
    return a[0] if a[1] is None else a[0] + a[1]


def chosen(condition: Array, a: Pair, b: Pair) -> Pair:
    """a where the condition holds, else b."""
    low = None if a[1] is None or b[1] is None else jnp.where(condition, a[1], b[1])
    return namespace(condition).where(condition, a[0], b[0]), low


def fraction(a: Pair) -> Pair:
    """a less the nearest whole number: -1/2 to 1/2."""
    if a[1] is None:
        return a[0] - namespace(a[0]).round(a[0]), None
    # The difference of the leading parts is exact.
    high, low = two_sum(a[0] - jnp.round(a[0]), a[1])
    return two_sum(high - jnp.round(high), low)


def sine_and_cosine(turns: Pair) -> tuple[Pair, Pair]:
    """sin(2 pi t) and cos(2 pi t) of a number of turns t.

    In float32 by the series within an eighth of a turn of a whole quarter.
    """
    if turns[1] is None:
        full = 2.0 * math.pi * fraction(turns)[0]
        return (namespace(full).sin(full), None), (namespace(full).cos(full), None)
    dtype = turns[0].dtype
    rest = fraction(turns)
    quarters = jnp.round(4.0 * rest[0])
    rest = total(rest, as_pair(-0.25 * quarters))
    angle = product(rest, pair_of(2.0 * math.pi, dtype))
    squared = product(angle, angle)
    sine, cosine = (
        _series(squared, [(-1.0) ** k / math.factorial(2 * k + first) for k in range(TERMS)]) for first in (1, 0)
    )
    sine = product(angle, sine)
    turned = jnp.mod(quarters, 4.0)
    odd, sine_sign, cosine_sign = (turned % 2.0) > 0.5, turned > 1.5, (turned > 0.5) & (turned < 2.5)
    first, second = chosen(odd, cosine, sine), chosen(odd, sine, cosine)
    return chosen(sine_sign, negative(first), first), chosen(cosine_sign, negative(second), second)


def _series(x: Pair, coefficients: list[float]) -> Pair:
    """sum_k c_k x^k by Horner's rule."""
    found = pair_of(coefficients[-1], x[0].dtype)
    for coefficient in coefficients[-2::-1]:
        found = total(product(found, x), pair_of(coefficient, x[0].dtype))
    return found


def entry(a: Pair, index: Any) -> Pair:
    """These entries of both parts."""
    return a[0][index], None if a[1] is None else a[1][index]
