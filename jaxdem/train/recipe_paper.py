"""The recipe of the source paper: what it makes of datasets and settings, and its loss."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import partial

import numpy as np
from jax import Array

from jaxdem.closures.network import PaperNetwork, Weights
from jaxdem.errors import InputError
from jaxdem.train.dataset_file import Dataset
from jaxdem.train.fit_evaluate import split_by_run
from jaxdem.train.fit_loop import LOSSES
from jaxdem.train.fit_network import network_columns
from jaxdem.train.fit_problem import (
    Problem,
    all_coarsenings,
    mean_and_scale,
    normalised,
    on_device,
    training_groups,
)
from jaxdem.train.fit_regression import linear_force, paper_features
from jaxdem.train.fit_settings import FitSettings


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
        normalised(inputs, closure.input_mean, closure.input_scale),
        normalised(forces, closure.output_mean, closure.output_scale),
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
