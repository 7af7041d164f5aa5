"""Runs of clumps: insertion, frames, and a run that is stopped and resumed, bit for bit."""

from __future__ import annotations

import os
import signal

import numpy as np
import pytest

from jaxdem import load_run, load_scene, simulate
from jaxdem.run import chunk
from jaxdem.run.time_loop import Interrupted

SCENE = {
    "seed": 3,
    "precision": "float64",  # compiles in half the time; pairs of floats are in tests/particles/test_clumps.py
    "domain": {"size": [0.2, 0.25]},
    "particles": {
        "count": 8,
        "density": 2000.0,
        "distribution": {
            "kind": "normal", "mean": 0.01, "standard_deviation": 0.001, "lower": 0.008, "upper": 0.012,
        },
        "species": [{"share": 0.5, "shape": "rod"}, {"share": 0.25, "shape": "two"}, {"share": 0.25}],
        "shapes": [
            {"name": "rod", "centres": [[-1.0, 0.0], [0.0, 0.0], [1.0, 0.0]], "radii": [1.0, 1.0, 1.0]},
            {"name": "two", "centres": [[0.0, 0.0], [1.0, 0.2], [0.1, 0.0]], "radii": [1.0, 0.7, 0.5]},
        ],
        "pack": {"kind": "random", "start": [0.0, 0.0], "stop": [0.2, 0.15]},
        "inlet": [{"side": "top", "rate": 40.0, "velocity": 0.5}],
    },
    "contact": {"young_modulus": 5e6, "friction": 0.5, "restitution": 0.5, "skin": 0.1},
    "coupling": {"interval": 0.01},
    "time": {"end": 0.2, "output_interval": 0.02},
    "output": {"checkpoint_interval": 0.0},
}  # fmt: skip


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """An uninterrupted run, and one that was stopped between two outputs and resumed."""
    scene, folder = load_scene(SCENE), tmp_path_factory.mktemp("clumps")
    whole = simulate(scene, folder / "whole")

    def stop(time, end):
        if round(20 * time / end) == 9:
            os.kill(os.getpid(), signal.SIGTERM)

    with pytest.raises(Interrupted), pytest.MonkeyPatch.context() as patch:
        patch.setattr(chunk, "LONGEST", 0.0)  # the host looks after every interval
        simulate(scene, folder / "resumed", progress=stop)
    assert load_run(folder / "resumed").number_of_frames < 11
    return whole, simulate(scene, folder / "resumed", resume=True)


def test_a_resumed_run_is_the_same(runs):
    whole, resumed = runs
    assert whole.summary["valid"]
    assert whole.summary["counts"]["neighbor_builds"] >= 5
    assert whole.number_of_frames == resumed.number_of_frames == 11
    for index in range(11):
        for kind in ("particles", "spheres"):
            ours, theirs = getattr(whole, kind)(index), getattr(resumed, kind)(index)
            assert ours.keys() == theirs.keys()
            for name in ours:
                assert ours[name].tobytes() == theirs[name].tobytes(), f"{kind} frame {index}: {name}"


def test_members_in_the_frames(runs):
    """Their places follow from those of the bodies and the angles; the sphere within another one is left out."""
    whole = runs[0]
    bodies, spheres = whole.particles(-1), whole.spheres(-1)
    number = np.bincount(spheres["id"], minlength=len(bodies["id"]))
    assert set(number) == {1, 2, 3}
    for body in np.flatnonzero(number == 3)[:3]:
        own = spheres["position"][spheres["id"] == body]
        assert np.allclose(own.mean(axis=0), bodies["position"][body], atol=1e-6)
        along = own[2] - own[0]
        angle = bodies["orientation"][body]
        assert np.allclose(along / np.linalg.norm(along), [np.cos(angle), np.sin(angle), 0.0], atol=1e-4)


def test_clumps_come_in_and_stay_in_the_box(runs):
    whole = runs[0]
    assert whole.summary["counts"]["inserted"] >= 5
    spheres = whole.spheres(-1)
    there = spheres["active"] > 0
    place, radius = spheres["position"][there][:, :2], spheres["radius"][there]
    assert (place - 0.8 * radius[:, None] > 0.0).all()
    assert (place[:, 0] + 0.8 * radius < 0.2).all()
    # No two bodies lie in each other.
    body = spheres["id"][there]
    apart = np.linalg.norm(place[:, None] - place[None], axis=2) / (radius[:, None] + radius[None])
    assert apart[body[:, None] != body[None]].min() > 0.8
