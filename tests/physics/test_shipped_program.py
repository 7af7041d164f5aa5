"""The tests compile otherwise than users do (`tests/conftest.py`): a coupled run gives the same with both."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest

import jaxdem
from tests.cases.tiers import COMBINATION

COMPILER = ("XLA_FLAGS", "JAX_DISABLE_MOST_OPTIMIZATIONS")
"""What the tests set of the compiler."""

SCENE = """
seed = 4
precision = "float64"
[domain]
size = [0.2, 0.2]
depth = 0.04
[particles]
count = 40
radius = 0.01
density = 3000.0
pack = { kind = "lattice", start = [0.0, 0.0], stop = [0.16, 0.2], spacing = 1.04, jitter = 0.04 }
[contact]
young_modulus = 1e6
friction = 0.4
rolling_friction = 0.1
restitution = 0.6
[fluid]
cells = [5, 5]
density = 1000.0
viscosity = 1e-6
[boundary.left]
kind = "inlet"
velocity = 0.3
from = 0.0
to = 0.08
[boundary.right]
kind = "outlet"
[time]
end = 0.1
output_interval = 0.02
"""


@COMBINATION
def test_a_coupled_run_is_the_same_as_with_the_program_that_users_have(tmp_path):
    """Contacts, lists, fluid and exchange: every metric to 1e-9, where rounding differs and grains have hardly met."""
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    if not (os.environ.get("XLA_FLAGS") or jax.config.read("jax_disable_most_optimizations")):
        pytest.skip("the tests run with the shipped program themselves")
    ours = jaxdem.simulate(jaxdem.load_scene(path), tmp_path / "ours")
    shipped = {key: value for key, value in os.environ.items() if key not in COMPILER}
    shipped["PYTHONPATH"] = str(Path(__file__).parents[2])
    command = [sys.executable, "-m", "jaxdem", "run", str(path), "--out", str(tmp_path / "theirs")]
    subprocess.run(command, env=shipped, check=True, capture_output=True, timeout=300)
    theirs = jaxdem.load_run(tmp_path / "theirs")
    assert ours.history["collision_force_mean"].max() > 0.0 and ours.history["drag_force_mean"][-1] > 0.0
    for name, column in ours.history.items():
        scale = np.abs(column).max()
        np.testing.assert_allclose(theirs.history[name], column, rtol=0, atol=1e-9 * scale, err_msg=name)
