"""What a recipe makes of datasets and settings: rows to train on, a loss, and how the result is judged."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence
from functools import cache, cached_property, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.closures.base import DragInputs
from jaxdem.closures.correlation import Correlation
from jaxdem.closures.file import LearnedClosure, StoredClosure
from jaxdem.errors import InputError, RunError
from jaxdem.train.dataset_file import Dataset, Group
from jaxdem.train.fit_evaluate import Forces, Predictor, Split, learned_force, map_rows, r_squared, thin
from jaxdem.train.fit_loop import Loss, Network, Outcome, Plan, Progress, Tree, minimize
from jaxdem.train.fit_settings import FitSettings

PARITY_ROWS = 5000
"""Rows kept for parity plots."""

Scores = dict[str, dict[str, float]]
"""By coarsening, as text: R2 of closure, base and regression, out_of_range (fraction of rows), samples."""
Parity = dict[int, dict[str, Forces]]
"""By coarsening the arrays predicted, target, base, regression, each (<= 5000, D) [N]."""


@dataclasses.dataclass(frozen=True, eq=False)
class FitResult:
    """A fitted closure and how good it is.

    Attributes:
        closure: the trained `PaperNetwork` or `InvariantClosure`, or an ensemble of them.
        metadata: what the closure file keeps, plain values: recipe, base_law, datasets, split, settings,
            samples, seed, seconds, loss_history (per epoch), r2 and r2_train (`Scores` on held-out and training rows).
        parity: `Parity` of held-out rows.
        split: how the held-out rows were chosen.
    """

    closure: StoredClosure
    metadata: dict[str, Any]
    parity: Parity
    split: str


@dataclasses.dataclass(frozen=True, eq=False)
class Problem:
    """One network to train.

    Attributes:
        recipe: "paper" or "filtered".
        closure: with its normalisation, range and initial weights.
        data: pytree of arrays (M, ...) on the device.
        loss: of weights and rows of `data`.
        fit_regression: fits the plain regression beside the network; called after the training.
        split: training and held-out rows.
        targets: by coarsening the name of the array that is the truth, "target_force" or "drag_force".
        settings: of the fit.
    """

    recipe: str
    closure: LearnedClosure
    data: Tree
    loss: Loss
    fit_regression: Callable[[], Predictor]
    split: Split
    targets: dict[int, str]
    settings: FitSettings

    @property
    def plan(self) -> Plan:
        """How it is trained."""
        settings = self.settings
        return Plan(self.loss, settings.batch, settings.epochs, settings.schedule)

    @property
    def network(self) -> Network:
        """What is trained."""
        return Network(self.closure.weights, self.data, self.settings.learning_rate, self.settings.seed)

    @property
    def rows(self) -> int:
        """Training rows."""
        return int(jax.tree.leaves(self.data)[0].shape[0])

    @cached_property
    def regression(self) -> Predictor:
        """The plain regression beside the network."""
        return self.fit_regression()

    def trained(self, outcome: Outcome) -> LearnedClosure:
        """The closure with trained weights."""
        return dataclasses.replace(self.closure, weights=outcome.weights)

    @property
    def kind(self) -> tuple[object, ...]:
        """Equal for problems that one compiled program can train at once."""
        names = ("hidden", "activation", "loss", "schedule", "batch", "epochs", "terms")
        shapes = [leaf.shape for leaf in jax.tree.leaves(self.data)]
        return (self.recipe, *(getattr(self.settings, name) for name in names), *shapes)

    def evaluate(self, closure: StoredClosure, datasets: Sequence[Dataset]) -> tuple[Scores, Parity]:
        """R2 and parity data of a closure, of the base law and of the regression on rows of datasets, by coarsening."""
        scores, parity = {}, {}
        base = _base_force(self.split.base)
        for coarsening in sorted({n for dataset in datasets for n in dataset.groups}):
            groups = [dataset.groups[coarsening] for dataset in datasets if coarsening in dataset.groups]
            drags = [map_rows(partial(learned_force, closure), group) for group in groups]
            forces = {
                "predicted": np.concatenate([force for force, _ in drags]),
                "target": np.concatenate([getattr(group, self.targets[coarsening]) for group in groups]),
                "base": np.concatenate([map_rows(base, group) for group in groups]),
                "regression": np.concatenate([self.regression(group) for group in groups]),
            }
            target = forces["target"]
            scores[str(coarsening)] = {
                "closure": r_squared(forces["predicted"], target),
                "base": r_squared(forces["base"], target),
                "regression": r_squared(forces["regression"], target),
                "out_of_range": float(np.mean(np.concatenate([outside for _, outside in drags]))),
                "samples": len(target),
            }
            kept = np.random.default_rng(self.settings.seed).permutation(len(target))[:PARITY_ROWS]
            parity[coarsening] = {name: values[kept] for name, values in forces.items()}
        return scores, parity

    def r2(self, closure: StoredClosure, datasets: Sequence[Dataset]) -> dict[str, float]:
        """R2 of a closure by coarsening."""
        return {coarsening: row["closure"] for coarsening, row in self.evaluate(closure, datasets)[0].items()}

    def judge(self, closure: StoredClosure, history: Sequence[float], seconds: float) -> FitResult:
        """The record of what came of the problem, judged on held-out and training rows.

        Args:
            closure: trained.
            history: loss of every epoch.
            seconds: that the training took.
        """
        split = self.split
        r2, parity = self.evaluate(closure, split.held_out)
        r2_train, _ = self.evaluate(closure, [thin(dataset) for dataset in split.train])
        metadata = {
            "recipe": self.recipe,
            "base_law": split.train[0].drag,
            "datasets": list(dict.fromkeys(d.run for d in (*split.train, *split.held_out))),
            "split": split.text,
            "settings": self.settings.as_plain(),
            "samples": self.rows,
            "seed": self.settings.seed,
            "seconds": seconds,
            "loss_history": list(history),
            "r2": r2,
            "r2_train": r2_train,
        }
        return FitResult(closure, metadata, parity, split.text)


@cache
def _base_force(law: Correlation) -> Callable[[DragInputs], Array]:
    """Force (M, D) [N] of a correlation, compiled."""
    return jax.jit(lambda inputs: law(inputs).coefficient[:, None] * inputs.slip_velocity)


def solve(problems: Sequence[Problem], progress: Progress | None = None, mapped: bool | None = None) -> list[Outcome]:
    """Train the networks of problems of one kind at once; raises ValueError for problems of several kinds.

    `mapped` is that of `minimize`.
    """
    if len({problem.kind for problem in problems}) > 1:
        raise ValueError("problems of different kinds cannot be trained at once")
    return minimize(problems[0].plan, [problem.network for problem in problems], progress, mapped)


def solve_all(problems: Sequence[Problem], progress: Progress | None, since: float) -> list[Outcome]:
    """`solve`; raises RunError where a loss is not finite. `since` is when the work began, by `perf_counter`."""
    outcomes = solve(problems, progress)
    for outcome in outcomes:
        if outcome.diverged:
            where, remedy = (
                f"epoch {len(outcome.history)}",
                "Lower the learning rate, or look for outliers in the dataset's forces.",
            )
            reason = f"the training loss is {outcome.history[-1]}, not finite"
            raise RunError(reason, where, time.perf_counter() - since, remedy)
    return outcomes


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


def normalised(values: Forces, mean: Array, scale: Array) -> Array:
    """(M, K) less mean, by scale (K,), in single precision."""
    return on_device((values - np.asarray(mean, np.float64)[None]) / np.asarray(scale, np.float64)[None])


def on_device(values: Forces) -> Array:
    """A JAX array in single precision."""
    return jnp.asarray(values, jnp.float32)
