"""Closures on scenes that they have not seen: forces on averaged inputs, and coarse runs."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import jax
import numpy as np
from jax import Array

from jaxdem.closures import load_closure
from jaxdem.closures.base import DragInputs
from jaxdem.closures.invariant import InvariantClosure
from jaxdem.closures.registry import drag_law
from jaxdem.train.dataset_file import Group, read_dataset
from jaxdem.train.fit_evaluate import Predictor, map_rows, r_squared, thin
from jaxdem.train.fit_regression import fit_regression, prepare_rows
from studies.evidence import Evidence
from studies.measure import PERCENT, mean, mean_over, noise_floor
from studies.specs import DatasetSpec, FitSpec, RunSpec
from studies.tables import Cell, Section, Table

ROWS = 60_000
"""Rows of a group that the regression is fitted to, and that closures are judged on."""

CLOSURES = ("filtered", "paper")
"""Whose forces are looked at."""

COARSE = {
    "Koch-Hill": "",
    "filtered": "_filtered",
    "sharp": "_sharp",
    "sharp, filtered": "_sharp_filtered",
    "deconvolved, filtered": "_deconvolved_filtered_deconvolved",
}
"""Coarse runs by what stands behind their names."""


def generalisation_part(evidence: Evidence) -> Section:
    """A-priori and a-posteriori errors in scenes that no closure was trained on."""
    section = Section("generalisation", "Scenes that no closure has seen")
    section.tables += [_forces(evidence), _runs(evidence)]
    section.missing = dict(evidence.missing)
    return section


@jax.jit
def _force(closure: Any, inputs: DragInputs) -> Array:
    drag = closure(inputs)
    force = drag.coefficient[:, None] * inputs.slip_velocity
    return force if drag.remainder is None else force + drag.remainder


def regression_of(closure: InvariantClosure, datasets: list[Any], coarsenings: tuple[int, ...]) -> Predictor:
    """The plain regression that stands beside a filtered closure, fitted to rows of its training data."""
    prepared, targets, weights = [], [], []
    for coarsening in coarsenings:
        groups = [thin(dataset, ROWS).groups[coarsening] for dataset in datasets if coarsening in dataset.groups]
        if not groups:
            continue
        target = np.concatenate([group.target_force for group in groups])
        spread = float(np.sum((target - target.mean(axis=0)[None]) ** 2))
        prepared += [map_rows(partial(prepare_rows, closure), group) for group in groups]
        targets.append(target)
        weights.append(np.full(len(target), 1.0 / spread))
    rows = jax.tree.map(lambda *leaves: np.concatenate(leaves), *prepared)
    return fit_regression(closure, rows, np.concatenate(targets), np.concatenate(weights))


def _forces(evidence: Evidence) -> Table:
    """Normalised error and R2 of the force on every grain."""
    laws: dict[str, Any] = {}
    for name in CLOSURES:
        if evidence.closure(name) is not None:
            laws[name] = load_closure(evidence.folder.closure(name))[0]
    predictors: dict[str, Predictor] = {
        name: partial(lambda closure, group: map_rows(partial(_force, closure), group), closure)
        for name, closure in laws.items()
    }
    spec, filtered = evidence.plan.specs["filtered"], laws.get("filtered")
    if isinstance(spec, FitSpec) and isinstance(filtered, InvariantClosure):
        files = [file for name in spec.datasets[:-1] if (file := evidence.dataset(name)) is not None]
        if len(files) == len(spec.datasets) - 1:
            data = [read_dataset(file) for file in files]
            predictors["regression"] = regression_of(filtered, data, spec.settings.coarsenings or (1,))
    rows: list[dict[str, Cell]] = []
    for name in evidence.plan.names("generalisation", DatasetSpec):
        file = evidence.dataset(name)
        if file is None:
            continue
        dataset = thin(read_dataset(file), ROWS)
        base = drag_law(dataset.drag)
        law = jax.jit(lambda inputs, base=base: base(inputs).coefficient[:, None] * inputs.slip_velocity)
        every = {"Koch-Hill": partial(map_rows, law), **predictors}
        for factor, group in dataset.groups.items():
            scene = name.removeprefix("dataset_")
            rows.append({"scene": scene, "inputs averaged": f"{factor}x", **_scores(every, group)})
    note = "Root-mean-square error of the force over its root-mean-square, and R2, both over all components."
    return Table.of("Force on the grains", rows, note, digits=4)


def _scores(predictors: dict[str, Any], group: Group) -> dict[str, Cell]:
    target = np.asarray(group.target_force, float)
    size = math.sqrt(float(np.mean(target**2)))
    scores: dict[str, Cell] = {}
    for kind, predictor in predictors.items():
        force = np.asarray(predictor(group), float)
        scores[f"RMSE/RMS, {kind}"] = math.sqrt(float(np.mean((force - target) ** 2))) / size
        scores[f"R2, {kind}"] = r_squared(force, target)
    return scores


def scene_names(evidence: Evidence) -> list[str]:
    """What stands before the runs' names, of every scene with coarse runs of 4x; "" is injection.toml's."""
    runs = evidence.plan.names("generalisation", RunSpec)
    return ["", *(name.removesuffix("fine") for name in runs if name.endswith("_fine"))]


def _runs(evidence: Evidence) -> Table:
    rows: list[dict[str, Cell]] = []
    for prefix in scene_names(evidence):
        fine = evidence.run(f"{prefix}fine")
        if fine is None:
            continue
        floor = noise_floor(fine, evidence.jittered(f"{prefix}fine"))
        for factor in (3, 4) if prefix == "" else (4,):
            scene = prefix.rstrip("_") or "injection"
            row: dict[str, Cell] = {"scene": scene, "mesh": f"{factor}x", "noise [%]": mean(floor) / PERCENT}
            for what, end in COARSE.items():
                error = evidence.errors(f"{prefix}coarse_{factor}{end}", f"{prefix}fine")
                row[f"mean error [%], {what}"] = None if error is None else mean(error) / PERCENT
                row[f"over noise [-], {what}"] = None if error is None else mean_over(error, floor)
            rows.append(row)
    note = "Coarse runs against the fine run of the same scene; mean over the nine metrics."
    return Table.of("Coarse runs in scenes that no closure has seen", rows, note)
