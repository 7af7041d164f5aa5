"""Lets the tests here and in `tests/physics` import `worlds`."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from worlds import runner


@pytest.fixture(autouse=True)
def own_programs(request):
    """A test that replaces code compiles its own programs, and leaves none to others."""
    if "monkeypatch" not in request.fixturenames:
        yield
        return
    runner.cache_clear()
    yield
    runner.cache_clear()
