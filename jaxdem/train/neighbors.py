"""Train a closure of neighbours on forces of particle-resolved arrays of spheres."""

from __future__ import annotations

import dataclasses
import os
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from jaxdem.closures.neighbors import NeighborClosure
from jaxdem.train.fit_loop import Progress
from jaxdem.train.level_fit import fitted
from jaxdem.train.neighbor_scores import scores
from jaxdem.train.neighbor_settings import SIZES, NeighborSettings
from jaxdem.train.neighbor_statistics import with_mean, with_scale
from jaxdem.train.sphere_moments import group_moments, linear_fit, predicted, targets_of, with_carried
from jaxdem.train.spheres import SphereGroup, read_spheres


class Trained(NamedTuple):
    """A closure, and what its file keeps of the training."""

    closure: NeighborClosure
    metadata: dict[str, Any]


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
