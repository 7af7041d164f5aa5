"""What a run measures beside frames on several devices, against one device."""

import numpy as np
import pytest

import jaxdem
from tests.cases.fluid_slabs import coupled_scene, places

DRY = {
    "precision": "float64",
    "domain": {"size": [0.24, 0.12], "depth": 0.02},
    "boundary": {"right": {"particles": "remove"}},
    "contact": {"young_modulus": 1e6, "friction": 0.4, "restitution": 0.6, "speed": 2.0, "skin": 0.2},
    "time": {"end": 0.03, "output_interval": 0.01},
    "probes": [
        {"name": "gate", "kind": "plane", "axis": "x", "at": 0.125, "interval": 0.01},
        {"name": "window", "kind": "plane", "axis": "z", "at": 0.05, "from": [0.05], "to": [0.2], "interval": 0.01},
        {"name": "exit", "kind": "plane", "axis": "x", "at": 0.235, "interval": 0.01},
        {"name": "slices", "kind": "profile", "axis": "x", "cells": 6, "interval": 0.01, "average": True},
        {"name": "boxes", "kind": "profile", "interval": 0.01, "regions": [[[0.06, 0.0], [0.18, 0.05]]]},
        {"name": "floor", "kind": "wall", "side": "bottom", "interval": 0.01},
        {"name": "contacts", "kind": "contacts", "interval": 0.01},
    ],
}


def grains():
    """Rows of grains of two sizes that fly to the right, the lowest on the floor."""
    across, up = np.meshgrid(0.012 + 0.0196 * np.arange(11), 0.0099 + 0.0196 * np.arange(4), indexing="ij")
    noise = np.random.default_rng(2).normal(size=(across.size, 2))
    return {
        "position": (np.stack((across, up), axis=-1).reshape(-1, 2)).tolist(),
        "radius": np.where(np.arange(across.size) % 3, 0.0099, 0.009).tolist(),
        "density": 2500.0,
        "velocity": ([1.2, 0.0] + 0.3 * noise).tolist(),
        "inlet": [
            {"start": [0.0, 0.085], "stop": [0.24, 0.115], "rate": 400.0, "velocity": [1.0, 0.0], "radius": 0.009}
        ],
    }


def runs(scene, folder, number):
    """On one device, and on several."""
    return [jaxdem.simulate(scene, folder / str(k), devices=k) for k in (1, number)]


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


@pytest.fixture(scope="module")
def dry(tmp_path_factory):
    return runs(jaxdem.load_scene(DRY | {"particles": grains()}), tmp_path_factory.mktemp("dry"), 2)


def test_probes_of_grains(dry):
    """Grains go through planes, slabs and the exit; contacts and profiles lie on both sides of a border."""
    one, other = dry
    require_same(one, other, 1e-12)
    told, removed = other.summary["devices"], one.history["removed"][-1]
    assert told["migrations"] > 0 and 0 < removed <= one.probes["exit"]["number"].sum()
    assert one.probes["gate"]["number"].sum() > 0 and np.abs(one.probes["window"]["number"]).sum() > 0
    table = one.probes["contacts"]
    last = (table["time"] == table["time"][-1]) & (table["wall"] < 0)
    assert np.abs(table["position_x"][last] - told["planes"][0]).min() < 0.009, "a contact across the border"
    assert np.abs(one.probes["floor"]["force_z"]).min() > 0.0


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
    one, other = runs(jaxdem.load_scene(tables), tmp_path, 2)
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
