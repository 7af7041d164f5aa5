"""A scene with meshes that begins from the state of another run: what contacts with a mesh keep goes on.

They keep springs of sliding and rolling, and that JKR holds them.
"""

from __future__ import annotations

import copy

import numpy as np
import pytest

from jaxdem import load_scene, simulate
from jaxdem.setup import started
from jaxdem.setup.builder import build_case

HALF, END = 0.06, 0.12
SCENE = {
    "precision": "float64",
    "domain": {"size": [0.4, 0.4]},
    "particles": {
        "radius": [0.01, 0.012, 0.011],
        "density": 2500.0,
        "position": [[0.1, 0.0995], [0.2, 0.111], [0.3, 0.1105]],
        "velocity": [[0.03, 0.0], [0.1, 0.0], [-0.3, 0.0]],
    },
    "contact": {"young_modulus": 1e6, "friction": 0.5, "restitution": 0.1, "rolling_friction": 0.1,
                "rolling_model": "epsd", "speed": 1.0, "cohesion": {"kind": "jkr", "work_of_adhesion": 0.05}},
    "walls": [{"kind": "mesh", "points": [[-0.1, 0.0], [0.15, 0.0], [0.5, 0.0]], "translate": [0.0, 0.09],
               "motion": [{"kind": "oscillation", "direction": [1.0, 0.0], "amplitude": 0.003, "frequency": 8.0}]}],
    "time": {"end": END, "output_interval": 0.02},
}  # fmt: skip


def of_end(end, **tables):
    given = copy.deepcopy(SCENE) | tables
    given["time"]["end"] = end
    return load_scene(given)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """The run as a whole, its first half, and the folder of both."""
    folder = tmp_path_factory.mktemp("runs")
    return simulate(of_end(END), folder / "whole"), simulate(of_end(HALF), folder / "half"), folder


def test_springs_of_meshes_go_on(runs, host_patch):
    """Beginning in the middle gives the run as a whole, to rounding; contacts that begin anew would slip at first."""
    whole, half, folder = runs
    scene = of_end(END, start={"from": str(half.path)})
    second = simulate(scene, folder / "second")
    last = whole.particles(whole.number_of_frames - 1), second.particles(second.number_of_frames - 1)
    for name in ("position", "velocity", "angular_velocity"):
        np.testing.assert_allclose(last[1][name], last[0][name], rtol=0.0, atol=1e-10, err_msg=name)
    host_patch.setattr(started, "kept_of_meshes", lambda start, scene, meshes, lists, blank, rows, springs: blank)
    anew = simulate(scene, folder / "anew").particles(half.number_of_frames - 1)
    assert np.abs(anew["position"] - last[0]["position"]).max() > 1e-7


def test_springs_go_to_the_contacts_that_they_belong_to(runs):
    """With a mesh that is elsewhere nothing goes on."""
    _, half, _ = runs
    scene = of_end(END, start={"from": str(half.path)})
    state, neighbors = build_case(scene).initial_state()
    row = np.asarray(neighbors.meshes[0].row)
    spring = np.asarray(state.particles.mesh_memory[0].spring[0])
    assert (np.abs(spring).max(axis=0)[row < 3] > 1e-9).all(), "all three grains lie on the mesh"
    renamed = [SCENE["walls"][0] | {"name": "floor", "end": 5.0}]  # the same wall, which is there until then
    state, _ = build_case(of_end(END, start={"from": str(half.path)}, walls=renamed)).initial_state()
    np.testing.assert_array_equal(state.particles.mesh_memory[0].spring[0], spring)
    moved = copy.deepcopy(SCENE["walls"])
    moved[0]["translate"] = [0.0, 0.0899]
    state, _ = build_case(of_end(END, start={"from": str(half.path)}, walls=moved)).initial_state()
    assert not any(np.asarray(part).any() for part in state.particles.mesh_memory[0].spring)
