"""Lets the tests here import `made_frames`; the folder is no package, `io` being a module of Python."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
