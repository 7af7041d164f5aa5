"""What the study finds: errors over noise, every part's tables, the replay, the hidden stress, closures of closures."""

import dataclasses
import json
import types
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.closures import load_closure, load_subgrid
from jaxdem.study import fit_to_files, parity_file
from jaxdem.train.dataset import make_dataset
from jaxdem.train.finetune import FinetuneResult
from jaxdem.train.fit import FitSettings
from studies import measure, paper, part_pareto
from studies.driver import PARTS
from studies.evidence import Evidence
from studies.hidden_stress import hidden_stress
from studies.injection import SWEEPS, injection_plan
from studies.replay import FLUID_METRICS, read_replay, replay_to_file
from studies.specs import EnsembleSpec, FitSpec, Folder, Plan, RunSpec, SmallerSpec, StressSpec
from studies.tables import Section, Table, write_results
from tests.cases.small_scenes import SMALL_INJECTION

SETTINGS = FitSettings.filtered(epochs=3, samples=500, batch=50)
FITTED = FitSpec("filtered", "filtered", SETTINGS, ("dataset",))


def ignore(done):
    pass


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with a fine run, its dataset and a closure that was trained on it."""
    out = tmp_path_factory.mktemp("made")
    times = {"time": {"end": 0.2, "output_interval": 0.1}, "output": {"samples": 0.01}}
    jaxdem.simulate(jaxdem.load_scene(SMALL_INJECTION | times), out / "fine")
    make_dataset(out / "fine", out / "dataset.h5", (1, 2))
    fit_to_files("filtered", [out / "dataset.h5"], SETTINGS, out / "filtered.closure.h5", ignore)
    return out


@pytest.fixture(scope="module")
def evidence(made, tmp_path_factory):
    """The study's folder: one run under the names of many, each with a history that is off by another factor."""
    fine, out, plan = made / "fine", tmp_path_factory.mktemp("full"), injection_plan()
    for name, off in factors(plan).items():
        (out / name).mkdir()
        for file in fine.iterdir():
            if file.name != "history.csv":
                (out / name / file.name).symlink_to(file)
        write_history(fine / "history.csv", out / name / "history.csv", 1.0 + off)
    fitted = made / "filtered.closure.h5"
    for name in ("filtered", "sweep_loss_mae"):
        (out / f"{name}.closure.h5").symlink_to(fitted)
    (out / "filtered.parity.npz").symlink_to(parity_file(fitted))
    for name in plan.specs["filtered"].datasets:
        (out / f"{name}.h5").symlink_to(made / "dataset.h5")
    return Evidence(Folder(plan, out), {"coarse_2_filtered": "diverged"}, 2)


def factors(plan):
    """How far the history of every run without a closure is off, but for the slab's, which are missing."""
    runs = [spec for spec in plan.specs.values() if isinstance(spec, RunSpec)]
    wanted = {run.name: number for number, run in enumerate(runs) if run.closure is None}
    return {
        name: 0.0 if name == "fine" else 1e-3 if "_seed_" in name else 0.01 * (1 + number)
        for name, number in wanted.items()
        if not name.startswith("slab")
    }


def write_history(source, path, factor):
    head, *lines = source.read_text().splitlines()
    rows = [[float(x) for x in line.split(",")] for line in lines]
    rows = [[row[0], *(x * factor for x in row[1:])] for row in rows]
    path.write_text("\n".join([head, *(",".join(repr(x) for x in row) for row in rows)]) + "\n")


def test_errors_over_noise_are_ratios_of_time_integrals(evidence):
    """A history 1e-3 off is the noise, one x off has an error of x, x / 1e-3 over noise, the mean where there are
    several packs, whatever seeds a closure has; and a missing run says why."""
    np.testing.assert_allclose(list(evidence.floor.values()), 1e-3, rtol=1e-6)
    first = factors(evidence.plan)["coarse_4"]
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


def test_the_papers_figure_stands_beside_that_of_the_network_with_its_settings(evidence):
    tables = {table.title: table for table in PARTS["closures"](dataclasses.replace(evidence, missing={})).tables}
    (row,) = tables["R2 by loss, fine inputs, 100 epochs"].rows
    assert row[:2] == ["mae", 0.3809] and np.isfinite(row[2]) and row[3] > 0.0
    assert all(set(paper.R2[what]) <= set(values) for what, values in SWEEPS.items())


def test_forces_of_laws_and_closures_stand_beside_those_of_the_fit(evidence):
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
    """Up to the last output before the run-off, which passes 11.5 m after 2 s, is within half a metre of the outlet."""
    scene = {"domain": {"size": [20.0, 2.0]}, "boundary": {"right": {"kind": "outlet"}}}
    history = {"time": np.arange(5.0), "runoff": np.array([8.0, 10.0, 11.4, 11.6, 11.3])}
    run = types.SimpleNamespace(scene=scene, history=history)
    assert measure.screen_time(run) is None
    run.scene["domain"]["size"][0] = 12.0
    assert measure.screen_time(run) == 2.0


def test_replay_on_the_run_s_own_mesh_gives_the_run_s_fluid(made, tmp_path):
    """What sampling and interpolation in time lose is small, momentum is conserved, and the metrics are the run's."""
    run = jaxdem.load_run(made / "fine")
    replay_to_file(run, 1, tmp_path / "oracle_1.npz", ignore)
    result = read_replay(tmp_path / "oracle_1.npz")
    np.testing.assert_allclose(result.time, run.times[1:], atol=1e-9)
    assert result.momentum < 1e-5  # float32
    # 0.6 % in the demonstration's scene; here the inlet's ramp lies between two samples.
    assert measure.flux_error(result.time, result.velocity, result.void_fraction, run) < 0.02
    for name in FLUID_METRICS[1:]:
        np.testing.assert_allclose(result.history()[name], run.history[name][1:], rtol=0.02)


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


def test_closures_made_of_closures(made, tmp_path):
    """A student, a pruned network, an ensemble and a stress are made as the plan asks, with the time it took."""
    for name in ("filtered.closure.h5", "dataset.h5"):
        (tmp_path / name).symlink_to(made / name)
    specs = (
        SmallerSpec("student", "filtered", ("dataset",), epochs=2, hidden=(4,)),
        SmallerSpec("pruned", "filtered", ("dataset",), epochs=2, neurons=0.5),
        EnsembleSpec("ensemble", ("filtered", "filtered")),
    )
    folder = Folder(Plan({FITTED.name: FITTED}, {}), tmp_path)
    widths = []
    for spec in specs:
        assert not spec.is_done(folder)
        spec.make(folder, ignore)
        assert spec.is_done(folder)
        closure, metadata = load_closure(folder.closure(spec.name))
        assert metadata["study_seconds"] > 0.0 and all("closure" in r2 for r2 in metadata["r2"].values())
        widths.append(getattr(closure, "members", closure).hidden)
    whole = load_closure(folder.closure("filtered"))[0].hidden
    assert widths == [(4,), tuple(-(-n // 2) for n in whole), whole]
    StressSpec("stress", 0.02, 0.1).make(folder, ignore)
    rate = jnp.array([1.0, 30.0])
    stress = load_subgrid(folder.closure("stress", "subgrid"))[0]
    coefficients = stress(rate, rate, jnp.array(0.1), jnp.array(1e-6), 0.5 * rate, rate)
    np.testing.assert_allclose(coefficients, [[0.02, 0.02], [0.1, 0.1]], rtol=1e-6)


def test_a_tuning_gets_the_plan_s_settings_and_scene(made, tmp_path, monkeypatch):
    """And what the training gives is saved; the time of all that a run uses is added up."""
    plan, seen = injection_plan(), []
    folder, spec = Folder(plan, tmp_path), plan.specs["searched_both"]
    (tmp_path / "filtered_narrow.closure.h5").symlink_to(made / "filtered.closure.h5")

    def stand_in(scene, reference, closures, metadata, settings, progress):
        seen.append((scene.fluid.cells, Path(reference).name, closures.trained, settings))
        return FinetuneResult(closures, {name: {"finetune": {}} for name in closures.trained}, "")

    monkeypatch.setattr("studies.specs.finetune", stand_in)
    spec.make(folder, ignore)
    assert seen == [((75, 12), "training_injection", ("drag", "subgrid"), spec.settings)]
    own = [load_closure(folder.closure(spec.name))[1], load_subgrid(folder.closure(spec.name, "subgrid"))[1]]
    assert all(metadata["study_seconds"] > 0.0 for metadata in own)
    evidence = Evidence(folder, {})
    start = load_closure(made / "filtered.closure.h5")[1]["study_seconds"]
    spent = evidence.training_of("coarse_4_sharp_searched_both")
    assert spent == pytest.approx(own[0]["study_seconds"] + start) and not evidence.missing


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


def test_letters_stand_for_runs_in_the_figure(tmp_path):
    """Its texts are read as drawn (tests/conftest.py)."""
    rng = np.random.default_rng(1)
    points = []
    for i in range(20):
        over = dict(zip(measure.NAMES, rng.uniform(0.5, 20.0, 9) / (1 + i), strict=True))
        points.append((f"coarse_{i}_with_a_long_name", 10.0 + i + 0.01 * (i % 3), over, 9.0 * (i % 2)))
    assert part_pareto.draw(points, 20.0, tmp_path / "pareto.png", "the scene").stat().st_size > 0
