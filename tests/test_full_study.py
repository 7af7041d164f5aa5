"""The full-size study's machinery in small: the pool, the plan, going on, the replay, and the tables."""

import dataclasses
import json
import os
import signal
import sys
import threading
import types

import numpy as np
import pytest

import jaxdem
from jaxdem.errors import InputError
from jaxdem.run.simulate import Interrupted
from jaxdem.studies import paper
from jaxdem.studies.driver import PARTS, FullStudy
from jaxdem.studies.injection import injection_plan
from jaxdem.studies.pieces import require_same_scene
from jaxdem.studies.plan import FitSpec, RunSpec, by_name
from jaxdem.studies.pool import Piece, Pool
from jaxdem.studies.subgrid_stress import hidden_stress
from jaxdem.studies.tables import Section, Table, write_results
from jaxdem.study import SCENES, _claim

WORKER = """
import json, pathlib, signal, sys, time
work = json.load(sys.stdin)
if work["do"] == "crash":
    sys.exit("no such luck")
if work["do"] == "refuse":
    print(json.dumps({"failed": "key = 1: not possible"}))
    sys.exit(2)
if work["do"] == "wait":
    def stop(number, _):
        pathlib.Path(work["out"]).write_text("checkpoint")
        print(json.dumps({"stopped": number}), flush=True)
        sys.exit(130)
    signal.signal(signal.SIGINT, stop)
    print(json.dumps({"done": 0.5}), flush=True)
    time.sleep(60)
pathlib.Path(work["out"]).write_text("done")
print("a line that is no word of ours")
print(json.dumps({"finished": True}))
"""


class Bars:
    """Keeps what it is told."""

    def __init__(self, at_progress=None):
        self.begun, self.said, self.at_progress = [], [], at_progress

    def begin(self, name, total):
        self.begun.append(name)
        return lambda done: self.at_progress and self.at_progress()

    def end(self, name):
        pass

    def say(self, message):
        self.said.append(message)


@pytest.fixture
def pool(tmp_path):
    def make(bars, jobs=2):
        script = tmp_path / "worker.py"
        script.write_text(WORKER)
        return Pool(jobs, tmp_path / "logs", bars, (sys.executable, str(script)))

    return make


def piece(tmp_path, name, do="finish", **more):
    return Piece(name, {"do": do, "out": str(tmp_path / name)}, 1.0, **more)


def test_a_piece_waits_for_what_it_needs_and_failures_cost_only_what_needs_them(pool, tmp_path):
    """In the order of need; a crash and a refusal are named with their reasons, the rest is done."""
    bars = Bars()
    problems = pool(bars).do(
        [
            piece(tmp_path, "old", done=True),
            piece(tmp_path, "run", needs=("closure", "old")),
            piece(tmp_path, "closure"),
            piece(tmp_path, "bad", do="crash"),
            piece(tmp_path, "worse", do="refuse"),
            piece(tmp_path, "after bad", needs=("bad",)),
            piece(tmp_path, "after that", needs=("after bad",)),
        ]
    )
    assert bars.begun.index("closure") < bars.begun.index("run") and "old" not in bars.begun
    assert (tmp_path / "run").read_text() == "done"
    assert set(problems) == {"bad", "worse", "after bad", "after that"}
    assert "no such luck" in problems["bad"] and problems["worse"] == "key = 1: not possible"
    assert problems["after bad"] == "needs bad" and not (tmp_path / "after bad").exists()


def test_a_signal_stops_all_processes_and_lets_them_leave_checkpoints(pool, tmp_path):
    """SIGINT is passed on once, the processes end by themselves, nothing new is begun."""
    once = threading.Event()

    def interrupt():
        if not once.is_set():
            once.set()
            os.kill(os.getpid(), signal.SIGINT)

    bars = Bars(interrupt)
    with pytest.raises(Interrupted) as stop:
        pool(bars, jobs=1).do([piece(tmp_path, "long", do="wait"), piece(tmp_path, "next")])
    assert stop.value.number == signal.SIGINT
    assert (tmp_path / "long").read_text() == "checkpoint" and not (tmp_path / "next").exists()


def test_every_scene_and_name_of_the_plan_is_sound(tmp_path):
    """All runs' scenes load, all names that parts, fits and datasets give exist, and held-out data are the fine run's."""
    plan = injection_plan()
    study = FullStudy(plan, SCENES, tmp_path, Bars(), 1)
    pieces = {piece.name: piece for piece in study.pieces()}
    assert not any(piece.done for piece in pieces.values())
    assert {name for piece in pieces.values() for name in piece.needs} <= set(pieces)
    assert set(PARTS) == set(plan.parts)
    assert {name for name in plan.runs} <= set(pieces)
    for fit in (one for one in plan.closures.values() if isinstance(one, FitSpec)):
        runs = [plan.datasets[name].run for name in fit.datasets]
        assert runs[-1] == "fine" and len(runs) > 2
    json.dumps([dict(piece.work) for piece in pieces.values()])


def test_runs_made_elsewhere_may_lie_in_the_folder_and_nothing_else(tmp_path):
    """A folder of the plan's runs is taken; one with something of the user's is not."""
    (tmp_path / "coarse_2").mkdir()
    _claim(tmp_path, {"study": "injection"}, injection_plan().files)
    (tmp_path / "study.json").unlink()
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(InputError, match="not empty"):
        _claim(tmp_path, {"study": "injection"}, injection_plan().files)


def test_unknown_parts_are_refused(tmp_path):
    """With the known names."""
    with pytest.raises(InputError, match=r"--parts.*mesh, budget"):
        FullStudy(injection_plan(), SCENES, tmp_path, Bars(), 1, ("mash",)).pieces()


def test_without_processes_there_are_tables_of_what_is_there(tmp_path):
    """`--jobs 0`: nothing is begun, and what is missing is named."""
    bars = Bars()
    study = FullStudy(injection_plan(), SCENES, tmp_path, bars, 0, ("budget",))
    assert study.run() is None and not bars.begun and not study.problems
    assert "not run: fine" in (tmp_path / "tables.md").read_text()


def test_two_things_of_one_name_are_refused():
    """A plan in which a name means two runs cannot be made."""
    same = RunSpec("a", "x.toml", {"seed": 1})
    assert by_name([same, dataclasses.replace(same)]) == {"a": same}
    with pytest.raises(ValueError, match="two different"):
        by_name([same, RunSpec("a", "x.toml", {"seed": 2})])


def test_a_run_of_another_scene_is_refused_and_one_of_older_defaults_is_not(tmp_path):
    """Keys that differ are named; keys that the stored file lacks have their defaults; a closure may lie elsewhere,
    and there may be samples that are not asked for, not the other way round."""
    scene = jaxdem.load_scene(SCENES / "settling.toml", {"closure.file": "/there/a.closure.h5"})
    text = scene.to_toml().replace("drag_inputs_coarsened = 1\n", "").replace("/there/", "/elsewhere/")
    (tmp_path / "scene.toml").write_text(text)
    require_same_scene(tmp_path, scene)
    other = jaxdem.load_scene(SCENES / "settling.toml", {"closure.file": "/there/a.closure.h5", "seed": 3})
    with pytest.raises(InputError, match="seed"):
        require_same_scene(tmp_path, other)
    sampled = jaxdem.load_scene(
        SCENES / "settling.toml", {"closure.file": "/there/a.closure.h5", "output.samples": 0.1}
    )
    with pytest.raises(InputError, match=r"output\.samples"):
        require_same_scene(tmp_path, sampled)
    (tmp_path / "scene.toml").write_text(sampled.to_toml())
    require_same_scene(tmp_path, scene)


def test_tables_are_numbers_and_text_and_parts_of_earlier_calls_are_kept(tmp_path):
    """Missing numbers are null and a dash; a second part leaves the first where it is."""
    one = Section("mesh", "Mesh", ["A sentence."], [Table("T", ["a", "b"], [["x", 0.012345], ["y", float("nan")]])])
    write_results(tmp_path, [one], {"jobs": 2}, ("budget", "mesh"))
    write_results(tmp_path, [Section("budget", "Budget", missing={"run": "failed"})], {"jobs": 1}, ("budget", "mesh"))
    text = (tmp_path / "tables.md").read_text()
    assert text.index("## Budget") < text.index("## Mesh")
    assert "| x | 0.0123 |" in text and "| y | - |" in text and "- failed: run" in text
    parts = json.loads((tmp_path / "results.json").read_text())["parts"]
    assert parts["mesh"]["tables"][0]["rows"][1] == ["y", None] and parts["mesh"]["about"] == {"jobs": 2}


def test_the_paper_s_figures_are_complete():
    """All meshes have all figures."""
    assert set(paper.MESHES) == set(paper.RUNOFF) == set(paper.HEIGHT) == set(paper.STORAGE)


@pytest.mark.parametrize("cells", [(12, 20), (12, 12, 16)], ids=["2-D", "3-D"])
def test_the_hidden_stress_of_a_linear_flow_is_the_gradient_model_s(cells):
    """u = G x averaged over 4 fine cells an axis: R_ij = g (1 - 1/4^2)/12 sum_k h_k^2 G_ik G_jk, whatever G."""
    size = tuple(0.1 * (n + axis) for axis, n in enumerate(cells))
    axes = [(np.arange(n) + 0.5) * length / n for n, length in zip(cells, size, strict=True)]
    place = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    gradient = np.random.default_rng(3).normal(size=(len(cells),) * 2)
    frame = {"velocity": place @ gradient.T, "void_fraction": np.full(cells, 0.6)}
    scene = {"domain": {"size": size}, "fluid": {"cells": cells}}
    run = types.SimpleNamespace(times=[0.0, 0.1], scene=scene, fluid=lambda index: frame)
    found = hidden_stress(run, tuple(n // 4 for n in cells))
    assert found.gradient_fit == pytest.approx((1.0 - 1.0 / 16.0) / 12.0, rel=1e-10)
    assert found.best == pytest.approx(1.0, abs=1e-10)
    assert found.gradient == pytest.approx(1.0 - 1.0 / 15.0**2, rel=1e-9)  # of c_n = 1/12, a fifteenth too large
