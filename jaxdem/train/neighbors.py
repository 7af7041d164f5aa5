"""Train a closure of neighbours on forces of particle-resolved arrays of spheres."""

from __future__ import annotations

import dataclasses
import itertools
import math
import os
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.closures.moments import MomentBasis
from jaxdem.closures.neighbors import CONDITIONS, LARGE, Level, NeighborClosure, Width, conditions, quartic
from jaxdem.errors import InputError, RunError, require_whole
from jaxdem.train.fit_loop import Network, Plan, Progress, minimize
from jaxdem.train.neighbor_scores import scores
from jaxdem.train.sphere_moments import Targets, group_moments, linear_fit, predicted, targets_of, with_carried
from jaxdem.train.spheres import RANDOM_SIDE, Floats, SphereGroup, random_group, read_spheres

WHITENED = 1e-6
"""Combinations of moments whose variance is a smaller part of the largest are left out."""


SMALLEST_SCATTER = 1e-6
"""Floor of the scatter of a force over the mean force, for forces that have none."""
PARTS = (1, 2, 1, 2)
"""Components of force along, force across, torque about and torque across."""


class Size(NamedTuple):
    """How large a closure is.

    Attributes:
        basis, carried, widths, wake: see `NeighborClosure.initial`.
    """

    basis: MomentBasis
    carried: MomentBasis | None
    widths: tuple[Width, ...]
    wake: MomentBasis | None = None


SIZES = {
    "large": Size(
        MomentBasis(4.45, 10, 6, 3),
        MomentBasis(4.45, 6, 4, 2),
        (LARGE, LARGE._replace(scalars=124)),
        MomentBasis(2.0, 6, 4, 1, stretch=3.0, decay=6),
    ),
    "medium": Size(MomentBasis(4.45, 10, 6, 3), None, (LARGE,)),
    "short": Size(MomentBasis(3.25, 7, 5, 3), None, (Width(48, 12, (64, 64)),)),
    "small": Size(MomentBasis(2.5, 6, 4, 3), None, (Width(24, 8, (32, 32)),)),
}
"""The sizes by name; docs/results/neighbours.md compares errors and costs."""


@dataclasses.dataclass(frozen=True)
class NeighborSettings:
    """How to train.

    Attributes:
        size: a name of `SIZES`.
        hidden: widths of the hidden layers; None means those of the size.
        learning_rate: of Adamax, falling to a hundredth along a cosine.
        batch: spheres in a batch.
        epochs: passes through the data.
        samples: largest number of spheres to train on, drawn by whole arrays; None means all.
        held_out_fraction: part of the arrays of every group that is held out.
        seed: of initial weights, held-out arrays and shuffling.
    """

    size: str = "large"
    hidden: tuple[int, ...] | None = None
    learning_rate: float = 6e-3
    batch: int = 1000
    epochs: int = 40
    samples: int | None = None
    held_out_fraction: float = 0.1
    seed: int = 0

    def __post_init__(self) -> None:
        """Raise InputError for a setting out of its range."""
        if self.size not in SIZES:
            raise InputError("size", self.size, "is not known", f"Use one of {', '.join(SIZES)}.")
        require_whole(self, ("batch", "epochs", "samples", "hidden"), 1)
        require_whole(self, ("seed",), 0)
        if not self.learning_rate > 0:
            raise InputError("learning_rate", self.learning_rate, "must be positive", "Raise it.")
        if not 0 < self.held_out_fraction < 1:
            raise InputError("held_out_fraction", self.held_out_fraction, "must lie in (0, 1)", "Use 0.1.")


class Rows(NamedTuple):
    """Spheres to train on.

    Attributes:
        moments: of every order (S, P, C), whitened.
        known: (S, 3) see `conditions`.
        target: (S, 6) see `Level.values`.
        precision: (S, 6) one over the deviations of these in the sphere's group.
    """

    moments: tuple[Array, ...]
    known: Array
    target: Array
    precision: Array


class Trained(NamedTuple):
    """A closure, and what its file keeps of the training."""

    closure: NeighborClosure
    metadata: dict[str, Any]


def level_loss(level: Level, rows: Rows) -> Array:
    """Mean square of the errors of a level over the variances of their groups, of force and torque."""
    found = level.values(level.mixed(rows.moments), rows.known)
    return jnp.mean(((found - rows.target) * rows.precision) ** 2)


def fit_neighbors(
    path: str | os.PathLike[str], settings: NeighborSettings, progress: Progress | None = None
) -> Trained:
    """Train a `NeighborClosure` and judge it on arrays that it has not seen.

    The metadata have `recipe`, `data`, `settings`, `r2` (see `scores`, of closure and of the least squares of pairwise
    terms), `mean_factor` and `seconds`.

    Args:
        path: see `read_spheres`.
        settings: of the training.
        progress: see `Progress`.

    Raises:
        InputError: the file is not of the layout.
        RunError: the loss becomes something else than a finite number.
    """
    started, size = time.perf_counter(), SIZES[settings.size]
    fresh = initial_closure(settings)
    groups = read_spheres(path, fresh.half_box)
    split = [group.split(settings.held_out_fraction, settings.seed) for group in groups]
    train = [fewer(one, settings.samples, groups, settings.seed) for one, _ in split]
    test = [other for _, other in split]
    values, judged = ([group_moments(size.basis, group, size.wake) for group in some] for some in (train, test))
    linear = [linear_fit(*fit) for fit in zip(values, map(targets_of, train), judged, strict=True)]
    closure, history = with_scale(fresh, train), []
    for number in range(len(closure.levels)):
        report = _of_level(progress, number, len(closure.levels))
        closure, losses = fitted(closure, number, train, values, settings, report)
        history.append(losses)
        if size.carried is not None and number == 0:
            values = [with_carried(closure, *one) for one in zip(train, values, strict=True)]
            judged = [with_carried(closure, *one) for one in zip(test, judged, strict=True)]
    closure = with_mean(closure, train, values)
    learned = [predicted(closure, *one) for one in zip(test, judged, strict=True)]
    metadata = {
        "recipe": "neighbours",
        "data": os.path.basename(path),
        "settings": dataclasses.asdict(settings),
        "spheres": sum(len(group.position) for group in train),
        "r2": scores(test, learned, groups),
        "r2_linear": scores(test, linear, groups),
        "loss": history,
        "seconds": time.perf_counter() - started,
    }
    return Trained(closure, metadata)


def initial_closure(settings: NeighborSettings) -> NeighborClosure:
    """Random weights."""
    basis, carried, widths, wake = SIZES[settings.size]
    if settings.hidden is not None:
        widths = tuple(width._replace(hidden=settings.hidden) for width in widths)
    return NeighborClosure.initial(basis, carried, widths, settings.seed, wake=wake)


def _of_level(progress: Progress | None, number: int, levels: int) -> Progress | None:
    """Progress of all levels together, from that of one."""
    if progress is None:
        return None
    return lambda epoch, epochs, loss: progress(number * epochs + epoch, levels * epochs, loss)


def fewer(group: SphereGroup, samples: int | None, groups: Sequence[SphereGroup], seed: int) -> SphereGroup:
    """As many whole arrays of a group as make its share of the samples, one at least."""
    total = sum(len(one.position) for one in groups)
    if samples is None or samples >= total:
        return group
    wanted = max(1, round(group.arrays * samples / total))
    chosen = np.random.default_rng(seed).permutation(group.arrays)[:wanted]
    return group.select(np.sort(chosen))


def fitted(
    closure: NeighborClosure,
    number: int,
    groups: Sequence[SphereGroup],
    values: Sequence[tuple[Floats, ...]],
    settings: NeighborSettings,
    progress: Progress | None = None,
    goes_on: bool = False,
) -> tuple[NeighborClosure, list[float]]:
    """The closure after training one of its levels, and the loss by epoch.

    The moments are whitened, a combination of unit variance for each input: then all combinations learn at one rate.
    What is trained mixes these, and the transformation becomes a part of the level's mixing afterwards.

    Args:
        closure: to start from.
        number: of the level, from 0.
        groups: of spheres.
        values: their moments.
        settings: of the training.
        progress: see `Progress`.
        goes_on: whether the level has been trained; else its mixing is drawn anew, for whitened moments.

    Raises:
        RunError: the loss becomes something else than a finite number.
    """
    level = closure.levels[number]
    transforms = [_whitening([one[order] for one in values]) for order in range(len(level.mixing))]
    rows = _rows(closure, groups, values, transforms)
    inverse = [np.linalg.pinv(matrix) for matrix, _ in transforms]
    start = _in_terms_of(level, inverse, transforms[0][1]) if goes_on else _drawn(level, transforms, settings.seed)
    network = Network(start, rows, settings.learning_rate, settings.seed)
    plan = Plan(level_loss, settings.batch, settings.epochs, "cosine")
    outcome = minimize(plan, [network], progress)[0]
    if outcome.diverged:
        place = f"epoch {len(outcome.history)}"
        raise RunError("the loss is not finite", place, math.nan, "Lower the learning rate.")
    matrices = [matrix for matrix, _ in transforms]
    trained = _in_terms_of(outcome.weights, matrices, -transforms[0][1] @ matrices[0])
    levels = (*closure.levels[:number], trained, *closure.levels[number + 1 :])
    return dataclasses.replace(closure, levels=levels), outcome.history


def _drawn(level: Level, transforms: Sequence[tuple[np.ndarray, np.ndarray]], seed: int) -> Level:
    """The level with random mixing of whitened moments."""
    counts = [matrix.shape[1] for matrix, _ in transforms]
    return dataclasses.replace(level, mixing=Level.initial(counts, level.width, seed).mixing)


def _in_terms_of(level: Level, matrices: Sequence[np.ndarray], middle: np.ndarray) -> Level:
    """The level of other moments, of which its own are products with the matrices; those of order zero also have
    `middle` less."""
    mixing = [matrix @ np.asarray(mixed, np.float64) for matrix, mixed in zip(matrices, level.mixing, strict=True)]
    offset = np.asarray(level.offset) + middle @ np.asarray(level.mixing[0], np.float64)
    return dataclasses.replace(
        level,
        mixing=tuple(jnp.asarray(matrix, jnp.float32) for matrix in mixing),
        offset=jnp.asarray(offset, jnp.float32),
    )


def with_mean(
    closure: NeighborClosure, groups: Sequence[SphereGroup], values: Sequence[tuple[Floats, ...]]
) -> NeighborClosure:
    """The closure whose mean over these arrays is zero at their Re and solid fraction, as near as `mean` can do it.

    Between the solid fractions of the data the mean is that of random arrays, see `between`; between the Reynolds
    numbers it changes by less than a hundredth.
    """
    random = between(groups, closure.half_box)
    groups = [*groups, *random]
    values = [
        *values,
        *(with_carried(closure, group, group_moments(closure.basis, group, closure.wake)) for group in random),
    ]
    bare = dataclasses.replace(closure, mean=jnp.zeros(8, jnp.float32))
    means = [predicted(bare, *one).along.mean(dtype=np.float64) for one in zip(groups, values, strict=True)]
    factors = np.linalg.lstsq(terms_of(groups), np.asarray(means), rcond=None)[0]
    return dataclasses.replace(closure, mean=jnp.asarray(factors, jnp.float32))


def between(groups: Sequence[SphereGroup], reach: float) -> list[SphereGroup]:
    """Random arrays at the solid fractions in the middle between those of the groups, at their Reynolds numbers."""
    fractions = sorted({group.solid_fraction for group in groups})
    middles = [0.5 * (one + other) for one, other in itertools.pairwise(fractions)]
    flows = sorted({group.reynolds for group in groups})
    return [random_group(flow, middle, max(RANDOM_SIDE, 2.0 * reach)) for middle in middles for flow in flows]


def with_scale(closure: NeighborClosure, groups: Sequence[SphereGroup]) -> NeighborClosure:
    """The closure with the scatter of these groups."""
    scatter = [_scatter(targets_of(group)) for group in groups]
    factors = np.linalg.lstsq(terms_of(groups)[:, :6], np.log(np.maximum(scatter, SMALLEST_SCATTER)), rcond=None)[0]
    return dataclasses.replace(closure, scale=jnp.asarray(factors.T, jnp.float32))


def _scatter(found: Targets) -> list[float]:
    """Of force along, force across, torque about and torque across."""
    parts = (found.along, found.across, found.torque[:, 0], found.torque[:, 1:])
    return [float(np.std(part)) for part in parts]


def known_of(groups: Sequence[SphereGroup]) -> np.ndarray:
    """(groups, 3) `conditions` of their flows."""
    flows = ([group.reynolds for group in groups], [group.solid_fraction for group in groups])
    return np.asarray(conditions(*(jnp.asarray(flow, jnp.float32) for flow in flows)))


def terms_of(groups: Sequence[SphereGroup]) -> np.ndarray:
    """(groups, 8) `quartic` terms of their flows."""
    return np.asarray(quartic(jnp.asarray(known_of(groups))), np.float64)


def _whitening(parts: Sequence[Floats]) -> tuple[np.ndarray, np.ndarray]:
    """(C, K) transformation to K combinations of unit variance, and the mean (C,), zero for orders above zero."""
    stacked = np.concatenate([part[:: max(1, len(part) // 4000)] for part in parts]).astype(np.float64)
    mean = stacked.mean(axis=(0, 1)) if stacked.shape[1] == 1 else np.zeros(stacked.shape[2])
    flat = (stacked - mean).reshape(-1, stacked.shape[2])
    unit = np.sqrt(np.mean(flat**2, axis=0))
    variance, directions = np.linalg.eigh((flat / unit).T @ (flat / unit) / len(flat))
    kept = variance > WHITENED * variance[-1]
    return directions[:, kept] / np.sqrt(variance[kept]) / unit[:, None], mean


def _rows(
    closure: NeighborClosure,
    groups: Sequence[SphereGroup],
    values: Sequence[tuple[Floats, ...]],
    transforms: Sequence[tuple[np.ndarray, np.ndarray]],
) -> Rows:
    """Everything that the loss sees of the spheres."""
    whitened = tuple(
        np.concatenate([(one[order] - mean).astype(np.float32) @ matrix.astype(np.float32) for one in values])
        for order, (matrix, mean) in enumerate(transforms)
    )
    scales = np.exp(terms_of(groups)[:, :6] @ np.asarray(closure.scale, np.float64).T)
    target, precision, known = [], [], []
    for group, scale, flow in zip(groups, scales, known_of(groups), strict=True):
        found = targets_of(group)
        whole = np.concatenate([found.along[:, None], found.across, found.torque], axis=1)
        target.append(whole / np.repeat(scale, PARTS))
        scatter = np.maximum(_scatter(found), SMALLEST_SCATTER)
        precision.append(np.broadcast_to(np.repeat(scale / scatter, PARTS), whole.shape))
        known.append(np.broadcast_to(flow, (len(whole), CONDITIONS)))
    rest = (np.concatenate(part) for part in (known, target, precision))
    return Rows(tuple(map(jnp.asarray, whitened)), *(jnp.asarray(part, jnp.float32) for part in rest))
