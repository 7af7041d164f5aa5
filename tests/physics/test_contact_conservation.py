"""What would break the conservation of momentum; that, and of energy: `tests/cases/conservation.py`."""

from __future__ import annotations

import numpy as np

from jaxdem.particles import pair_forces
from tests.cases.conservation import cluster, totals
from tests.cases.worlds import track


def test_full_arm_would_lose_angular_momentum(monkeypatch):
    """Negative control: with the tangential force turned about r instead of r - d/2 angular momentum
    drifts."""
    original = pair_forces.pair_geometry

    def deeper(*arguments):
        overlap, normal = original(*arguments)
        return overlap * (1 + 1e-3), normal

    monkeypatch.setattr(pair_forces, "pair_geometry", deeper)
    scene = cluster(2)
    _, seen = track(scene, 2e-5, 80, 25)
    _, angular = totals(scene, seen)
    scale = np.sum(np.asarray(scene.properties.mass)[:, None] * np.abs(np.asarray(scene.state.velocity)))
    assert np.abs(angular - angular[:1]).max() > 1e-10 * scale
