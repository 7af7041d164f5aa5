"""The plan of the study at full size, its folder, and the command."""

import dataclasses
import pickle

import pytest

import jaxdem
from jaxdem.cli.study import FULL_SIZE, STUDIES
from jaxdem.errors import InputError
from jaxdem.study import DEMOS, SCENES, claim
from studies import __main__ as command
from studies import driver
from studies.driver import PARTS, PLANS
from studies.injection import injection_plan, sweeps
from studies.pool import Stopped
from studies.specs import FitSpec, Folder, RunSpec, by_name, require_same_scene


def test_every_study_has_a_demonstration_and_those_that_say_so_a_full_size():
    assert set(STUDIES) == set(DEMOS) and set(FULL_SIZE) == set(PLANS)


def test_every_scene_and_name_of_the_plan_is_sound(tmp_path):
    """All runs' scenes load, what is needed exists and comes before, held-out data are the fine run's, and a process
    can be given the work."""
    plan = injection_plan()
    pieces = Folder(plan, tmp_path).pieces(plan.parts.values())
    names = [piece.name for piece in pieces]
    assert set(names) == set(plan.specs) and not any(piece.done for piece in pieces)
    assert all(names.index(need) < names.index(piece.name) for piece in pieces for need in piece.needs)
    assert set(PARTS) == set(plan.parts) and all(piece.length > 0.0 for piece in pieces)
    for fit in (one for one in plan.specs.values() if isinstance(one, FitSpec)):
        runs = [plan.specs[name].run for name in fit.datasets]
        assert runs[-1] == "fine" and len(runs) > 2
    tuned = next(piece for piece in pieces if piece.name == "searched_both")
    assert {"filtered_narrow", "training_injection"} <= set(tuned.needs)
    assert pickle.loads(pickle.dumps(tuned)).make.args[0] == plan.specs["searched_both"]


def test_a_sweep_varies_one_setting_of_the_papers_network():
    for what, fits in sweeps().items():
        assert len({getattr(fit.settings, what) for fit in fits}) == len(fits) > 4
        assert len({dataclasses.replace(fit.settings, **{what: getattr(fits[0].settings, what)}) for fit in fits}) == 1


def test_runs_made_elsewhere_may_lie_in_the_folder_and_nothing_else(tmp_path):
    """A folder of the plan's runs is taken; one with something of the user's is not."""
    (tmp_path / "coarse_2").mkdir()
    claim(tmp_path, {"study": "injection"}, injection_plan().files)
    (tmp_path / "study.json").unlink()
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(InputError, match="not empty"):
        claim(tmp_path, {"study": "injection"}, injection_plan().files)


def test_two_things_of_one_name_are_refused():
    """A plan in which a name means two runs cannot be made."""
    same = RunSpec("a", "x.toml", {"seed": 1})
    assert by_name([same, dataclasses.replace(same)]) == {"a": same}
    with pytest.raises(ValueError, match="two different"):
        by_name([same, RunSpec("a", "x.toml", {"seed": 2})])


def test_a_run_of_another_scene_is_refused_and_one_of_older_defaults_is_not(tmp_path):
    """Keys that differ are named; keys that the stored file lacks have their defaults; a closure may lie elsewhere,
    and there may be samples that are not asked for, not the other way round."""
    closure = {"closure.file": "/there/a.closure.h5"}
    scene = jaxdem.load_scene(SCENES / "settling.toml", closure)
    text = scene.to_toml().replace("drag_inputs_coarsened = 1\n", "").replace("/there/", "/elsewhere/")
    (tmp_path / "scene.toml").write_text(text)
    require_same_scene(tmp_path, scene)
    with pytest.raises(InputError, match="seed"):
        require_same_scene(tmp_path, jaxdem.load_scene(SCENES / "settling.toml", {**closure, "seed": 3}))
    sampled = jaxdem.load_scene(SCENES / "settling.toml", {**closure, "output.samples": 0.1})
    with pytest.raises(InputError, match=r"output\.samples"):
        require_same_scene(tmp_path, sampled)
    (tmp_path / "scene.toml").write_text(sampled.to_toml())
    require_same_scene(tmp_path, scene)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["flying"], ("NAME", "flying", "injection")),
        (["injection", "--parts", "mesh,mash"], ("--parts", "mash", "mesh, budget")),
        (["injection", "--jobs", "-1"], ("--jobs", "at least 1")),
    ],
)
def test_wrong_options_are_refused_before_the_folder_is_touched(arguments, words, tmp_path, capsys):
    assert command.main([*arguments, "--out", str(tmp_path / "new")]) == 2
    said = capsys.readouterr().err
    assert all(word in said for word in words) and not (tmp_path / "new").exists()


def test_without_processes_there_are_tables_of_what_is_there(tmp_path, capsys):
    """`--jobs 0`: nothing is begun, and what is missing is named."""
    assert command.main(["injection", "--out", str(tmp_path), "--parts", "budget", "--jobs", "0"]) == 0
    said = capsys.readouterr().out
    assert "begun" not in said and "budget: " in said
    assert "not run: fine" in (tmp_path / "tables.md").read_text()
    assert not (tmp_path / "report.html").exists()


def test_a_stopped_study_says_how_to_go_on_and_a_failed_piece_is_named(tmp_path, capsys, monkeypatch):
    def stopped(*_):
        raise Stopped(2)

    arguments = ["injection", "--out", str(tmp_path), "--parts", "mesh", "--jobs", "3"]
    monkeypatch.setattr(driver, "run_study", stopped)
    assert command.main(arguments) == 130
    assert f"python -m studies injection --out {tmp_path} --parts mesh --jobs 3" in capsys.readouterr().err
    monkeypatch.setattr(driver, "run_study", lambda *_: {"fine": "no such luck"})
    assert command.main(arguments) == 1 and "fine: no such luck" in capsys.readouterr().err
