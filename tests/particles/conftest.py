"""Lets the tests here and in `tests/physics` import `worlds`."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from worlds import own_programs  # noqa: F401 - a fixture
