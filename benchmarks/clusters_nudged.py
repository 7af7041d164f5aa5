"""Closures from coarse runs with parcels that are nudged to the fine runs, see `jaxdem.train.nudged`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import jaxdem
from benchmarks.clusters_closures import Seen, fit_seen, parted
from benchmarks.clusters_runs import RELAXATION, Case, simulated
from benchmarks.clusters_seen import view_of
from jaxdem.closures import WenYu
from jaxdem.closures.nudged import NudgedDrag
from jaxdem.errors import required
from jaxdem.train.dataset_file import Dataset, read_dataset, write_dataset
from jaxdem.train.nudged import NudgedRun, Nudging, Reference, reference_of

NUDGINGS = {
    "nudged": Nudging(stiffness=3.0, relaxation=RELAXATION / 4.0),
    "nudgedbox": Nudging(stiffness=0.0, relaxation=math.inf, control=RELAXATION / 4.0),
}
"""Closures, and how the runs that they are fitted to are nudged: to the fine run in every cell, or to the slip of the
whole box alone. A cell is crossed in a quarter of a relaxation time."""
CELL, PARCEL, STEP = 24.0, 4, 5e-4
"""Cells in diameters, l of the parcels and fluid step of the nudged runs [s]."""
SEEDS = {0.01: (0, 1)}
"""Of the places of the parcels at the start, by solid fraction; 0 where none are named: few parcels need more runs."""
INTERVALS = 11
"""Coupling intervals between samples: a quarter of a relaxation time."""


def nudged_datasets(one: Seen, folder: Path) -> dict[str, Dataset]:
    """What parcels see in runs that are nudged to a fine run, by closure; what is there is not done again."""
    files = {name: folder / f"{one.case.folder}.{name}.h5" for name in NUDGINGS}
    if not all(file.exists() for file in files.values()):
        _make(one, folder, files)
    return {name: read_dataset(file) for name, file in files.items()}


def _make(one: Seen, folder: Path, files: dict[str, Path]) -> None:
    run, view = simulated(one.case, folder), view_of(one.case, CELL, 1)
    reference = reference_of(required(run.samples, "samples of the run"), view)
    cases = [
        Case(one.case.solid_fraction, CELL, seed, parcel=PARCEL, step=STEP)
        for seed in SEEDS.get(one.case.solid_fraction, (0,))
    ]
    collected: dict[str, list[dict[str, np.ndarray]]] = {name: [] for name in NUDGINGS}
    for case in cases:
        nudged, start = _run_of(case, reference)
        for name, nudging in NUDGINGS.items():
            outputs = math.floor(float(reference.times[-1]) / (INTERVALS * STEP))
            rows, series = nudged.samples(nudging, *start, outputs, INTERVALS)
            late = rows["time"] > one.dropped * RELAXATION
            collected[name].append({column: values[late] for column, values in rows.items()})
            _report(name, case, series, rows, one.dropped)
    density, viscosity = float(view.properties.density), float(view.properties.viscosity)
    for name, file in files.items():
        attributes = {
            "drag": "wen_yu",
            "fluid_density": density,
            "dynamic_viscosity": density * viscosity,
            "dimension": 2,
            "run": one.case.folder,
            "scene_toml": run.scene_toml,
        }
        write_dataset(file, attributes, {round(CELL / one.case.cell): view.group(collected[name])})


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
        f"{name} {case.solid_fraction:g} seed {case.seed}: slip over fine {quotient:.3f}, factor {factor:.3f}, "
        f"correlation of solids {correlation:.2f}",
        flush=True,
    )


def train_nudged(runs: Sequence[Seen], folder: Path, seed: int = 0) -> None:
    """The closures of `NUDGINGS`, with the features and the fit of `wide`."""
    if all((folder / f"{name}.closure.h5").exists() for name in NUDGINGS):
        return
    datasets = [nudged_datasets(one, folder) for one in runs]
    for name in NUDGINGS:
        own = [of_run[name] for of_run in datasets]
        fit_seen(name, "wide", [*own, parted(own[0])[1]], folder, seed)
