"""Numbers as unevaluated sums of two floats, for positions that must carry the overlap of a contact.

In a 12 m box a float32 position resolves 1e-6 m, while a grain of 1 cm at rest overlaps its neighbour by
1.6e-5 m at 70 MPa and 1.6e-7 m at 70 GPa. A pair (high, low) with value high + low and |low| <= ulp(high)/2
resolves 1e-13 m there. In float64 the low part is not needed and is None throughout.

Source: T. J. Dekker, A floating-point technique for extending the available precision,
Numer. Math. 18 (1971) 224-242.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxdem.numerics.host import namespace

Low = Array | None
Pair = tuple[Array, Low]


def two_sum(a: Array, b: Array) -> tuple[Array, Array]:
    """a + b as rounded sum and exact rounding error (Knuth; XLA does not reassociate it)."""
    total = a + b
    virtual = total - a
    return total, (a - (total - virtual)) + (b - virtual)


def exact_sum(terms: Sequence[Array]) -> tuple[Array, Array]:
    """Sum of float32 terms as a pair that is not renormalised; largest first keeps the second part small."""
    total, error = terms[0], jnp.zeros_like(terms[0])
    for term in terms[1:]:
        total, rounding = two_sum(total, term)
        error = error + rounding
    return total, error


def halves(a: Array) -> tuple[Array, Array]:
    """a as a sum of two numbers of 12 bits, in float32."""
    bits = lax.bitcast_convert_type(a, jnp.uint32)
    high = lax.bitcast_convert_type(bits & jnp.uint32(0xFFFFF000), jnp.float32)
    return high, a - high


def exact_square(a: Array) -> tuple[Array, Array, Array]:
    """a^2 as three products that are exact in float32, largest first.

    The factor is split by masking its last 12 bits. Compilers contract a product and a sum into a fused
    multiply-add, which breaks the usual error-free product; with products that are exact in themselves the
    contraction changes nothing.
    """
    high, low = halves(a)
    return high * high, 2.0 * high * low, low * low


def affine(x: Array, factors: Sequence[float], constant: float, addend: Array | None = None) -> Pair:
    """addend + (constant + sum_k factors_k x_k) as a pair, for factors and a constant known in float64.

    In float32 the factors are cut into parts of 12 bits, so that the products are exact: the error is about
    3e-14 of the largest term, however much of it cancels. In float64 there is no low part.

    Args:
        x: (D,).
        factors: D numbers.
        constant: a number.
        addend: ().
    """
    if x.dtype != jnp.float32:
        total = jnp.full((), constant, x.dtype)
        for k, factor in enumerate(factors):
            total = total + factor * x[k]
        return total if addend is None else addend + total, None
    leading = float(np.float32(constant))
    terms, small = [], [jnp.full((), constant - leading, x.dtype)]
    for k, factor in enumerate(factors):
        if factor == 0.0:  # as along the axes: not in the program
            continue
        high, low = halves(x[k])
        first = _twelve_bits(factor)
        terms += [first * high, first * low]
        if factor != first:
            second = _twelve_bits(factor - first)
            terms.append(second * high)
            small += [second * low, (factor - first - second) * x[k]]
    # The constant last: with it as the first operand XLA would reassociate the sum.
    total, error = exact_sum([*terms, jnp.full((), leading, x.dtype)])
    for term in small:
        error = error + term
    if addend is not None:
        total, rounding = two_sum(addend, total)
        error = rounding + error
    return two_sum(total, error)


def whole_periods(number: Array, length: float) -> Pair:
    """number * length as a pair, for whole numbers and a length known in float64: a thousand periods of 0.3 m are off
    by 2e-5 m in one float32, more than grains overlap."""
    return affine(number[None], (length,), 0.0)


def into_box(
    high: Sequence[Array], low: Sequence[Low], box: Sequence[float], periodic: Sequence[bool]
) -> tuple[Array, ...]:
    """Leading parts (N,) of positions moved by whole periods into the box; the same bits where they are there already.

    The leading part alone is off by 1e-4 m a thousand periods of 2 m away.
    """
    return tuple(
        difference(x, trailing, *whole_periods(jnp.floor(x / length), length))[0] if wraps else x
        for x, trailing, length, wraps in zip(high, low, box, periodic, strict=True)
    )


def advance(high: Array, low: Low, increment: Array) -> tuple[Array, Low]:
    """(high, low) + increment, renormalised; plain addition when there is no low part."""
    if low is None:
        return high + increment, None
    total, error = two_sum(high, low + increment)
    return total, error


def difference(a_high: Array, a_low: Low, b_high: Array, b_low: Low) -> tuple[Array, Low]:
    """a - b of two pairs as a pair; plain difference when there are no low parts."""
    if a_low is None or b_low is None:
        return a_high - b_high, None
    total, error = two_sum(a_high, -b_high)
    return two_sum(total, error + (a_low - b_low))


def rounded_difference(a_high: Array, a_low: Low, b_high: Array, b_low: Low) -> Array:
    """a - b rounded once to a single float, exact in its leading parts when a and b are close."""
    high = a_high - b_high
    return high if a_low is None or b_low is None else high + (a_low - b_low)


def overlap_of_spheres(separation: tuple[Pair, ...], radius_sum: Array, radius_sum_low: Low = None) -> Array:
    """S - |r| without cancellation, as (S^2 - |r|^2) / (S + |r|) with the numerator in pairs.

    Args:
        separation: D components of the vector r between the centres as pairs [m].
        radius_sum: S, broadcastable [m].
        radius_sum_low: trailing part of S, if S is a pair.

    Returns:
        Overlap, negative for a gap [m]. The error is about 1e-14 of S in float32.
    """
    squared_high = radius_sum * radius_sum
    if separation[0][1] is None:
        distance_squared = sum(high * high for high, _ in separation)
        root = namespace(separation[0][0]).sqrt
        return (squared_high - distance_squared) / (radius_sum + root(distance_squared))
    terms = [jnp.broadcast_to(term, separation[0][0].shape) for term in exact_square(radius_sum)]
    for high, _ in separation:
        terms += [-term for term in exact_square(high)]
    total, error = exact_sum(terms)
    if radius_sum_low is not None:
        error = error + 2.0 * radius_sum * radius_sum_low
    for high, low in separation:
        error = error - 2.0 * high * low  # type: ignore[operator]
    distance_squared = sum(high * high for high, _ in separation)
    return (total + error) / (radius_sum + jnp.sqrt(distance_squared))


def _twelve_bits(number: float) -> float:
    """The leading 12 bits of a number."""
    bits = np.asarray(number, np.float32).view(np.uint32) & np.uint32(0xFFFFF000)
    return float(bits.view(np.float32))
