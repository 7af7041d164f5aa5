"""A scene with walls that the fluid sees that begins from the state of another run."""

from __future__ import annotations

import copy

import pytest

from jaxdem import load_scene, simulate
from jaxdem.setup.start_point import of_deposit
from tests.cases.tiers import tiered

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


SWINGS = {"kind": "oscillation", "direction": [0.0, 1.0], "amplitude": 0.01, "frequency": 8.0}
WARM = {
    "walls": [SCENE["walls"][0] | {"temperature": 350.0, "motion": [SWINGS]}],
    "boundary": SCENE["boundary"] | {"left": SCENE["boundary"]["left"] | {"temperature": 320.0}},
    "heat": {
        "fluid_heat_capacity": 4000.0, "fluid_conductivity": 5.0, "fluid_temperature": 300.0,
        "particle_heat_capacity": 800.0, "particle_temperature": 330.0,
    },
}  # fmt: skip


JET = {"kind": "inlet", "times": [0.0, 0.015, 0.03], "flows": [0.0, 0.002, -0.001], "ramp_time": 0.025}
OPEN = {"walls": [SCENE["walls"][0] | {"motion": [SWINGS | {"frequency": 2.0}], "opening": [JET]}]}


@pytest.mark.parametrize(
    "tables", tiered([{}, WARM, OPEN], first=[WARM]), ids=["at rest", "warm and swings", "opening in time"]
)
def test_two_halves_are_the_whole(tmp_path, tables):
    """Bit for bit, void fraction and pressure between the walls too; and heat in cells that open and close."""
    whole = simulate(scene(END, **tables), tmp_path / "whole")
    half = simulate(scene(HALF, **tables), tmp_path / "half")
    rest = simulate(scene(END, start={"from": str(half.path)}, **tables), tmp_path / "rest")
    if "heat" in tables:
        assert rest.summary["heat"]["start"] == half.summary["heat"]["fluid"] + half.summary["heat"]["grains"]
    pairs = [(whole.particles(-1), rest.particles(-1)), (whole.fluid(-1), rest.fluid(-1))]
    for before, after in pairs:
        for name, values in before.items():
            assert values.tobytes() == after[name].tobytes(), name


def test_another_opening_does_not_change_how_grains_fill_the_cells():
    """So the void fraction of the run goes on where a stage changes what comes in, but not with another place of it."""
    before = of_deposit(scene(END, **OPEN).tables())
    wall = OPEN["walls"][0]
    assert of_deposit(scene(END, walls=[wall | {"opening": [{"kind": "inlet", "flow": 0.1}]}]).tables()) == before
    assert of_deposit(scene(END, walls=[wall | {"radius": 0.03}]).tables()) != before
