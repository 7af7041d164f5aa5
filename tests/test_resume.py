"""A run that was stopped and resumed is the uninterrupted run, bit for bit; one that ran out of room is it
but for rounding."""

from __future__ import annotations

import os
import shutil
import signal
import tomllib
from pathlib import Path

import h5py
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem import InputError, RunError, load_run, load_scene, simulate
from jaxdem.failures import OF_PARTICLES, failures, first_meaning
from jaxdem.io import scene_text
from jaxdem.particles import list_room
from jaxdem.run import chunk
from jaxdem.run.chunk import Records
from jaxdem.run.restart import origin
from jaxdem.run.scene_run import simulate_once
from jaxdem.run.time_loop import Interrupted, TimeLoop
from jaxdem.run.totals import Totals
from jaxdem.state import Parameters
from tests.cases.tiers import COMBINATION

SCENE = {
    "domain": {"size": [0.2, 0.2], "depth": 0.04},
    "particles": {
        "radius": 0.01,
        "density": 2650.0,
        "pack": {
            "kind": "lattice",
            "start": [0.01, 0.02],
            "stop": [0.15, 0.15],
            "spacing": 1.05,
            "jitter": 0.04,
        },
    },
    "contact": {"young_modulus": 5e5, "restitution": 0.6, "friction": 0.4, "skin": 0.06, "speed": 1.0},
    "fluid": {"cells": [5, 5], "time_step": 0.01},
    "boundary": {
        "left": {
            "kind": "inlet",
            "velocity": 0.2,
            "from": 0.0,
            "to": 0.08,
            "ramp_time": 0.0,
            "temperature": 300.0,
            "scalars": {"dye": 1.0},
        },
        "right": {"kind": "outlet"},
        "bottom": {"temperature": 350.0},
    },
    "coupling": {"drag": "koch_hill"},
    "heat": {
        "fluid_heat_capacity": 4000.0,
        "fluid_conductivity": 0.6,
        "fluid_temperature": 300.0,
        "expansion": 2e-4,
        "particle_heat_capacity": 800.0,
        "particle_temperature": 310.0,
        "particle_conductivity": 2.0,
        "true_young_modulus": 5e10,
    },
    "scalars": [{"name": "dye", "diffusivity": 1e-6, "value": 1.0}],
    "time": {"end": 0.2, "output_interval": 0.02},
    "output": {"samples": 0.02, "checkpoint_interval": 0.0},
    "probes": [
        {"name": "in", "kind": "plane", "axis": "x", "at": 0.0, "interval": 0.01},
        {"name": "out", "kind": "plane", "axis": "x", "at": 0.2, "interval": 0.05, "begin": 0.01},
        {"name": "layers", "kind": "profile", "axis": "z", "cells": 3, "average": True, "interval": 0.05},
        {"name": "jet", "kind": "point", "points": [[0.1, 0.04], [0.19, 0.1]], "average": True, "window": 0.01},
    ],
}
INTERVALS, STOPPED_AT = 20, 9
"""The stop lies between two outputs, so that the sums since the last output must be in the checkpoint."""


@pytest.fixture(scope="module")
def scene():
    return load_scene(SCENE)


@pytest.fixture(scope="module")
def whole(scene, tmp_path_factory):
    """The uninterrupted run."""
    return simulate(scene, tmp_path_factory.mktemp("whole") / "run")


def stop_at(interval, action):
    """A progress function that acts after so many intervals of the scene."""

    def progress(time, end):
        if round(time / end * INTERVALS) == interval:
            action()

    return progress


@pytest.fixture(scope="module")
def resumed(scene, tmp_path_factory):
    """Stopped by a signal between two outputs, then resumed."""
    out = tmp_path_factory.mktemp("resumed") / "run"
    with pytest.raises(Interrupted) as caught, pytest.MonkeyPatch.context() as patch:
        patch.setattr("jaxdem.run.summary.WORTH_SPLITTING", 0.0)
        patch.setattr(chunk, "LONGEST", 0.0)  # the host looks after every interval
        simulate(scene, out, progress=stop_at(STOPPED_AT, lambda: os.kill(os.getpid(), signal.SIGTERM)))
    assert caught.value.number == signal.SIGTERM
    half = load_run(out)
    assert half.summary["stages_s"]["neighbors"] is None, "nothing is compiled to tell stages apart"
    assert not half.summary["valid"]
    assert not half.summary["complete"]
    assert "--resume" in half.summary["reason"]
    assert half.number_of_frames == 1 + STOPPED_AT // 2
    return simulate(scene, out, resume=True)


def file_bytes(run, name):
    return (Path(run.path) / name).read_bytes()


def assert_same_frames(first, second):
    """Every array of every frame, bit for bit."""
    assert first.number_of_frames == second.number_of_frames == 11
    for index in range(first.number_of_frames):
        for kind in ("particles", "fluid"):
            ours, theirs = getattr(first, kind)(index), getattr(second, kind)(index)
            assert ours.keys() == theirs.keys()
            for name in ours:
                assert ours[name].tobytes() == theirs[name].tobytes(), f"{kind} frame {index}: {name}"


def checkpoint_arrays(run):
    """Arrays of the checkpoint, without the wall times."""
    arrays = {}
    with h5py.File(Path(run.path) / "checkpoint.h5") as file:
        file.visititems(lambda name, item: arrays.update({name: item[()]} if isinstance(item, h5py.Dataset) else {}))
    names = {name: name.replace("%2F", "/") for name in arrays}
    timed = ("extra/wall", "extra/start", "extra/stage_")
    return {names[name]: value for name, value in arrays.items() if not any(t in names[name] for t in timed)}


def test_the_run_is_worth_resuming(whole):
    """Contacts, a moving fluid and rebuilt neighbour lists, or the other tests would show nothing."""
    counts = whole.summary["counts"]
    assert whole.summary["valid"]
    assert counts["neighbor_builds"] >= 5
    assert whole.history["collision_force_mean"][-1] > 0.0
    assert whole.history["drag_force_mean"][-1] > 0.0
    assert np.abs(whole.particles(-1)["contact_force"]).max() > 0.0
    assert np.abs(whole.particles(-1)["angular_velocity"]).max() > 0.0
    assert whole.history["fluid_velocity_mean"][-1] > 0.0


def test_resumed_by_signal_the_run_is_the_same(whole, resumed):
    assert resumed.summary["valid"]
    assert file_bytes(whole, "history.csv") == file_bytes(resumed, "history.csv")
    assert_same_frames(whole, resumed)


def test_the_last_checkpoints_agree_bit_for_bit(whole, resumed):
    ours, theirs = checkpoint_arrays(whole), checkpoint_arrays(resumed)
    assert ours.keys() == theirs.keys()
    assert len(ours) > 20
    for name in ours:
        assert np.asarray(ours[name]).tobytes() == np.asarray(theirs[name]).tobytes(), name


def test_samples_agree_bit_for_bit(whole, resumed):
    with h5py.File(whole.path / "samples.h5") as ours, h5py.File(resumed.path / "samples.h5") as theirs:
        names = []
        ours.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
        assert names
        for name in names:
            assert np.asarray(ours[name]).tobytes() == np.asarray(theirs[name]).tobytes(), name


def test_the_rows_of_probes_agree_bit_for_bit(whole, resumed):
    """The stop lies within the time over which three of them average."""
    assert list(whole.probes) == ["in", "out", "layers", "jet"]
    for name in whole.probes:
        file = f"probes/{name}.csv"
        assert len(file_bytes(whole, file).splitlines()) == {"in": 21, "out": 4, "layers": 13, "jet": 21}[name]
        assert file_bytes(whole, file) == file_bytes(resumed, file)


def test_the_fluid_that_comes_in_goes_out(whole):
    """The volume of the grains in the box is constant, and so is that of the fluid: 0.2 m/s through 0.08 m x 0.04 m."""
    np.testing.assert_allclose(whole.probes["in"]["fluid_volume_flow"], 0.2 * 0.08 * 0.04, rtol=1e-5)
    np.testing.assert_allclose(whole.probes["out"]["fluid_volume_flow"], 0.2 * 0.08 * 0.04, rtol=1e-4)
    np.testing.assert_allclose(whole.probes["out"]["time"], [0.06, 0.11, 0.16])


def test_heat_is_kept(whole):
    """What is in fluid and grains is what was there, and what has passed the sides; a uniform dye stays uniform."""
    heat = whole.summary["heat"]
    assert abs(heat["missing_relative"]) < 1e-6
    assert heat["through_sides"]["left"] > 0.0 > heat["through_sides"]["right"]
    assert heat["through_sides"]["bottom"] > 0.0 and heat["from_walls_to_grains"] > 0.0
    grains, fluid = whole.particles(-1), whole.fluid(-1)
    assert 300.0 < grains["temperature"].min() < 309.0
    np.testing.assert_allclose(fluid["dye"], 1.0, rtol=2e-5)
    assert fluid["temperature"].min() >= 300.0 and fluid["temperature"].max() < 350.0
    assert whole.history["particle_temperature_mean"][-1] == pytest.approx(grains["temperature"].mean(), rel=1e-6)


def test_slices_hold_all_grains(whole):
    table = whole.probes["layers"]
    grains, last = whole.particles(-1), table["time"] == 0.2
    np.testing.assert_allclose(table["particles"][last].sum(), len(grains["radius"]), rtol=1e-3)
    assert table["solid_fraction"][last][0] > table["solid_fraction"][last][2]


def test_counts_go_on_over_the_stop(whole, resumed):
    assert resumed.summary["counts"] == whole.summary["counts"]
    assert resumed.summary["residuals"] == whole.summary["residuals"]


def test_a_complete_run_is_given_back_unchanged(scene, resumed):
    before = file_bytes(resumed, "summary.json")
    again = simulate(scene, resumed.path, resume=True)
    assert again.summary["valid"]
    assert file_bytes(resumed, "summary.json") == before


def test_a_later_end_goes_on_bit_for_bit(scene, whole, tmp_path):
    """As one run of that length; an earlier end, or another key, is refused with what to do."""
    half = load_scene(SCENE, {"time.end": 0.1})
    run = simulate(half, tmp_path / "run")
    assert run.number_of_frames == 6 and run.summary["complete"]
    with pytest.raises(InputError, match=r"time\.end = 0\.08.*later end at most.*\[start\] from"):
        simulate(load_scene(SCENE, {"time.end": 0.08}), run.path, resume=True)
    with pytest.raises(InputError, match=r"contact\.friction = 0\.3.*\[start\] from"):
        simulate(load_scene(SCENE, {"contact.friction": 0.3}), run.path, resume=True)
    longer = simulate(scene, run.path, resume=True)
    assert longer.scene["time"]["end"] == 0.2
    assert file_bytes(whole, "history.csv") == file_bytes(longer, "history.csv")
    assert_same_frames(whole, longer)
    assert longer.summary["counts"] == whole.summary["counts"]
    with pytest.raises(InputError, match=r"time\.end = 0\.1"):
        simulate(half, run.path, resume=True)


def test_a_later_end_that_brings_more_particles_is_refused(tmp_path):
    """All frames of a run have as many rows; a scene that begins from it has room for more."""
    tables = dict(
        domain=dict(size=[0.2, 0.2], depth=0.04),
        particles=dict(
            radius=0.01,
            density=2500.0,
            inlet=[dict(side="top", rate=100.0, velocity=0.5)],
        ),
        time=dict(end=0.02, output_interval=0.02),
        contact=dict(young_modulus=5e5),
    )  # fmt: skip
    run = simulate(load_scene(tables), tmp_path / "run")
    with pytest.raises(InputError, match=r"time\.end: .*inlets bring 2 more.*\[start\] from"):
        simulate(load_scene(tables, {"time.end": 0.04}), run.path, resume=True)


def test_an_exception_leaves_what_a_resume_needs(scene, whole, tmp_path, host_patch):
    """As after a kill: nothing is closed or joined; frames beyond the checkpoint are cut off and done again."""

    def fail():
        raise KeyError("from outside")

    out = tmp_path / "run"
    host_patch.setattr(chunk, "LONGEST", 0.0)  # the host looks after every interval
    with pytest.raises(KeyError):
        simulate(scene, out, progress=stop_at(13, fail))
    assert not (out / "summary.json").exists()
    assert load_run(out).number_of_frames == 7
    again = simulate(scene, out, resume=True)
    assert file_bytes(whole, "history.csv") == file_bytes(again, "history.csv")
    for name in whole.probes:
        assert file_bytes(whole, f"probes/{name}.csv") == file_bytes(again, f"probes/{name}.csv")
    assert_same_frames(whole, again)


def test_a_complete_run_of_other_sizes_is_not_taken_for_done(tmp_path):
    """The scene names files; what is in one of them has changed since the run."""
    files = {"radius": [0.01, 0.02], "position": [[0.05, 0.1], [0.15, 0.1]], "velocity": [[0.0, 0.0], [0.0, 0.1]]}
    files["angular_velocity"] = [0.0, 1.0]
    for name, rows in files.items():
        np.savetxt(tmp_path / f"{name}.txt", rows)
    named = {name: str(tmp_path / f"{name}.txt") for name in files}
    tables = dict(
        domain=dict(size=[0.2, 0.2], depth=0.04),
        particles=dict(density=2500.0, **named),
        time=dict(end=0.001, output_interval=0.001),
    )  # fmt: skip
    run = simulate(load_scene(tables), tmp_path / "run")
    assert simulate(load_scene(tables), tmp_path / "run", resume=True).summary == run.summary
    assert simulate_once(load_scene(tables), tmp_path / "run", pytest.fail).summary == run.summary
    for name, rows in files.items():
        np.savetxt(tmp_path / f"{name}.txt", 0.9 * np.asarray(rows))
        for again in (
            lambda scene: simulate(scene, tmp_path / "run", resume=True),
            lambda scene: simulate_once(scene, tmp_path / "run", pytest.fail),
        ):
            with pytest.raises(InputError, match="is complete, of another closure"):
                again(load_scene(tables))
        np.savetxt(tmp_path / f"{name}.txt", rows)
    (tmp_path / "run" / "checkpoint.h5").unlink()  # then nothing is known of it
    assert simulate(load_scene(tables), tmp_path / "run", resume=True).summary == run.summary
    (tmp_path / "run" / "summary.json").unlink()  # broken off, with outputs: they are not thrown away
    with pytest.raises(InputError, match=r"needs checkpoint\.h5"):
        simulate_once(load_scene(tables), tmp_path / "run", lambda: lambda *_: None)
    begun = tmp_path / "begun"
    begun.mkdir()
    shutil.copy(tmp_path / "run" / "scene.toml", begun)  # stopped before its first checkpoint
    assert simulate_once(load_scene(tables), begun, lambda: lambda *_: None).summary["valid"]


def test_a_figure_that_was_lost_shows():
    """NaN is larger than all numbers, before and after; what lies beyond the chunk's end does not count."""
    totals = Totals()
    totals.add(Records(fastest=np.array([1.0, 2.0, 9.0])), 2)
    assert totals.fastest == 2.0
    totals.add(Records(fastest=np.array([1.0, np.nan])), 2)
    totals.add(Records(fastest=np.array([3.0])), 1)
    assert np.isnan(totals.fastest)


def test_particles_that_an_older_checkpoint_did_not_count_are_unknown():
    """And stay so: a part of them would be too few. A checkpoint of now goes on counting."""
    totals = Totals()
    totals.add(Records(present=np.array([3, 4, 9])), 2)
    for kept, count in ((totals.save(), 7.0 + 5.0), (totals.save() | {"present": None}, np.nan)):
        resumed = Totals()
        resumed.load({name: np.asarray(value) for name, value in kept.items() if value is not None})
        resumed.add(Records(present=np.array([5])), 1)
        np.testing.assert_equal(resumed.present, count)


def test_a_failed_run_keeps_its_frames_and_says_why(scene, tmp_path, host_patch):
    advance = TimeLoop._advance

    def failing(loop, count):
        if loop.done + count > 5:
            loop._raise(4, loop.state, None)
        return advance(loop, count)

    host_patch.setattr(TimeLoop, "_advance", failing)
    with pytest.raises(RunError, match="left the box") as caught:
        simulate(scene, tmp_path / "run")
    assert "particle" in caught.value.where
    run = load_run(tmp_path / "run")
    assert run.number_of_frames == 3
    assert not run.summary["valid"]
    assert "left the box" in run.summary["reason"]


def test_where_a_closure_lies_does_not_matter():
    """A study's folder may be moved between two calls: the checkpoint has the weights, the scene only names a file."""
    parameters = Parameters(np.zeros(2), None, None, None, None, None)
    texts = [f'seed = 1\n[closure]\nfile = "{name}"\n' for name in ("/a/drag.h5", "/b/drag.h5", "/a/other.h5")]
    here, moved, other = (origin(text, parameters)["scene"] for text in texts)
    assert here == moved != other
    scenes = [tomllib.loads(text) for text in texts]
    assert scene_text.first_difference(*scenes[:2]) is None
    assert scene_text.first_difference(scenes[0], scenes[2]) == ("closure.file", "drag.h5", "other.h5")


def test_too_few_neighbour_slots_change_nothing(tmp_path, monkeypatch):
    """Slots are added and the interval done again: the numbers are those with slots to spare.

    Of the grains alone. But for rounding, for more slots are another program: XLA joins other products and sums into
    one operation.
    """
    tables = {name: SCENE[name] for name in ("domain", "particles", "contact", "time")}
    scene = load_scene(tables, {"particles.pack.spacing": 1.3})
    whole = simulate(scene, tmp_path / "whole")
    monkeypatch.setattr(list_room, "USUAL_SLOTS", {2: 1, 3: 1})
    monkeypatch.setattr(list_room, "EXTRA_CAPACITY", 1.0)
    tight = simulate(scene, tmp_path / "run")
    counts = tight.summary["counts"]
    assert counts["neighbor_resizes"] > 0
    assert whole.summary["counts"]["neighbor_resizes"] == 0
    assert counts["neighbor_builds"] == whole.summary["counts"]["neighbor_builds"]
    # Collisions amplify rounding: to 1.5e-8 ... 1.2e-7 m at the end of the run, by the compiler's options; little in
    # its first half.
    for index in range(whole.number_of_frames // 2 + 1):
        ours, theirs = whole.particles(index), tight.particles(index)
        np.testing.assert_allclose(ours["position"], theirs["position"], rtol=0, atol=1e-7)
        np.testing.assert_allclose(ours["velocity"], theirs["velocity"], rtol=0, atol=2e-5)


@COMBINATION
def test_what_else_is_wrong_after_an_overflow_does_not_count(scene, whole, tmp_path, monkeypatch):
    """Particles that missed their contacts may be lost or too fast: the interval is done again all the same."""
    monkeypatch.setattr(list_room, "USUAL_SLOTS", {2: 1, 3: 1})
    monkeypatch.setattr(list_room, "EXTRA_CAPACITY", 1.0)

    def worse(simulation, diagnostics):
        code = failures(simulation, diagnostics)
        return code | jnp.where(diagnostics.particles.overflow, int(OF_PARTICLES), 0)

    monkeypatch.setattr(chunk, "failures", worse)
    tight = simulate(scene, tmp_path / "run")
    assert tight.summary["valid"] and tight.summary["counts"]["neighbor_resizes"] > 0
    assert first_meaning(int(OF_PARTICLES))[0] == "the neighbour list ran out of room"
