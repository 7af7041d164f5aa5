"""Closures from coarse runs with parcels that are nudged to the fine runs, see `jaxdem.train.nudged`."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

import jaxdem
from benchmarks.clusters_closures import Seen, fit_seen, parted
from benchmarks.clusters_runs import RELAXATION, Case, simulated
from benchmarks.clusters_seen import view_of
from jaxdem.closures import WenYu
from jaxdem.closures.nudged import NudgedDrag
from jaxdem.errors import required
from jaxdem.train.dataset import described
from jaxdem.train.dataset_file import Dataset, read_dataset, write_dataset
from jaxdem.train.nudged import NudgedRun, Nudging, Reference, reference_of

NUDGINGS = {
    "nudged": Nudging(stiffness=3.0, relaxation=RELAXATION / 4.0),
    "nudgedbox": Nudging(stiffness=0.0, relaxation=math.inf, control=RELAXATION / 4.0),
    "nudgedboth": Nudging(stiffness=1.0, relaxation=RELAXATION / 4.0, control=RELAXATION / 4.0),
}
"""How runs are nudged: to the fine run in every cell, to the slip of the whole box alone, or in both ways. A cell is
crossed in a quarter of a relaxation time."""
TRAINED_AT = (0.01, 0.05, 0.15, 0.3)
"""Solid fractions of the runs."""
FITTED = {name: dict.fromkeys(TRAINED_AT, name) for name in ("nudged", "nudgedbox")}
"""Closures, and how the runs that they are fitted to are nudged, by solid fraction."""
LONGER_FITTED = {
    "longmixed": {0.01: "nudgedbox", 0.05: "nudgedbox", 0.15: "nudged", 0.3: "nudged"},
    "longboth": dict.fromkeys(TRAINED_AT, "nudgedboth"),
    "longbox": dict.fromkeys(TRAINED_AT, "nudgedbox"),
}
"""The same for longer fine runs. The first is held to the slip of the box in thin suspensions, where the gas that a
parcel drags along is much of what it sees, and drawn to the cells in dense ones, where the uneven places count."""
MIXED_FITTED = {"mixed": LONGER_FITTED["longmixed"] | {0.1: "nudgedbox"}}
"""The same for fine runs at five solid fractions."""
MIXED_AGAIN = {"mixed_s1": 1, "mixed_s2": 2}
"""Closures of the same samples, and the seeds of the training."""
CALIBRATED_WAYS = dict.fromkeys((0.01, 0.05, 0.1, 0.15, 0.3), "nudgedbox")
"""How the runs are nudged that the closure `CALIBRATED` of `clusters_matched` is fitted to."""
CELL, PARCEL, STEP = 24.0, 4, 5e-4
"""Cells in diameters where no others are named, l of the parcels and fluid step of the nudged runs [s]."""
SEEDS = {0.01: (0, 1)}
"""Of the places of the parcels at the start, by solid fraction; 0 where none are named: few parcels need more runs."""
INTERVALS = 11
"""Coupling intervals between samples: a quarter of a relaxation time."""


def nudged_datasets(one: Seen, folder: Path, names: Sequence[str], cell: float = CELL) -> dict[str, Dataset]:
    """What parcels see in runs that are nudged to a fine run in these ways; what is there is not done again."""
    files = {name: folder / f"{one.case.folder}.{name}.c{cell:g}.h5" for name in names}
    if not all(file.exists() for file in files.values()):
        _make(one, folder, files, cell)
    return {name: read_dataset(file) for name, file in files.items()}


def on_meshes(one: Seen, folder: Path, way: str, cells: Sequence[float]) -> Dataset:
    """What parcels see in runs on cells of several sizes that are nudged to a fine run in one way."""
    found = [nudged_datasets(one, folder, [way], cell)[way] for cell in cells]
    groups = {n: group for dataset in found for n, group in dataset.groups.items()}
    return dataclasses.replace(found[0], groups=groups)


def _make(one: Seen, folder: Path, files: dict[str, Path], cell: float) -> None:
    run, view = simulated(one.case, folder), view_of(one.case, cell, 1)
    reference = reference_of(required(run.samples, "samples of the run"), view)
    cases = [
        Case(one.case.solid_fraction, cell, seed, parcel=PARCEL, step=STEP)
        for seed in SEEDS.get(one.case.solid_fraction, (0,))
    ]
    collected: dict[str, list[dict[str, np.ndarray]]] = {name: [] for name in files}
    for case in cases:
        nudged, start = _run_of(case, reference)
        for name in files:
            outputs = math.floor(float(reference.times[-1]) / (INTERVALS * STEP))
            rows, series = nudged.samples(NUDGINGS[name], *start, outputs, INTERVALS)
            late = rows["time"] > one.dropped * RELAXATION
            collected[name].append({column: values[late] for column, values in rows.items()})
            _report(name, case, series, rows, one.dropped)
    for name, file in files.items():
        write_dataset(file, described(run), {round(cell / one.case.cell): view.group(collected[name])})


def _run_of(case: Case, reference: Reference) -> tuple[NudgedRun, tuple[object, object]]:
    scene = case.scene()
    simulation, parameters = jaxdem.build(scene, closure=NudgedDrag.of(WenYu(), case.count, 2))
    return NudgedRun(simulation, parameters, reference), jaxdem.initial_state(scene, simulation, parameters)


def _report(name: str, case: Case, series: dict[str, np.ndarray], rows: dict[str, np.ndarray], dropped: float) -> None:
    """A line of what the nudged run did: slips over that of the fine run, and the factor that its forces need."""
    late, own = (s["time"] > dropped * RELAXATION for s in (series, rows))
    quotient = series["slip"][late, 1].mean() / series["fine_slip"][late, 1].mean()
    factor = rows["target_force"][own, 1].mean() / rows["drag_force"][own, 1].mean()
    correlation = series["correlation"][late].mean()
    print(
        f"{name} {case.solid_fraction:g} cells of {case.cell:g}, seed {case.seed}: "
        f"slip over fine {quotient:.3f}, factor {factor:.3f}, "
        f"correlation of solids {correlation:.2f}",
        flush=True,
    )


def train_nudged(runs: Sequence[Seen], folder: Path, fitted: Mapping[str, Mapping[float, str]], seed: int = 0) -> None:
    """The closures of `FITTED` or `LONGER_FITTED`, with the features and the fit of `wide`.

    Args:
        runs: fine runs.
        folder: of all runs.
        fitted: by closure and solid fraction, how runs are nudged.
        seed: of the training.
    """
    if all((folder / f"{name}.closure.h5").exists() for name in fitted):
        return
    datasets = {}
    for one in runs:
        s = one.case.solid_fraction
        datasets[s] = nudged_datasets(one, folder, sorted({ways[s] for ways in fitted.values() if s in ways}))
    for name, ways in fitted.items():
        own = [of_run[ways[s]] for s, of_run in datasets.items() if s in ways]
        fit_seen(name, "wide", [*own, parted(own[0])[1]], folder, seed)
