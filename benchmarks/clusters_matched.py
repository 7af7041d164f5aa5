"""Closures that are trained through the solver by statistics: coarse runs are to have the slips of the fine ones.

The forces of a training run are multiplied by k, from 1 on, and the closure is fitted anew: ln k grows by the logarithm
of the slip of a coarse run with it over that of the fine run, later by the secant rule, until that is within `WITHIN`.
Every training run, and every mesh that it is seen on, has its own k. Nothing is differentiated.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from benchmarks.clusters_closures import Seen, fit_seen, parted, seen_datasets, with_forces
from benchmarks.clusters_measures import measured
from benchmarks.clusters_nudged import CALIBRATED_WAYS, on_meshes
from benchmarks.clusters_runs import Case, simulated
from jaxdem.closures import DragClosure, load_closure, save_closure

MATCHED = "matched"
"""`wide` with the forces of some training runs scaled."""
CALIBRATED = "calibrated"
"""A fit to nudged runs on several meshes with the forces of every run on every mesh scaled."""
WITHIN = 0.02
"""Logarithm of the quotient of two slips below which they are taken for equal: about the noise of a run."""
Fit = Callable[[str, Mapping[Case, float]], DragClosure]
"""The closure of a name that is fitted with the factor of each case."""


def matched(name: str, fit: Fit, cases: Sequence[Case], slips: Sequence[float], folder: Path, steps: int) -> Path:
    """The closure NAME.closure.h5, by the rule of the module; of those that are tried the one with the least error.

    Args:
        name: of the closure.
        fit: see `Fit`.
        cases: coarse runs without closure.
        slips: mean slip of the fine runs beside each case, in terminal speeds.
        folder: of all runs.
        steps: closures that are tried.
    """
    path = folder / f"{name}.closure.h5"
    if path.exists():
        return path
    logs = [0.0] * len(cases)
    tried: list[list[tuple[float, float]]] = [[] for _ in cases]
    best, least = path, math.inf
    for step in range(steps):
        trial = f"{name}_{step}"
        closure = fit(trial, {case: math.exp(own) for case, own in zip(cases, logs, strict=True)})
        for k, (case, slip) in enumerate(zip(cases, slips, strict=True)):
            own = dataclasses.replace(case, closure=trial)
            error = math.log(measured(own, simulated(own, folder, closure))["slip"]["mean"] / slip)
            tried[k].append((logs[k], error))
            print(f"{own.folder}: ln k {logs[k]:.3f}, ln of slip over fine {error:.3f}", flush=True)
        worst = max(abs(errors[-1][1]) for errors in tried)
        if worst < least:
            best, least = folder / f"{trial}.closure.h5", worst
        if worst < WITHIN:
            break
        logs = [stronger(errors) for errors in tried]
    closure, metadata = load_closure(best)
    found = {case.folder: own for case, own in zip(cases, tried, strict=True)}
    save_closure(path, closure, {**metadata, "tried": found})
    return path


def match(runs: Sequence[Seen], cases: Sequence[Case], slips: Sequence[float], folder: Path) -> Path:
    """The closure `MATCHED`.

    A parcel sees the gas that it drags along itself, which a single grain of the fine run does not. So a closure that
    has the right mean force for the slips of the fine run has too little in a coarse run.

    Args:
        runs: training runs.
        cases, slips, folder: see `matched`; the cases are of solid fractions of some of the runs.
    """

    def fit(trial: str, scales: Mapping[Case, float]) -> DragClosure:
        by_fraction = {case.solid_fraction: k for case, k in scales.items()}
        return fit_seen(trial, "wide", seen_datasets(runs, folder, by_fraction), folder)

    return matched(MATCHED, fit, cases, slips, folder, steps=4)


def calibrate(runs: Sequence[Seen], cases: Sequence[Case], slips: Sequence[float], folder: Path) -> Path:
    """The closure `CALIBRATED`, of nudged runs on the meshes of the cases.

    Args:
        runs: fine runs, of the solid fractions of the cases.
        cases, slips, folder: see `matched`.
    """
    cells = sorted({case.cell for case in cases})
    datasets = {one.case: on_meshes(one, folder, CALIBRATED_WAYS[one.case.solid_fraction], cells) for one in runs}

    def fit(trial: str, scales: Mapping[Case, float]) -> DragClosure:
        own = []
        for fine, dataset in datasets.items():
            here = {c: k for c, k in scales.items() if c.solid_fraction == fine.solid_fraction}
            given = {round(c.cell / fine.cell): k for c, k in here.items()}
            own.append(with_forces(dataset, dict.fromkeys(dataset.groups, 1.0) | given))
        return fit_seen(trial, "meshes", [*own, parted(own[0])[1]], folder)

    return matched(CALIBRATED, fit, cases, slips, folder, steps=5)


def stronger(tried: Sequence[tuple[float, float]]) -> float:
    """The next ln k, at most 0.4 from the last one: drag and slip of single grains are inverse to each other."""
    last, error = tried[-1]
    slope = -1.0
    if len(tried) > 1 and abs(last - tried[-2][0]) > 1e-3:
        slope = min(-0.3, (error - tried[-2][1]) / (last - tried[-2][0]))
    return last if abs(error) < WITHIN else last - max(-0.4, min(0.4, error / slope))
