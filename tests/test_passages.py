"""What passes inlets, outlets and openings, as runs tell it: flows that are known, and the volume of the fluid."""

import jax
import numpy as np
import pytest

from jaxdem import build, initial_state, load_scene, simulate
from jaxdem.fluid.side_conditions import FreeSlip
from jaxdem.run.chunk import Records
from jaxdem.run.totals import Totals
from tests.cases.tiers import COMBINATION

SLOPE = {
    "kind": "plane", "point": [0.2, 0.05], "normal": [0.5, 1.0], "fluid": "no_slip",
    "opening": [{
        "kind": "inlet", "flow": 4e-4, "region": {"shape": "sphere", "center": [0.2, 0.05], "radius": 0.06},
    }],
}  # fmt: skip
BED = {
    "precision": "float64",
    "domain": {"size": [0.4, 0.4], "depth": 0.02, "gravity": [0.0, -9.81]},
    "fluid": {"cells": [16, 16], "density": 1000.0, "viscosity": 1e-4},
    "boundary": {
        "left": {"kind": "inlet", "velocity": 0.1, "from": [0.21], "to": [0.3], "ramp_time": 0.04},
        "top": {"kind": "outlet"},
    },
    "particles": {
        "radius": 0.008, "density": 2000.0, "position": [[0.15, 0.2], [0.25, 0.22], [0.2, 0.15], [0.2, 0.3]],
        "inlet": [{"start": [0.05, 0.3], "stop": [0.35, 0.36], "rate": 100.0, "end": 0.035, "velocity": [0.0, 0.0]}],
    },
    "contact": {"young_modulus": 1e7},
    "walls": [SLOPE],
    "time": {"end": 0.06, "output_interval": 0.02},
}  # fmt: skip
INTO, OUT = 0.1 * 0.09 * 0.02, "outflow_top"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Grains that come in above a sloped floor with a jet in it, beside an inlet that ends within a cell."""
    return simulate(load_scene(BED), tmp_path_factory.mktemp("bed"))


def test_flows_are_those_of_the_scene_and_change_the_volume_of_the_fluid(run):
    """Means over every output interval: of ramps over 0.04 and 0.05 s what they are at the ends of the fluid steps; and
    what is left of the volume, without the grains that came, to rounding."""
    history, balance = run.history, run.summary["fluid_volume"]
    names = [f"{way}_{name}" for name in ("left", "top", "wall_0_opening_0") for way in ("inflow", "outflow")]
    assert [name for name in history if "flow" in name] == names
    assert [history[name][0] for name in names] == [0.0] * 6
    steps = run.summary["counts"]["fluid_steps"]
    ends = 0.06 / steps * (1 + np.arange(steps)).reshape(3, -1)
    for name, flow, ramp in (("left", INTO, 0.04), ("wall_0_opening_0", 4e-4, 0.05)):
        exact = flow * np.minimum(ends / ramp, 1.0).mean(axis=1)
        np.testing.assert_allclose(history[f"inflow_{name}"][1:], exact, rtol=1e-12)
        assert not history[f"outflow_{name}"].any()
    came = {name: 0.02 * history[f"inflow_{name}"].sum() for name in ("left", "wall_0_opening_0")}
    assert balance["through"]["left"]["inflow"] == pytest.approx(came["left"], rel=1e-12)
    assert balance["through"]["walls.0.opening.0"] == {
        "inflow": pytest.approx(came["wall_0_opening_0"], rel=1e-12), "outflow": 0.0,
    }  # fmt: skip
    grains = (run.summary["counts"]["present"] - 4) * np.pi / 6.0 * 0.016**3
    assert grains > 0.0
    assert 0.02 * history[OUT].sum() == pytest.approx(sum(came.values()) + grains, rel=1e-9)
    assert balance["end"] == pytest.approx(balance["start"] - grains, rel=1e-12)
    assert abs(balance["missing_relative"]) < 1e-13


def test_a_run_that_goes_on_tells_the_same(run, tmp_path):
    simulate(load_scene(BED, {"time.end": 0.04}), tmp_path / "run")
    resumed = simulate(load_scene(BED), tmp_path / "run", resume=True)
    assert resumed.summary["fluid_volume"] == run.summary["fluid_volume"]
    for name in run.history:
        np.testing.assert_array_equal(resumed.history[name], run.history[name])


def test_a_stop_between_outputs_keeps_what_has_passed():
    rows, totals, whole = np.arange(12.0).reshape(6, 1, 2), Totals(), Totals()
    whole.add(Records(passed=rows[:2]), 2)
    totals.add(Records(passed=rows[:2]), 2)
    assert whole.means().passed.tolist() == totals.means().passed.tolist() == [1.0, 2.0]
    whole.add(Records(passed=rows[2:]), 4)
    totals.add(Records(passed=rows[2:]), 1)
    resumed = Totals()
    resumed.load({name: np.asarray(value) for name, value in totals.save().items()})
    resumed.add(Records(passed=rows[3:]), 3)
    assert resumed.means().passed.tolist() == whole.means().passed.tolist() == [7.0, 8.0]
    assert resumed.passed == whole.passed == (30.0, 36.0)


@COMBINATION
def test_two_devices_tell_the_same(run, tmp_path):
    """With the inlet of the side and the opening in the first slab alone, and the outlet in both."""
    again = simulate(load_scene(BED), tmp_path / "run", devices=2)
    for name in run.history:
        if "flow" in name:
            np.testing.assert_allclose(again.history[name], run.history[name], rtol=1e-8, atol=1e-14)
    assert abs(again.summary["fluid_volume"]["missing_relative"]) < 1e-13


def test_liquid_is_told_beside_both_fluids(tmp_path):
    """Of an inlet that its level divides; net it is the liquid of the balance of `[surface]`."""
    side = {"from": [0.0], "to": [0.4]}
    scene = load_scene({
        "precision": "float64",
        "domain": {"size": [1.0, 1.0], "depth": 0.5, "gravity": [0.0, -9.81]},
        "fluid": {"cells": [8, 8], "density": 1000.0, "viscosity": 1e-6},
        "surface": {"level": 0.5, "density": 1.2, "viscosity": 1e-5},
        "boundary": {
            "left": {"kind": "inlet", "velocity": 0.2, "level": 0.3, "ramp_time": 0.0, **side},
            "right": {"kind": "outlet", "level": 0.3},
        },
        "time": {"end": 0.04, "output_interval": 0.04},
    })  # fmt: skip
    run = simulate(scene, tmp_path / "run")
    through, liquid = run.summary["fluid_volume"]["through"], run.summary["liquid_phase"]["through_sides"]
    assert abs(run.summary["fluid_volume"]["missing_relative"]) < 1e-12
    for name in ("left", "right"):
        net = through[name]["liquid_inflow"] - through[name]["liquid_outflow"]
        assert net == pytest.approx(liquid[name], rel=1e-12) and net != 0.0
    assert through["left"]["liquid_inflow"] == pytest.approx(0.75 * through["left"]["inflow"], rel=1e-12)
    assert through["right"]["outflow"] > through["right"]["liquid_outflow"] > 0.0


def test_a_box_that_nothing_passes_has_no_such_figures():
    scene = load_scene(BED | {"boundary": {}, "walls": [], "particles": BED["particles"] | {"inlet": []}})
    simulation, parameters = build(scene)
    told = jax.eval_shape(simulation.step, parameters, *initial_state(scene, simulation, parameters))[2]
    assert told.fluid.passed is None
    own, _ = build(scene, side_conditions={"left": FreeSlip()})
    assert own.boundary.passable == (0,)
