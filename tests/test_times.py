"""Times that a run reports: what it took with and without compiling, by stage, and the simulated times it writes."""

import time as clock

import jax
import jax.numpy as jnp
import pytest

from jaxdem.compile_time import CompileClock
from jaxdem.records import Totals


def test_nested_spans_count_once():
    """Tracing reports inner functions before the outer one that contains them."""
    watch = CompileClock()
    for begin, end in ((1.0, 2.0), (2.5, 3.0), (0.5, 4.0), (5.0, 6.0), (5.5, 7.0)):
        watch.add(begin, end)
    assert watch.total == pytest.approx(3.5 + 2.0)


def test_what_is_compiled_within_a_stage_is_compile_time():
    """Also where no one thought of it: a program that an output compiles is not in the run time, nor in the output's."""
    totals = Totals()
    totals.begin()
    with totals.timed("output"):
        jax.block_until_ready(jax.jit(lambda x: jnp.cos(x) @ jnp.sin(x).T + 0.123)(jnp.ones((7, 7))))
        clock.sleep(0.05)
    wall, compiling = totals.elapsed(), totals.compile_seconds()
    assert compiling > 0.002
    assert 0.05 <= totals.stages["output"] <= wall - compiling
    resumed = Totals()
    resumed.load(totals.save())
    resumed.begin()
    assert resumed.compile_seconds() == pytest.approx(compiling, abs=1e-9)
    assert resumed.elapsed() - resumed.compile_seconds() == pytest.approx(wall - compiling, abs=0.02)
