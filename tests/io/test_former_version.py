"""Files of the version before: read, or refused with what to do.

`tests/data/former_run` was written on 28 November 2026 by the package of commit e72a816: three grains that fall in
water.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from jaxdem import InputError, load_run, load_scene, simulate
from jaxdem.closures import load_closure
from jaxdem.io import RunDirectory, read_checkpoint, run_folder
from jaxdem.io.checkpoint import write_checkpoint
from jaxdem.run.totals import Totals

ROOT = Path(__file__).parents[2]
FORMER = ROOT / "tests" / "data" / "former_run"


def test_a_run_of_the_version_before_is_read():
    """Lines, frames and samples agree: a mean over particles, a wall that nothing passes, three grains."""
    run = load_run(FORMER)
    assert run.summary["valid"] and run.times.tolist() == [0.0, 0.02, 0.04]
    last, fluid = run.particles(-1), run.fluid(-1)
    speed = np.linalg.norm(last["velocity"], axis=1).mean()
    assert speed == pytest.approx(run.history["particle_velocity_mean"][-1], rel=1e-6)
    assert fluid["velocity"].shape == (4, 4, 3) and run.spacing == (0.05, 0.05)
    assert np.all(last["position"][:, 1] > 0.0) and last["id"].tolist() == [0, 1, 2]
    assert run.samples.times.tolist() == [0.01, 0.03] and run.samples.frame(-1)["slip_velocity"].shape == (3, 2)


def test_its_scene_is_the_same_scene_to_this_version(tmp_path):
    copy = shutil.copytree(FORMER, tmp_path / "run")
    scene = load_scene(copy / "scene.toml")
    # Two keys that the version before had not yet are as if it had their defaults; another value is another scene.
    text = (copy / "scene.toml").read_text()
    older = re.sub(r"(?m)^(virtual_mass|maximum_overlap) = .*\n", "", text)
    assert len(older) < len(text) - 30
    (copy / "scene.toml").write_text(older)
    run_folder.require_usable(copy, scene.to_toml(), True, scene.defaults())
    assert run_folder.is_complete(copy)
    with pytest.raises(InputError, match="virtual_mass"):
        changed = load_scene(FORMER / "scene.toml", {"coupling.virtual_mass": 0.5})
        run_folder.require_usable(copy, changed.to_toml(), True, changed.defaults())
    with RunDirectory.resume(copy, scene.to_toml(), defaults=scene.defaults()) as directory:
        directory.cut_back(2, 1)
    assert load_run(copy).number_of_frames == 2 and len(load_run(copy).samples) == 1


def test_its_checkpoint_is_refused_with_the_version_and_the_remedy():
    """It lacks the radius of the neighbour list, so its format (5) is another one."""
    with pytest.raises(InputError, match=r"has format 5, this version reads [6-9]") as caught:
        read_checkpoint(FORMER / "checkpoint.h5")
    assert "version of jaxdem that wrote it, or start the run anew" in caught.value.remedy


GRAIN = {
    "precision": "float32",
    "domain": {"size": [0.1, 0.1]},
    "particles": {"position": [[0.05, 0.05]], "radius": 0.005, "density": 2500.0},
    "contact": {"young_modulus": 1e6},
    "time": {"end": 0.02, "output_interval": 0.01},
}


@pytest.mark.parametrize(("lost", "needed"), [("surface_force", False), ("courant", True)])
def test_a_run_goes_on_from_a_checkpoint_without_a_sum_of_later_commits(tmp_path, lost, needed):
    """The force on walls in the fluid is a sum that a scene without such walls does not have; others are named."""
    simulate(load_scene(GRAIN), tmp_path)
    arrays, attributes = read_checkpoint(tmp_path / "checkpoint.h5")
    del arrays[f"extra/{lost}"]
    write_checkpoint(tmp_path / "checkpoint.h5", arrays, attributes)
    longer = load_scene(GRAIN, {"time.end": 0.04})
    if needed:
        with pytest.raises(InputError, match=f"{lost}.*is missing"):
            simulate(longer, tmp_path, resume=True)
    else:
        assert simulate(longer, tmp_path, resume=True).times[-1] == pytest.approx(0.04)


def test_a_sum_over_a_run_with_walls_in_the_fluid_is_not_begun_anew():
    values = {name: np.asarray(value) for name, value in Totals().save().items()}
    del values["surface_force"]
    with pytest.raises(InputError, match="surface_force"):
        Totals().load(values, walls_in_fluid=True)


def test_its_closure_is_read():
    """The closure of the scenes has been there since before: seven inputs, eight hidden units."""
    closure, _ = load_closure(ROOT / "scenes" / "filtered.closure.h5")
    assert (len(closure.features), closure.hidden) == (7, (8,)) and np.all(closure.feature_scale > 0.0)


def test_a_run_that_was_begun_without_a_column_goes_on_without_it(tmp_path):
    """Of an outlet it had neither flows nor their sums; it does not tell a part of them for all."""
    tables = GRAIN | {
        "boundary": {"top": {"kind": "outlet"}},
        "fluid": {"cells": [4, 4], "density": 1.0, "viscosity": 1e-3},
    }
    tables = {name: table for name, table in tables.items() if name not in ("particles", "contact")}
    run = simulate(load_scene(tables), tmp_path)
    assert run.summary["fluid_volume"]["missing"] == pytest.approx(0.0, abs=1e-9)
    file = tmp_path / "history.csv"
    file.write_text("".join(",".join(line.split(",")[:-2]) + "\n" for line in file.read_text().splitlines()))
    arrays, attributes = read_checkpoint(tmp_path / "checkpoint.h5")
    kept = {name: value for name, value in arrays.items() if "passed" not in name and "fluid_volume" not in name}
    assert len(kept) == len(arrays) - 4
    write_checkpoint(tmp_path / "checkpoint.h5", kept, attributes)
    longer = simulate(load_scene(tables, {"time.end": 0.04}), tmp_path, resume=True)
    assert len(longer.history["time"]) == 5 and not any("flow" in name for name in longer.history)
    assert "fluid_volume" not in longer.summary
