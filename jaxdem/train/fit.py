"""Fit a learned drag closure to datasets: the source paper's recipe and the one on filtered inputs."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.closures.correlation import Correlation
from jaxdem.closures.file import LearnedClosure
from jaxdem.closures.invariant import InvariantClosure, PreparedInputs
from jaxdem.closures.network import PaperNetwork
from jaxdem.closures.registry import drag_law
from jaxdem.errors import InputError
from jaxdem.train.dataset_file import Dataset, Group
from jaxdem.train.fit_evaluate import (
    Forces,
    Predictor,
    Split,
    evaluate_fit,
    map_rows,
    split_by_run,
    thin,
)
from jaxdem.train.fit_loop import LOSSES, Progress, minimize
from jaxdem.train.fit_regression import fit_regression, linear_force, paper_features, prepare_rows
from jaxdem.train.fit_settings import FitSettings

__all__ = ["FitResult", "FitSettings", "fit_filtered", "fit_paper", "fit_regression"]


@dataclasses.dataclass(frozen=True, eq=False)
class FitResult:
    """A fitted closure and how good it is.

    Attributes:
        closure: the trained `PaperNetwork` or `InvariantClosure`.
        metadata: what the closure file keeps, plain values: recipe, base_law, datasets, split, settings,
            samples, seed, seconds, loss_history (per epoch), r2 and r2_train (by coarsening: closure, base,
            regression, out_of_range, samples), out of held-out and of training rows.
        parity: by coarsening the held-out arrays predicted, target, base, regression, each (<= 5000, D) [N].
        split: how the held-out rows were chosen.
    """

    closure: LearnedClosure
    metadata: dict[str, Any]
    parity: dict[int, dict[str, Forces]]
    split: str


def fit_paper(
    datasets: Sequence[Dataset], settings: FitSettings | None = None, progress: Progress | None = None
) -> FitResult:
    """The source paper's recipe: velocities and void fraction of the fine mesh in, the fine run's drag out.

    The network learns `drag_force` of the finest coarsening there is. On coarser inputs it is judged by
    `target_force`, the force that a run on that mesh would need. Inputs and outputs are normalised by mean
    and standard deviation. The regression beside it is linear in the same inputs.

    Args:
        datasets: of one drag law and dimension.
        settings: the paper's by default.
        progress: progress(epoch, epochs, loss), called about a hundred times.

    Raises:
        InputError: datasets that do not fit together or cannot be split, or a coarsening that is not there.
        RunError: the loss becomes non-finite.
    """
    settings = settings or FitSettings()
    started = time.perf_counter()
    split = split_by_run(datasets, settings.held_out, settings.held_out_fraction)
    finest = min(_coarsenings(split, train_only=True))
    groups = _training_groups(split.train, settings.coarsenings or (finest,))
    targets = {n: "drag_force" if n == finest else "target_force" for n in _coarsenings(split)}
    inputs = np.concatenate([paper_features(g) for parts in groups.values() for g in parts])
    forces = np.concatenate([getattr(g, targets[n]) for n, parts in groups.items() for g in parts])
    kept = np.random.default_rng(settings.seed).permutation(len(forces))[: settings.samples]
    inputs, forces = inputs[kept], forces[kept]

    base, dimension = drag_law(datasets[0].drag, "dataset.drag"), datasets[0].dimension
    closure = PaperNetwork.initial(dimension, base, settings.hidden, settings.activation, settings.seed)
    mean, scale = _mean_and_scale(inputs)
    offset, unit = _mean_and_scale(forces)
    constants = (mean, scale, inputs.min(axis=0), inputs.max(axis=0), offset, unit)
    names = ("input_mean", "input_scale", "input_low", "input_high", "output_mean", "output_scale")
    closure = dataclasses.replace(closure, **_float32(names, constants))
    data = _on_device((inputs - mean[None]) / scale[None]), _on_device((forces - offset[None]) / unit[None])
    measure = LOSSES[settings.loss]

    def loss(weights: Any, rows: tuple[Array, Array]) -> Array:
        return measure(dataclasses.replace(closure, weights=weights).normalised_force(rows[0]), rows[1])

    weights, history = _minimize(loss, closure.weights, data, settings, progress)
    closure = dataclasses.replace(closure, weights=weights)
    seconds = time.perf_counter() - started
    regression = linear_force(inputs, forces)
    return _result("paper", closure, base, regression, split, targets, settings, history, len(kept), seconds)


def fit_filtered(
    datasets: Sequence[Dataset], settings: FitSettings | None = None, progress: Progress | None = None
) -> FitResult:
    """Fit an `InvariantClosure` on filtered inputs to the force that a coarse run has to apply.

    The loss is the mean over coarsenings c of sum |force - target_c|^2 / sum |target_c - mean|^2, that is the
    mean of 1 - R2 on the training rows, so that every coarsening counts alike however large its forces or
    many its rows.

    The regression beside it takes the factor on the base law linear in the same features (and
    has the same terms), fitted by the same weighted squares; its factor may be negative.

    Args:
        datasets: of one drag law and dimension.
        settings: `FitSettings.filtered()` by default.
        progress: progress(epoch, epochs, loss), called about a hundred times.

    Raises:
        InputError: datasets that do not fit together or cannot be split, or a coarsening that is not there.
        RunError: the loss becomes non-finite.
    """
    settings = settings or FitSettings.filtered()
    if settings.loss != "mse":
        raise InputError("loss", settings.loss, "the filtered recipe has its own", "Leave it at mse.")
    started = time.perf_counter()
    split = split_by_run(datasets, settings.held_out, settings.held_out_fraction)
    groups = _training_groups(split.train, settings.coarsenings or _coarsenings(split, train_only=True))
    base = drag_law(datasets[0].drag, "dataset.drag")
    closure = InvariantClosure.initial(
        base, settings.hidden, settings.activation, settings.terms, settings.seed
    )
    prepared, target, weight = _filtered_rows(closure, groups, settings)
    features = np.asarray(prepared.features, np.float64)
    mean, scale = _mean_and_scale(features)
    names = ("feature_mean", "feature_scale", "feature_low", "feature_high")
    constants = (mean, scale, features.min(axis=0), features.max(axis=0))
    closure = dataclasses.replace(closure, **_float32(names, constants))

    def loss(weights: Any, rows: tuple[PreparedInputs, Array, Array]) -> Array:
        inputs, truth, counts = rows
        drag = dataclasses.replace(closure, weights=weights).evaluate(inputs)
        force = drag.coefficient[:, None] * inputs.slip
        if drag.remainder is not None:
            force = force + drag.remainder
        return jnp.mean(counts * jnp.sum((force - truth) ** 2, axis=-1))

    data = (jax.tree.map(jnp.asarray, prepared), _on_device(target), _on_device(weight))
    weights, history = _minimize(loss, closure.weights, data, settings, progress)
    closure = dataclasses.replace(closure, weights=weights)
    seconds = time.perf_counter() - started
    regression = fit_regression(closure, prepared, target, weight)
    targets = dict.fromkeys(_coarsenings(split), "target_force")
    return _result(
        "filtered", closure, base, regression, split, targets, settings, history, len(target), seconds
    )


def _filtered_rows(
    closure: InvariantClosure, groups: dict[int, list[Group]], settings: FitSettings
) -> tuple[PreparedInputs, Forces, Forces]:
    """Prepared inputs, target (M, D) [N] and weight (M,) [1/N2] of the training rows of all coarsenings."""
    generator, share = np.random.default_rng(settings.seed), max(1, settings.samples // len(groups))
    prepared, targets, weights = [], [], []
    for coarsening, parts in groups.items():
        everything = [map_rows(partial(prepare_rows, closure), group) for group in parts]
        rows = jax.tree.map(lambda *leaves: np.concatenate(leaves), *everything)
        target = np.concatenate([group.target_force for group in parts])
        kept = generator.permutation(len(target))[:share]
        target = target[kept]
        spread = float(np.sum((target - target.mean(axis=0)[None]) ** 2))
        if not spread > 0:
            limit = f"coarsen_{coarsening}/target_force is the same in all training rows"
            raise InputError("dataset", coarsening, limit, "Give a dataset in which the force varies.")
        prepared.append(jax.tree.map(lambda leaf, kept=kept: leaf[kept], rows))
        targets.append(target)
        weights.append(np.full(len(target), 1.0 / (spread * len(groups))))
    weight = np.concatenate(weights)
    # mean(weight * squares) is then the mean over coarsenings of sum(squares) / spread
    merged = jax.tree.map(lambda *leaves: np.concatenate(leaves), *prepared)
    return merged, np.concatenate(targets), weight * len(weight)


def _result(
    recipe: str,
    closure: LearnedClosure,
    base: Correlation,
    regression: Predictor,
    split: Split,
    targets: dict[int, str],
    settings: FitSettings,
    history: list[float],
    samples: int,
    seconds: float,
) -> FitResult:
    """Judge the closure on held-out and training rows and put the record together."""
    name = targets.__getitem__
    r2, parity = evaluate_fit(closure, base, regression, split.held_out, name, settings.seed)
    r2_train, _ = evaluate_fit(
        closure, base, regression, [thin(dataset) for dataset in split.train], name, settings.seed
    )
    fields = dataclasses.asdict(settings)
    metadata = {
        "recipe": recipe,
        "base_law": split.train[0].drag,
        "datasets": list(dict.fromkeys(d.run for d in (*split.train, *split.held_out))),
        "split": split.text,
        "settings": {
            name: list(value) if isinstance(value, tuple) else value for name, value in fields.items()
        },
        "samples": samples,
        "seed": settings.seed,
        "seconds": seconds,
        "loss_history": history,
        "r2": r2,
        "r2_train": r2_train,
    }
    return FitResult(closure, metadata, parity, split.text)


def _coarsenings(split: Split, train_only: bool = False) -> tuple[int, ...]:
    datasets = split.train if train_only else [*split.train, *split.held_out]
    return tuple(sorted({n for dataset in datasets for n in dataset.groups}))


def _training_groups(datasets: Sequence[Dataset], coarsenings: Sequence[int]) -> dict[int, list[Group]]:
    """The groups of the wanted coarsenings; raises InputError for one that no dataset has."""
    groups = {n: [dataset.groups[n] for dataset in datasets if n in dataset.groups] for n in coarsenings}
    missing = [n for n, parts in groups.items() if not parts]
    if missing:
        raise InputError("coarsenings", missing, "are in no training dataset", "Use coarsenings that are.")
    return groups


def _minimize(
    loss: Any, weights: Any, data: Any, settings: FitSettings, progress: Progress | None
) -> tuple[Any, list[float]]:
    names = ("batch", "epochs", "learning_rate", "schedule", "seed")
    return minimize(
        loss, weights, data, progress=progress, **{name: getattr(settings, name) for name in names}
    )


def _mean_and_scale(values: Forces) -> tuple[Forces, Forces]:
    """(K,) mean and standard deviation of (M, K) in double precision; 1 where a column does not vary."""
    mean, deviation = values.mean(axis=0, dtype=np.float64), values.std(axis=0, dtype=np.float64)
    varies = deviation > 1e-6 * np.maximum(np.abs(mean), 1e-12)
    return mean, np.where(varies, deviation, 1.0)


def _float32(names: Sequence[str], values: Sequence[Forces]) -> dict[str, Any]:
    return {name: _on_device(value) for name, value in zip(names, values, strict=True)}


def _on_device(values: Forces) -> Array:
    return jnp.asarray(values, jnp.float32)
