"""Pairs of floats against exact rational arithmetic, inside jit, where a compiler may reorder."""

from __future__ import annotations

from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np

from jaxdem.numerics import compensated

GENERATOR = np.random.default_rng(7)


def exact(*values):
    return sum((Fraction(float(value)) for value in values), Fraction(0))


def test_two_sum_is_exact_in_jit():
    """high + low = a + b exactly, and |low| <= ulp(high) / 2 (Knuth); over 12 decades of ratio."""
    a = (GENERATOR.standard_normal(300) * 10.0 ** GENERATOR.uniform(-6, 6, 300)).astype(np.float32)
    b = (GENERATOR.standard_normal(300) * 10.0 ** GENERATOR.uniform(-6, 6, 300)).astype(np.float32)
    high, low = (np.asarray(x) for x in jax.jit(compensated.two_sum)(a, b))
    for x, y, s, e in zip(a, b, high, low, strict=True):
        assert exact(x, y) == exact(s, e)
    assert (np.abs(low) <= 0.5 * np.spacing(np.abs(high))).all()


def test_exact_square_terms_sum_to_the_square_in_jit():
    """The three terms are exact products: their sum is a^2 as a rational number.

    The low part has at most 12 bits, the high one 12: every product fits into 24.
    """
    a = GENERATOR.uniform(1e-3, 12.0, 300).astype(np.float32)
    terms = [np.asarray(x) for x in jax.jit(compensated.exact_square)(jnp.asarray(a))]
    for value, *parts in zip(a, *terms, strict=True):
        assert exact(value) ** 2 == exact(*parts)


def test_advance_keeps_what_one_float_loses():
    """10,000 steps of 1e-9 m at 10 m in float32: the pair moves 1e-5 m, a single float not at all."""

    @jax.jit
    def walk(high, low):
        body = lambda _, pair: compensated.advance(pair[0], pair[1], jnp.float32(1e-9))  # noqa: E731
        return jax.lax.fori_loop(0, 10_000, body, (high, low))

    high, low = walk(jnp.float32(10.0), jnp.float32(0.0))
    moved = float(exact(float(high), float(low)) - 10)
    # The low part, up to 5e-7, resolves 6e-14: rounding 10,000 times by half of it gives at most 3e-10.
    np.testing.assert_allclose(moved, 1e4 * float(np.float32(1e-9)), atol=3e-10)
    assert np.float32(10.0) + np.float32(1e-9) == np.float32(10.0)


def test_difference_of_pairs():
    """a - b of pairs near 10 m to 1e-14 m: the pair's own low part rounds at 2^-24 of a separation's ulp."""
    a, b = (10.0 + GENERATOR.uniform(0, 0.02, 200) for _ in range(2))
    split = [(x.astype(np.float32), (x - x.astype(np.float32)).astype(np.float32)) for x in (a, b)]
    high, low = jax.jit(compensated.difference)(*split[0], *split[1])
    for k in range(200):
        truth = exact(*(x[k] for x in split[0])) - exact(*(x[k] for x in split[1]))
        assert abs(float(exact(high[k], low[k]) - truth)) < 1e-13
        rounded = compensated.rounded_difference(*(x[k] for x in split[0]), *(x[k] for x in split[1]))
        # One rounding of a number up to 0.02, and one of the difference of low parts, below 1e-6.
        assert abs(float(exact(rounded) - truth)) < 1.1e-9


def test_overlap_of_spheres_against_exact_arithmetic():
    """S - |r| in float32 pairs against the root in longdouble: 1e-14 of S, as the docstring says.

    The overlaps are 1e-10 ... 1e-4 m of 2 cm: in plain float32 their error is 2e-9 m.
    """
    count, radius_sum = 300, np.float32(0.02)
    overlap = 10.0 ** GENERATOR.uniform(-10, -4, count) * GENERATOR.choice([-1, 1], count)
    direction = GENERATOR.standard_normal((count, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    vector = direction * (float(radius_sum) - overlap)[:, None]
    high = vector.astype(np.float32)
    low = (vector - high).astype(np.float32)
    pairs = tuple((jnp.asarray(high[:, k]), jnp.asarray(low[:, k])) for k in range(3))
    ours = np.asarray(jax.jit(compensated.overlap_of_spheres)(pairs, jnp.asarray(radius_sum)))
    full = high.astype(np.longdouble) + low.astype(np.longdouble)
    truth = np.longdouble(radius_sum) - np.sqrt(np.sum(full**2, axis=1))
    # 24 bits of the overlap itself, and the pair's limit: 2^-48 of S^2 over 2 S per term, some ten terms.
    tolerance = 3e-7 * np.abs(truth) + 10 * 2.0**-48 * float(radius_sum)
    assert (np.abs(ours - truth) < tolerance).all()
    plain = radius_sum - np.sqrt(np.sum(high**2, axis=1, dtype=np.float32))
    assert np.abs(plain - truth).max() > 1e-10  # what the pairs are for
