"""The whole chain on a tiny scene: run, samples, dataset, fit, run with the closure, compare; and going on."""

import dataclasses
import json
import shutil
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.closures import KochHill, load_closure, load_subgrid
from jaxdem.errors import InputError
from jaxdem.studies import measure
from jaxdem.studies.driver import PARTS, FullStudy
from jaxdem.studies.evidence import Evidence
from jaxdem.studies.injection import injection_plan
from jaxdem.studies.oracle import FLUID_METRICS, read_replay, replay_to_file
from jaxdem.studies.work import WORK
from jaxdem.study import DEMOS, FULL, SCENES, Plan, Study, run_study
from jaxdem.train.dataset import make_dataset
from jaxdem.train.dataset_file import read_dataset
from jaxdem.train.finetune import FinetuneResult
from jaxdem.train.fit import FitSettings
from tests.cases.small_scenes import SMALL_INJECTION

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
        factors=(2,),
        samples=0.01,
        seeds=(1,),
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
        "run fine_seed_1",
        "dataset",
        "train filtered",
        "run coarse_2",
        "run coarse_2_seed_1",
        "run coarse_2_filtered",
        "run coarse_2_filtered_seed_1",
    ]
    for name in ("report.html", "comparison.csv", "metrics.png", "dataset.h5", "filtered.closure.h5"):
        assert (done.out / name).stat().st_size > 0
    for run in ("fine", "coarse_2", "coarse_2_filtered"):
        assert jaxdem.load_run(done.out / run).summary["valid"] is True
    assert jaxdem.load_run(done.out / "coarse_2").cells == (5, 3)
    closure = jaxdem.load_run(done.out / "coarse_2_filtered").summary["closure"]
    assert closure["file"].endswith("filtered.closure.h5")
    assert [len(row.packs) for row in comparison.rows] == [1, 2, 2] and len(comparison.noise_rows) == 1
    learned = comparison.rows[2]
    assert learned.mean_error == pytest.approx(np.mean(learned.pack_errors))
    assert comparison.error_noise >= comparison.noise_mean > 0.0
    words = " ".join(comparison.sentences)
    assert "over 2 packs" in words and ("the closure" in words or "the learned closure" in words)


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


def test_a_dataset_of_model_b_is_of_model_a(tmp_path):
    """All of its fluid force is drag f_A / g: the law's part is f_A again, the target all force less what model A applies."""
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
    """With the self-disturbance correction (3-D; here the scene only says so) the force is of a slip that no sample holds."""
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


@pytest.fixture(scope="module")
def evidence(study, tmp_path_factory):
    """The full size's folder: one run under the names of many, each with a history that is off by another factor."""
    fine, out, plan = study[0].out / "fine", tmp_path_factory.mktemp("full"), injection_plan()
    for number, name in enumerate(plan.runs):
        if plan.runs[name].closure is None and not name.startswith("slab"):
            off = 0.0 if name == "fine" else 1e-3 if "_seed_" in name else 0.01 * (1 + number)
            (out / name).mkdir()
            for file in fine.iterdir():
                if file.name != "history.csv":
                    (out / name / file.name).symlink_to(file)
            write_history(fine / "history.csv", out / name / "history.csv", 1.0 + off)
    for name in ("filtered.closure.h5", "filtered.parity.npz"):
        (out / name).symlink_to(fine.parent / name)
    for name in plan.closures["filtered"].datasets:
        (out / f"{name}.h5").symlink_to(fine.parent / "dataset.h5")
    return Evidence(plan, out, {"coarse_2_filtered": "diverged"}, 2)


def write_history(source, path, factor):
    head, *lines = source.read_text().splitlines()
    rows = [[float(x) for x in line.split(",")] for line in lines]
    rows = [[row[0], *(x * factor for x in row[1:])] for row in rows]
    path.write_text("\n".join([head, *(",".join(repr(x) for x in row) for row in rows)]) + "\n")


def test_errors_over_noise_are_ratios_of_time_integrals(evidence):
    """A history 1e-3 off is the noise, one x off has an error of x, x / 1e-3 over noise, the mean where there are several
    packs, whatever seeds a closure has; and a missing run says why."""
    np.testing.assert_allclose(list(evidence.floor.values()), 1e-3, rtol=1e-6)
    first = 0.01 * (1 + list(evidence.plan.runs).index("coarse_4"))
    assert evidence.packs("coarse_4") == 3 and evidence.packs("coarse_2_paper_seed_1") == 0
    relative = (first + 2e-3) / 3  # the other packs are 1e-3 off, as all are
    error = evidence.errors("coarse_4")
    np.testing.assert_allclose(list(error.values()), relative, rtol=1e-6)
    assert measure.mean_over(error, evidence.floor) == pytest.approx(relative / 1e-3, rel=1e-6)
    assert evidence.errors("coarse_2_filtered") is None and evidence.missing["coarse_2_filtered"] == "diverged"


def test_times_are_for_one_machine(evidence):
    """A run of another device has no run time, and is not drawn over it; its errors count."""
    run = evidence.run("coarse_4_superbee")
    assert evidence.run_time(run) == run.summary["wall_time_s"] - run.summary["stages_s"]["compile"]
    elsewhere = dataclasses.replace(evidence, missing={}, _runs=dict(evidence._runs))
    elsewhere._runs["coarse_4"] = Elsewhere(run)
    assert elsewhere.run_time(elsewhere.run("coarse_4")) is None
    (table, *_) = PARTS["pareto"](elsewhere).tables
    assert "coarse_4" not in [row[0] for row in table.rows]
    assert elsewhere.missing["coarse_4"] == "was run on another device than its fine run, or with another JAX"
    assert "coarse_8" in [row[0] for row in table.rows]


class Elsewhere:
    """A run of another device."""

    def __init__(self, run):
        self.run, self.summary = run, {**run.summary, "device": "another"}

    def __getattr__(self, name):
        return getattr(self.run, name)


@pytest.mark.parametrize("name", PARTS)
def test_every_part_has_tables_and_names_what_is_missing(evidence, name):
    """With runs missing (the slab, all with closures) a part still gives what there is."""
    section = PARTS[name](dataclasses.replace(evidence, missing={}))
    assert section.tables and section.markdown().startswith("## ")
    assert section.missing
    widths = [(len(table.headings), {len(row) for row in table.rows}) for table in section.tables]
    assert all(rows <= {width} for width, rows in widths)
    assert any(table.rows for table in section.tables)


def test_forces_of_laws_and_closures_stand_beside_those_of_the_fit(evidence, study):
    """R2 of Koch-Hill, regression and closure on a dataset are the fit's own, whose held-out rows are among these."""
    table = PARTS["generalisation"](evidence).tables[0]
    columns = [heading for heading in table.headings if heading.startswith("R2")]
    assert columns == ["R2, Koch-Hill", "R2, filtered", "R2, regression"]
    row = next(row for row in table.rows if row[:2] == ["fine", "2x"])
    law, closure, regression = (row[table.headings.index(name)] for name in columns)
    assert 0.5 < law <= 1.0 and 0.5 < closure <= 1.0 and regression > law
    errors = [row[table.headings.index(f"RMSE/RMS, {kind}")] for kind in ("Koch-Hill", "regression")]
    assert errors[1] < errors[0] < 1.0


def test_nothing_is_compared_after_the_front_has_reached_the_screen():
    """Up to the last output before the run-off is within half a metre of the outlet."""
    run = Front({"domain": {"size": [20.0, 2.0]}, "boundary": {"right": {"kind": "outlet"}}})
    assert measure.screen_time(run) is None
    run.scene["domain"]["size"][0] = 12.0
    assert measure.screen_time(run) == 2.0


@dataclasses.dataclass
class Front:
    """As much of a run as has a front, which passes 11.5 m after 2 s."""

    scene: dict
    history: dict = dataclasses.field(
        default_factory=lambda: {"time": np.arange(5.0), "runoff": np.array([8.0, 10.0, 11.4, 11.6, 11.3])}
    )


def test_replay_on_the_run_s_own_mesh_gives_the_run_s_fluid(study, tmp_path):
    """What sampling and interpolation in time lose is small, momentum is conserved, and the metrics are the run's."""
    run = jaxdem.load_run(study[0].out / "fine")
    replay_to_file(run, 1, tmp_path / "oracle_1.npz", lambda time: None)
    result = read_replay(tmp_path / "oracle_1.npz")
    np.testing.assert_allclose(result.time, run.times[1:], atol=1e-9)
    assert result.momentum < 1e-5  # float32
    # 0.6 % in the demonstration's scene; here the inlet's ramp lies between two samples.
    assert measure.flux_error(result.time, result.velocity, result.void_fraction, run) < 0.02
    for name in FLUID_METRICS[1:]:
        np.testing.assert_allclose(result.history()[name], run.history[name][1:], rtol=0.02)


def test_closures_made_of_closures(study, tmp_path):
    """A student, a pruned network, an ensemble and a tuned closure are made as the plan asks, with the time it took."""
    fine = study[0].out
    made = {"teacher": str(fine / "filtered.closure.h5"), "datasets": [str(fine / "dataset.h5")], "epochs": 2}
    settings = dataclasses.asdict(FitSettings.filtered())
    given = {
        "distill": {**made, "hidden": [4]},
        "prune": {**made, "neurons": 0.5},
        "ensemble": {**made, "members": [made["teacher"]] * 2, "recipe": "filtered", "settings": settings},
    }
    widths = {}
    for kind, work in given.items():
        out = tmp_path / f"{kind}.closure.h5"
        WORK[kind](work | {"out": str(out)}, lambda done: None)
        closure, metadata = load_closure(out)
        assert metadata["study_seconds"] > 0.0 and all("closure" in r2 for r2 in metadata["r2"].values())
        widths[kind] = getattr(closure, "members", closure).hidden
    whole = load_closure(made["teacher"])[0].hidden
    assert widths == {"distill": (4,), "prune": tuple(-(-n // 2) for n in whole), "ensemble": whole}
    stress = tmp_path / "stress.subgrid.h5"
    WORK["stress"]({"viscosity": 0.02, "gradient": 0.1, "out": str(stress)}, lambda done: None)
    rate = jnp.array([1.0, 30.0])
    coefficients = load_subgrid(stress)[0](rate, rate, jnp.array(0.1), jnp.array(1e-6), 0.5 * rate, rate)
    np.testing.assert_allclose(coefficients, [[0.02, 0.02], [0.1, 0.1]], rtol=1e-6)


def test_a_tuning_gets_the_plan_s_settings_and_scene(study, tmp_path, monkeypatch):
    """Settings pass through JSON unchanged, and what the training gives is saved."""
    plan = injection_plan()
    pieces = {piece.name: piece for piece in FullStudy(plan, SCENES, tmp_path, Recorder(), 1).pieces()}
    piece = pieces["train searched_both"]
    assert {"train filtered_narrow", "training_injection"} <= set(piece.needs)
    seen = []

    def stand_in(scene, reference, closures, metadata, settings, progress):
        seen.append((scene.fluid.cells, Path(reference).name, closures.trained, settings))
        return FinetuneResult(closures, {name: {"finetune": {}} for name in closures.trained}, "")

    monkeypatch.setattr("jaxdem.train.finetune.finetune", stand_in)
    work = json.loads(json.dumps(dict(piece.work)))
    WORK["tune"](work | {"start": str(study[0].out / "filtered.closure.h5")}, lambda done: None)
    trained = plan.closures["searched_both"]
    assert seen == [((75, 12), "training_injection", ("drag", "subgrid"), trained.settings)]
    for load, ending in ((load_closure, "closure"), (load_subgrid, "subgrid")):
        assert load(tmp_path / f"searched_both.{ending}.h5")[1]["study_seconds"] > 0.0
    evidence = Evidence(plan, tmp_path, {})
    assert evidence.training_of("coarse_4_sharp_searched_both") > 0.0
    assert list(evidence.missing) == ["filtered_narrow"]
