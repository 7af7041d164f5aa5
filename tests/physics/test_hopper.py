"""The hopper of `scenes/`: loads, passes its check, and empties through its opening. The scene has its full rate."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from jaxdem import load_scene, simulate
from jaxdem.check.check import check_scene
from tests.cases.tiers import COMBINATION

SCENE = Path(__file__).parents[2] / "scenes" / "hopper.toml"
FEWER = {"particles.radius": 8e-3, "time.end": 0.12, "time.output_interval": 0.04}
"""Grains of 16 mm, 300 of them."""


def test_the_scene_passes_its_check():
    report = check_scene(load_scene(SCENE))
    assert 2300 < report.particles < 2700 and not report.warnings
    assert "additional walls: wedge" in report.compiled_in and "removal of particles" in report.compiled_in


@COMBINATION
def test_grains_leave_through_the_opening_alone(tmp_path):
    """All are there or counted as removed; those that stay lie between the planes; the first ones fall freely."""
    scene = load_scene(SCENE, FEWER)
    run = simulate(scene, tmp_path / "run")
    assert run.summary["valid"]
    start, last = run.particles(0), run.particles(-1)
    present = last["active"] > 0
    assert len(present) == present.sum() + run.history["removed"][-1] and 0 < run.history["removed"][-1] < len(present)
    x, z = last["position"][present, 0], last["position"][present, 1]
    # Distance of a centre from a plane 30 degrees from the vertical through (0.15, -0.05196): a radius less the overlap
    # that contact.maximum_overlap accepts, 20 % of a diameter.
    distance = np.cos(np.pi / 6) * ((z + 0.05196) * math.tan(np.pi / 6) - np.abs(x - 0.15))
    assert distance.min() > (1.0 - 2.0 * 0.2) * 8e-3 and z.min() > 0.0
    lowest = np.argsort(start["position"][:, 1])[:2]
    assert not present[lowest].any(), "a grain over the opening falls its radius in 40 ms"
