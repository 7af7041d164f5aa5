"""Lets the contact tests here import `worlds`, the small scenes of `tests/particles`."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "particles"))

from worlds import own_programs  # noqa: F401 - a fixture
