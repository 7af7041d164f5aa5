"""Scenes in stages: one command runs them, a kill at any moment loses nothing, and what is wrong is said before."""

from __future__ import annotations

import copy
import random
from pathlib import Path

import jax
import pytest
import tomli_w
from typer.testing import CliRunner

from jaxdem import InputError, build, external_fluid, initial_state, load_run, load_scene, simulate
from jaxdem.check.check import check_scene
from jaxdem.cli.main import app
from jaxdem.closures import KochHill, Stokes, SubgridClosure
from jaxdem.io import read_checkpoint
from jaxdem.run import chunk
from jaxdem.run.chain import foreseen_cases
from jaxdem.run.time_loop import TimeLoop
from jaxdem.run.writer import RunWriter
from jaxdem.scene.stages import StagedScene

SCENE = {
    "domain": {"size": [0.1, 0.1], "depth": 0.02},
    "particles": {
        "radius": 0.005,
        "density": 2500.0,
        "pack": {"kind": "lattice", "start": [0.01, 0.0], "stop": [0.05, 0.05], "spacing": 1.02},
    },
    "contact": {"young_modulus": 1e6, "friction": 0.5, "speed": 1.0},
    "time": {"end": 0.01, "output_interval": 0.01},
    "output": {"checkpoint_interval": 0.0},
    "coupling": {"interval": 0.005},
}
STAGES = [
    {"name": "fill", "time": {"end": 0.03}},
    {"name": "tilt", "time": {"end": 0.06}, "domain": {"gravity": [2.0, -9.0]}},
    {
        "name": "thin",
        "time": {"end": 0.08},
        "start": {"remove": [{"shape": "box", "start": [0.0, 0.03], "stop": [0.1, 0.1]}]},
    },
]
STAGED = SCENE | {"stages": STAGES}


@pytest.fixture(scope="module", autouse=True)
def in_single_precision():
    with jax.enable_x64(False):
        yield


@pytest.fixture(scope="module")
def chain(tmp_path_factory):
    """All stages, run without a stop."""
    out = tmp_path_factory.mktemp("chain") / "runs"
    simulate(load_scene(STAGED), out)
    return out


def command(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def written(path, tables):
    path.write_text(tomli_w.dumps(tables))
    return path


def kept(folder):
    """What a run came to: its frames, its history, and its last checkpoint without the times that it took."""
    run = load_run(folder)
    frames = []
    for k in range(run.number_of_frames):
        frame = run.particles(k)
        frames += [frame[name].tobytes() for name in sorted(frame)]
    arrays = read_checkpoint(Path(folder) / "checkpoint.h5")[0]
    counted = {name: value.tobytes() for name, value in arrays.items() if "wall" not in name and "stage_" not in name}
    return frames, (Path(folder) / "history.csv").read_bytes(), counted


def test_each_stage_begins_where_the_one_before_ended(chain):
    fill, tilt, thin = (load_run(chain / name) for name in ("fill", "tilt", "thin"))
    assert [float(run.times[0]) for run in (fill, tilt, thin)] == [0.0, 0.03, 0.06]
    assert [float(run.times[-1]) for run in (fill, tilt, thin)] == [0.03, 0.06, 0.08]
    for before, after in ((fill, tilt), (tilt, thin)):
        assert after.particles(0)["velocity"].tobytes()[:16] == before.particles(-1)["velocity"].tobytes()[:16]
        assert after.summary["start"]["from"] == str(before.path)
    # A change stays for later stages; what a stage does at its start does not.
    assert tilt.scene["domain"]["gravity"] == thin.scene["domain"]["gravity"] == [2.0, -9.0]
    assert "remove" in thin.scene["start"] and not tilt.scene["start"]["remove"]
    assert thin.summary["start"]["removed"] == thin.summary["counts"]["removed"] > 0
    assert "active" not in tilt.particles(0) and not thin.particles(0)["active"].all()


def test_python_gets_the_last_run(chain):
    scene = load_scene(STAGED)
    assert isinstance(scene, StagedScene) and scene.time.end == 0.03
    again = simulate(scene, chain, resume=True)
    assert again.path == chain / "thin"
    with pytest.raises(InputError, match=r"is not empty.*--resume"):
        simulate(scene, chain)


def test_what_takes_one_scene_refuses_several():
    """Which stage is meant is not known."""
    scene = load_scene(STAGED)
    first = scene.stages[0].scene
    built = build(first)
    for act in (build, external_fluid, check_scene, lambda scene: initial_state(scene, *built)):
        with pytest.raises(InputError, match="fill, tilt, thin") as caught:
            act(scene)
        assert caught.value.key == "stages" and "scene.stages[0].scene" in caught.value.remedy
    assert initial_state(first, *built)[0].particles.position.shape == (12, 2)


class Killed(BaseException):
    """What ends a run as a kill does: nothing is written any more."""


def test_twenty_kills_at_random_moments_change_nothing(chain, tmp_path, host_patch):
    """Before or after any interval, frame or checkpoint; then the chain is gone on with, as often as it takes."""
    out, deaths = tmp_path / "runs", Deaths(20)
    host_patch.setattr(chunk, "LONGEST", 0.0)  # one interval at a time
    for owner, name in ((TimeLoop, "_advance"), (RunWriter, "frame"), (RunWriter, "checkpoint")):
        host_patch.setattr(owner, name, deaths.around(getattr(owner, name)))
    host_patch.setattr(TimeLoop, "_compile", compiled_once(TimeLoop._compile))
    scene = load_scene(STAGED)
    for _ in range(21):
        try:
            simulate(scene, out, resume=(out / "stages.toml").is_file())
        except Killed:
            continue
        break
    assert deaths.left == 0
    for name in ("fill", "tilt", "thin"):
        assert kept(out / name) == kept(chain / name), name


class Deaths:
    """So many deaths, at random moments."""

    def __init__(self, number):
        self.left, self._dice = number, random.Random(3)

    def around(self, action):
        def wrapped(*arguments):
            self._roll()
            result = action(*arguments)
            self._roll()
            return result

        return wrapped

    def _roll(self):
        if self.left and self._dice.random() < 0.2:
            self.left -= 1
            raise Killed


def compiled_once(compile_it):
    """One program for every stage, however often it is gone on with: a death does not change it."""
    programs = {}

    def compiled(loop):
        name = loop.directory.path.name
        if name not in programs:
            compile_it(loop)
            programs[name] = loop.program
        loop.program = programs[name]

    return compiled


def test_files_are_stages_too(chain, tmp_path, host_patch):
    """The same three scenes as files: the same bits; complete stages are not run again."""
    names, files, below = [], [], SCENE
    for stage in STAGES:
        names.append(stage["name"])
        changes = {key: value for key, value in stage.items() if key not in ("name", "start")}
        below = below | {key: below[key] | value for key, value in changes.items()}
        tables = below | ({"start": stage["start"]} if "start" in stage else {})
        files.append(written(tmp_path / f"{stage['name']}.toml", tables))
    done = command("run", *files, "--out", tmp_path / "runs", "--quiet")
    assert done.exit_code == 0, done.output
    for name in names:
        assert kept(tmp_path / "runs" / name) == kept(chain / name), name
    host_patch.setattr(TimeLoop, "run", lambda *_: pytest.fail("it is complete"))
    again = command("run", *files, "--out", tmp_path / "runs", "--quiet", "--resume")
    assert again.exit_code == 0 and "is complete" in again.output


def test_check_looks_at_every_stage(tmp_path):
    path = written(tmp_path / "scene.toml", STAGED)
    done = command("check", path)
    assert done.exit_code == 0, done.output
    for name in ("fill", "tilt", "thin"):
        assert f"Stage {name}" in done.output
    wrong = copy.deepcopy(STAGED)
    wrong["stages"][2]["contact"] = {"time_step": 1.0}
    for order in ("check", "run"):
        options = ["--out", tmp_path / "runs"] if order == "run" else []
        done = command(order, written(path, wrong), *options)
        assert done.exit_code == 2
        assert "contact.time_step" in done.output and "thin" in done.output
    assert not (tmp_path / "runs").exists(), "said before anything is run"


@pytest.mark.parametrize(
    ("number", "change", "message"),
    [
        (1, {"fluid": {"cells": [0, 4]}}, r"stages\.1\.fluid\.cells"),
        (1, {"domain": {"gravty": [0.0, 0.0]}}, r"stages\.1\.domain\.gravty.*gravity"),
        (1, {"time": {"end": 0.03}}, r"stages\.1\.time\.end.*time goes on"),
        (
            1,
            {"time": {"end": 0.065}},
            r"stages\.1\.time\.output_interval.*must divide the time from the start at 0\.03 s",
        ),
        (1, {"name": "fill"}, r"stages\.1\.name.*another stage"),
        (1, {"name": "a/b"}, r"stages\.1\.name.*folder"),
        (1, {"time": {"output_interval": 0.01}}, r"stages\.1\.time\.end: is missing"),
        (1, {"start": {"from": "x"}}, r"stages\.1\.start\.from.*stage begins from the end of the one before"),
        (2, {"particles": {"radius": 0.006}}, r"stages\.2\.particles\.radius.*start\.add"),
        (1, {"particles": False}, r"stages\.1\.particles = False: cannot be left out.*remove = "),
        (1, {"fluid": False}, r"stages\.1\.fluid = False: .*there is no such table here"),
        (1, {"walls": False}, r"stages\.1\.walls = False: .*write walls = \[\]"),
        (1, {"precision": "float64"}, r"stages\.1\.precision = 'float64': fill has float32"),
        (1, {"name": "Fill"}, r"stages\.1\.name.*another stage"),
        (1, {"name": "stages.toml"}, r"stages\.1\.name.*a file beside the stages"),
    ],
)
def test_what_is_wrong_with_a_stage_names_its_key(number, change, message):
    wrong = copy.deepcopy(STAGED)
    wrong["stages"][number] |= change
    with pytest.raises(InputError, match=message):
        load_scene(wrong)


def test_a_table_given_as_false_is_left_out_from_there_on():
    wet = SCENE | {"fluid": {"cells": [4, 4]}, "coupling": {"drag": "koch_hill"}}
    stages = [
        {"name": "wet", "time": {"end": 0.02}},
        {"name": "dry", "time": {"end": 0.04}, "fluid": False, "coupling": False},
        {"name": "on", "time": {"end": 0.05}},
    ]
    scene = load_scene(wet | {"stages": stages})
    assert [stage.scene.fluid is None for stage in scene.stages] == [False, True, True]


def test_a_part_of_the_user_goes_to_the_stages_that_read_it_and_is_refused_where_none_does(tmp_path):
    """A bed that is filled dry and fluidised then, by a law of the user's."""
    stages = [
        {"name": "fill", "time": {"end": 0.02}},
        {"name": "wet", "time": {"end": 0.04}, "fluid": {"cells": [4, 4]}},
    ]
    scene = load_scene(SCENE | {"stages": stages})
    (_, _, dry), (_, _, wet) = foreseen_cases(scene.stages, Stokes())
    assert dry.simulation.coupling is None and wet.parameters.closure == Stokes() != KochHill()
    with pytest.raises(InputError, match=r"^subgrid = 'given': needs \[fluid\], which no stage has"):
        simulate(load_scene(SCENE | {"stages": stages[:1]}), tmp_path, subgrid=SubgridClosure.constant(0.0, 1 / 12))
    assert not any(tmp_path.iterdir())


def test_a_folder_of_stages_is_no_run(chain, tmp_path):
    for order in (["plot", chain], ["animate", chain, "--out", tmp_path / "a.gif"]):
        done = command(*order)
        assert done.exit_code == 2
        assert "fill, tilt, thin" in done.output and "folder of one" in done.output
    other = load_scene(SCENE | {"stages": [STAGES[0] | {"name": "other"}]})
    with pytest.raises(InputError, match=r"stages.*fill, tilt, thin"):
        simulate(other, chain, resume=True)


def test_a_stage_of_another_scene_is_not_gone_on_with(chain):
    changed = copy.deepcopy(STAGED)
    changed["stages"][1]["domain"]["gravity"] = [3.0, -9.0]
    with pytest.raises(InputError, match=r"domain\.gravity.*stage 1 \(tilt\)"):
        simulate(load_scene(changed), chain, resume=True)
