"""The whole chain on a tiny scene: run, samples, dataset, fit, run with the closure, compare; and going on."""

import dataclasses
import json
import shutil

import numpy as np
import pytest

import jaxdem
from jaxdem.closures import KochHill
from jaxdem.errors import InputError
from jaxdem.study import DEMOS, SCENES, Coarse, Plan, Study, run_study
from jaxdem.train.dataset import make_dataset
from jaxdem.train.dataset_file import read_dataset
from jaxdem.train.fit import FitSettings
from tests.cases.small_scenes import SMALL_INJECTION
from tests.cases.tiers import COMBINATION

SCENE = SMALL_INJECTION | {"time": {"end": 0.2, "output_interval": 0.1}}


class Recorder:
    """Keeps the names of the stages that were done."""

    def __init__(self):
        self.stages = []

    def stage(self, name, total):
        self.stages.append(name)
        return lambda done: None

    def say(self, message):
        pass


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    plan = Plan(
        scene="tiny.toml",
        title="tiny",
        factor=2,
        coarse=(Coarse("coarse_2", "coarse"),),
        samples=0.01,
        seeds=(1,),
        settings=FitSettings.filtered(epochs=3, samples=500, batch=50),
        kernel={},
        notes=(),
    )
    out = tmp_path_factory.mktemp("study")
    result = Study(plan, jaxdem.load_scene(SCENE), out, Recorder())
    return result, result.run()


def test_chain_leaves_every_file(study):
    """Each stage leaves what the next one and the reader need."""
    done, comparison = study
    assert done.listener.stages == [
        "run fine",
        "run fine_seed_1",
        "dataset",
        "train filtered",
        "run coarse_2",
        "run coarse_2_seed_1",
        "run coarse_2_closure",
        "run coarse_2_closure_seed_1",
    ]
    for name in ("report.html", "comparison.csv", "metrics.png", "dataset.h5", "filtered.closure.h5"):
        assert (done.out / name).stat().st_size > 0
    for run in ("fine", "coarse_2", "coarse_2_closure"):
        assert jaxdem.load_run(done.out / run).summary["valid"] is True
    assert jaxdem.load_run(done.out / "coarse_2").cells == (5, 3)
    closure = jaxdem.load_run(done.out / "coarse_2_closure").summary["closure"]
    assert closure["file"].endswith("filtered.closure.h5")
    assert [len(row.trials) for row in comparison.rows] == [1, 2, 2] and len(comparison.noise_rows) == 1
    learned = comparison.rows[2]
    assert learned.mean_error == pytest.approx(np.mean(learned.pack_errors))
    assert comparison.error_noise >= comparison.noise_mean > 0.0
    words = " ".join(comparison.sentences)
    assert "over 2 packs" in words and ("the closure" in words or "the learned closure" in words)


def test_a_stage_done_is_not_done_again(study, monkeypatch):
    """A second run of the same study only compares, the same runs; the pictures, which take long, are left out."""
    done, comparison = study
    again, asked = dataclasses.replace(done, listener=Recorder()), []
    monkeypatch.setattr("jaxdem.study.compare", lambda *given, **more: asked.append((given, more)))
    again.run()
    assert again.listener.stages == []
    (((reference, candidates, out), more),) = asked
    assert out == done.out and more["noise"] and more["page"]
    assert [one.run.path for one in (reference, *candidates)] == [row.run.path for row in comparison.rows]


def test_dataset_of_the_own_mesh_is_what_the_law_saw(study):
    """Coarsening by 1 gives the samples back: remapping, deposit and interpolation are the solver's own."""
    done, _ = study
    samples = jaxdem.load_run(done.out / "fine").samples
    group = read_dataset(done.out / "dataset.h5").groups[1]
    count = samples.frame(0)["position"].shape[0]
    for number in (1, len(samples.times) - 1):
        rows = slice(number * count, (number + 1) * count)
        sample = samples.frame(number)
        for name in ("fluid_velocity", "solid_fraction", "void_fraction_gradient", "pressure_gradient"):
            size = np.abs(sample[name]).max()
            # float32 round-off of one more division by the void fraction.
            np.testing.assert_allclose(getattr(group, name)[rows], sample[name], atol=1e-5 * size)
        size = np.abs(sample["drag_force"]).max()
        # The sample's viscous force is the mean over the interval, the dataset's that of the moment.
        lag = np.abs(sample["viscous_force"]).max()
        np.testing.assert_allclose(group.target_force[rows], sample["drag_force"], atol=1e-4 * size + lag)
        law = KochHill()(group.select(np.arange(rows.start, rows.stop)).drag_inputs())
        force = np.asarray(law.coefficient)[:, None] * sample["slip_velocity"]
        np.testing.assert_allclose(force, sample["drag_force"], atol=1e-4 * size)


def test_a_dataset_sees_through_the_coarse_runs_own_kernel(study, tmp_path):
    """By centres, the solid fraction at a grain is the volume of the grains in its coarse cell, over the cell's."""
    done, _ = study
    fine, out = jaxdem.load_run(done.out / "fine"), tmp_path / "d.h5"
    make_dataset(done.out / "fine", out, (1, 2), overrides={"coupling.void_fraction": "centre"})
    groups, sample = read_dataset(out).groups, fine.samples.frame(0)
    group, own = groups[2], groups[1].solid_fraction[: len(sample["position"])]
    np.testing.assert_allclose(own, sample["solid_fraction"], rtol=1e-5)  # the fine mesh as its run saw it
    cell = tuple(np.floor(sample["position"] / np.array([0.08, 0.2 / 3])).astype(int).T)
    number = np.zeros((5, 3))
    np.add.at(number, cell, 1.0)
    solids = number[cell] * (4.0 / 3.0 * np.pi * 0.01**3) / (0.08 * 0.2 / 3 * 0.04)
    np.testing.assert_allclose(group.solid_fraction[: len(solids)], solids, rtol=1e-5)
    with pytest.raises(InputError, match=r"fluid\.advection.*coupling\.kernel_width"):
        make_dataset(done.out / "fine", out, (2,), overrides={"fluid.advection": "upwind"})


@COMBINATION
def test_a_dataset_of_model_b_is_of_model_a(tmp_path):
    """All of its fluid force is drag f_A / g: the law's part is f_A again, the target all force less what model A
    applies."""
    tables = SCENE | {"fluid": SCENE["fluid"] | {"model": "B"}, "output": {"samples": 0.01}}
    run = jaxdem.simulate(jaxdem.load_scene(tables, {"time.end": 0.02, "time.output_interval": 0.02}), tmp_path / "b")
    make_dataset(run.path, tmp_path / "b.h5", (1,))
    group, sample = read_dataset(tmp_path / "b.h5").groups[1], run.samples.frame(1)
    assert not np.any(sample["pressure_gradient_force"]) and not np.any(sample["viscous_force"])
    rows = slice(12, 24)
    law = KochHill()(group.select(np.arange(24)[rows]).drag_inputs())
    force = np.asarray(law.coefficient)[:, None] * sample["slip_velocity"]
    size = np.abs(force).max()
    np.testing.assert_allclose(group.drag_force[rows], force, atol=1e-4 * size)
    pressure = -4.0 / 3.0 * np.pi * 0.01**3 * group.pressure_gradient[rows]
    assert np.abs(pressure).max() > 0.1 * size
    # Viscosity 1e-6: its stress is nothing beside these.
    np.testing.assert_allclose(group.target_force[rows], sample["drag_force"] - pressure, atol=1e-3 * size)


def test_a_dataset_of_a_run_in_double_precision_is_single(study, tmp_path):
    """Closures are trained in that; the command line need not know what the run had."""
    done, _ = study
    copied = shutil.copytree(done.out / "fine", tmp_path / "double")
    text = (copied / "scene.toml").read_text()
    (copied / "scene.toml").write_text(text.replace('precision = "float32"', 'precision = "float64"'))
    assert jaxdem.load_run(copied).scene["precision"] == "float64"
    for run, name in ((done.out / "fine", "one.h5"), (copied, "two.h5")):
        make_dataset(run, tmp_path / name, (2,))
    one, two = (read_dataset(tmp_path / name).groups[2] for name in ("one.h5", "two.h5"))
    for name in ("fluid_velocity", "solid_fraction", "target_force"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))


def test_a_run_that_broke_off_teaches_nothing(study, tmp_path):
    """It is refused with its reason."""
    done, _ = study
    broken = shutil.copytree(done.out / "fine", tmp_path / "broken")
    summary = json.loads((broken / "summary.json").read_text()) | {"valid": False, "reason": "too fast"}
    (broken / "summary.json").write_text(json.dumps(summary))
    with pytest.raises(InputError, match=r"not a valid run \(too fast\)"):
        make_dataset(broken, tmp_path / "d.h5", (2,))


def test_a_run_whose_law_had_another_slip_teaches_nothing(study, tmp_path, monkeypatch):
    """With the self-disturbance correction (3-D; here the scene only says so) the force is of a slip that no sample
    holds."""
    done, _ = study

    def corrected(*arguments):
        scene = jaxdem.load_scene(*arguments)
        return scene.model_copy(update={"coupling": scene.coupling.model_copy(update={"self_disturbance": True})})

    monkeypatch.setattr("jaxdem.train.dataset.load_scene", corrected)
    with pytest.raises(InputError, match=r"coupling\.self_disturbance.*without it"):
        make_dataset(done.out / "fine", tmp_path / "d.h5", (2,))


def test_dataset_needs_samples(study, tmp_path):
    """A run without samples is refused with the key that asks for them."""
    done, _ = study
    with pytest.raises(InputError, match=r"output\.samples"):
        make_dataset(done.out / "coarse_2", tmp_path / "d.h5")


def test_an_unknown_study_is_refused(tmp_path):
    """With the known names."""
    with pytest.raises(InputError, match="injction.*Known: clusters, injection"):
        run_study("injction", tmp_path, Recorder())


def test_a_folder_of_something_else_is_refused(tmp_path):
    """Nothing of the user's is touched."""
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(InputError, match="not empty"):
        run_study("injection", tmp_path, Recorder())
    assert (tmp_path / "thesis.tex").read_text() == "precious"


def test_plans_name_scenes_that_build():
    for plan in DEMOS.values():
        jaxdem.build(jaxdem.load_scene(SCENES / plan.scene))
