"""The command line as a user meets it: exit codes, messages, and nothing that looks like a crash."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Annotated

import jax
import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from jaxdem import __version__, load_run
from jaxdem.cli import options as declared
from jaxdem.cli.inputs import this_command
from jaxdem.cli.main import app
from jaxdem.cli.progress import StudyDisplay
from jaxdem.closures import (
    EnsembleClosure,
    InvariantClosure,
    SubgridClosure,
    load_closure,
    load_subgrid,
    save_closure,
)
from jaxdem.errors import visible
from jaxdem.io.access import acquire_lock
from jaxdem.run.sweep import _name, parse_variation
from jaxdem.study import identity
from jaxdem.train.dataset_file import SCALARS, VECTORS, write_dataset
from jaxdem.train.finetune import FinetuneResult

GRAINS = """
[domain]
size = [0.2, 0.2]
[particles]
radius = 0.01
density = 2650.0
position = [[0.05, 0.02], [0.1, 0.1], [0.11, 0.15]]
[contact]
young_modulus = 2e6
[time]
end = 0.04
output_interval = 0.02
[output]
checkpoint_interval = 0.0
"""


@pytest.fixture(autouse=True)
def settings_of_jax(host_patch, tmp_path_factory):
    """The command line sets the compilation cache for its process; here that is taken back after each test."""
    names = ("jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs", "jax_enable_x64")
    before = {name: getattr(jax.config, name) for name in names}
    host_patch.delenv("JAX_COMPILATION_CACHE_DIR", raising=False)
    host_patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))
    yield
    for name, value in before.items():
        jax.config.update(name, value)


@pytest.fixture(scope="session")
def grains(tmp_path_factory):
    path = tmp_path_factory.mktemp("scenes") / "grains.toml"
    path.write_text(GRAINS)
    return path


def invoke(*arguments):
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert "Traceback" not in result.output
    return result


@pytest.fixture(scope="session")
def done(grains, tmp_path_factory):
    """A finished run, and what was said."""
    out = tmp_path_factory.mktemp("done") / "run"
    return out, invoke("run", grains, "--out", out)


def refused(result, *words):
    """Exit code 2 and one message on standard error with these words."""
    assert result.exit_code == 2, result.output
    assert not result.stdout
    for word in words:
        assert word in result.stderr
    return result


def test_a_run_ends_with_a_summary_and_no_bar(done):
    out, result = done
    assert result.exit_code == 0, result.output
    assert not result.stderr
    labels = [line[:10].strip() for line in result.stdout.splitlines()]
    assert labels == ["valid", "run time", "stages", "output", "energy"]
    assert str(out) in result.stdout
    assert "compilation" in result.stdout
    assert load_run(out).summary["valid"]


def test_version_and_help():
    assert invoke("--version").stdout.strip() == f"jaxdem {__version__}"
    text = invoke("--help").stdout
    assert all(
        name in text
        for name in (
            *("check", "run", "dataset", "train", "finetune", "compare"),
            *("plot", "animate", "sweep", "study", "export", "distill", "prune"),
        )
    )


def test_a_key_of_a_scene_is_explained():
    text = invoke("scene", "contact.friction").stdout
    assert "sliding (Coulomb) friction" in text and "number ≥ 0" in text and "[contact]" in text
    assert "0.5" in text.split("default")[1]
    assert "m²/s" in invoke("scene", "fluid.viscosity").stdout.replace("m2/s", "m²/s")
    assert "from" in invoke("scene", "boundary.left").stdout
    assert all(name in invoke("scene", "coupling").stdout for name in ("drag", "kernel_width", "interval"))
    assert all(name in invoke("scene").stdout for name in ("[contact]", "[[walls]]", "[time]"))
    assert "Before the first table" in invoke("scene").stdout and "seed" in invoke("scene", "seed").stdout
    wrong = invoke("scene", "contact.frction")
    assert wrong.exit_code == 2 and "contact.friction" in wrong.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        ("fly",),
        ("run",),
        ("run", "scene.toml"),
        ("check",),
        ("train", "--out", "x.h5"),
        ("compare", "a", "b"),
    ],
)
def test_wrong_usage_is_exit_code_2(arguments):
    assert invoke(*arguments).exit_code == 2


def test_a_scene_that_is_not_there(tmp_path):
    refused(invoke("check", tmp_path / "absent.toml"), "absent.toml", "no such file")


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("particles.radus=1", ("particles.radus", "Did you mean 'radius'")),
        ("time.end=-1", ("time.end", "greater than 0")),
        ("time.end", ("--set", "key=value")),
        ("contact.time_step=2e-2", ("contact.time_step", "stable step", '"auto"')),
        ("particles.position=[[0.1, 0.1], [0.11, 0.1]]", ("particles 0 and 1", "overlap")),
        ("particles.position=[[9.0, 0.1]]", ("particle 0", "wall")),
        ("particles.count=7", ("particles.count", "3 positions")),
        ("output.samples=0.01", ("output.samples", "[fluid]")),
        ("closure.file=none.h5", ("closure.file",)),
        ("fluid={cells=[4,4], subgrid='none.h5'}", ("fluid.subgrid", "none.h5", "is not a file")),
        (
            "fluid={cells=[4,4], subgrid='s.h5', smagorinsky=0.1}",
            ("fluid.smagorinsky", "same unresolved eddies"),
        ),
    ],
)
@pytest.mark.parametrize("command", ["check", "run"])
def test_check_and_run_refuse_alike(grains, tmp_path, command, setting, words):
    out = ("--out", tmp_path / "run") if command == "run" else ()
    refused(invoke(command, grains, *out, "--set", setting), "jaxdem: ", *words)
    assert not (tmp_path / "run").exists(), "nothing is left of a run that was refused"


def test_brackets_in_a_message_are_not_taken_for_markup(grains):
    result = refused(invoke("check", grains, "--set", "closure.file=[red]"))
    assert "[red]" in result.stderr


def test_a_closure_that_is_not_one(grains, tmp_path):
    path = tmp_path / "closure.h5"
    path.write_text("not HDF5")
    fluid = ("--set", "fluid.cells=[4, 4]", "--set", "fluid.time_step=0.01")
    refused(invoke("run", grains, *fluid, "--closure", path, "--out", tmp_path / "run"), str(path), "closure")


@pytest.mark.parametrize("option", ["--closure", "--subgrid"])
def test_a_file_of_an_option_that_a_dry_scene_does_not_read_is_refused_by_the_option(grains, tmp_path, option):
    """The scene has no [closure] to remove, nor a [fluid] that lacks its cells: it is the option that must go."""
    result = refused(
        invoke("run", grains, option, "c.h5", "--out", tmp_path / "run"),
        f"{option} = ",
        "needs [fluid]",
        f"Leave out {option}",
    )
    assert "[closure]" not in result.stderr and "cells" not in result.stderr
    fluid = ("--set", "fluid.cells=[4, 4]", "--set", "fluid.time_step=0.01")
    refused(invoke("run", grains, *fluid, option, "c.h5", "--out", tmp_path / "run"), f"{option} = ", "is not a file")


def test_out_that_is_not_empty(grains, done, tmp_path):
    out, _ = done
    refused(invoke("run", grains, "--out", out), str(out), "not empty", "--resume")
    (tmp_path / "letter.txt").write_text("dear")
    refused(invoke("run", grains, "--out", tmp_path), "not empty", "another folder")
    assert (tmp_path / "letter.txt").read_text() == "dear"


def test_resume_without_a_checkpoint(grains, tmp_path):
    refused(invoke("run", grains, "--out", tmp_path / "absent", "--resume"), "--resume", "checkpoint.h5")


def test_resume_of_a_complete_run(grains, done):
    result = invoke("run", grains, "--out", done[0], "--resume")
    assert result.exit_code == 0
    assert "is complete; there is nothing to resume" in " ".join(result.stdout.split())


@pytest.mark.parametrize("complete", [True, False])
def test_resume_onto_another_scene(grains, done, tmp_path, complete):
    out = tmp_path / "run"
    shutil.copytree(done[0], out)
    if not complete:
        (out / "summary.json").unlink()
    result = invoke("run", grains, "--out", out, "--resume", "--set", "contact.friction=0.1")
    refused(result, "contact.friction", "0.1", "0.5", "same scene")


def test_a_run_that_fails_is_exit_code_1(grains, tmp_path):
    """A grain so fast that it passes the wall in one step; the scene claims that it is slow."""
    settings = ("particles.velocity=[[0.0, 0.0], [-5e4, 0.0], [0.0, 0.0]]", "contact.speed=1.0")
    arguments = [part for setting in settings for part in ("--set", setting)]
    result = invoke("run", grains, "--out", tmp_path / "run", *arguments)
    assert result.exit_code == 1
    assert "particle 1" in result.stderr
    assert "contact.speed" in result.stderr, "the remedy"
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["valid"] is False
    assert summary["reason"] in " ".join(result.stderr.split())


def test_check_prints_what_a_user_decides_by(grains):
    fluid = ("--set", "fluid.cells=[4, 4]", "--set", "contact.rolling_friction=0.1")
    result = invoke("check", grains, *fluid)
    assert result.exit_code == 0
    text = " ".join(result.stdout.split())
    for words in (
        "particles 3",
        "mesh 4 x 4 cells of 0.05 x 0.05 m",
        "cell / diameter 2.5",
        "Rayleigh time",
        "duration of an impact",
        "2/omega_max",
        "contact steps per interval",
        "error of the restitution about 0.02",
        "overlap at that speed",
        "Courant limit",
        "viscous limit",
        "Stokes relaxation time",
        "kernel half-width 0.05 x 0.05 m",
        "Memory (estimate)",
        "void fraction at the start",
        "limit 0.05 in a cell, drag laws are evaluated at 0.2",
        "contact.maximum_overlap",
        "every contact for which there is room",
        "automatic contact step",
        "no stability limit",
        "float32 resolves overlaps",
        "compiled in particles, contact law HertzMindlin, rolling friction",
        "drag law KochHill",
        "left out cohesion, clumps of spheres, bonds between particles, lubrication",
    ):
        assert words in text, words


def test_check_names_the_options_of_the_fluid(grains, tmp_path):
    fluid = ("--set", "fluid.cells=[4, 4]")
    save_closure(tmp_path / "s.h5", SubgridClosure.initial(), {})

    def parts(*options):
        return " ".join(invoke("check", grains, *fluid, *options).stdout.split()).split("left out")

    left = "boundary.left={kind='inlet', times=[0.0, 1.0], velocities=[0.0, 0.1]}"
    parabola = "boundary.left={kind='inlet', velocity=0.1, profile='parabolic'}"
    right, tilt = "boundary.right.kind=outlet", "domain.gravity=[[0.0, -9.81], [1.0, -9.81]]"
    for words, *options in (
        ("Smagorinsky subgrid viscosity", "--set", "fluid.smagorinsky=0.1"),
        ("mixing length over a bed", "--set", "fluid.bed_mixing={}", "--set", "boundary.top.kind=free_slip"),
        ("learned subgrid stress", "--set", f"fluid.subgrid={tmp_path / 's.h5'}"),
        ("model B", "--set", "fluid.model=B"),
        ("virtual mass", "--set", "coupling.virtual_mass=0.5"),
        ("Basset force", "--set", "coupling.basset=20"),
        ("inlet profile", "--set", parabola, "--set", right),
        ("velocity of a side over time", "--set", left, "--set", right),
        ("gravity over time", "--set", tilt, "--set", "domain.gravity_times=[0.0, 1.0]"),
        ("factor on the drag over time", "--set", "coupling={drag_factor=[0.0, 1.0], drag_times=[0.0, 1.0]}"),
    ):
        compiled, left_out = parts()
        assert words in left_out and words not in compiled
        compiled, left_out = parts(*options)
        assert words in compiled and words not in left_out


@pytest.mark.parametrize("option", ["fluid.smagorinsky=0.2", "fluid.model=B"])
def test_check_bounds_the_viscous_limit_of_the_models(grains, option):
    moving = ("--set", "fluid.cells=[4, 4]", "--set", "fluid.velocity=[0.1, 0.0]")
    assert "viscous limit of the models" not in invoke("check", grains, *moving).stdout
    assert "viscous limit of the models" in invoke("check", grains, *moving, "--set", option).stdout


@pytest.mark.parametrize(("quiet", "warned"), [((), 1), (("--quiet",), 0)])
def test_run_warns_of_units_as_check_does(grains, done, tmp_path, host_patch, quiet, warned):
    """A density in g/cm3: one line on standard error before the run, and none where none is wanted."""
    host_patch.setattr("jaxdem.run.scene_run.simulate", lambda *_, **__: load_run(done[0]))
    result = invoke("run", grains, "--out", tmp_path / "run", "--set", "particles.density=2.65", *quiet)
    assert result.exit_code == 0 and result.stderr.count("lighter than foam") == warned
    assert "write 2650" in invoke("check", grains, "--set", "particles.density=2.65").stdout


def test_check_of_grains_alone_has_no_fluid(grains):
    text = " ".join(invoke("check", grains).stdout.split())
    assert "Courant" not in text
    parts = (
        "cohesion, clumps of spheres, bonds between particles, lubrication, friction by the film between particles, "
        "balance of energy, rolling friction, rolling springs, radius per particle, density per particle, "
        "additional walls, temperatures"
    )
    assert f"left out {parts}, gravity over time, fluid" in text


def test_float64_is_set_before_building(grains):
    jax.config.update("jax_enable_x64", False)
    result = invoke("check", grains, "--set", "precision=float64")
    assert result.exit_code == 0, result.output
    assert "precision float64" in " ".join(result.stdout.split())


def test_compare_and_plot_runs_of_any_name(done, tmp_path, figure_names):
    """Between dollars matplotlib would read mathematics, and a terminal takes what follows an escape for a command.
    What a killed comparison has left in the folder goes."""
    named, out = tmp_path / "r$^$_1\x1b[31m\x9bred", tmp_path / "report"
    figure_names.append(visible(named.name))
    shutil.copytree(done[0], named)
    out.mkdir()
    os.close(acquire_lock(out))
    (out / ".report.html.4711.tmp").write_bytes(b"half")
    (out / ".mine.tmp").write_bytes(b"of the user")
    results = [
        invoke("compare", done[0], named, "--out", out),
        invoke("plot", named),
        invoke("compare", named, tmp_path / "absent\x1b[2J", "--out", tmp_path / "none"),
    ]
    for result in results:
        assert "\x1b" not in result.output and "\x9b" not in result.output
        assert "\\x1b" in result.output
    assert [result.exit_code for result in results] == [0, 0, 2], results[0].output
    assert str(out / "report.html") in results[0].stdout
    assert (out / "report.html").stat().st_size > 1000
    assert [left.name for left in out.glob(".*.tmp")] == [".mine.tmp"]
    refused(results[2], "not a run directory")
    assert not (tmp_path / "none").exists()


def test_results_of_several_runs_do_not_go_into_the_folder_of_one(done, grains):
    """A comparison and a sweep are refused before anything is read or written."""
    out, before = done[0], sorted(path.name for path in done[0].iterdir())
    for command in (("compare", out, out), ("sweep", grains, "--vary", "seed=1,2")):
        refused(invoke(*command, "--out", out), "--out", "is a run directory", "another folder")
    assert sorted(path.name for path in out.iterdir()) == before


def test_plot_and_animate_a_run(done, tmp_path):
    out, _ = done
    result = invoke("plot", out, "--out", tmp_path / "plots", "--time", 0.0)
    assert result.exit_code == 0 and not result.stderr, result.output
    assert {path.name for path in (tmp_path / "plots").iterdir()} == {"metrics.png", "snapshot.png"}
    result = invoke("animate", out, "--out", tmp_path / "films" / "run.gif", "--fps", 5)
    assert result.exit_code == 0 and not result.stderr, result.output
    frames = load_run(out).number_of_frames
    assert f"{frames} of {frames} outputs" in " ".join(result.stdout.split())
    assert (tmp_path / "films" / "run.gif").read_bytes()[:6] == b"GIF89a"


def test_plot_and_animate_refuse_what_they_cannot_draw(done, tmp_path):
    broken = tmp_path / "broken"
    broken.mkdir()
    (broken / "scene.toml").write_text("seed = 1")
    for command in ("plot", "animate"):
        out = ("--out", tmp_path / "a.gif") if command == "animate" else ()
        refused(invoke(command, tmp_path / "absent", *out), "absent", "not a run directory")
        refused(invoke(command, broken, *out), "history.csv")
        assert invoke(command, done[0], *out, "--color", "red").exit_code == 2
    refused(invoke("plot", done[0], "--time", 99.0), "--time", "99.0", "outputs of")
    refused(invoke("animate", done[0], "--out", tmp_path / "a.avi"), "--out", ".gif or .mp4")
    refused(invoke("animate", done[0], "--out", tmp_path / "a.gif", "--fps", "0.001"), "--fps", "0.01 ... 50")
    refused(invoke("animate", done[0], "--out", tmp_path / "a.gif", "--color", "drag"), "--color", "fluid")
    assert not (tmp_path / "a.gif").exists()


SWEEP = ("--set", "contact.speed=1.0", "--set", "time.end=0.02")
STILL, FAST = "[[0.0, 0.0], [0.0, 0.0], [0.0, 0.0]]", "[[0.0, 0.0], [-5e4, 0.0], [0.0, 0.0]]"


def test_a_sweep_goes_on_after_a_failed_run_and_where_it_was_stopped(grains, tmp_path):
    out, vary = tmp_path / "sweep", ("--vary", f"particles.velocity={FAST},{STILL}")
    arguments = ("sweep", grains, "--out", out, *vary, *SWEEP)
    result = invoke(*arguments)
    assert result.exit_code == 1
    assert "1 of 2 runs are not valid" in result.stderr and "particle 1" in result.stdout
    with open(out / "sweep.csv", newline="") as file:
        failed, sound = csv.DictReader(file)
    assert [failed["valid"], sound["valid"]] == ["false", "true"] and "particle 1" in failed["reason"]
    run = load_run(out / sound["run"])
    assert float(sound["kinetic_energy"]) == run.history["kinetic_energy"][-1]
    times = [float(sound[name]) for name in ("run_time_s", "compile_time_s")]
    assert times == [run.summary["run_time_s"], run.summary["stages_s"]["compile"]]
    assert sum(times) == pytest.approx(run.summary["wall_time_s"]) and sound["drag_force_mean"] == "nan"
    before = (out / sound["run"] / "summary.json").stat().st_mtime_ns
    assert invoke("sweep", grains, "--out", out, "--vary", f"particles.velocity={STILL}", *SWEEP).exit_code == 0
    assert (out / sound["run"] / "summary.json").stat().st_mtime_ns == before, "a run that is done is not done again"
    refused(invoke(*arguments, "--set", "contact.friction=0.1"), "contact.friction", "same scene")


def test_a_sweep_goes_on_after_a_stage_that_failed(tmp_path, host_patch):
    """The folder of the stages is no run: it is the stage that says how far it got. The bar goes to the end of all."""
    stage, totals = StudyDisplay.stage, []
    host_patch.setattr(StudyDisplay, "stage", lambda *given: (totals.append(given[2]), stage(*given))[1])
    stages = '[[stages]]\nname = "one"\ntime.end = 0.02\n[[stages]]\nname = "two"\ntime.end = 0.04\n'
    (tmp_path / "scene.toml").write_text(GRAINS.replace("end = 0.04", "end = 0.02") + stages)
    vary = ("--vary", f"particles.velocity={FAST},{STILL}", "--set", "contact.speed=1.0")
    result = invoke("sweep", tmp_path / "scene.toml", "--out", tmp_path / "sweep", *vary)
    assert result.exit_code == 1 and "1 of 2 runs are not valid" in result.stderr
    with open(tmp_path / "sweep" / "sweep.csv", newline="") as file:
        failed, sound = csv.DictReader(file)
    assert [failed["valid"], sound["valid"]] == ["false", "true"] and "particle 1" in failed["reason"]
    assert load_run(tmp_path / "sweep" / sound["run"] / "two").times[-1] == 0.04 and totals == [0.04, 0.04]


PROBED = """
[boundary.left]
particles = "remove"
[[probes]]
name = "floor"
kind = "wall"
side = "bottom"
interval = 0.01
[[probes]]
name = "layers"
kind = "profile"
axis = "z"
cells = 2
"""


def test_a_sweep_has_the_probes_and_what_parts_of_the_scene_have_put_into_the_history(tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text(GRAINS.replace("[0.05, 0.02]", "[0.05, 0.01]") + PROBED)
    assert invoke("sweep", scene, "--out", tmp_path / "sweep", "--vary", "contact.friction=0.1,0.4").exit_code == 0
    with open(tmp_path / "sweep" / "sweep.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        run = load_run(tmp_path / "sweep" / row["run"])
        force = run.probes["floor"]["force_z"]
        assert len(force) == 4 and force.any(), "the floor carries the lowest grain"
        assert (float(row["floor.force_z_last"]), float(row["floor.force_z_mean"])) == (force[-1], force.mean())
        assert float(row["present"]) == 3 and not any(name.startswith("layers") for name in row)


def test_a_second_sweep_or_comparison_onto_one_folder_is_refused(grains, done, tmp_path):
    """While the first has it; nothing of the first is touched."""
    commands = (
        ("sweep", grains, "--vary", "contact.friction=0.1", *SWEEP),
        ("compare", done[0], done[0]),
        ("study", "injection", "--scale", "demo"),
    )
    for arguments in commands:
        out = tmp_path / arguments[0]
        out.mkdir()
        if arguments[0] == "study":
            continue_study(out)
        lock = acquire_lock(out)
        before = {path.name for path in out.iterdir()}
        refused(invoke(*arguments, "--out", out), "--out", str(out), f"process {os.getpid()}", "is writing to it")
        assert {path.name for path in out.iterdir()} == before
        os.close(lock)


def continue_study(out):
    """The mark of the demonstration in its folder."""
    (out / "study.json").write_text(json.dumps(identity("injection")))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--vary", "contact.friction"), ("--vary", "key=value")),
        (("--vary", "contact.friction=0.1,,0.2"), ("empty",)),
        (("--vary", "contact.friction=0.1,0.10"), ("twice",)),
        (
            ("--vary", "contact.friction=0.1", "--set", "contact.friction=0.2"),
            ("contact.friction", "given twice"),
        ),
        (("--vary", "contact.fricton=0.1"), ("contact.fricton", "Did you mean 'friction'")),
        (("--vary", "contact.friction=0.1,-1"), ("contact.friction", "-1")),
        (("--vary", "precision=float32,float64"), ("precision", "--set")),
        (("--vary", "domain.size=[0.2,0.2],[0.2"), ("TOML",)),
    ],
)
def test_a_sweep_is_refused_before_its_first_run(grains, tmp_path, options, words):
    refused(invoke("sweep", grains, "--out", tmp_path / "sweep", *options), *words)
    assert not (tmp_path / "sweep").exists()


def test_a_sweep_leaves_other_folders_alone_and_goes_on_after_a_refused_run(grains, tmp_path):
    (tmp_path / "letter.txt").write_text("dear")
    vary = ("--vary", "contact.time_step=2e-2")
    refused(invoke("sweep", grains, "--out", tmp_path, *vary), "not empty")
    result = invoke("sweep", grains, "--out", tmp_path / "sweep", *vary)
    assert result.exit_code == 2 and "stable step" in result.stdout and "1 of 1" in result.stderr


def test_values_and_names_of_a_sweep():
    values = parse_variation("a.b=1e-3, koch_hill,[1, 2],'x,y',{k = [1, 2]}").values
    assert values == (1e-3, "koch_hill", [1, 2], "x,y", {"k": [1, 2]})
    names = {}
    for chosen in (
        {"fluid.cells": [10, 20], "contact.friction": 0.5},
        {"a.x": 1, "b.x": "p/q"},
        {"b.x": "p?q", "a.x": 1},
    ):
        names[_name(chosen, names)] = None
    assert list(names)[:2] == ["cells=10x20,friction=0.5", "a.x=1,b.x=p_q"]
    assert _name({"a.x": 1, "b.x": "p?q"}, names) == "a.x=1,b.x=p_q~2"
    many = _name({"a": "\u65e5" * 300}, {})
    assert len(many.encode()) <= 252 and many.startswith("a=\u65e5"), "file systems count bytes"


def test_dataset_and_training_refuse_what_they_cannot_use(done, tmp_path):
    refused(invoke("dataset", tmp_path, "--out", tmp_path / "d.h5"), "not a run directory")
    refused(invoke("dataset", done[0], "--out", tmp_path / "d.h5"), "samples")
    refused(invoke("dataset", done[0], "--out", tmp_path / "d.h5", "--coarsen", "1,x"), "--coarsen", "1,2,4")
    refused(invoke("dataset", done[0], "--out", tmp_path), "--out", "is a folder")
    refused(invoke("train", tmp_path / "absent.h5", "--out", tmp_path / "c.h5"), "absent.h5", "is not a file")
    refused(invoke("train", done[0], "--out", tmp_path / "c.h5", "--hidden", "8-"), "--hidden", "4-2-1")


def test_train_writes_a_closure_and_says_how_good_it_is(tmp_path):
    path = tmp_path / "data.h5"
    small_dataset(path)
    common = ("--out", tmp_path / "new" / "closure.h5", "--epochs", 2, "--hidden", "4-4")
    for recipe in ("paper", "filtered"):
        result = invoke("train", path, "--recipe", recipe, *common)
        assert result.exit_code == 0, result.output
        assert not result.stderr
        assert all(word in result.stdout for word in ("koch_hill", "regression", "Split", "closure.h5"))
    closure, smaller = tmp_path / "new" / "closure.h5", tmp_path / "smaller.h5"
    # the last was of the filtered recipe
    result = invoke("prune", closure, path, "--neurons", 0.5, "--out", smaller)
    assert result.exit_code == 0, result.output
    assert "Hidden layers reduced from 4-4 to 2-2" in result.stdout and load_closure(smaller)[0].hidden == (
        2,
        2,
    )
    result = invoke("distill", closure, path, "--hidden", "4-4", "--epochs", 2, "--out", smaller)
    assert result.exit_code == 0, result.output
    assert "the R2 of the given closure is" in result.stdout and load_closure(smaller)[0].hidden == (4, 4)
    out = tmp_path / "bounded.h5"
    chosen = ("--bounded", "--loss", "balance", "--features", "solid_fraction,log1p_reynolds")
    result = invoke("train", path, *common, "--out", out, *chosen)
    bounded, metadata = load_closure(out)
    assert result.exit_code == 0 and bounded.bounded and bounded.features == ("solid_fraction", "log1p_reynolds")
    assert metadata["settings"]["loss"] == "balance"
    refused(invoke("train", path, "--loss", "balance", "--terms", "pressure_gradient", "--out", out), "terms", "mse")


@pytest.mark.parametrize("option", [("--bounded",), ("--loss", "balance"), ("--terms", "x"), ("--features", "x")])
def test_options_of_the_filtered_recipe_are_refused_with_that_of_the_paper(option, tmp_path):
    given = ("train", tmp_path / "d.h5", "--recipe", "paper", "--out", tmp_path / "c.h5", *option)
    refused(invoke(*given), option[0], "--recipe filtered")


def test_train_ensembles(tmp_path):
    path = tmp_path / "data.h5"
    small_dataset(path)
    common = ("train", path, "--recipe", "filtered", "--epochs", 2, "--hidden", "4-4")
    refused(invoke(*common, "--out", tmp_path / "c.h5", "--terms", "lift"), "terms", "pressure_gradient")
    result = invoke(*common, "--out", tmp_path / "ensemble.h5", "--ensemble", 2)
    assert result.exit_code == 0, result.output
    assert "within two spreads" in result.stdout
    closure = load_closure(tmp_path / "ensemble.h5")[0]
    assert isinstance(closure, EnsembleClosure)
    refused(invoke("prune", tmp_path / "ensemble.h5", path, "--out", tmp_path / "p.h5"), "ensemble of 2")


def small_dataset(path, rows=400):
    generator = np.random.default_rng(0)
    columns = {name: generator.uniform(0.1, 0.3, rows) for name in SCALARS}
    columns["time"] = np.linspace(0.0, 1.0, rows)
    columns |= {name: generator.normal(size=(rows, 2)) for name in VECTORS}
    attributes = {
        "drag": "koch_hill",
        "fluid_density": 1000.0,
        "dynamic_viscosity": 1e-3,
        "dimension": 2,
        "run": "one",
        "scene_toml": "seed = 1\n",
    }
    write_dataset(path, attributes, {2: {"filter_size": 0.1, "kernel_width": 0.1, **columns}})


def test_finetune_refuses_and_writes(grains, done, tmp_path, host_patch):
    """What is trained is kept also where the training ends early; the training itself is put in by hand."""
    closure, out = tmp_path / "c.h5", tmp_path / "new" / "tuned.h5"
    save_closure(closure, InvariantClosure.initial(hidden=(2,)), {"recipe": "filtered"})
    common = ("--closure", closure, "--out", out)
    refused(invoke("finetune", grains, "--reference", tmp_path / "none", *common), "not a run directory")
    refused(invoke("finetune", grains, "--reference", done[0], *common), "[particles] and [fluid]")
    absent = ("--closure", tmp_path / "absent.h5", "--out", out)
    refused(invoke("finetune", grains, "--reference", done[0], *absent), "absent.h5", "is not a file")
    refused(invoke("finetune", grains, "--reference", done[0], *common, "--horizons", "1,x"), "--horizons")
    assert not out.exists()
    record = {"validation_loss_before": 0.5, "validation_loss": 0.25, "skipped": 5, "seconds": 1.0}

    def trained(scene, reference, start, metadata, settings, progress):
        assert settings.horizons == (1, 2) and settings.updates == 3
        written = {name: values | {"finetune": record} for name, values in metadata.items()}
        return FinetuneResult(start, written, "5 updates in a row failed")

    host_patch.setattr("jaxdem.train.finetune.finetune", trained)
    chosen = ("--horizons", "1,2", "--updates", 3)
    result = invoke("finetune", grains, "--reference", done[0], *common, *chosen)
    assert result.exit_code == 1 and "5 updates in a row failed" in result.stderr
    assert "0.5 before, 0.25 after, 5 updates skipped" in result.stdout
    assert load_closure(out)[1] == {"recipe": "filtered", "finetune": record}
    stress = tmp_path / "stress.h5"
    both = ("--subgrid", "new", "--subgrid-out", stress)
    result = invoke("finetune", grains, "--reference", done[0], *common, *chosen, *both)
    assert result.exit_code == 1
    assert load_closure(out)[1] == {"recipe": "filtered", "finetune": record}
    assert load_subgrid(stress)[1] == {"finetune": record}
    alone = ("--subgrid", stress, "--out", out)
    assert invoke("finetune", grains, "--reference", done[0], *alone, *chosen).exit_code == 1
    assert jax.tree.structure(load_subgrid(out)[0]) == jax.tree.structure(load_subgrid(stress)[0])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), ("--closure", "--subgrid new")),
        (("--subgrid", "none.h5"), ("--subgrid = ", "none.h5", "is not a file")),
        (("--closure", "c.h5", "--subgrid", "new"), ("--subgrid-out", "is needed")),
        (("--subgrid", "new", "--subgrid-out", "s.h5"), ("--subgrid-out", "only subgrid is trained")),
    ],
)
def test_finetune_refuses_what_does_not_go_together(grains, tmp_path, host_patch, options, words):
    host_patch.chdir(tmp_path)
    save_closure("c.h5", InvariantClosure.initial(hidden=(2,)), {})
    refused(invoke("finetune", grains, "--reference", "none", "--out", "out.h5", *options), *words)


def test_export_writes_what_was_asked_for(tmp_path):
    path = tmp_path / "drag.closure.h5"
    save_closure(path, InvariantClosure.initial(hidden=(2,)), {"recipe": "filtered"})
    result = invoke("export", path, "--format", "c", "--out", tmp_path / "new" / "drag.h")
    assert result.exit_code == 0, result.output
    assert result.stdout == f"Wrote {tmp_path / 'new' / 'drag.h'}\n"
    assert "drag_drag(const drag_inputs *in)" in (tmp_path / "new" / "drag.h").read_text()
    refused(invoke("export", tmp_path / "absent.h5", "--format", "c", "--out", tmp_path / "x.h"), "absent.h5")
    refused(invoke("export", path, "--format", "c", "--out", tmp_path), "--out", "is a folder")
    assert invoke("export", path, "--format", "fortran", "--out", tmp_path / "x").exit_code == 2
    kept = path.read_bytes()
    refused(invoke("export", path, "--format", "c", "--out", path), "--out", "would be lost")
    for command in ("distill", "prune"):
        refused(invoke(command, path, tmp_path / "data.h5", "--out", path), "--out", "would be lost")
    assert path.read_bytes() == kept


def test_what_a_study_is_asked_for_in_vain_is_refused(tmp_path, host_patch):
    """The full size too where the package is not in a checkout."""
    out = tmp_path / "study"
    refused(invoke("study", "flying", "--out", out), "flying", "injection")
    refused(invoke("study", "injection", "--out", out, "--jobs", 2), "--jobs", "--scale paper")
    host_patch.setattr("jaxdem.cli.study.SOURCE", tmp_path)
    full = ("study", "injection", "--scale", "paper", "--out", out)
    refused(invoke(*full), "--scale", "paper", "studies", "source code", "pip install --editable")
    assert not out.exists()


def test_the_full_size_study_is_that_of_the_checkout(tmp_path):
    """With its options, its messages and its exit code."""
    full = ("study", "injection", "--scale", "paper", "--jobs", 0)
    result = invoke(*full, "--out", tmp_path, "--parts", "budget")
    assert result.exit_code == 0 and "budget: " in result.output, result.output
    assert "not run: fine" in (tmp_path / "tables.md").read_text()
    assert invoke(*full, "--out", tmp_path / "new", "--parts", "mash").exit_code == 2


def start(grains, out):
    """The program itself, on a run that would take minutes."""
    command = [sys.executable, "-m", "jaxdem", "run", str(grains), "--out", str(out)]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
    return subprocess.Popen(
        [*command, "--set", "time.end=2000.0"],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def wait_for(path, process):
    limit = time.monotonic() + 120
    while not path.exists() and time.monotonic() < limit and process.poll() is None:
        time.sleep(0.05)


def wait_for_frames(history, frames, process):
    """Until the history has its header and a line for each frame."""
    limit = time.monotonic() + 120
    while time.monotonic() < limit and process.poll() is None:
        if len(history.read_text().splitlines()) > frames:
            return
        time.sleep(0.05)


def stopped(process, out):
    """Exit code of a stopped program, with a checkpoint left and one message that says how to go on."""
    stdout, stderr = process.communicate(timeout=120)
    assert "Traceback" not in stderr
    assert not stdout, "no bar where the output is not a terminal"
    assert f"--out {out}" in stderr
    assert "--set time.end=2000.0 --resume" in stderr
    assert (out / "checkpoint.h5").exists()
    return process.returncode


def test_signals_leave_a_checkpoint_and_their_exit_codes(grains, tmp_path):
    codes = {signal.SIGINT: 130, signal.SIGTERM: 143}
    running = {number: start(grains, tmp_path / number.name) for number in codes}
    try:
        for number, process in running.items():
            wait_for(tmp_path / number.name / "history.csv", process)
            wait_for_frames(tmp_path / number.name / "history.csv", 2, process)
            process.send_signal(number)
        for number, process in running.items():
            out = tmp_path / number.name
            assert stopped(process, out) == codes[number]
            run = load_run(out)
            assert run.number_of_frames > 1
            assert run.summary["valid"] is False
    finally:
        for process in running.values():
            process.kill()


def test_a_signal_while_compiling_leaves_a_checkpoint_too(grains, tmp_path):
    process = start(grains, tmp_path / "run")
    try:
        wait_for(tmp_path / "run" / "scene.toml", process)
        process.send_signal(signal.SIGTERM)
        assert stopped(process, tmp_path / "run") == 143
    finally:
        process.kill()


def test_the_hint_is_the_command_with_all_that_was_given():
    commands, hints = typer.Typer(), []
    commands.callback()(lambda: None)

    @commands.command("sweep")
    def command(
        context: typer.Context,
        scene: declared.SceneFile,
        out: Annotated[Path, declared.folder_out("Folder.")],
        vary: declared.Vary,
        fps: declared.FrameRate = 10.0,
        resume: declared.Resume = False,
        quiet: declared.Quiet = False,
    ) -> None:
        hints.append(this_command(context, resume=True))

    given = ["sweep", "a b.toml", "--quiet", "--vary", "x=1,2", "--out", "o", "--vary", "y=3", "--fps", "10.0"]
    assert CliRunner().invoke(commands, given).exit_code == 0
    assert hints == ["jaxdem sweep 'a b.toml' --out o --vary x=1,2 --vary y=3 --resume --quiet"]
