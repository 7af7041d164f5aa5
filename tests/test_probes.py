"""Probes of a scene: their files, what a run with an inlet and an exit counts, wrong input, and their programs."""

from __future__ import annotations

import csv
from functools import partial

import h5py
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from typer.testing import CliRunner

import jaxdem
from jaxdem.check.check import check_scene
from jaxdem.check.probe_rows import probe_cautions
from jaxdem.cli.main import app
from jaxdem.errors import InputError
from jaxdem.io.outputs import refuse_what_is_read
from jaxdem.probes.contacts import ContactsProbe
from jaxdem.run import chunk
from jaxdem.run.numbers import NO_NUMBERS, loop_numbers, with_numbers
from jaxdem.run.observer import Observer, probe_marks
from jaxdem.setup.builder import build_case
from jaxdem.setup.probes import scene_probes
from tests.cases.tiers import COMBINATION

SHEET = {
    "seed": 2,
    "precision": "float64",
    "domain": {"size": [0.4, 0.3], "gravity": [0.0, 0.0]},
    "particles": {
        "radius": 0.01, "density": 2500.0, "position": [[0.35, 0.1]], "velocity": [[1.0, 0.0]],
        "inlet": [{"start": [0.0, 0.0], "stop": [0.1, 0.3], "rate": 100.0, "total": 20, "velocity": [1.0, 0.1]}],
    },
    "contact": {"young_modulus": 1e6, "speed": 1.0},
    "boundary": {"right": {"particles": "remove"}, "bottom": {"kind": "periodic"}},
    "coupling": {"interval": 0.01},
    "time": {"end": 0.5, "output_interval": 0.1},
    "probes": [
        {"name": "middle", "kind": "plane", "axis": "x", "at": 0.2},
        {"name": "end", "kind": "plane", "axis": "x", "at": 0.4, "interval": 0.02, "begin": 0.04},
        {"name": "seam", "kind": "plane", "axis": "z", "at": 0.0, "interval": 0.5},
    ],
}  # fmt: skip
PLANE = SHEET["probes"][0]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return jaxdem.simulate(jaxdem.load_scene(SHEET), tmp_path_factory.mktemp("probes") / "run")


def test_what_crossed_is_what_has_left_and_what_is_beyond(run):
    """Grains come in before the plane and leave behind it: crossed = removed + beyond - beyond at the start."""
    middle, end = run.probes["middle"], run.probes["end"]
    for k, time in enumerate(middle["time"], start=1):
        frame, removed = run.particles(k), run.history["removed"][k]
        beyond = (frame["active"].astype(bool) & (frame["position"][:, 0] > 0.2)).sum()
        assert time == run.times[k] and middle["number"][:k].sum() == removed + beyond - 1
        assert end["number"][end["time"] <= time + 1e-9].sum() == removed
    assert removed > 2 and middle["number"].max() > 2
    mass = 2500.0 * 4.0 / 3.0 * np.pi * 0.01**3
    np.testing.assert_allclose(middle["mass_flow"], mass * middle["number"] / 0.1, rtol=1e-12)
    np.testing.assert_allclose(middle["number_flow"], middle["number"] / 0.1, rtol=1e-12)
    # They move at 1 m/s: the momentum that they carry is that of their mass.
    np.testing.assert_allclose(middle["momentum_flow_x"], middle["mass_flow"], rtol=1e-9)
    assert run.probes["seam"]["time"].tolist() == [0.5] and run.probes["seam"]["number"][0] > 0


def test_files_are_read_in_one_line(run):
    """By the csv module and by h5py as pandas reads them; both hold the same table, with units."""
    for name in run.probes:
        with open(run.path / "probes" / f"{name}.csv", newline="") as file:
            rows = list(csv.DictReader(file))
        table = h5py.File(run.path / "probes.h5")[name][:]
        assert table.dtype.names == tuple(rows[0]) == tuple(run.probes[name])
        for column in table.dtype.names:
            np.testing.assert_array_equal(table[column], [float(row[column]) for row in rows])
            np.testing.assert_array_equal(table[column], run.probes[name][column])
    assert run.probes.units("middle") == {
        "time": "s", "number": "-", "number_forward": "-", "number_flow": "1/s", "mass_flow": "kg/s",
        "volume_flow": "m3/s", "momentum_flow_x": "N", "momentum_flow_z": "N",
    }  # fmt: skip
    assert "middle" in run.probes and len(run.probes) == 3
    with pytest.raises(KeyError, match="the probes of this run are middle, end, seam"):
        run.probes["inner"]


def test_no_command_writes_over_them(run):
    for name in ("probes/middle.csv", "probes.h5"):
        with pytest.raises(InputError, match="is a file of a run"):
            refuse_what_is_read("--out", run.path / name, [])


def text_of(probes, without_watch=False):
    """The program of a chunk, before it is compiled."""
    case = build_case(jaxdem.load_scene({**SHEET, "probes": probes}))
    state, neighbors = case.initial_state()
    dtype = case.parameters.gravity.dtype
    observer = Observer(case.probes)
    observer.fit(state, neighbors, dtype)
    program = jax.jit(partial(chunk.advance, with_numbers(case.simulation, NO_NUMBERS)))
    given = (loop_numbers(case.simulation, dtype), case.parameters, state, neighbors, jnp.int32(1))
    if without_watch:
        return program.lower(*given).as_text()
    return program.lower(*given, observer.watch).as_text()


def test_probes_are_in_the_program_of_a_scene_that_has_some():
    """Other places and times of theirs are no other program; without them the program is that of a scene without."""
    with_one, without = text_of([PLANE]), text_of([])
    assert len(with_one) > len(without)
    assert with_one == text_of([PLANE | {"at": 0.1, "interval": 0.2, "begin": 0.1, "window": 0.05}])
    assert without == text_of([], without_watch=True)


def test_check_lists_probes():
    report = check_scene(jaxdem.load_scene(SHEET))
    assert dict(report.probes)["end"].startswith("plane, 23 rows")


def test_check_warns_of_a_probe_whose_last_row_is_before_the_end():
    """0.04 + 7 x 0.06 = 0.46; 0.08 + 6 x 0.07 = 0.5."""
    probes = [PLANE | {"name": "a", "interval": 0.06, "begin": 0.04}, PLANE | {"interval": 0.07, "begin": 0.08}]
    (warning,) = probe_cautions(build_case(jaxdem.load_scene(SHEET | {"probes": probes})))
    assert warning.startswith("probes.0.interval = 0.06: the last row is at 0.46 s, and the run ends at 0.5 s.")


WRONG = {
    "name": ({"name": "../a"}, "is the name of a file"),
    "hidden": ({"name": ".a"}, "is the name of a file"),
    "kind": ({"kind": "plan"}, "must be 'plane', 'profile', 'point', 'wall' or 'contacts'"),
    "no axis": ({"axis": "y"}, r"probes\.0\.axis = 'y': the box has no such axis"),
    "outside": ({"at": 0.7}, "the plane must lie in the box, between 0 and 0.4 m"),
    "nothing": ({"at": None, "axis": None}, "either axis and at, or normal and point"),
    "both": ({"normal": [1.0, 0.0], "point": [0.1, 0.1]}, "either axis and at, or normal and point"),
    "seam": ({"axis": None, "at": None, "normal": [0.0, 1.0], "point": [0.1, 0.1]}, "the same all along a periodic"),
    "half": ({"from": 0.1}, "needs both from and to"),
    "corners": ({"from": [0.1, 0.2], "to": [0.2, 0.3]}, "needs 1 number, got 2"),
    "order": ({"from": 0.2, "to": 0.1}, r"must be above probes\.0\.from"),
    "interval": ({"interval": 0.025}, r"interval = 0\.025: must be a multiple of the coupling interval, 0\.01 s"),
    "short": ({"interval": 0.001}, r"Use, for example, 0\.01"),
    "late": ({"begin": 0.45}, "the first row would be at begin"),
    "window": ({"window": 0.2}, "is more than the interval of 0.1 s"),
    "sampled flow": ({"sample_interval": 0.02}, "a plane looks at every coupling interval"),
    "average": ({"average": False}, "flows through a plane are means over time"),
    "keys": ({"points": [[0.1, 0.1]]}, "the keys of a probe of kind plane are"),
    "unknown": ({"plane": 1.0}, "unknown key"),
}


@pytest.mark.parametrize("change", WRONG)
def test_wrong_planes_are_refused(change):
    given, match = WRONG[change]
    probe = {key: value for key, value in (PLANE | given).items() if value is not None}
    with pytest.raises(InputError, match=match) as caught:
        build_case(jaxdem.load_scene({**SHEET, "probes": [probe]}))
    assert caught.value.exit_code == 2 and str(caught.value).startswith("probes")


PROFILE = {"name": "a", "kind": "profile"}


@pytest.mark.parametrize(
    ("probe", "match"),
    [
        (PROFILE, "needs either an axis, with cells or edges, or regions"),
        (PROFILE | {"axis": "x"}, "needs either cells or edges"),
        (PROFILE | {"axis": "x", "cells": 2, "edges": [0.0, 0.1]}, "needs either cells or edges"),
        (PROFILE | {"axis": "x", "edges": [0.0, 0.2, 0.1]}, "must increase"),
        (PROFILE | {"axis": "x", "edges": [0.0, 0.7]}, "must lie between 0 and 0.4 m"),
        (PROFILE | {"regions": [[[0.0, 0.0], [0.7, 0.1]]]}, r"regions\.0\.1 = .*must lie in the box"),
        (PROFILE | {"regions": [[[0.0], [0.1, 0.1]]]}, r"regions\.0\.0 = .*needs 2 numbers, got 1"),
        (PROFILE | {"regions": [[[0.2, 0.0], [0.1, 0.1]]]}, r"regions\.0\.1 = .*above probes\.1\.regions\.0\.0 = "),
        (PROFILE | {"axis": "x", "cells": 2, "window": 0.1}, "is for averages"),
        (
            PROFILE | {"axis": "x", "cells": 2, "average": True, "window": 0.08, "sample_interval": 0.03},
            r"must divide the time over which is averaged, 0\.08 s.*0\.02",
        ),
        ({"name": "a", "kind": "point"}, "is needed by kind = point"),
        ({"name": "a", "kind": "point", "points": [[0.1, 0.1]]}, "the scene has none"),
        ({"name": "a", "kind": "wall"}, "needs either side or wall"),
        ({"name": "a", "kind": "wall", "side": "bottom"}, "is periodic, and no wall"),
        ({"name": "a", "kind": "wall", "side": "front"}, "the box has no such side"),
        ({"name": "a", "kind": "wall", "side": "right"}, "is no wall: the fluid passes through it"),
        ({"name": "a", "kind": "wall", "wall": 0}, "the scene has 0 tables"),
        ({"name": "a", "kind": "wall", "wall": "gate"}, r"wall = 'gate': no wall has this name; named are none"),
        ({"name": "a", "kind": "wall", "side": "left", "about": [0.0, 0.0]}, "there is no torque to measure"),
        ({"name": "a", "kind": "contacts", "average": True}, "contacts are those at a time"),
        ({"name": "a", "kind": "contacts", "window": 0.01}, r"window = 0\.01: contacts are those at a time"),
        ({"name": "MIDDLE", "kind": "plane", "axis": "x", "at": 0.1}, "is the name of another probe"),
    ],
)
def test_wrong_probes_are_refused(probe, match):
    with pytest.raises(InputError, match=match):
        build_case(jaxdem.load_scene({**SHEET, "probes": [PLANE, probe]}))


def test_every_wall_may_have_a_probe():
    """By its name where a file may have it and no other probe has; what is measured already is not measured again."""
    planes = [{"kind": "plane", "point": [0.01 * k, 0.0], "normal": [1.0, 0.0]} for k in range(5)]
    for plane, name in zip(planes, (None, "Gate", "a/b", "lid", "floor"), strict=True):
        plane |= {} if name is None else {"name": name}
    probes = [{"name": "gate", "kind": "plane", "axis": "x", "at": 0.01}, {"name": "of", "kind": "wall", "wall": "lid"}]
    given = SHEET | {"walls": planes, "probes": probes, "output": {"walls": True}}
    scene = jaxdem.load_scene(given)
    found = [(probe.name, probe.wall) for probe in scene.probes]
    assert found == [("gate", None), ("of", "lid"), ("wall_0", 0), ("wall_1", 1), ("wall_2", 2), ("floor", 4)]
    assert all(probe.average and probe.interval == scene.time.output_interval for probe in scene.probes)
    assert jaxdem.load_scene(scene.tables()).probes == scene.probes
    assert len(jaxdem.load_scene(given | {"output": {}}).probes) == 2
    planes[0]["name"] = "wall_2"
    with pytest.raises(InputError, match=r"output\.walls = True: walls\.2 gets a probe of the name wall_2"):
        jaxdem.load_scene(given)


def test_walls_have_names():
    """A probe by the name of a wall is that by its number; two walls of one name are refused."""
    plane = {"kind": "plane", "point": [0.39, 0.0], "normal": [-1.0, 0.0]}
    walls = [{"kind": "plane", "point": [0.01, 0.0], "normal": [1.0, 0.0]}, plane | {"name": "gate"}]
    probes = [{"name": name, "kind": "wall", "wall": wall} for name, wall in (("a", "gate"), ("b", 1))]
    scene = jaxdem.load_scene(SHEET | {"walls": walls, "probes": probes})
    by_name, by_number = (one.probe for one in build_case(scene).probes)
    assert by_name.surfaces == by_number.surfaces == (1,) and by_name.about == (0.39, 0.0)
    assert jaxdem.load_scene(scene.tables()).probes[0].wall == "gate"
    with pytest.raises(InputError, match=r"probes\.0\.wall = 'door': no wall has this name; named are gate"):
        jaxdem.load_scene(SHEET | {"walls": walls, "probes": [probes[0] | {"wall": "door"}]})
    with pytest.raises(InputError, match=r"walls\.1\.name = 'gate': is the name of another wall too"):
        jaxdem.load_scene(SHEET | {"walls": [walls[0] | {"name": "gate"}, walls[1]]})


def test_contacts_in_single_precision_have_exact_numbers(host_patch):
    """2^24 + 1 is the first whole number that float32 does not have. The sheet has 1 grain and 20 that come."""
    scene = jaxdem.load_scene(SHEET | {"precision": "float32", "probes": [{"name": "a", "kind": "contacts"}]})
    steps = build_case(scene).simulation.steps
    assert len(scene_probes(scene, steps, particles=2**24)) == 1
    with pytest.raises(InputError, match=r'probes\.0\.kind = \'contacts\': .*16777216.*precision = "float64"'):
        scene_probes(scene, steps, particles=2**24 + 1)
    scene_probes(scene.model_copy(update={"precision": "float64"}), steps, particles=2**24 + 1)
    host_patch.setattr("jaxdem.setup.probes.MOST_NUMBERED", 20)
    with pytest.raises(InputError, match="the scene has 21"):
        build_case(scene)


def test_contacts_are_written_in_the_order_of_their_numbers():
    """Pairs and walls in any order of the list, one of them apart."""
    rows = {
        "first": [3, 0, 2, 0, 0],
        "second": [-1, 4, 1, -1, -1],
        "wall": [0, -1, -1, 1, 0],
        "overlap": [1, 1, 0, 1, 1],
    }
    means = {name: np.asarray(values, float) for name, values in rows.items()}
    assert ContactsProbe("a", "xz").written(means).tolist() == [4, 3, 1, 0]


@COMBINATION
def test_a_profiled_run_has_the_same_rows(run, tmp_path):
    """Its programs are others: fluid and particles apart, and the probes by themselves."""
    profiled = jaxdem.simulate(jaxdem.load_scene(SHEET), tmp_path / "run", profile=True)
    for name in run.probes:
        for column, values in run.probes[name].items():
            np.testing.assert_allclose(profiled.probes[name][column], values, rtol=1e-9, atol=1e-15)


AVERAGED = [
    PLANE | {"interval": 0.06},
    {
        "name": "mean", "kind": "profile", "axis": "x", "cells": 2, "interval": 0.07, "average": True,
        "window": 0.04, "sample_interval": 0.02,
    },
    {"name": "wall", "kind": "wall", "side": "left", "interval": 0.08, "begin": 0.04},
]  # fmt: skip


@pytest.fixture(scope="module")
def in_two(tmp_path_factory):
    """A run whose probes have rows at times that no stage ends at, and the same in two stages."""
    path, tables = tmp_path_factory.mktemp("in_two"), SHEET | {"probes": AVERAGED}
    whole = jaxdem.simulate(jaxdem.load_scene(tables), path / "whole")
    stages = [{"name": "first", "time": {"end": 0.2}}, {"name": "second", "time": {"end": 0.5}}]
    jaxdem.simulate(jaxdem.load_scene(tables | {"stages": stages}), path / "stages")
    return whole, *(jaxdem.load_run(path / "stages" / stage["name"]) for stage in stages)


def test_sums_go_on_over_a_start(in_two):
    """Sums that the first stage has begun, rows of the second have: the same bits as in one run."""
    whole, first, second = in_two
    for name, table in whole.probes.items():
        assert len(first.probes[name]["time"]) and len(second.probes[name]["time"])
        for column, values in table.items():
            both = np.concatenate([first.probes[name][column], second.probes[name][column]])
            np.testing.assert_array_equal(both, values, err_msg=f"{name}.{column}")
    assert whole.probes["middle"]["number"][3] > 0  # that of the row at 0.24 s, which both stages have counted for


@pytest.mark.parametrize(
    ("start", "change"),
    [({}, {"at": 0.1}), ({}, {"window": 0.05}), ({"time": 0.2}, {})],
    ids=["another place", "another window", "a frame"],
)
def test_other_probes_begin_anew(in_two, start, change):
    """One that was changed, and those of a run that begins from a frame: no sum belongs to them."""
    tables = SHEET | {"start": {"from": str(in_two[1].path), **start}, "probes": [AVERAGED[0] | change]}
    case = build_case(jaxdem.load_scene(tables))
    observer = Observer(case.probes)
    observer.fit(*case.initial_state(), case.parameters.gravity.dtype)
    blank = observer.save()
    observer.go_on(case.start, probe_marks(case))
    assert observer.save().keys() == blank.keys()
    assert all(np.array_equal(array, blank[name]) for name, array in observer.save().items())


def test_check_counts_the_rows_of_a_run_that_begins_from_another(in_two):
    """As many as it writes: 0.24 to 0.48, 0.21 to 0.49 and 0.28 to 0.44 s. Of the two
    measurements of the row at 0.21 s one was in the first stage."""
    tables = SHEET | {"start": {"from": str(in_two[1].path)}, "probes": AVERAGED}
    report = check_scene(jaxdem.load_scene(tables))
    for name, text in report.probes:
        assert f", {len(set(in_two[2].probes[name]['time']))} rows of " in text
    assert "measured in 9 of 30 coupling intervals" in dict(report.probes)["mean"]
    late = [text for text in report.warnings if text.startswith("probes.")]
    assert [text.split("at ")[1].split(" s")[0] for text in late] == ["0.48", "0.49", "0.44"]


@COMBINATION
def test_each_run_of_a_sweep_has_its_probes(tmp_path):
    """A grain that leaves to the right or goes back through the plane in the middle: one program, two runs."""
    path, out = tmp_path / "scene.toml", tmp_path / "sweep"
    tables = SHEET | {
        "particles": {key: SHEET["particles"][key] for key in ("radius", "density", "position", "velocity")}
    }
    path.write_text(jaxdem.load_scene(tables).to_toml())
    vary = "particles.velocity=[[1.0,0.0]],[[-1.0,0.0]]"
    assert CliRunner().invoke(app, ["sweep", str(path), "--out", str(out), "--vary", vary]).exit_code == 0
    with open(out / "sweep.csv", newline="") as file:
        right, left = (jaxdem.load_run(out / row["run"]) for row in csv.DictReader(file))
    numbers = [[int(run.probes[name]["number"].sum()) for name in ("middle", "end")] for run in (right, left)]
    assert numbers == [[0, 1], [-1, 0]]
    assert left.probes["middle"]["number"].tolist() == [0, -1, 0, 0, 0]  # 0.15 m at 1 m/s
