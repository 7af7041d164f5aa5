"""The recipe on filtered inputs: what it makes of datasets and settings, and its losses."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.closures.base import Drag
from jaxdem.closures.invariant import InvariantClosure, PreparedInputs, corrected
from jaxdem.closures.network import Weights
from jaxdem.errors import InputError
from jaxdem.train.dataset_file import Dataset, Group
from jaxdem.train.fit_evaluate import Forces, map_rows, split_by_run
from jaxdem.train.fit_network import network_columns
from jaxdem.train.fit_problem import (
    Problem,
    all_coarsenings,
    mean_and_scale,
    normalised,
    on_device,
    training_groups,
)
from jaxdem.train.fit_regression import fit_regression, prepare_rows
from jaxdem.train.fit_settings import FitSettings

RANGE_QUANTILE = 1e-3
"""Part of the rows at either end of a feature that its range leaves out: a few stray grains are not a flow."""


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
    known = normalised(features, closure.feature_mean, closure.feature_scale)
    data = (jax.tree.map(jnp.asarray, prepared._replace(features=known)), on_device(target), on_device(weight))
    loss = (BalanceLoss if balance else FilteredLoss)(settings.activation, closure.bounded)
    regression = partial(fit_regression, closure, prepared, target, weight)
    targets = dict.fromkeys(all_coarsenings(split), "target_force")
    return Problem("filtered", closure, data, loss, regression, split, targets, settings)


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
