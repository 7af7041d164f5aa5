"""Runs on several devices and what they measure beside frames, a start from one of them, and chains of runs, against
one device."""

import numpy as np
import pytest

import jaxdem
from jaxdem.run.parts import energy
from jaxdem.setup.builder import build_case
from tests.cases.fluid_slabs import coupled_scene, places
from tests.cases.tiers import COMBINATION

ACROSS, UP = np.meshgrid(0.012 + 0.0196 * np.arange(11), 0.0099 + 0.0196 * np.arange(4), indexing="ij")
NOISE = np.random.default_rng(2).normal(size=(ACROSS.size, 2))
LEAN = {
    "precision": "float64",
    "domain": {"size": [0.24, 0.12], "depth": 0.02},
    "particles": {
        "position": np.stack((ACROSS, UP), axis=-1).reshape(-1, 2).tolist(),
        "radius": np.where(np.arange(ACROSS.size) % 3, 0.0099, 0.009).tolist(),
        "density": 2500.0,
        "velocity": ([1.2, 0.0] + 0.3 * NOISE).tolist(),
        "inlet": [
            {"start": [0.0, 0.085], "stop": [0.24, 0.115], "rate": 400.0, "velocity": [1.0, 0.0], "radius": 0.009}
        ],
    },
    "walls": [
        {"kind": "plane", "point": [0.0, 0.118], "normal": [0.0, -1.0],
         "piston": {"direction": [0.0, -1.0], "force": 2.0, "mass": 1.0}},
    ],
    "boundary": {"right": {"particles": "remove"}},
    "contact": {"young_modulus": 1e6, "friction": 0.4, "restitution": 0.6, "speed": 2.0, "skin": 0.2,
                "rolling_friction": 0.1, "rolling_model": "epsd"},
    "output": {"energy": True},
    "time": {"end": 0.03, "output_interval": 0.01},
    "probes": [
        {"name": "gate", "kind": "plane", "axis": "x", "at": 0.235, "interval": 0.01},
        {"name": "window", "kind": "plane", "axis": "z", "at": 0.05, "from": [0.05], "to": [0.2], "interval": 0.01},
        {"name": "slices", "kind": "profile", "axis": "x", "cells": 6, "interval": 0.01, "average": True},
        {"name": "floor", "kind": "wall", "side": "bottom", "interval": 0.01},
        {"name": "contacts", "kind": "contacts", "interval": 0.01},
    ],
}  # fmt: skip
"""Rows of grains of two sizes that fly to the right, the lowest along the floor, under a piston, and leave."""

GATE = {"kind": "plane", "point": [0.2375, 0.0], "normal": [-1.0, 0.0], "end": 0.0175}
"""Before the exit, until it goes: for a set of walls there is a loop of contact steps, and most of the program."""


def on_one_and_two(tables, out):
    """The runs on one device and on two."""
    return [jaxdem.simulate(jaxdem.load_scene(tables), out / str(number), devices=number) for number in (1, 2)]


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """The same scene on one device and on two, whose stored energy is asked for at both ends by one program."""
    programs = energy._stored_of_slabs._cache_size()
    found = on_one_and_two(LEAN, tmp_path_factory.mktemp("runs"))
    assert energy._stored_of_slabs._cache_size() == programs + 1
    return found


def require_same(one, other, tolerance):
    """The tables of all probes, a column within so much of its largest value."""
    assert list(one.probes) == list(other.probes)
    for name in one.probes:
        assert list(one.probes[name]) == list(other.probes[name])
        for column, expected in one.probes[name].items():
            found = other.probes[name][column]
            assert found.shape == expected.shape, (name, column)
            scale = np.nanmax(np.abs(expected), initial=1e-300)
            np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * scale, err_msg=f"{name} {column}")


def require_same_frames(one, other, tolerance):
    """All arrays of the last frames, of the grains that are there, each within so much of its largest value."""
    expected, found = one.particles(-1), other.particles(-1)
    np.testing.assert_array_equal(found["active"], expected["active"])
    there = expected["active"] == 1
    for name in expected:
        scale = max(np.abs(expected[name][there]).max(), 1e-300)
        close = np.abs(found[name][there] - expected[name][there]).max() <= tolerance * scale
        assert close, name


def test_probes_of_grains(runs):
    """Grains go through slabs, a rectangle and a plane before the exit; contacts and profiles lie on both sides of a
    border."""
    one, other = runs
    require_same(one, other, 1e-12)
    told, removed = other.summary["devices"], one.history["removed"][-1]
    assert told["migrations"] > 0 and 0 < removed <= one.probes["gate"]["number"].sum()
    assert np.abs(one.probes["window"]["number"]).sum() > 0
    table = one.probes["contacts"]
    last = (table["time"] == table["time"][-1]) & (table["wall"] < 0)
    assert np.abs(table["position_x"][last] - told["planes"][0]).min() < 0.009, "a contact across the border"
    assert np.abs(one.probes["floor"]["force_z"]).min() > 0.0


def test_balance_of_energy(runs):
    """Every store, work and loss is that of one device: of contacts across borders, grains that come, leave and go to
    other slabs, and a piston. Nothing is missing."""
    require_same_energy(*runs, "walls", "population")


@COMBINATION
def test_a_gate_that_goes_while_grains_press_on_it(tmp_path):
    """Probes and balance of energy are those of one device."""
    runs = on_one_and_two(LEAN | {"walls": [*LEAN["walls"], GATE]}, tmp_path)
    require_same(*runs, 1e-12)
    require_same_energy(*runs, "walls", "population", "wall_changes")
    assert 0 < runs[0].history["removed"][-1] == runs[1].history["removed"][-1]


def require_same_energy(run, other_run, *works):
    """The same balance, in which nothing is missing, with these works in it."""
    one, other = run.summary["energy"], other_run.summary["energy"]
    scale = sum(one["end"].values())
    for group in ("start", "end", "work", "dissipated"):
        assert one[group].keys() == other[group].keys()
        for name, expected in one[group].items():
            assert abs(other[group][name] - expected) < 1e-11 * scale, (group, name)
    for found in (one, other):
        assert abs(found["missing"]) < 1e-11 * scale
        assert 0.0 < abs(found["gained"]) < 1e-3 * scale
    for name in works:
        assert abs(one["work"][name]) > 1e-4 * scale, name
    for name in ("damping", "sliding", "rolling"):
        assert one["dissipated"][name] > 1e-4 * scale, name


@COMBINATION
def test_stages_do_what_they_do_on_one_device(tmp_path):
    """Gravity turns, and no energy is asked for any more."""
    first = {"name": "lean", "time": LEAN["time"]}
    second = {"name": "back", "time": {"end": 0.04}, "domain": {"gravity": [-4.0, -9.0]}, "output": {"energy": False}}
    staged = LEAN | {"time": {"end": 0.01, "output_interval": 0.01}, "stages": [first, second]}
    one, other = on_one_and_two(staged, tmp_path)
    assert other.path == tmp_path / "2" / "back"
    assert other.summary["devices"]["number"] == 2 and other.summary["complete"]
    require_same_frames(one, other, 1e-10)
    require_same(one, other, 1e-9)
    for name in ("removed", "wall_0_displacement"):
        np.testing.assert_allclose(other.history[name], one.history[name], rtol=1e-10)
    resumed = jaxdem.simulate(jaxdem.load_scene(staged), tmp_path / "2", devices=2, resume=True)
    assert resumed.path == other.path


def test_a_run_on_one_device_begins_from_one_on_two(runs):
    """State, springs of contacts and what came in are those of a start from one device."""
    states = []
    for run in runs:
        tables = LEAN | {"start": {"from": str(run.path)}, "time": {"end": 0.05, "output_interval": 0.01}}
        state, neighbors = build_case(jaxdem.load_scene(tables)).initial_state()
        states.append((state, jaxdem.devices.contacts.contacts_of_list(state.particles.contact_spring, neighbors)))
    (one, of_one), (other, of_two) = states
    assert int(one.step) == int(other.step)
    np.testing.assert_array_equal(one.particles.active, other.particles.active)
    np.testing.assert_array_equal(one.particles.inserted, other.particles.inserted)
    there = np.flatnonzero(one.particles.active)
    for name in ("position", "velocity", "angular_velocity", "contact_force", "wall_spring"):
        axis = 2 if name == "wall_spring" else 0
        kept = (np.asarray(getattr(state.particles, name)) for state in (one, other))
        expected, found = (np.take(values, there, axis) for values in kept)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max(), err_msg=name)
    moved = [float(state.particles.pistons.displacement[0]) for state in (one, other)]
    assert moved[0] != 0.0 and abs(moved[1] - moved[0]) < 1e-10 * abs(moved[0])
    pairs = [dict(zip(zip(c.first, c.second, strict=True), c.values.T, strict=True)) for c in (of_one, of_two)]
    assert pairs[0].keys() == pairs[1].keys() and len(pairs[0]) > 10
    largest = np.abs(of_one.values).max()
    for pair, spring in pairs[0].items():
        np.testing.assert_allclose(pairs[1][pair], spring, rtol=0, atol=1e-9 * largest)


@COMBINATION
def test_probes_and_samples_beside_a_fluid(tmp_path):
    """Points in cells of both slabs and between them, planes along and across the cut, forces on a wall, and what the
    drag law saw; the tolerance is that of the pressure."""
    tables = coupled_scene(2, {"left": {"kind": "inlet", "velocity": 0.2}, "right": {"kind": "outlet"}})
    tables["particles"] |= {"position": places([0.4, 0.2], count=40), "velocity": [[0.5, -0.2]] * 40}
    tables["output"] = {"samples": 0.01}
    tables["probes"] = [
        {"name": "points", "kind": "point", "interval": 0.01,
         "points": [[0.0, 0.1], [0.19, 0.1], [0.2, 0.05], [0.21, 0.199], [0.4, 0.2]]},
        {"name": "across", "kind": "plane", "axis": "x", "at": 0.21, "interval": 0.01},
        {"name": "end", "kind": "plane", "axis": "x", "at": 0.4, "interval": 0.01},
        {"name": "along", "kind": "plane", "axis": "z", "at": 0.09, "from": [0.13], "to": [0.33], "interval": 0.01},
        {"name": "slices", "kind": "profile", "axis": "x", "cells": 3, "interval": 0.01},
        {"name": "floor", "kind": "wall", "side": "bottom", "interval": 0.01},
    ]  # fmt: skip
    one, other = (jaxdem.simulate(jaxdem.load_scene(tables), tmp_path / str(k), devices=k) for k in (1, 2))
    require_same(one, other, 1e-11)
    assert np.ptp(one.probes["points"]["fluid_velocity_x"]) > 0.01
    assert (
        len(one.samples) == len(other.samples) == 2 and one.samples.attributes.keys() == other.samples.attributes.keys()
    )
    for index in range(2):
        expected, found = one.samples.frame(index), other.samples.frame(index)
        assert expected.keys() == found.keys()
        for name in expected:
            scale = np.abs(expected[name]).max()
            np.testing.assert_allclose(found[name], expected[name], rtol=0, atol=1e-11 * scale, err_msg=name)
