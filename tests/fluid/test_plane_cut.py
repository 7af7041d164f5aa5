"""A plane in a unit cell, against the sum over the corners that it cuts off, in exact fractions."""

import itertools
import math
from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from jaxdem.fluid.plane_cut import offset_of, volume_below

NORMALS = {
    2: [(0.5, 0.5), (1.0, 0.0), (0.0, 1.0), (0.25, 0.75), (2.0**-30, 1.0 - 2.0**-30)],
    3: [
        (0.25, 0.25, 0.5),
        (0.125, 0.375, 0.5),
        (0.3125, 0.3125, 0.375),
        (1.0, 0.0, 0.0),
        (0.0, 0.25, 0.75),
        (2.0**-30, 0.5, 0.5 - 2.0**-30),
        (2.0**-30, 2.0**-29, 1.0 - 3.0 * 2.0**-30),
        (0.0625, 0.46875, 0.46875),
    ],
}


def exact(normal, offset):
    """1/(D! m_1...m_D) sum over subsets S of (-1)^|S| (a - sum_S m)_+^D, of the components that are not zero."""
    m = [Fraction(x) for x in normal if x]
    total = sum(
        (-1) ** len(chosen) * max(Fraction(offset) - sum(chosen), Fraction(0)) ** len(m)
        for size in range(len(m) + 1)
        for chosen in itertools.combinations(m, size)
    )
    return float(total / (math.factorial(len(m)) * math.prod(m)))


@pytest.mark.parametrize("dimension", (2, 3))
def test_volume_and_its_inverse(dimension):
    normals = np.array(NORMALS[dimension])
    offsets = np.linspace(0.0, 1.0, 41)
    m = tuple(jnp.asarray(np.repeat(normals[:, a], offsets.size)) for a in range(dimension))
    a = jnp.asarray(np.tile(offsets, len(normals)))
    volume = jax.jit(volume_below)(m, a)
    expected = np.array([exact(n, x) for n in normals for x in offsets])
    np.testing.assert_allclose(volume, expected, atol=2e-15)
    inside = (expected > 1e-12) & (expected < 1.0 - 1e-12)
    back = jax.jit(offset_of)(m, jnp.where(inside, volume, 0.5))
    again = jax.jit(volume_below)(m, back)
    np.testing.assert_allclose(again[inside], expected[inside], atol=5e-15)
    np.testing.assert_allclose(back[inside], np.asarray(a)[inside], atol=1e-9)


def test_slopes_are_finite_and_those_of_the_inverse():
    m = tuple(jnp.asarray(x)[None] for x in np.array(NORMALS[3]).T)
    volumes = jnp.asarray([1e-14, 1e-3, 0.2, 0.45, 0.5, 0.7, 1.0 - 1e-12])[:, None] * jnp.ones((1, len(NORMALS[3])))
    m = tuple(jnp.broadcast_to(x, volumes.shape) for x in m)

    def both(m, volume):
        offset = offset_of(m, volume)
        return jnp.sum(offset), jnp.sum(volume_below(m, lax.stop_gradient(offset)))

    slope = jax.jit(jax.grad(lambda v: both(m, v)[0]))(volumes)
    inverse = jax.jit(jax.grad(lambda a: jnp.sum(volume_below(m, a))))(offset_of(m, volumes))
    np.testing.assert_allclose(slope * inverse, 1.0, rtol=1e-6)
    for slopes in jax.jit(jax.grad(lambda m: sum(both(m, volumes))))(m):
        assert np.isfinite(slopes).all()


@pytest.mark.parametrize("dimension", (2, 3))
def test_slopes_are_finite_in_single_precision_where_a_component_has_no_square(dimension):
    """At the ends of the cell and just within, where the plane is as good as parallel to sides of the cell."""
    small = [jnp.full(4, size, jnp.float32) for size in (1e-25, 1e-24)[: dimension - 1]]
    m = (*small, jnp.ones(4, jnp.float32))
    offset = jnp.asarray([0.0, 5e-26, 2e-25, 1.0], jnp.float32)
    slopes = jax.jit(jax.grad(lambda m, a: jnp.sum(volume_below(m, a)), (0, 1)))(m, offset)
    for slope in jax.tree.leaves(slopes):
        assert np.isfinite(slope).all()
