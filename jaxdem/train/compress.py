"""Cheaper closures: a small network taught by a large one, and a network without the neurons that matter least."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Sequence
from functools import partial
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.closures.file import LearnedClosure, StoredClosure
from jaxdem.closures.network import ACTIVATIONS, PaperNetwork, Weights, layer_name
from jaxdem.errors import InputError
from jaxdem.train.dataset_file import Dataset
from jaxdem.train.ensemble import one_of
from jaxdem.train.fit import RECIPES
from jaxdem.train.fit_evaluate import Forces, learned_force, map_rows, split_by_run
from jaxdem.train.fit_loop import Progress
from jaxdem.train.fit_problem import FitResult, Problem, solve_all
from jaxdem.train.fit_settings import FitSettings

IMPORTANCE_ROWS = 50_000
"""Rows by which neurons are judged."""


def settings_for(closure: StoredClosure, **changes: Any) -> FitSettings:
    """Settings of the closure's recipe with its activation, terms, features and bound; changes that are not None."""
    one = one_of(closure)
    chosen = {name: value for name, value in changes.items() if value is not None}
    if isinstance(one, PaperNetwork):
        return FitSettings(**{"activation": one.activation, "hidden": one.hidden, **chosen})
    kept = {name: getattr(one, name) for name in ("activation", "hidden", "terms", "features", "bounded")}
    return FitSettings.filtered(**{**kept, **chosen})


def recipe_of(closure: StoredClosure) -> str:
    """The recipe that trains closures of this kind."""
    return "paper" if isinstance(one_of(closure), PaperNetwork) else "filtered"


def distill(
    teacher: StoredClosure,
    datasets: Sequence[Dataset],
    settings: FitSettings,
    progress: Progress | None = None,
) -> FitResult:
    """Train a network on the forces that another one gives for the inputs of datasets.

    What the teacher gives is smooth where the runs' forces scatter, so that a small network learns more from it
    than from the runs themselves. The student is of the teacher's kind; an ensemble is taught as its mean.

    Args:
        teacher: trained closure.
        datasets: as it was trained on, or others of its base law and dimension.
        settings: of the student.
        progress: see `Progress`.

    Returns:
        The student, judged against the runs; its metadata has in `distilled` by coarsening r2_of_teacher (the
        teacher against the runs) and r2_against_teacher (the student against the teacher), out of held-out rows. The
        regression is fitted to the teacher's forces.

    Raises:
        InputError: datasets that do not fit together or cannot be split.
        RunError: the loss becomes non-finite.
    """
    started = time.perf_counter()
    recipe = recipe_of(teacher)
    taught = [_taught(dataset, teacher) for dataset in datasets]
    problem = RECIPES[recipe](taught, settings)
    (outcome,) = solve_all([problem], progress, started)
    student = problem.trained(outcome)
    truth = split_by_run(datasets, settings.held_out, settings.held_out_fraction)
    result = dataclasses.replace(problem, split=truth).judge(student, outcome.history, time.perf_counter() - started)
    result.metadata["distilled"] = {
        "teacher_hidden": list(one_of(teacher).hidden),
        "r2_of_teacher": problem.r2(teacher, truth.held_out),
        "r2_against_teacher": problem.r2(student, problem.split.held_out),
    }
    return result


def prune(
    closure: LearnedClosure,
    datasets: Sequence[Dataset],
    neurons: float,
    settings: FitSettings,
    retrain: bool,
    progress: Progress | None = None,
) -> FitResult:
    """Remove the neurons of every hidden layer that matter least, and go on training if asked for.

    Args:
        closure: trained.
        datasets: whose training rows say what matters.
        neurons: part of each layer's neurons that is kept, rounded up.
        settings: of the choice of rows, and of the training that follows.
        retrain: whether to train the smaller network.
        progress: see `Progress`.

    Returns:
        The smaller closure; its metadata has in `pruned` the widths before, and r2_before by coarsening.

    Raises:
        InputError: `neurons` not in (0, 1), datasets that do not fit together or cannot be split.
        RunError: the loss becomes non-finite.
    """
    if not 0.0 < neurons < 1.0:
        raise InputError("--neurons", neurons, "must lie between 0 and 1", "For example --neurons 0.5.")
    started = time.perf_counter()
    make = RECIPES[recipe_of(closure)]
    problem: Problem = make(datasets, settings, closure)
    inputs = problem.data[0] if isinstance(closure, PaperNetwork) else problem.data[0].features
    # Evenly over all rows: the filtered recipe has them mesh by mesh.
    inputs = inputs[:: -(-len(inputs) // IMPORTANCE_ROWS)]
    weights = prune_weights(closure.weights, closure.activation, inputs, neurons)
    hidden = tuple(weights[layer_name(layer)]["bias"].shape[0] for layer in range(len(closure.hidden)))
    smaller = dataclasses.replace(closure, weights=weights, hidden=hidden)
    history: list[float] = []
    changed = dataclasses.replace(settings, hidden=hidden)
    if retrain:
        problem = make(datasets, changed, smaller)
        (outcome,) = solve_all([problem], progress, started)
        smaller, history = problem.trained(outcome), outcome.history
    problem = dataclasses.replace(problem, settings=changed)
    result = problem.judge(smaller, history, time.perf_counter() - started)
    result.metadata["pruned"] = {
        "hidden_before": list(closure.hidden),
        "r2_before": problem.r2(closure, problem.split.held_out),
    }
    return result


def prune_weights(weights: Weights, activation: str, rows: Array, neurons: float) -> Weights:
    """Weights of the network without the least important neurons of its hidden layers.

    From the first layer to the last, with a_j the activation of neuron j over the rows and w_j its outgoing weights:
    importance_j = std(a_j) |w_j|, the deviation of the next layer's inputs if the neuron gave its mean instead. The
    mean, w_j mean(a_j), goes to the biases of the next layer.

    Args:
        weights: of the network.
        activation: its activation.
        rows: (M, K) inputs as the network sees them.
        neurons: part of each layer's neurons that is kept, rounded up.

    Source: Sietsma & Dow (1991), Creating artificial neural networks that generalize, Neural Networks 4, 67-79,
    section 2, for neurons of constant output.
    """
    layers = [
        {name: np.asarray(value, np.float64) for name, value in weights[layer_name(i)].items()}
        for i in range(len(weights))
    ]
    dtype = np.asarray(weights[layer_name(0)]["bias"]).dtype
    values = np.asarray(rows, np.float64)
    for layer, following in zip(layers[:-1], layers[1:], strict=True):
        inputs = jnp.asarray(values @ layer["kernel"] + layer["bias"][None], dtype)
        values = np.asarray(ACTIVATIONS[activation](inputs), np.float64)
        mean, outgoing = values.mean(axis=0), following["kernel"]
        importance = values.std(axis=0) * np.linalg.norm(outgoing, axis=1)
        count = math.ceil(neurons * len(importance))
        order = np.argsort(-importance, kind="stable")
        kept, removed = np.sort(order[:count]), order[count:]
        following["bias"] = following["bias"] + mean[removed] @ outgoing[removed]
        following["kernel"] = outgoing[kept]
        layer["kernel"], layer["bias"] = layer["kernel"][:, kept], layer["bias"][kept]
        values = values[:, kept]
    return {
        layer_name(i): {name: jnp.asarray(value, dtype) for name, value in layer.items()}
        for i, layer in enumerate(layers)
    }


def _taught(dataset: Dataset, teacher: StoredClosure) -> Dataset:
    """The dataset with the teacher's forces in place of the run's."""
    groups = {}
    for coarsening, group in dataset.groups.items():
        force: Forces = map_rows(partial(learned_force, teacher), group)[0]
        groups[coarsening] = dataclasses.replace(group, drag_force=force, target_force=force)
    return dataclasses.replace(dataset, groups=groups)
