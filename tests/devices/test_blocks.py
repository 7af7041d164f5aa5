"""Slabs on host devices: neighbours, ends and what is combined over all slabs."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.sharding import Mesh, PartitionSpec

from jaxdem.numerics import blocks as over_blocks
from jaxdem.numerics.blocks import MESH_AXIS, Blocks

NUMBERS = (1, 2, 4)


def on_slabs(blocks, function, *arrays):
    """The function of each slab's part of the arrays, along their first axis."""
    mesh = Mesh(np.array(jax.devices()[: blocks.number]), (MESH_AXIS,))
    spec = PartitionSpec(MESH_AXIS)
    return jax.jit(jax.shard_map(function, mesh=mesh, in_specs=spec, out_specs=spec, check_vma=False))(*arrays)


@pytest.mark.parametrize("number", NUMBERS)
def test_neighbours_are_a_ring(number):
    blocks, own = Blocks(number, 0, periodic=True), jnp.arange(3.0 * number)

    def both(x):
        return blocks.from_lower({"x": x})["x"], blocks.from_upper((x,))[0]

    lower, upper = on_slabs(blocks, both, own)
    np.testing.assert_array_equal(lower, np.roll(own, 3))
    np.testing.assert_array_equal(upper, np.roll(own, -3))


@pytest.mark.parametrize("number", NUMBERS)
def test_at_an_end_there_is_no_neighbour(number):
    blocks, own = Blocks(number, 0, periodic=False), jnp.arange(1.0, number + 1.0)
    lower, upper = on_slabs(blocks, lambda x: (blocks.from_lower(x), blocks.from_upper(x)), own)
    np.testing.assert_array_equal(lower, [0, *own[:-1]])
    np.testing.assert_array_equal(upper, [*own[1:], 0])


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("number", NUMBERS)
def test_only_an_axis_that_is_not_periodic_has_ends(number, periodic):
    blocks = Blocks(number, 1, periodic)
    ends = on_slabs(blocks, lambda x: jnp.stack([blocks.is_first(), blocks.is_last()])[None], jnp.zeros(number))
    expected = np.zeros((number, 2), bool)
    if not periodic:
        expected[0, 0] = expected[-1, 1] = True
    np.testing.assert_array_equal(ends, expected)


def test_combined_over_all_slabs():
    blocks, x = Blocks(4, 0, periodic=False), jnp.array([3.0, -1.0, 7.0, 2.0])

    def combined(x):
        own = jnp.squeeze(x)
        found = over_blocks.total(blocks, own), over_blocks.largest(blocks, own), over_blocks.any_of(blocks, own > 5)
        return jnp.stack([y.astype(float) for y in found])[None]

    np.testing.assert_array_equal(on_slabs(blocks, combined, x), np.tile([11.0, 7.0, 1.0], (4, 1)))
    none = on_slabs(blocks, lambda x: blocks.any(x > 8), x)
    assert not none.any()


def test_one_device_computes_nothing():
    x = jnp.ones(3)
    assert over_blocks.total(None, x) is x
    assert over_blocks.largest(None, x) is x
    assert over_blocks.any_of(None, x) is x


def test_the_derivative_of_a_replicated_sum_is_that_on_one_device():
    """By reverse mode through neighbours and a sum; a factor for every slab would be a usual mistake."""
    blocks = Blocks(4, 0, periodic=True)

    def objective(x, sum_of, below):
        return sum_of(x**2 * below(x)) ** 2

    mesh = Mesh(np.array(jax.devices()[:4]), (MESH_AXIS,))

    @partial(jax.shard_map, mesh=mesh, in_specs=PartitionSpec(MESH_AXIS), out_specs=PartitionSpec(), check_vma=False)
    def on_four(x):
        return objective(x, lambda y: blocks.total(jnp.sum(y)), lambda y: blocks.from_lower(y))

    def on_one(x):
        return objective(x, jnp.sum, lambda y: jnp.roll(y, 1))

    x = jnp.array([0.3, -1.2, 0.7, 2.0])
    np.testing.assert_allclose(jax.jit(jax.grad(on_four))(x), jax.grad(on_one)(x), rtol=1e-14)


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("number", NUMBERS)
def test_both_ways_are_a_message_each(number, periodic):
    """Of one slab none: it is its own neighbour, or has none. Of two slabs one, unless the arrays differ in length.
    Slopes by both are those of each way alone."""
    blocks = Blocks(number, 0, periodic)
    low, high = np.random.default_rng(0).normal(size=(2, number))
    program = jax.jit(lambda a, b: on_slabs(blocks, blocks.from_both, a, b))
    below, above = program(low, high)
    expected = [np.roll(high, 1), np.roll(low, -1)]
    if not periodic:
        expected[0][0] = expected[1][-1] = 0.0
    np.testing.assert_array_equal(below, expected[0])
    np.testing.assert_array_equal(above, expected[1])
    assert program.lower(low, high).as_text().count("collective_permute") == {1: 0, 2: 1, 4: 2}[number]

    def weighted(exchange):
        def objective(low, high):
            below, above = on_slabs(blocks, exchange, low, high)
            return jnp.sum(below * 2.0 + above**3)

        return jax.jit(jax.grad(objective, argnums=(0, 1)))(low, high)

    alone = weighted(lambda a, b: (blocks.from_lower(jnp.sin(b)), blocks.from_upper(jnp.sin(a))))
    np.testing.assert_array_equal(weighted(lambda a, b: blocks.from_both(a, b, jnp.sin)), alone)
    longer = jax.jit(lambda a, b: on_slabs(blocks, lambda a, b: blocks.from_both(jnp.stack((a, a)), b)[0], a, b))
    np.testing.assert_array_equal(longer(low, high), expected[0])
