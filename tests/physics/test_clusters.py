"""The scene of clusters in small: its momentum, and what its benchmark measures, of fields whose values are known."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks import clusters, clusters_plan, clusters_tables, harness
from benchmarks import clusters_matched as matched
from benchmarks import clusters_measures as measures
from benchmarks import clusters_nudged as nudged
from benchmarks import clusters_runs as runs
from benchmarks.clusters_closures import parted, scaled
from benchmarks.clusters_seen import OF_GRAINS, thinned
from jaxdem.closures import DragInputs, InvariantClosure, WenYu, load_closure, save_closure
from jaxdem.train.dataset_file import VECTORS, Dataset, Group
from tests.cases.tiers import COMBINATION

CASE = runs.Case(0.05, 12.0, box=(48, 96), times=1)


def test_the_terminal_speed_balances_weight_and_drag():
    speed = runs.terminal_speed(CASE)
    reynolds = speed * CASE.diameter / runs.VISCOSITY
    drag = 3 * math.pi * runs.DENSITY * runs.VISCOSITY * CASE.diameter * speed * (1 + 0.15 * reynolds**0.687)
    assert drag == pytest.approx(1498.7 * math.pi / 6 * CASE.diameter**3 * 9.81, rel=1e-6)
    assert speed == pytest.approx(0.22, abs=0.002)


@pytest.mark.parametrize("parcel", [1, 4])
def test_the_gradient_carries_the_weight_and_parcels_keep_the_solid_fraction(parcel):
    case = runs.Case(0.1, 12.0, box=(48, 96), parcel=parcel)
    scene = case.scene()
    volume = math.prod(scene.domain.size) * 75e-6
    grains = case.count * parcel**2 * math.pi / 6 * 75e-6**3
    weight = 9.81 * (grains * 1500 + (volume - grains) * 1.3)
    assert -scene.fluid.pressure_gradient[1] * volume == pytest.approx(weight, rel=1e-6)
    assert case.mean_solid_fraction == pytest.approx(0.1, rel=0.01)


@COMBINATION
def test_momentum_does_not_drift_and_grains_fall_through_the_gas(tmp_path):
    run = runs.simulated(CASE, tmp_path)
    frame, fluid = run.particles(-1), run.fluid(-1)
    mass = 1500 * math.pi / 6 * CASE.diameter**3
    cell = math.prod(run.scene["domain"]["size"]) * CASE.diameter / fluid["void_fraction"].size

    def gas(fields: dict[str, np.ndarray]) -> float:
        return float((1.3 * cell * fields["void_fraction"] * fields["velocity"][..., 1]).sum())

    moved = mass * frame["velocity"][:, 1].sum() + gas(fluid) - gas(run.fluid(0))
    impulse = mass * CASE.count * 9.81 * runs.RELAXATION
    assert abs(moved) < 1e-4 * impulse
    result = measures.measured(CASE, run, dropped=0)
    assert 0.6 < result["slip"]["mean"] < 1.1
    assert (tmp_path / f"{CASE.folder}.time.json").is_file()


class FakeRun(SimpleNamespace):
    """Two frames: grains in every second column of cells of 24 diameters, two in each, all at the same velocity."""

    def __init__(self, fall: float, rise: float, case: runs.Case):
        x, z = np.meshgrid([0.25, 0.25, 0.75, 0.75], (np.arange(4) + 0.5) / 4, indexing="ij")
        size = np.asarray(case.box) * case.diameter
        place = np.stack([x.ravel() / 2, z.ravel()], axis=-1) * size
        self.scene = {"domain": {"size": size.tolist()}}
        self.times = np.array([10.0, 11.0]) * runs.RELAXATION
        time = np.linspace(10.5, 12.0, 12) * runs.RELAXATION
        self.probes = {"box": {"time": time, "fluid_velocity_z": np.full(12, rise), "velocity_z": np.full(12, fall)}}
        force = float(runs.uniform_drag(case, rise - fall)) * case.parcel**2
        count = len(place)
        self._particles = {
            "position": np.pad(place, ((0, 0), (0, 1))) - [0.0, size[1], 0.0],  # a period below the box
            "velocity": np.tile([0.0, fall, 0.0], (count, 1)),
            "drag_force": np.tile([0.0, force / 2.0, 0.0], (count, 1)),
        }
        cells = (4, 8)
        self._fluid = {"void_fraction": np.full(cells, 0.9), "velocity": np.zeros((*cells, 3))}
        self._fluid["velocity"][..., 1] = rise

    def particles(self, index: int) -> dict[str, np.ndarray]:
        return self._particles

    def fluid(self, index: int) -> dict[str, np.ndarray]:
        return self._fluid


def test_measures_of_a_flow_in_columns():
    case = runs.Case(0.05, 24.0, box=(96, 96), parcel=2)
    result = measures.measured(case, FakeRun(-0.1, 0.2, case))
    speed = runs.terminal_speed(case)
    assert result["slip"]["mean"] == pytest.approx(0.3 / speed)
    assert result["slip"]["error"] == pytest.approx(0.0, abs=1e-12)
    assert result["drag"]["mean"] == pytest.approx(0.5)  # half of the uniform state's, as given
    # two of four columns hold 2 each where the mean is 1: the variance over the mean squared is 1
    assert result["solids_24"]["mean"] == pytest.approx(1.0)
    assert result["grains_24"]["mean"] == pytest.approx(0.0, abs=1e-12)
    assert result["gas_24"]["mean"] == pytest.approx(0.0, abs=1e-12)


def test_grains_belong_to_the_cell_of_their_centre_over_the_seam_too():
    size, cells = np.array([2.0, 4.0]), (2, 4)
    place = np.array([[0.5, 0.5], [-1.5, 4.5], [1.5, 3.5], [3.9, -0.1]])
    number, mean = measures.in_cells(place, np.array([1.0, 3.0, 5.0, 7.0]), size, cells)
    assert number[0, 0] == 2 and number[1, 3] == 2 and number.sum() == 4
    assert mean[0, 0] == 2.0 and mean[1, 3] == 6.0 and mean[0, 1] == 0.0


def test_a_field_over_other_cells_keeps_its_mean():
    field = np.arange(24.0).reshape(6, 4)
    coarse = measures.over_cells(field, (2, 2))
    assert coarse[0, 0] == pytest.approx(field[:3, :2].mean())
    assert measures.over_cells(field, (4, 3)).mean() == pytest.approx(field.mean())
    assert measures.over_cells(field, (12, 8))[::2, ::2] == pytest.approx(field)


def test_the_error_of_a_mean_is_that_of_its_blocks():
    series = np.repeat([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 7)
    found = measures.with_error(series)
    assert found["mean"] == pytest.approx(3.5)
    assert found["error"] == pytest.approx(np.std([1, 2, 3, 4, 5, 6], ddof=1) / np.sqrt(6))


def test_runs_of_one_case_are_pooled_by_their_time_and_their_scatter():
    """Equal runs: the error falls with the root of their number. Runs that differ by more than their errors say have
    the error of their scatter: of two equally long ones, half of what they differ by."""

    def row(mean: float, error: float, times: int) -> dict[str, object]:
        return {"slip": {"mean": mean, "error": error}, "times": times + measures.DROPPED}

    assert measures.pooled([row(2.0, 0.1, 30)], "slip") == pytest.approx({"mean": 2.0, "error": 0.1})
    assert measures.pooled([row(2.0, 0.1, 30)] * 4, "slip") == pytest.approx({"mean": 2.0, "error": 0.05})
    apart = measures.pooled([row(1.0, 0.1, 30), row(2.0, 0.1, 30)], "slip")
    assert apart == pytest.approx({"mean": 1.5, "error": 0.5})
    assert measures.pooled([row(1.0, 0.1, 90), row(2.0, 0.5, 30)], "slip")["mean"] == pytest.approx(1.25)


def test_a_scaled_closure_has_the_logarithm_of_its_factor_scaled():
    closure = InvariantClosure.initial(WenYu(), (), features=("solid_fraction",))
    weights = {"Dense_0": {"kernel": jnp.zeros((1, 1)), "bias": jnp.full(1, -0.01)}}
    closure = dataclasses.replace(closure, weights=weights)
    rows = jnp.zeros((1, 2))
    inputs = DragInputs(
        rows, rows + 0.1, jnp.full(1, 0.1), rows, rows, *(jnp.asarray(value) for value in (75e-6, 1e-3, 1.3, 1.8e-5))
    )
    base = float(closure.base(inputs).coefficient[0])
    once, twice = (math.log(float(scaled(closure, k)(inputs).coefficient[0]) / base) for k in (1.0, 2.0))
    assert once < 0 and twice == pytest.approx(2.0 * once, rel=1e-3)


@pytest.mark.parametrize("slope", [-0.5, -1.0, -1.6])
def test_forces_are_scaled_until_the_slip_of_a_coarse_run_is_that_of_the_fine_one(slope):
    """The logarithm of the quotient of the slips falls on a line with that of the scale; a slip that is right stays."""
    tried = [(0.0, 0.21)]
    while abs(tried[-1][1]) >= matched.WITHIN and len(tried) < 5:
        log = matched.stronger(tried)
        tried.append((log, 0.21 + slope * log))
    assert abs(tried[-1][1]) < matched.WITHIN and len(tried) <= 3
    assert matched.stronger(tried) == tried[-1][0]
    assert matched.stronger([(0.0, 2.0)]) == 0.4  # one step is bounded


def test_a_search_scales_every_case_by_itself_and_keeps_the_closure_with_the_least_error(monkeypatch, tmp_path):
    """Slips are 1.3 and 0.8 of the fine ones with forces as they are, and inverse to the forces."""
    cases, off = [runs.Case(s, 24.0, parcel=4) for s in (0.01, 0.3)], {0.01: 1.3, 0.3: 0.8}
    tried: list[dict[float, float]] = []

    def fit(name, scales):
        tried.append({case.solid_fraction: k for case, k in scales.items()})
        save_closure(tmp_path / f"{name}.closure.h5", closure, {"number": len(tried)})
        return closure

    def found(case, run):
        return {"slip": {"mean": 2.0 * off[case.solid_fraction] / tried[-1][case.solid_fraction]}}

    closure = InvariantClosure.initial(WenYu())
    monkeypatch.setattr(matched, "simulated", lambda case, folder, closure: None)
    monkeypatch.setattr(matched, "measured", found)
    path = matched.matched("found", fit, cases, [2.0, 2.0], tmp_path, steps=6)
    metadata = load_closure(path)[1]
    assert tried[0] == {0.01: 1.0, 0.3: 1.0} and len(tried) < 6
    assert metadata["number"] == len(tried)
    for case in cases:
        assert tried[-1][case.solid_fraction] == pytest.approx(off[case.solid_fraction], rel=matched.WITHIN)
        assert len(metadata["tried"][case.folder]) == len(tried)
    assert matched.matched("found", fit, cases, [2.0, 2.0], tmp_path, steps=6) == path and len(tried) < 6  # once


def test_parcels_of_a_thinned_sample_share_out_the_grains():
    """Every grain is a parcel in one of the draws, with l^2 times its force: the mean of all draws has all forces."""
    names = ("position", "particle_velocity", *OF_GRAINS)
    generator = np.random.default_rng(0)
    sample = {name: generator.normal(size=(64, 2)) for name in names} | {"solid_fraction": np.arange(64.0)}
    draws = thinned(sample | {"pressure": np.ones(3)}, 4, 16, seed=1)
    assert len(draws) == 16 and all(len(draw["position"]) == 4 for draw in draws)
    rows = np.concatenate([draw["solid_fraction"] for draw in draws]).astype(int)
    assert sorted(rows) == list(range(64)) and (rows != np.arange(64)).any()
    for name in OF_GRAINS:
        total = np.sum([draw[name].sum(axis=0) for draw in draws], axis=0) / 16
        np.testing.assert_allclose(total, sample[name].sum(axis=0))
    np.testing.assert_array_equal(np.concatenate([draw["position"] for draw in draws]), sample["position"][rows])
    assert all((draw["pressure"] == 1.0).all() for draw in draws)  # the gas stays as it is


def test_the_plan_has_a_fine_run_for_every_coarse_one_and_no_folder_twice():
    cases = [case for group in clusters_plan.plan().values() for case in group]
    folders = [case.folder for case in set(cases)]
    assert len(folders) == len(set(folders))
    fine = {(case.solid_fraction, case.box) for case in cases if case.cell == 3.0 and not case.closure}
    assert {(case.solid_fraction, case.box) for case in cases} == fine
    assert Path(runs.SCENE).is_file()


@pytest.mark.parametrize(
    ("fitted", "runs_on"),
    [
        (nudged.FITTED, clusters_plan.SEEN_ON),
        (nudged.LONGER_FITTED, clusters_plan.LONGER_ON),
        (nudged.MIXED_FITTED, clusters_plan.CALIBRATED_ON),
    ],
)
def test_every_closure_is_fitted_to_a_way_of_nudging_in_a_run_that_there_is(monkeypatch, tmp_path, fitted, runs_on):
    """Each closure gets the samples of its own ways, one dataset a run."""
    made: list[tuple[float, tuple[str, ...]]] = []
    fits: dict[str, list[str]] = {}

    def datasets(one, folder, names):
        made.append((one.case.solid_fraction, tuple(names)))
        assert set(names) <= set(nudged.NUDGINGS)
        return {name: f"{one.case.solid_fraction:g} {name}" for name in names}

    monkeypatch.setattr(nudged, "nudged_datasets", datasets)
    monkeypatch.setattr(nudged, "parted", lambda dataset: ("", f"end of {dataset}"))
    monkeypatch.setattr(nudged, "fit_seen", lambda name, fit, sets, folder, seed: fits.update({name: sets}))
    nudged.train_nudged(runs_on, tmp_path, fitted)
    assert sorted(s for s, _ in made) == sorted(one.case.solid_fraction for one in runs_on)
    for name, ways in fitted.items():
        assert sorted(fits[name][:-1]) == sorted(f"{s:g} {way}" for s, way in ways.items())
        assert fits[name][-1] == f"end of {fits[name][0]}"


def test_the_closure_that_comes_with_the_scene_lowers_the_drag_in_dense_suspensions_alone():
    """Factors in even suspensions: about one where it is thin, about half at 0.1 to 0.15, never more than one."""
    closure, metadata = load_closure(runs.SCENE.with_name("clusters.closure.h5"))
    solids = jnp.asarray([0.01, 0.02, 0.05, 0.1, 0.15, 0.2])
    rows = jnp.tile(jnp.asarray([0.0, 0.1]), (len(solids), 1))
    inputs = DragInputs(
        rows, rows, solids, rows, rows, *(jnp.asarray(value) for value in (75e-6, 24 * 75e-6, 1.3, 1.8e-5))
    )._replace(wide_solid_fraction=solids)
    drag = closure(inputs)
    factor = np.asarray(drag.coefficient / closure.base(inputs).coefficient)
    assert isinstance(closure.base, WenYu) and metadata["settings"]["loss"] == "balance"
    assert not np.asarray(drag.out_of_range).any()
    assert factor[0] > 0.95 and (factor <= 1.0).all() and (np.abs(factor[3:5] - 0.55) < 0.05).all()


def test_the_end_of_a_run_is_held_out():
    time = np.linspace(0.0, 1.0, 11)
    arrays = {name: np.zeros((11, 2)) for name in VECTORS} | {"solid_fraction": time, "diameter": time + 1.0}
    group = Group(4, 1e-3, 1e-3, 1.3, 1.8e-5, time=time, **arrays)
    early, late = parted(Dataset("wen_yu", 1.3, 1.8e-5, 2, "run", "", {4: group}))
    assert (early.groups[4].time <= 0.85).all() and (late.groups[4].time > 0.85).all()
    assert len(early.groups[4]) + len(late.groups[4]) == 11 and len(late.groups[4]) == 2
    assert early.run != late.run


def test_rows_of_a_file_stand_beside_new_ones_in_the_table():
    """A box is a list in a file and a tuple in a new row; both are one box."""
    rows = json.loads((harness.RESULTS / "clusters.json").read_text())["rows"]
    new = [row | {"box": tuple(row["box"])} if k % 2 else row for k, row in enumerate(rows)]
    table = clusters.table_of(rows)
    assert clusters.table_of(new) == table
    assert table.count("small box") == sum(row["box"] == [48, 96] for row in rows) > 0
    assert (harness.RESULTS / "clusters.md").read_text().startswith(table)


def test_the_pages_have_the_tables_of_the_rows_and_a_run_of_two_groups_counts_once():
    rows = json.loads((harness.RESULTS / "clusters.json").read_text())["rows"]
    pages = [page.read_text() for page in clusters_tables.PAGES]
    assert sorted(name for page in pages for name in clusters_tables.marked(page)) == sorted(clusters_tables.TABLES)
    twice = [*rows, *({**row, "group": "another"} for row in rows)]
    for page in pages:
        assert clusters_tables.written(page, twice) == page
    fewer = [row for row in rows if row["solid_fraction"] != 0.2]
    assert all(clusters_tables.written(page, fewer) != page for page in pages)
