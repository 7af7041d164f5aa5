"""The whole chain on a tiny scene: run, samples, dataset, fit, run with the closure, compare; and going on."""

import dataclasses

import numpy as np
import pytest

import jaxdem
from jaxdem.closures import KochHill
from jaxdem.errors import InputError
from jaxdem.study import DEMOS, FULL, Plan, Study, run_study
from jaxdem.train.dataset import make_dataset
from jaxdem.train.dataset_file import read_dataset
from jaxdem.train.fit import FitSettings

SCENE = {
    "domain": {"size": [0.4, 0.2], "depth": 0.04},
    "particles": {
        "count": 12,
        "radius": 0.01,
        "density": 2650.0,
        "pack": {"kind": "polygon", "vertices": [[0.05, 0.0], [0.15, 0.0], [0.15, 0.1], [0.05, 0.1]]},
    },
    "contact": {"young_modulus": 5e6, "friction": 0.3},
    "fluid": {"cells": [10, 6], "viscosity": 1e-6, "time_step": 0.01},
    "boundary": {
        "left": {"kind": "inlet", "velocity": 0.5, "from": 0.0, "to": 0.1},
        "right": {"kind": "outlet"},
    },
    "time": {"end": 0.2, "output_interval": 0.1},
}


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
        factors=(2,),
        samples=0.01,
        noise_seeds=(),
        filtered=FitSettings.filtered(epochs=3, samples=500, batch=50),
        paper=None,
    )
    out = tmp_path_factory.mktemp("study")
    result = Study(plan, jaxdem.load_scene(SCENE), out, Recorder())
    return result, result.run()


def test_chain_leaves_every_file(study):
    """Each stage leaves what the next one and the reader need."""
    done, comparison = study
    assert done.listener.stages == [
        "run fine",
        "run coarse_2",
        "dataset",
        "train filtered",
        "run coarse_2_filtered",
    ]
    for name in ("report.html", "comparison.csv", "metrics.png", "dataset.h5", "filtered.closure.h5"):
        assert (done.out / name).stat().st_size > 0
    for run in ("fine", "coarse_2", "coarse_2_filtered"):
        assert jaxdem.load_run(done.out / run).summary["valid"] is True
    assert jaxdem.load_run(done.out / "coarse_2").cells == (5, 3)
    closure = jaxdem.load_run(done.out / "coarse_2_filtered").summary["closure"]
    assert closure["file"].endswith("filtered.closure.h5")
    assert len(comparison.rows) == 3


def test_a_stage_done_is_not_done_again(study):
    """A second run of the same study only compares."""
    done, _ = study
    again = dataclasses.replace(done, listener=Recorder())
    again.run()
    assert again.listener.stages == []


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


def test_dataset_needs_samples(study, tmp_path):
    """A run without samples is refused with the key that asks for them."""
    done, _ = study
    with pytest.raises(InputError, match=r"output\.samples"):
        make_dataset(done.out / "coarse_2", tmp_path / "d.h5")


@pytest.mark.parametrize(("name", "scale"), [("injction", "demo"), ("injection", "huge")])
def test_unknown_studies_are_refused(name, scale, tmp_path):
    """With the known names."""
    with pytest.raises(InputError, match="known"):
        run_study(name, scale, tmp_path, Recorder())


def test_a_folder_of_something_else_is_refused(tmp_path):
    """Nothing of the user's is touched."""
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(InputError, match="not empty"):
        run_study("injection", "demo", tmp_path, Recorder())
    assert (tmp_path / "thesis.tex").read_text() == "precious"


def test_plans_name_scenes_that_load():
    """Every study has a demonstration whose scene builds, and a full size."""
    assert set(DEMOS) == set(FULL)
    for plan in DEMOS.values():
        jaxdem.build(jaxdem.load_scene(jaxdem.study.SCENES / plan.scene))
