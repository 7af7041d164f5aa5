"""A scene with walls that the fluid sees that begins from the state of another run."""

from __future__ import annotations

import copy

from jaxdem import load_scene, simulate

HALF, END = 0.02, 0.04
SCENE = {
    "precision": "float64",
    "domain": {"size": [0.2, 0.1], "gravity": [0.0, 0.0]},
    "particles": {"radius": 0.004, "density": 2500.0, "position": [[0.05, 0.078], [0.06, 0.03]]},
    "contact": {"young_modulus": 1e5, "speed": 0.5},
    "fluid": {"cells": [16, 8], "viscosity": 1e-4, "velocity": [0.3, 0.0]},
    "boundary": {"left": {"kind": "inlet", "velocity": 0.3, "ramp_time": 0.0}, "right": {"kind": "outlet"}},
    "walls": [{"kind": "cylinder", "center": [0.1, 0.05], "radius": 0.02, "inside": False, "fluid": "no_slip"}],
    "coupling": {"interval": 0.005},
    "time": {"end": END, "output_interval": 0.01},
}


def scene(end, **tables):
    given = copy.deepcopy(SCENE) | tables
    given["time"]["end"] = end
    return load_scene(given)


def test_two_halves_are_the_whole(tmp_path):
    """Bit for bit, void fraction and pressure between the walls too."""
    whole = simulate(scene(END), tmp_path / "whole")
    half = simulate(scene(HALF), tmp_path / "half")
    rest = simulate(scene(END, start={"from": str(half.path)}), tmp_path / "rest")
    pairs = [(whole.particles(-1), rest.particles(-1)), (whole.fluid(-1), rest.fluid(-1))]
    for before, after in pairs:
        for name, values in before.items():
            assert values.tobytes() == after[name].tobytes(), name
