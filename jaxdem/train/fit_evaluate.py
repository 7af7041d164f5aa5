"""What a fit is judged by: rows held out by run, forces on them, and R2."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jax import Array
from numpy.typing import NDArray

from jaxdem.closures.base import DragInputs
from jaxdem.closures.correlation import Correlation
from jaxdem.closures.file import StoredClosure
from jaxdem.closures.registry import drag_law
from jaxdem.errors import InputError
from jaxdem.io import scene_text
from jaxdem.train.dataset_file import SEEING, Dataset, Group

ROWS_AT_ONCE = 65536
"""Rows that are evaluated together, to bound the memory of hidden layers."""
TRAINING_ROWS = 250_000
"""Rows of a group on which the fit to the training data is judged."""

Forces = NDArray[np.floating[Any]]
Predictor = Callable[[Group], Forces]


class Split(NamedTuple):
    """Datasets to train on, datasets held out, and a sentence that says how they were parted."""

    train: list[Dataset]
    held_out: list[Dataset]
    text: str

    @property
    def base(self) -> Correlation:
        """The drag law of the runs."""
        return drag_law(self.train[0].drag, "dataset.drag")


def split_by_run(datasets: Sequence[Dataset], held_out: str | None, fraction: float) -> Split:
    """Hold out a run: the named or the last one; of a single run, the last part of its time.

    Never by sample: neighbouring particles and times are nearly copies of each other.

    Args:
        datasets: at least one; files of the same run stay together.
        held_out: name of the run to hold out, or None for that of the last dataset.
        fraction: part of the time span held out where there is one run only.

    Raises:
        InputError: no dataset, no run of that name, datasets of different dimension or drag law, different runs of
            one name, or one run without a time span.
    """
    if not datasets:
        raise InputError("dataset", (), "at least one is needed", "Make one with `jaxdem dataset`.")
    for name in ("drag", "dimension"):
        values = {getattr(dataset, name) for dataset in datasets}
        if len(values) > 1:
            remedy = "Train on datasets of one kind."
            raise InputError(f"dataset.{name}", sorted(values), "must be the same in all datasets", remedy)
    runs = list(dict.fromkeys(dataset.run for dataset in datasets))
    for run in runs:
        scenes = [_scene_of_run(dataset) for dataset in datasets if dataset.run == run]
        if any(scene != scenes[0] for scene in scenes):
            remedy = "Rename a run's folder and make its dataset again: data are split by the run's name."
            raise InputError("dataset.run", run, "two runs of different scenes have this name", remedy)
    if held_out is not None and (held_out not in runs or len(runs) == 1):
        limit = f"must be one of several runs; there are {runs}"
        raise InputError("held_out", held_out, limit, "Name a run, or leave it out.")
    if len(runs) > 1:
        name = datasets[-1].run if held_out is None else held_out
        train = [dataset for dataset in datasets if dataset.run != name]
        others = ", ".join(run for run in runs if run != name)
        text = f"by run: {name} held out, trained on {others}"
        return Split(train, [dataset for dataset in datasets if dataset.run == name], text)
    return _split_by_time(datasets, fraction)


def _scene_of_run(dataset: Dataset) -> dict[str, Any]:
    """The scene that was run: without the keys in which the coarse mesh of a dataset may differ from it."""
    scene = scene_text.parse(dataset.scene_toml, f"the dataset of {dataset.run}")
    coupling = scene.get("coupling", {})
    return scene | {"coupling": {key: coupling[key] for key in coupling if f"coupling.{key}" not in SEEING}}


def _split_by_time(datasets: Sequence[Dataset], fraction: float) -> Split:
    times = np.concatenate([group.time for dataset in datasets for group in dataset.groups.values()])
    first, last = float(times.min()), float(times.max())
    limit = last - fraction * (last - first)
    train = [_select(dataset, lambda group: group.time <= limit) for dataset in datasets]
    held_out = [_select(dataset, lambda group: group.time > limit) for dataset in datasets]
    train = [dataset for dataset in train if dataset.groups]
    held_out = [dataset for dataset in held_out if dataset.groups]
    if not train or not held_out:
        reason = "one run with samples of one time cannot be split"
        raise InputError("dataset", datasets[0].run, reason, "Sample more times, or give two runs.")
    text = (
        f"by time within one run: the last {100 * fraction:.0f} % of {datasets[0].run} held out "
        f"(t > {limit:.6g} s of {first:.6g} to {last:.6g} s)"
    )
    return Split(train, held_out, text)


def _select(dataset: Dataset, rows: Callable[[Group], NDArray[np.bool_]]) -> Dataset:
    """The dataset with some rows only; groups without any are left out."""
    groups = {n: group.select(rows(group)) for n, group in dataset.groups.items() if np.any(rows(group))}
    return dataclasses.replace(dataset, groups=groups)


def thin(dataset: Dataset, rows: int = TRAINING_ROWS) -> Dataset:
    """The dataset with evenly spaced rows only, at most `rows` in a group."""
    strides = {n: -(-len(group) // rows) for n, group in dataset.groups.items()}
    groups = {n: g.select(np.arange(0, len(g), strides[n])) for n, g in dataset.groups.items()}
    return dataclasses.replace(dataset, groups=groups)


def r_squared(predicted: Forces, target: Forces) -> float:
    """Coefficient of determination over all components, 1 - SS_res / SS_tot, the mean taken per component.

    Args:
        predicted: (M, D).
        target: (M, D).
    """
    truth = np.asarray(target, np.float64)
    residual = np.sum((np.asarray(predicted, np.float64) - truth) ** 2)
    total = np.sum((truth - np.mean(truth, axis=0, keepdims=True)) ** 2)
    return float(1.0 - residual / total) if total > 0 else float("nan")


def float32_inputs(group: Group) -> DragInputs:
    """The group's drag inputs in single precision, in which closures are trained."""
    return jax.tree.map(lambda leaf: leaf.astype(np.float32), group.drag_inputs())


def map_rows(function: Callable[[DragInputs], Any], group: Group) -> Any:
    """The function's arrays (M, ...) for all rows of a group, on the host, `ROWS_AT_ONCE` rows at a time.

    Blocks are filled up to a power of two by repeating the last row, so that groups of any length share few
    compilations.
    """
    parts = []
    for first in range(0, len(group), ROWS_AT_ONCE):
        count = min(ROWS_AT_ONCE, len(group) - first)
        size = 1 << (count - 1).bit_length()
        rows = np.minimum(np.arange(first, first + size), len(group) - 1)
        result = jax.device_get(function(float32_inputs(group.select(rows))))
        parts.append(jax.tree.map(lambda leaf, count=count: leaf[:count], result))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


@jax.jit
def learned_force(closure: StoredClosure, inputs: DragInputs) -> tuple[Array, Array]:
    """Force (M, D) [N] and out_of_range (M,)."""
    drag = closure(inputs)
    force = drag.coefficient[:, None] * inputs.slip_velocity
    return (force if drag.remainder is None else force + drag.remainder), drag.out_of_range
