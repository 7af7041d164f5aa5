"""Fit a learned drag closure to datasets: the source paper's recipe and the one on filtered inputs."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.closures.base import Drag
from jaxdem.closures.invariant import InvariantClosure, PreparedInputs, corrected
from jaxdem.closures.network import PaperNetwork, Weights
from jaxdem.errors import InputError
from jaxdem.train.dataset_file import Dataset, Group
from jaxdem.train.fit_evaluate import Forces, map_rows, split_by_run
from jaxdem.train.fit_loop import LOSSES, Progress
from jaxdem.train.fit_network import network_columns
from jaxdem.train.fit_problem import (
    FitResult,
    Problem,
    all_coarsenings,
    mean_and_scale,
    on_device,
    solve_all,
    training_groups,
)
from jaxdem.train.fit_regression import fit_regression, linear_force, paper_features, prepare_rows
from jaxdem.train.fit_settings import FitSettings

__all__ = [
    "RECIPES",
    "FitResult",
    "FitSettings",
    "fit_filtered",
    "fit_paper",
    "fit_regression",
]

RANGE_QUANTILE = 1e-3
"""Part of the rows at either end of a feature that its range leaves out: a few stray grains are not a flow."""


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
    return _fit_one(paper_problem, datasets, settings or FitSettings(), progress)


def fit_filtered(
    datasets: Sequence[Dataset], settings: FitSettings | None = None, progress: Progress | None = None
) -> FitResult:
    """Fit an `InvariantClosure` on filtered inputs to the force that a coarse run has to apply.

    The loss is the mean over coarsenings c of sum |force - target_c|^2 / sum |target_c - mean|^2, that is the
    mean of 1 - R2 on the training rows, so that every coarsening counts alike however large its forces or
    many its rows.

    With the loss "balance" the factor f is the one with which rows of equal features have the mean force of the fine
    run. With e the direction of the mean slip of a run and a coarsening, b = c (u - v) . e of the base law and
    F = target . e, it minimises the mean of f^2 b / 2 - f F, whose derivative by f vanishes where <f b> = <F>. Every
    run and coarsening counts alike. A fit of squares to a slip that is uncertain, or that varies where the force does
    not, gives <b F> / <b^2>, which is too small (attenuation: W. A. Fuller, Measurement Error Models (1987), sec. 1.1),
    and then the mean slip of a coarse run is too large.

    The regression beside it takes the factor on the base law linear in the same features (and
    has the same terms), fitted by the same weighted squares; its factor may be negative.

    Args:
        datasets: of one drag law and dimension.
        settings: `FitSettings.filtered()` by default.
        progress: progress(epoch, epochs, loss), called about a hundred times.

    Raises:
        InputError: datasets that do not fit together or cannot be split, or a coarsening that is not there; with the
            loss "balance" terms, or a run without a mean slip.
        RunError: the loss becomes non-finite.
    """
    return _fit_one(filtered_problem, datasets, settings or FitSettings.filtered(), progress)


def _fit_one(
    make: Callable[..., Problem],
    datasets: Sequence[Dataset],
    settings: FitSettings,
    progress: Progress | None,
) -> FitResult:
    started = time.perf_counter()
    problem = make(datasets, settings)
    (outcome,) = solve_all([problem], progress, started)
    return problem.judge(problem.trained(outcome), outcome.history, time.perf_counter() - started)


def paper_problem(datasets: Sequence[Dataset], settings: FitSettings, start: PaperNetwork | None = None) -> Problem:
    """What `fit_paper` solves; raises what it raises.

    With `start` its layers, weights, normalisation and range are kept and gone on from.
    """
    for name, of_filtered in (("bounded", settings.bounded), ("loss", settings.loss == "balance")):
        if of_filtered:
            limit = "is of the filtered recipe"
            raise InputError(name, getattr(settings, name), limit, "Leave it out, or take that recipe.")
    split = split_by_run(datasets, settings.held_out, settings.held_out_fraction)
    finest = min(all_coarsenings(split, train_only=True))
    groups = training_groups(split.train, settings.coarsenings or (finest,))
    targets = {n: "drag_force" if n == finest else "target_force" for n in all_coarsenings(split)}
    inputs = np.concatenate([paper_features(g) for parts in groups.values() for g in parts])
    forces = np.concatenate([getattr(g, targets[n]) for n, parts in groups.items() for g in parts])
    kept = np.random.default_rng(settings.seed).permutation(len(forces))[: settings.samples]
    inputs, forces = inputs[kept], forces[kept]
    closure = start
    if closure is None:
        layers = settings.hidden, settings.activation, settings.seed
        closure = PaperNetwork.initial(datasets[0].dimension, split.base, *layers)
        mean, scale = mean_and_scale(inputs)
        offset, unit = mean_and_scale(forces)
        closure = dataclasses.replace(
            closure,
            input_mean=on_device(mean), input_scale=on_device(scale),
            input_low=on_device(inputs.min(axis=0)), input_high=on_device(inputs.max(axis=0)),
            output_mean=on_device(offset), output_scale=on_device(unit),
        )  # fmt: skip
    data = (
        _normalised(inputs, closure.input_mean, closure.input_scale),
        _normalised(forces, closure.output_mean, closure.output_scale),
    )
    loss = PaperLoss(settings.loss, settings.activation)
    regression = partial(linear_force, inputs, forces)
    return Problem("paper", closure, data, loss, regression, split, targets, settings)


@dataclasses.dataclass(frozen=True)
class PaperLoss:
    """Loss of weights and rows: normalised inputs (M, K) and forces (M, D) [-].

    Attributes:
        measure: a name of `LOSSES`.
        activation: of the network.
    """

    measure: str
    activation: str

    def __call__(self, weights: Weights, rows: tuple[Array, Array]) -> Array:
        """The loss."""
        return LOSSES[self.measure](network_columns(weights, self.activation, rows[0].T), rows[1].T)


def _learned_drag(weights: Weights, activation: str, inputs: PreparedInputs, bounded: bool) -> Drag:
    """The drag on every row by the network, also beyond the range of the training."""
    output = network_columns(weights, activation, inputs.features.T).T
    return corrected(inputs, output, jnp.ones_like(inputs.out_of_range), bounded)


@dataclasses.dataclass(frozen=True)
class FilteredLoss:
    """Loss of weights and rows: prepared inputs with normalised features, forces (M, D) [N], weights (M,) [1/N2].

    Attributes:
        activation: of the network.
        bounded: whether the factor is at most one.
    """

    activation: str
    bounded: bool = False

    def __call__(self, weights: Weights, rows: tuple[PreparedInputs, Array, Array]) -> Array:
        """The loss."""
        inputs, truth, counts = rows
        drag = _learned_drag(weights, self.activation, inputs, self.bounded)
        force = drag.coefficient[:, None] * inputs.slip
        if drag.remainder is not None:
            force = force + drag.remainder
        return jnp.mean(counts * jnp.sum((force - truth) ** 2, axis=-1))


@dataclasses.dataclass(frozen=True)
class BalanceLoss:
    """The loss "balance" of `fit_filtered`, of rows as `FilteredLoss` has them; slip and force are along e (M, 1).

    Attributes:
        activation: of the network.
        bounded: whether the factor is at most one.
    """

    activation: str
    bounded: bool = False

    def __call__(self, weights: Weights, rows: tuple[PreparedInputs, Array, Array]) -> Array:
        """The loss."""
        inputs, truth, counts = rows
        drag = _learned_drag(weights, self.activation, inputs, self.bounded)
        factor = drag.coefficient / inputs.coefficient
        return jnp.mean(counts * factor * (0.5 * drag.coefficient * inputs.slip[:, 0] - truth[:, 0]))


def filtered_problem(
    datasets: Sequence[Dataset], settings: FitSettings, start: InvariantClosure | None = None
) -> Problem:
    """What `fit_filtered` solves; raises what it raises.

    With `start` its layers, terms, bound, weights, normalisation and range are kept and gone on from.
    """
    if settings.loss not in ("mse", "balance"):
        raise InputError("loss", settings.loss, "the filtered recipe has its own", "Use mse or balance.")
    balance = settings.loss == "balance"
    if balance and (settings.terms or (start is not None and start.terms)):
        raise InputError("terms", settings.terms, "have no loss of the balance", "Leave them out, or use mse.")
    split = split_by_run(datasets, settings.held_out, settings.held_out_fraction)
    groups = training_groups(split.train, settings.coarsenings or all_coarsenings(split, train_only=True))
    closure = start or InvariantClosure.initial(
        split.base, settings.hidden, settings.activation, settings.terms, settings.seed, settings.features,
        settings.bounded,
    )  # fmt: skip
    prepared, target, weight = _filtered_rows(closure, groups, settings)
    features = np.asarray(prepared.features, np.float64)
    if start is None:
        mean, scale = mean_and_scale(features)
        low, high = np.quantile(features, (RANGE_QUANTILE, 1.0 - RANGE_QUANTILE), axis=0)
        closure = dataclasses.replace(
            closure,
            feature_mean=on_device(mean), feature_scale=on_device(scale),
            feature_low=on_device(low), feature_high=on_device(high),
        )  # fmt: skip

    # The network is trained on all rows, strays too, so that what it sees can be had once for all epochs.
    normalised = _normalised(features, closure.feature_mean, closure.feature_scale)
    data = (jax.tree.map(jnp.asarray, prepared._replace(features=normalised)), on_device(target), on_device(weight))
    loss = (BalanceLoss if balance else FilteredLoss)(settings.activation, closure.bounded)
    regression = partial(fit_regression, closure, prepared, target, weight)
    targets = dict.fromkeys(all_coarsenings(split), "target_force")
    return Problem("filtered", closure, data, loss, regression, split, targets, settings)


def _normalised(values: Forces, mean: Array, scale: Array) -> Array:
    """(M, K) less mean, by scale (K,), in single precision."""
    return on_device((values - np.asarray(mean, np.float64)[None]) / np.asarray(scale, np.float64)[None])


RECIPES: dict[str, Callable[..., Problem]] = {
    "paper": paper_problem,
    "filtered": filtered_problem,
}
"""What recipes make of datasets, settings and, if given, a closure to start from, by name."""


def _filtered_rows(
    closure: InvariantClosure, groups: dict[int, list[Group]], settings: FitSettings
) -> tuple[PreparedInputs, Forces, Forces]:
    """Prepared inputs, target (M, D) [N] and weight (M,) [1/N2] of the training rows of all coarsenings; for the loss
    "balance" the vectors are along the mean slip (M, 1), and the weight is in 1/N."""
    generator, share = np.random.default_rng(settings.seed), max(1, settings.samples // len(groups))
    balance = settings.loss == "balance"
    prepared, targets, weights = [], [], []
    for coarsening, parts in groups.items():
        runs = [(map_rows(partial(prepare_rows, closure), group), group.target_force) for group in parts]
        if balance:
            runs = [_along_mean_slip(*run) for run in runs]
        rows, target = jax.tree.map(lambda *leaves: np.concatenate(leaves), *runs)
        kept = generator.permutation(len(target))[:share]
        if balance:
            # Every run counts alike, whatever its forces and the number of its rows.
            weight = np.concatenate([np.full(len(force), 1.0 / abs(float(force.sum()))) for _, force in runs])[kept]
        else:
            weight = np.full(len(kept), 1.0 / _spread(target[kept], coarsening))
        prepared.append(jax.tree.map(lambda leaf, kept=kept: leaf[kept], rows))
        targets.append(target[kept])
        weights.append(weight / len(groups))
    weight = np.concatenate(weights)
    # mean(weight * squares) is then the mean over coarsenings of sum(squares) / spread
    merged = jax.tree.map(lambda *leaves: np.concatenate(leaves), *prepared)
    return merged, np.concatenate(targets), weight * len(weight)


def _spread(target: Forces, coarsening: int) -> float:
    """Sum of squares of forces (M, D) less their mean [N2]; raises InputError where all are the same."""
    spread = float(np.sum((target - target.mean(axis=0)[None]) ** 2))
    if not spread > 0:
        limit = f"coarsen_{coarsening}/target_force is the same in all training rows"
        raise InputError("dataset", coarsening, limit, "Give a dataset in which the force varies.")
    return spread


def _along_mean_slip(rows: PreparedInputs, force: Forces) -> tuple[PreparedInputs, Forces]:
    """Rows of a run with slip and force along their mean slip (M, 1); raises InputError where that is zero."""
    slip = np.asarray(rows.slip, np.float64)
    mean = slip.mean(axis=0)
    length = float(np.linalg.norm(mean))
    if not length > 0:
        raise InputError("loss", "balance", "a dataset has no mean slip to balance forces along", "Use mse.")
    along = mean[:, None] / length
    return rows._replace(slip=(slip @ along).astype(np.float32)), np.asarray(force, np.float64) @ along
