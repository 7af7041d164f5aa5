"""Fit a learned drag closure to datasets: the source paper's recipe and the one on filtered inputs."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from jaxdem.train.dataset_file import Dataset
from jaxdem.train.fit_loop import Progress
from jaxdem.train.fit_problem import FitResult, Problem, solve_all
from jaxdem.train.fit_settings import FitSettings
from jaxdem.train.recipe_filtered import filtered_problem
from jaxdem.train.recipe_paper import paper_problem

__all__ = [
    "RECIPES",
    "FitResult",
    "FitSettings",
    "fit_filtered",
    "fit_paper",
]


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


RECIPES: dict[str, Callable[..., Problem]] = {
    "paper": paper_problem,
    "filtered": filtered_problem,
}
"""What recipes make of datasets, settings and, if given, a closure to start from, by name."""
