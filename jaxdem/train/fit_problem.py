"""What a recipe makes of datasets and settings: rows to train on, a loss, and how the result is judged."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.closures.correlation import Correlation
from jaxdem.closures.file import LearnedClosure, StoredClosure
from jaxdem.errors import InputError
from jaxdem.train.dataset_file import Dataset, Group
from jaxdem.train.fit_evaluate import Forces, Predictor, Split, evaluate_fit, thin
from jaxdem.train.fit_loop import Loss, Outcome, Progress, minimize
from jaxdem.train.fit_settings import FitSettings


@dataclasses.dataclass(frozen=True, eq=False)
class FitResult:
    """A fitted closure and how good it is.

    Attributes:
        closure: the trained `PaperNetwork` or `InvariantClosure`, or an ensemble of them.
        metadata: what the closure file keeps, plain values: recipe, base_law, datasets, split, settings,
            samples, seed, seconds, loss_history (per epoch), r2 and r2_train (by coarsening: closure, base,
            regression, out_of_range, samples), out of held-out and of training rows.
        parity: by coarsening the held-out arrays predicted, target, base, regression, each (<= 5000, D) [N].
        split: how the held-out rows were chosen.
    """

    closure: StoredClosure
    metadata: dict[str, Any]
    parity: dict[int, dict[str, Forces]]
    split: str


@dataclasses.dataclass(frozen=True, eq=False)
class Problem:
    """One network to train.

    Attributes:
        recipe: "paper" or "filtered".
        closure: with its normalisation, range and initial weights.
        data: pytree of arrays (M, ...) on the device.
        loss: of weights and rows of `data`.
        regression: gives the plain regression beside the network; called after the training.
        base: the base law.
        split: training and held-out rows.
        targets: by coarsening the name of the array that is the truth.
        settings: of the fit.
    """

    recipe: str
    closure: LearnedClosure
    data: Any
    loss: Loss
    regression: Callable[[], Predictor]
    base: Correlation
    split: Split
    targets: dict[int, str]
    settings: FitSettings

    @property
    def rows(self) -> int:
        """Training rows."""
        return int(jax.tree.leaves(self.data)[0].shape[0])

    def trained(self, outcome: Outcome) -> LearnedClosure:
        """The closure with trained weights."""
        return dataclasses.replace(self.closure, weights=outcome.weights)

    @property
    def kind(self) -> tuple[Any, ...]:
        """Equal for problems that one compiled program can train at once."""
        names = ("hidden", "activation", "loss", "schedule", "batch", "epochs", "terms")
        shapes = [leaf.shape for leaf in jax.tree.leaves(self.data)]
        return (self.recipe, *(getattr(self.settings, name) for name in names), *shapes)


def solve(problems: Sequence[Problem], progress: Progress | None = None, mapped: bool | None = None) -> list[Outcome]:
    """Train the networks of problems of one kind at once; raises ValueError for problems of several kinds.

    `mapped` is that of `minimize`.
    """
    if len({problem.kind for problem in problems}) > 1:
        raise ValueError("problems of different kinds cannot be trained at once")
    shared = problems[0].settings
    return minimize(
        problems[0].loss,
        [problem.closure.weights for problem in problems],
        [problem.data for problem in problems],
        batch=shared.batch,
        epochs=shared.epochs,
        learning_rates=[problem.settings.learning_rate for problem in problems],
        schedule=shared.schedule,
        seeds=[problem.settings.seed for problem in problems],
        progress=progress,
        mapped=mapped,
    )


def judge(problem: Problem, closure: StoredClosure, history: Sequence[float], seconds: float) -> FitResult:
    """Judge what came of a problem on held-out and training rows and put the record together.

    Args:
        problem: what was solved.
        closure: trained.
        history: loss of every epoch.
        seconds: that the training took.
    """
    settings, split, base = problem.settings, problem.split, problem.base
    regression, name = problem.regression(), problem.targets.__getitem__
    r2, parity = evaluate_fit(closure, base, regression, split.held_out, name, settings.seed)
    r2_train, _ = evaluate_fit(
        closure, base, regression, [thin(dataset) for dataset in split.train], name, settings.seed
    )
    metadata = {
        "recipe": problem.recipe,
        "base_law": split.train[0].drag,
        "datasets": list(dict.fromkeys(d.run for d in (*split.train, *split.held_out))),
        "split": split.text,
        "settings": settings.as_plain(),
        "samples": problem.rows,
        "seed": settings.seed,
        "seconds": seconds,
        "loss_history": list(history),
        "r2": r2,
        "r2_train": r2_train,
    }
    return FitResult(closure, metadata, parity, split.text)


def all_coarsenings(split: Split, train_only: bool = False) -> tuple[int, ...]:
    """Coarsenings of the training rows, or of all rows."""
    datasets = split.train if train_only else [*split.train, *split.held_out]
    return tuple(sorted({n for dataset in datasets for n in dataset.groups}))


def training_groups(datasets: Sequence[Dataset], coarsenings: Sequence[int]) -> dict[int, list[Group]]:
    """The groups of the wanted coarsenings; raises InputError for one that no dataset has."""
    groups = {n: [dataset.groups[n] for dataset in datasets if n in dataset.groups] for n in coarsenings}
    missing = [n for n, parts in groups.items() if not parts]
    if missing:
        raise InputError("coarsenings", missing, "are in no training dataset", "Use coarsenings that are.")
    return groups


def mean_and_scale(values: Forces) -> tuple[Forces, Forces]:
    """(K,) mean and standard deviation of (M, K) in double precision; 1 where a column does not vary."""
    mean, deviation = values.mean(axis=0, dtype=np.float64), values.std(axis=0, dtype=np.float64)
    varies = deviation > 1e-6 * np.maximum(np.abs(mean), 1e-12)
    return mean, np.where(varies, deviation, 1.0)


def constants(**values: Forces) -> dict[str, Any]:
    """Arrays by name in the precision in which closures are kept."""
    return {name: on_device(value) for name, value in values.items()}


def on_device(values: Forces) -> Array:
    """A JAX array in single precision."""
    return jnp.asarray(values, jnp.float32)
