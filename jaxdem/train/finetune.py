"""Training closures through the solver: unrolled coarse runs that are to have the statistics of a fine one.

A coarse run is started from a frame of the reference, unrolled for some outputs, and its observables (front, height,
mean drag, profiles; `jaxdem.train.observables`) are compared with the reference's at those times (`Unrolled` has the
loss). Single trajectories diverge chaotically, so they are not compared, and horizons grow from short to long. Trained
are the weights of the drag closure, of the subgrid stress, or of both at once; with a subgrid stress in the run the
fluid is compared too. The gradient goes through the whole coupled step by `jaxdem.rollout`. A gradient-free search on
a few of the parameters stands beside it as a baseline.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable
from functools import reduce
from operator import or_
from pathlib import Path
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax import Array
from scipy.optimize import minimize

from jaxdem.errors import InputError, RunError, is_whole, require_whole, sentence
from jaxdem.failures import first_meaning
from jaxdem.io import load_run
from jaxdem.scene import Scene
from jaxdem.train.closures import Closures, Weights, few_parameters
from jaxdem.train.fit_loop import Tree
from jaxdem.train.reference import CoarseCase, follow
from jaxdem.train.unrolled import Unrolled

Progress = Callable[[int, int, float], None]
"""progress(updates done, updates in all, loss)."""

PATIENCE = 5
"""So many updates in a row without a finite gradient end the training."""

MEMORY = 0.95
"""Adam's decay of squared gradients: a training has tens of updates, and its first gradients are the largest."""

USUAL_HORIZONS = (1, 2, 4, 8)


@dataclasses.dataclass(frozen=True)
class FinetuneSettings:
    """How to train through the solver.

    Attributes:
        horizons: outputs of the reference that a run is unrolled for, stage by stage; None means 1, 2, 4 and 8, as
            far as the reference goes.
        updates: of each stage; a gradient-free search has as many evaluations in all.
        starts: start times in a stage, evenly over the reference; an update takes one of them.
        method: "gradient" (Adam) or "gradient-free" (Nelder-Mead at the longest horizon).
        parameters: "all" weights, or "few": a shift of every output and one factor on each network's last layer,
            where that is not zero.
            A gradient-free search always has few.
        learning_rate: of Adam, which falls to a twentieth along a cosine.
        largest_gradient: global norm that a gradient is clipped to.
        seed: of the order of the start times.
    """

    horizons: tuple[int, ...] | None = None
    updates: int = 10
    starts: int = 4
    method: Literal["gradient", "gradient-free"] = "gradient"
    parameters: Literal["all", "few"] = "all"
    learning_rate: float = 3e-3
    largest_gradient: float = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        """Raise InputError for a setting out of its range."""
        require_whole(self, ("updates", "starts"), 1)
        require_whole(self, ("seed",), 0)
        for name in ("learning_rate", "largest_gradient"):
            if not getattr(self, name) > 0:
                raise InputError(name, getattr(self, name), "must be positive", "Raise it.")
        if self.horizons is not None and not (self.horizons and all(is_whole(n) and n >= 1 for n in self.horizons)):
            limit = "needs at least one output in each stage"
            raise InputError("--horizons", self.horizons, limit, "For example 1,2,4.")

    def stages(self, outputs: int) -> tuple[int, ...]:
        """The horizons for a reference with so many outputs after its first.

        Raises:
            InputError: one is longer than the reference.
        """
        if self.horizons is None:
            return tuple(horizon for horizon in USUAL_HORIZONS if horizon <= max(1, outputs - 1))
        if max(self.horizons) > outputs:
            limit = f"the reference has {outputs} outputs after its first"
            raise InputError("--horizons", self.horizons, limit, "Shorten them, or run the reference on.")
        return self.horizons


@dataclasses.dataclass(frozen=True)
class FinetuneResult:
    """What a training gave.

    Attributes:
        closures: the best at the longest horizon, those given included.
        metadata: for the file of each that was trained, by its name.
        stopped: why the training ended early; empty if it did not.
    """

    closures: Closures
    metadata: dict[str, dict[str, Any]]
    stopped: str


def finetune(
    scene: Scene,
    reference: str | Path,
    closures: Closures,
    metadata: dict[str, dict[str, Any]],
    settings: FinetuneSettings | None = None,
    progress: Progress | None = None,
) -> FinetuneResult:
    """Train closures through runs of a coarse scene that follow a reference.

    Runs over the longest horizon from the reference's first frame and from the last that leaves room for them decide
    which weights are kept; no update starts there (unless there is no other frame to start from).

    Args:
        scene: coarse scene; its drag law, closure and subgrid stress are replaced where one is given.
        reference: run directory of a finer run of the same scene.
        closures: to start from.
        metadata: of the file of each that is trained, by its name.
        settings: see `FinetuneSettings`.
        progress: see `Progress`.

    Raises:
        InputError: scene and reference do not fit together.
        RunError: the run cannot be unrolled with the closures that were given.
    """
    settings = settings or FinetuneSettings()
    began = time.perf_counter()
    closures.check()
    case = follow(scene, load_run(reference), closures)
    stages = settings.stages(case.run.number_of_frames - 1)
    training = Training(case, closures, settings, stages)
    stopped = training.run(progress)
    record = training.record() | {
        "reference": Path(reference).name,
        "scene_toml": scene.to_toml(),
        "trained": list(closures.trained),
        "settings": dataclasses.asdict(settings) | {"horizons": list(stages)},
        "seconds": time.perf_counter() - began,
        "stopped": stopped,
    }
    written = {}
    for name in closures.trained:
        before = metadata.get(name, {})
        written[name] = before | {"recipe": "finetune", "before": before, "finetune": record}
    return FinetuneResult(closures.with_weights(training.best), written, stopped)


class Training:
    """One training: which weights it tries, and the best so far."""

    def __init__(self, case: CoarseCase, closures: Closures, settings: FinetuneSettings, stages: tuple[int, ...]):
        self.unrolled = Unrolled(case, closures, max(stages))
        self.settings, self.stages = settings, stages
        self.best = closures.weights
        self.validation: list[float] = []
        self.losses: list[float] = []
        self.skipped = 0
        few = settings.parameters == "few" or settings.method == "gradient-free"
        self.variables: Tree = closures.weights
        self.weights_of: Callable[[Tree], Weights] = lambda weights: weights
        if few:
            self.variables, weights_of = few_parameters(closures)
            self.weights_of = jax.jit(weights_of)
        self._slopes_of = jax.jit(lambda at, slopes: jax.vjp(self.weights_of, at)[1](slopes)[0])

    def run(self, progress: Progress | None) -> str:
        """Train; returns why it ended early, or nothing.

        Raises:
            RunError: the run with the closure given fails by itself.
        """
        value, code = self._held_out_loss(self.best)
        if code or not math.isfinite(value):
            not_finite = ("its loss is not finite", "Check that a plain run with this closure works.")
            reason, remedy = first_meaning(code) if code else not_finite
            raise RunError(reason, f"run with the closures as given, {max(self.stages)} outputs", 0.0, remedy)
        self.validation.append(value)
        return self._by_gradient(progress) if self.settings.method == "gradient" else self._by_search(progress)

    def record(self) -> dict[str, Any]:
        """What happened, for the metadata."""
        return {
            "validation_loss_before": self.validation[0],
            "validation_loss": min(self.validation),
            "validation_history": self.validation,
            "loss_history": self.losses,
            "skipped": self.skipped,
            "forward_runs": self.unrolled.forward_runs,
            "neighbor_resizes": self.unrolled.resizes,
        }

    def starts(self, outputs: int) -> list[int]:
        """Frames that runs over so many outputs start from; not those that the validation has."""
        frames = [frame for frame in range(1, self._last_start(outputs) + 1) if frame not in self.held_out]
        if not frames:
            return [0]
        places = np.linspace(0, len(frames) - 1, min(self.settings.starts, len(frames)))
        return [frames[round(place)] for place in places]

    @property
    def held_out(self) -> list[int]:
        """Frames that the validation starts from: the first alone would be judged by the start-up."""
        last = self._last_start(max(self.stages))
        return [0, last] if last > 1 else [0]

    def _last_start(self, outputs: int) -> int:
        """The last frame that leaves room for so many outputs."""
        return self.unrolled.case.run.number_of_frames - 1 - outputs

    def _held_out_loss(self, weights: Weights) -> tuple[float, int]:
        """Mean loss of the validation, and the failure flags of its runs."""
        values, codes = zip(*(self.unrolled.loss(weights, n, max(self.stages)) for n in self.held_out), strict=True)
        return float(np.mean(values)), reduce(or_, codes)

    def _by_gradient(self, progress: Progress | None) -> str:
        settings = self.settings
        rate = optax.cosine_decay_schedule(settings.learning_rate, settings.updates * len(self.stages), alpha=0.05)
        optimizer = optax.chain(optax.clip_by_global_norm(settings.largest_gradient), optax.adam(rate, b2=MEMORY))

        @jax.jit
        def update_of(variables: Tree, state: Tree, slopes: Tree) -> tuple[Tree, Tree, Array]:
            """Variables and state of the optimiser after an update, and the norm of the gradient."""
            changes, state = optimizer.update(slopes, state)
            return optax.apply_updates(variables, changes), state, optax.tree.norm(slopes)

        variables, state = self.variables, jax.jit(optimizer.init)(self.variables)
        generator, in_a_row = np.random.default_rng(settings.seed), 0
        for horizon in self.stages:
            starts = self.starts(horizon)
            for update in range(settings.updates):
                if update % len(starts) == 0:
                    order = generator.permutation(starts)
                value, code, slopes = self._slope(variables, int(order[update % len(starts)]), horizon)
                changed, changed_state, size = update_of(variables, state, slopes)
                sound = code == 0 and math.isfinite(value) and math.isfinite(float(size))
                in_a_row = 0 if sound else in_a_row + 1
                self.skipped += not sound
                if in_a_row == PATIENCE:
                    return _no_gradient(code, horizon)
                if sound:
                    variables, state = changed, changed_state
                self.losses.append(value)
                self._report(progress, value)
            self._validate(variables)
        return ""

    def _slope(self, variables: Tree, index: int, horizon: int) -> tuple[float, int, Tree]:
        """Loss, flags and gradient by the variables."""
        value, code, slopes = self.unrolled.slope(self.weights_of(variables), index, horizon)
        return value, code, self._slopes_of(variables, slopes)

    def _by_search(self, progress: Progress | None) -> str:
        horizon = max(self.stages)
        starts = self.starts(horizon)

        def mean_loss(point: np.ndarray) -> float:
            results = [self.unrolled.loss(self._moved(point), index, horizon) for index in starts]
            sound = all(code == 0 and math.isfinite(value) for value, code in results)
            self.skipped += not sound
            self.losses.append(float(np.mean([value for value, _ in results])) if sound else math.inf)
            self._report(progress, self.losses[-1])
            return self.losses[-1]

        size = len(self.variables)
        simplex = np.concatenate([np.zeros((1, size)), 0.2 * np.eye(size)])
        budget = self.settings.updates * len(self.stages)
        found = minimize(
            mean_loss, np.zeros(size), method="Nelder-Mead",
            options={"maxfev": budget, "initial_simplex": simplex, "xatol": 1e-3, "fatol": 0.0},
        )  # fmt: skip
        self._validate(jnp.asarray(found.x, self.variables.dtype))
        return ""

    def _moved(self, point: np.ndarray) -> Weights:
        return self.weights_of(jnp.asarray(point, self.variables.dtype))

    def _validate(self, variables: Tree) -> None:
        """Keeps these variables if they are the best so far at the longest horizon."""
        weights = self.weights_of(variables)
        value, code = self._held_out_loss(weights)
        sound = code == 0 and math.isfinite(value)
        if sound and value < min(self.validation):
            self.best = weights
        self.validation.append(value if sound else math.inf)

    def _report(self, progress: Progress | None, value: float) -> None:
        if progress is not None:
            progress(len(self.losses), self.settings.updates * len(self.stages), value)


def _no_gradient(code: int, horizon: int) -> str:
    not_finite = ("the gradient is not finite", "Lower the learning rate or the horizons.")
    reason, remedy = first_meaning(code) if code else not_finite
    return f"{PATIENCE} updates in a row over {horizon} outputs failed: {reason}. {sentence(remedy)}"
