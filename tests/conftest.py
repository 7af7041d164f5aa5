"""Strict settings for all tests: float64 unless a test asks for less, no silent rank promotion."""

import jax
import pytest

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")

from benchmarks.cases.worlds import runner  # noqa: E402 - after the settings


@pytest.fixture(autouse=True)
def own_programs(request):
    """A test that replaces code compiles its own programs of small worlds, and leaves none to others."""
    if "monkeypatch" not in request.fixturenames:
        yield
        return
    runner.cache_clear()
    yield
    runner.cache_clear()
