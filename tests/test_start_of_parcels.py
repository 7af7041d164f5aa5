"""Starts in 3-D of parcels, with a pack that has settled, Basset memory and probes: with unchanged keys the bits of one
run; of larger parcels a merge."""

from __future__ import annotations

import copy
import json

import jax
import numpy as np
import pytest
from typer.testing import CliRunner

from jaxdem import load_run, load_scene, simulate
from jaxdem.check.check import check_scene
from jaxdem.check.stages import check_stages
from jaxdem.cli.main import app
from jaxdem.io import read_checkpoint
from jaxdem.setup.builder import build_case
from tests.cases.tiers import COMBINATION

RADIUS, PARCELS, INTERVAL, HALF, END = 5e-4, 40, 1e-3, 0.01, 0.02
SCENE = {
    "seed": 3,
    "domain": {"size": [0.01, 0.01, 0.02]},
    "particles": {
        "radius": RADIUS,
        "density": 2500.0,
        "coarse_grain": 2.0,
        "pack": {"kind": "settled", "start": [0.0, 0.0, 0.0], "stop": [0.01, 0.01, 0.018], "count": PARCELS},
    },
    "contact": {"young_modulus": 1e6, "restitution": 0.5, "friction": 0.5, "speed": 1.0},
    "fluid": {"cells": [2, 2, 4], "density": 1000.0, "viscosity": 1e-6, "time_step": INTERVAL},
    "boundary": {"bottom": {"kind": "inlet", "velocity": 0.08}, "top": {"kind": "outlet"}},
    "coupling": {"drag": "koch_hill", "basset": 3},
    "time": {"end": END, "output_interval": 0.005},
    "output": {"checkpoint_interval": 0.0},
    "probes": [{"name": "plane", "kind": "plane", "axis": "z", "at": 0.003, "interval": 3 * INTERVAL}],
}
"""Parcels at rest, which a stream of water lifts."""


@pytest.fixture(scope="module", autouse=True)
def in_single_precision():
    with jax.enable_x64(False):
        yield


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """One run; its first half as a run of its own; and the second half, which begins from there."""
    folder = tmp_path_factory.mktemp("parcels")
    whole = simulate(load_scene(SCENE), folder / "whole")
    half = simulate(load_scene(SCENE, {"time.end": HALF}), folder / "half")
    return whole, half, simulate(later(half), folder / "second")


def later(run, changes=None):
    return load_scene(copy.deepcopy(SCENE) | {"start": {"from": str(run.path)}}, changes)


@COMBINATION
def test_parcels_in_3d_go_on_with_the_same_bits(runs):
    """Places, contact springs, what the Basset force remembers: all of the last checkpoint and frame."""
    whole, half, second = runs
    assert whole.summary["valid"] and second.summary["valid"]
    ours, theirs = (read_checkpoint(run.path / "checkpoint.h5")[0] for run in (whole, second))
    assert ours.keys() == theirs.keys()
    memory = [name for name in ours if "fluid_memory" in name and "basset" in name]
    assert memory and max(np.abs(ours[name]).max() for name in memory) > 0.0
    assert np.abs(ours["state.particles.contact_spring[0]"]).max() > 0.0
    for name in ours:
        if not name.startswith("extra/"):
            assert ours[name].tobytes() == theirs[name].tobytes(), name
    assert whole.history["drag_force_mean"][-1] == second.history["drag_force_mean"][-1] > 0.0
    assert second.summary["start"]["from"] == str(half.path) and "merged" not in second.summary["start"]


@COMBINATION
def test_probes_go_on_over_a_start(runs):
    """The two files one after the other are the file of one run, though a row has the mean over three intervals and
    the start is within one."""
    whole, half, second = (run.probes["plane"] for run in runs)
    assert len(half["time"]) == 3 and len(second["time"]) == 3 and second["time"][0] < HALF + 3 * INTERVAL
    for name in whole:
        np.testing.assert_array_equal(np.concatenate([half[name], second[name]]), whole[name])
    assert np.abs(whole["fluid_volume_flow"]).max() > 0.0


@pytest.fixture(scope="module")
def larger(runs, tmp_path_factory):
    """Ten intervals of parcels of l = 3, made of those of l = 2."""
    each = SCENE["probes"][0] | {"name": "each", "interval": INTERVAL}
    changes = {"particles.coarse_grain": 3.0, "probes": [SCENE["probes"][0], each], "time.end": 0.02}
    folder = tmp_path_factory.mktemp("larger")
    scene = later(runs[1], changes)
    path = folder / "scene.toml"
    path.write_text(scene.to_toml())
    done = CliRunner().invoke(app, ["run", str(path), "--out", str(folder / "run")])
    assert done.exit_code == 0, done.output
    return scene, done.output, load_run(folder / "run")


@COMBINATION
def test_merged_parcels_run_on(runs, larger):
    """27/8 of the parcels make a larger one: 11 of them of 40, and the rest is told."""
    scene, printed, run = larger
    half = runs[1]
    told = run.summary["start"]["merged"]
    number = int(PARCELS * 8 / 27)
    assert (told["particles"], told["parcels"], told["to_one"]) == (PARCELS, number, 27 / 8)
    assert run.summary["valid"] and run.summary["counts"]["particles"] == number
    assert run.summary["counts"]["grains_per_particle"] == 27.0
    assert run.times[0] == HALF and run.summary["counts"]["coupling_intervals"] == 10
    grain = 4.0 / 3.0 * np.pi * RADIUS**3 * 2500.0
    assert told["left_out_mass"] == pytest.approx(grain * (8 * PARCELS - 27 * number), rel=1e-6)
    frame, before = run.particles(0), half.particles(-1)
    np.testing.assert_allclose(frame["radius"], 3.0 * RADIUS, rtol=1e-6)
    assert frame["position"][:, 2].max() < before["position"][:, 2].max() + 3.0 * RADIUS
    history = run.history["kinetic_energy"][0]
    assert history == pytest.approx(told["energy_after"], rel=1e-5) and history < told["energy_before"]
    # The fluid goes on, around the volume of the grains that there are.
    solids = np.sum(1.0 - run.fluid(0)["void_fraction"].astype(float)) * 0.005**3
    assert solids == pytest.approx(27 * number * grain / 2500.0, rel=1e-5)
    np.testing.assert_array_equal(run.fluid(0)["velocity"], half.fluid(-1)["velocity"])
    assert np.abs(run.fluid(0)["velocity"]).max() > 0.01
    for text in ("merged", f"{PARCELS} particles into {number} parcels", "left out"):
        assert text in printed
    report = check_scene(scene)
    assert report.start["merged"]["parcels"] == number
    json.dumps(build_case(scene).start_figures)


@COMBINATION
def test_sums_of_probes_do_not_go_on_over_a_merge(larger):
    """A row is a mean since the merge: the third of an interval that was measured before it, of other particles, is
    not in it. Of 27 grains each is a particle that is counted."""
    run = larger[2]
    plane, each = run.probes["plane"], run.probes["each"]
    np.testing.assert_allclose(plane["time"], HALF + INTERVAL * np.array([2, 5, 8]), rtol=1e-12)
    np.testing.assert_allclose(each["time"], HALF + INTERVAL * np.arange(1, 11), rtol=1e-12)
    for name in ("fluid_volume_flow", "mass_flow", "momentum_flow_z"):
        parts = [each[name][begin:end].mean() for begin, end in ((0, 2), (2, 5), (5, 8))]
        np.testing.assert_allclose(plane[name], parts, rtol=1e-5, atol=1e-12)
    assert np.abs(np.diff(each["fluid_volume_flow"])).min() > 1e-5 * np.abs(each["fluid_volume_flow"]).max()
    mass = 27.0 * 4.0 / 3.0 * np.pi * RADIUS**3 * 2500.0
    np.testing.assert_allclose(each["mass_flow"] * INTERVAL, mass * each["number"], rtol=1e-5)


@COMBINATION
def test_a_merge_is_resumed_from_the_runs_own_folder(larger):
    """`start.h5` has the particles before the merge; it is made again, the same."""
    scene, _, run = larger
    again = simulate(scene.model_copy(), run.path, resume=True)
    assert again.summary["start"] == run.summary["start"]
    known = load_scene(run.path / "scene.toml")
    assert known.particles.coarse_grain == 3.0 and not known.start.absent


def test_stages_may_merge():
    """Checked before anything has run, when places are not known yet."""
    stages = [{"name": "one", "time": {"end": HALF}}, {"name": "two", "time": {"end": END}}]
    stages[1]["particles"] = {"coarse_grain": 4.0}
    reports = list(check_stages(load_scene(copy.deepcopy(SCENE) | {"probes": [], "stages": stages})))
    assert [report.particles for _, report in reports] == [PARCELS, PARCELS // 8]
