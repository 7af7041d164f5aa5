"""Training of one level of a closure of neighbours."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.closures.neighbor_level import Level
from jaxdem.closures.neighbor_range import CONDITIONS
from jaxdem.closures.neighbors import NeighborClosure
from jaxdem.errors import RunError
from jaxdem.train.fit_loop import Network, Plan, Progress, minimize
from jaxdem.train.neighbor_settings import NeighborSettings
from jaxdem.train.neighbor_statistics import PARTS, SMALLEST_SCATTER, known_of, scatter_of, terms_of
from jaxdem.train.sphere_moments import targets_of
from jaxdem.train.spheres import Floats, SphereGroup

WHITENED = 1e-6
"""Combinations of moments whose variance is a smaller part of the largest are left out."""


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


def level_loss(level: Level, rows: Rows) -> Array:
    """Mean square of the errors of a level over the variances of their groups, of force and torque."""
    found = level.values(level.mixed(rows.moments), rows.known)
    return jnp.mean(((found - rows.target) * rows.precision) ** 2)


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
        scatter = np.maximum(scatter_of(found), SMALLEST_SCATTER)
        precision.append(np.broadcast_to(np.repeat(scale / scatter, PARTS), whole.shape))
        known.append(np.broadcast_to(flow, (len(whole), CONDITIONS)))
    rest = (np.concatenate(part) for part in (known, target, precision))
    return Rows(tuple(map(jnp.asarray, whitened)), *(jnp.asarray(part, jnp.float32) for part in rest))
