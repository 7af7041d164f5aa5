"""Training an ensemble: networks that differ in their seed, at once, and whether their spread says where they err."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence
from functools import partial

import jax
import numpy as np
from jax import Array

from jaxdem.closures.base import DragInputs
from jaxdem.closures.ensemble import EnsembleClosure
from jaxdem.closures.file import LearnedClosure, StoredClosure
from jaxdem.errors import InputError, is_whole
from jaxdem.train.dataset_file import Dataset
from jaxdem.train.fit import RECIPES
from jaxdem.train.fit_evaluate import learned_force, map_rows
from jaxdem.train.fit_loop import Progress
from jaxdem.train.fit_problem import FitResult, Problem, solve_all
from jaxdem.train.fit_settings import FitSettings


def one_of(closure: StoredClosure) -> LearnedClosure:
    """The closure itself, or the stacked members of an ensemble: kind, layers and terms."""
    return closure.members if isinstance(closure, EnsembleClosure) else closure


def fit_ensemble(
    datasets: Sequence[Dataset],
    recipe: str,
    settings: FitSettings,
    members: int,
    progress: Progress | None = None,
) -> FitResult:
    """Train networks of consecutive seeds at once and put them together as an `EnsembleClosure`.

    Each draws its initial weights, its rows (where there are more than `settings.samples`) and its order from its own
    seed.

    Args:
        datasets: see `jaxdem.train.fit`.
        recipe: "paper" or "filtered".
        settings: of all; the first member has their seed.
        members: at least 2.
        progress: see `Progress`.

    Returns:
        The ensemble, judged as a whole; its metadata has `members`, `r2_members` (by coarsening, of each) and
        `spread` (by coarsening on held-out rows: the root mean squares of spread and of error over that of the
        force, and the part of the rows whose error is less than two spreads).

    Raises:
        InputError: fewer than two members, datasets that do not fit together or cannot be split.
        RunError: the loss of a member becomes non-finite.
    """
    if not is_whole(members) or members < 2:
        raise InputError("--ensemble", members, "needs at least two members", "For example --ensemble 5.")
    started = time.perf_counter()
    make: Callable[..., Problem] = RECIPES[recipe]
    problems = [make(datasets, dataclasses.replace(settings, seed=settings.seed + n)) for n in range(members)]
    outcomes = solve_all(problems, progress, started)
    elapsed = time.perf_counter() - started
    closures = [problem.trained(outcome) for problem, outcome in zip(problems, outcomes, strict=True)]
    history = np.mean([outcome.history for outcome in outcomes], axis=0).tolist()
    return put_together(problems[0], closures, history, elapsed)


def put_together(
    problem: Problem, closures: Sequence[LearnedClosure], history: list[float], elapsed: float
) -> FitResult:
    """Closures that differ in their seed as one, judged on held-out rows; see `fit_ensemble`.

    Args:
        problem: that the first was trained on.
        closures: the members.
        history: their mean loss by epoch.
        elapsed: time of their training [s].
    """
    ensemble = EnsembleClosure.of(closures)
    result = problem.judge(ensemble, history, elapsed)
    alone = [problem.r2(closure, problem.split.held_out) for closure in closures]
    result.metadata["members"] = len(closures)
    result.metadata["r2_members"] = {n: [scores[n] for scores in alone] for n in alone[0]}
    result.metadata["spread"] = {n: _calibration(ensemble, problem, int(n)) for n in alone[0]}
    return result


@jax.jit
def _spread(ensemble: EnsembleClosure, inputs: DragInputs) -> Array:
    return ensemble.spread(inputs)


def _calibration(ensemble: EnsembleClosure, problem: Problem, coarsening: int) -> dict[str, float]:
    """Spread and error on the held-out rows of a coarsening."""
    groups = [d.groups[coarsening] for d in problem.split.held_out if coarsening in d.groups]
    spread = np.concatenate([map_rows(partial(_spread, ensemble), group) for group in groups])
    force = np.concatenate([map_rows(partial(learned_force, ensemble), group)[0] for group in groups])
    target = np.concatenate([getattr(group, problem.targets[coarsening]) for group in groups])
    error = np.linalg.norm(force - target, axis=1)
    size = np.sqrt(np.mean(np.sum(target**2, axis=1)))
    return {
        "spread": float(np.sqrt(np.mean(spread.astype(np.float64) ** 2)) / size),
        "error": float(np.sqrt(np.mean(error**2)) / size),
        "within_two_spreads": float(np.mean(error < 2.0 * spread)),
    }
