"""Messages of programs over several devices are in one order, which does not change what they give."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from jax.sharding import Mesh, PartitionSpec

import jaxdem
from jaxdem.devices.message_order import in_one_order
from jaxdem.numerics.blocks import MESH_AXIS
from jaxdem.run import chunk
from tests.cases.program_text import unordered_messages
from tests.cases.tiers import COMBINATION
from tests.devices.test_probes import LEAN

ROUND = [(0, 1), (1, 0)]


def sent(x):
    return lax.ppermute(x, MESH_AXIS, ROUND)


def total(x):
    return lax.psum(x, MESH_AXIS)


def loop(x):
    """A number of steps that is found while it runs."""
    return lax.while_loop(lambda c: c[0] < x.size, lambda c: (c[0] + 1, 0.5 * (c[1] + sent(jnp.sin(c[1])))), (0, x))[1]


def branch(x, least=-9.0):
    """Both devices take the same one."""
    return lax.cond(lax.pmax(x[0], MESH_AXIS) > least, lambda x: x - total(x), lambda x: 2.0 * x, x)


def scan(x):
    return lax.scan(lambda c, k: (0.5 * c + sent(c) * k, total(c)), x, jnp.arange(3.0))


def solve(x):
    """Of 2 y = x, by what stands for iterations with sums over all."""

    def iterated(_, b):
        return lax.fori_loop(0, 3, lambda k, y: y + 0.5 * (b - 2.0 * y) + 0.0 * total(y), 0.5 * b)

    return lax.custom_linear_solve(lambda y: 2.0 * y, x, iterated, symmetric=True)


PARTS = {
    "loop and branch": lambda x, y: (loop(x), branch(y)),
    "loop and message": lambda x, y: (loop(x), total(y)),
    "message and loop": lambda x, y: (total(y), loop(x)),
    "scan and branches": lambda x, y: (scan(x), branch(y), branch(y + 1.0, 9.0)),
    "solve and branch": lambda x, y: (solve(x), branch(y)),
    "in calls": lambda x, y: (jax.jit(loop)(x), jax.jit(branch)(y)),
    "within a loop": lambda x, y: lax.fori_loop(0, 3, lambda k, c: (loop(c[0]), branch(c[1])), (x, y)),
    "within a branch": lambda x, y: lax.cond(
        total(x)[0] > 0.0, lambda x, y: (loop(x), branch(y)), lambda x, y: (y, x), x, y
    ),
    "of whole numbers": lambda x, y: (
        lax.fori_loop(0, 3, lambda k, c: c + sent(c), jnp.int32(10.0 * x)),
        lax.cond(lax.pmax(y[0], MESH_AXIS) > -9.0, lambda b: sent(b), lambda b: b, y > 0.3),
    ),
}


def on_two(function):
    mesh = Mesh(np.array(jax.devices()[:2]), (MESH_AXIS,))
    spec = PartitionSpec(MESH_AXIS)

    def of_one(x, y):
        return jax.tree.map(lambda one: one[None], function(x[0], y[0]))

    return jax.jit(jax.shard_map(of_one, mesh=mesh, in_specs=spec, out_specs=spec, check_vma=False))


@pytest.mark.parametrize("name", PARTS)
def test_blocks_and_messages_wait_for_each_other(name):
    given = np.random.default_rng(3).normal(size=(2, 2, 4))
    plain, ordered = (on_two(one).lower(*given).compile() for one in (PARTS[name], in_one_order(PARTS[name])))
    assert unordered_messages(plain.as_text()), "nothing to order"  # not to be run: it may not come to an end
    assert not unordered_messages(ordered.as_text())
    expected = jax.jit(jax.vmap(PARTS[name], axis_name=MESH_AXIS))(*given)
    jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-14, atol=1e-14), ordered(*given), expected)


def test_not_a_number_goes_on():
    given = np.full((2, 2, 4), np.nan)
    for values in on_two(in_one_order(PARTS["loop and message"]))(*given):
        assert np.isnan(values).all()


def test_what_sends_nothing_is_the_same_program():
    x = jnp.arange(4.0)

    def function(x):
        return lax.fori_loop(0, 3, lambda k, y: jnp.sin(y), x)

    texts = [jax.jit(one).lower(x).as_text() for one in (function, in_one_order(function))]
    assert texts[0].split("{", 1)[1] == texts[1].split("{", 1)[1]


@COMBINATION
def test_messages_of_a_run_are_in_one_order(tmp_path, host_patch):
    """A scene with probes, a piston and an inlet: without an order 70 pairs are left open."""
    texts = []
    own = chunk.SlabProgram.__init__

    def kept(self, *given):
        own(self, *given)
        texts.append(self._compiled.as_text())

    host_patch.setattr(chunk.SlabProgram, "__init__", kept)
    jaxdem.simulate(jaxdem.load_scene(LEAN), tmp_path / "run", devices=2)
    assert texts and not any(map(unordered_messages, texts))
