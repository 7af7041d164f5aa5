"""How much of the fluctuations of forces on spheres a closure of neighbours explains."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxdem.closures.neighbors import NeighborClosure
from jaxdem.train.sphere_moments import Targets, group_moments, predicted, targets_of, with_carried
from jaxdem.train.spheres import SphereGroup, read_spheres

QUANTITIES = ("along", "across", "torque")
"""Force along the stream, force across it, torque across it."""


def evaluate_neighbours(closure: NeighborClosure, path: str | os.PathLike[str]) -> dict[str, dict[str, Any]]:
    """Compare a closure of neighbours with forces of particle-resolved simulations, all arrays of a file.

    Args:
        closure: from `load_closure`.
        path: see `read_spheres`.

    Returns:
        See `scores`.

    Raises:
        InputError: the file is not of the layout.
    """
    groups = read_spheres(path, closure.half_box)
    values = [with_carried(closure, group, group_moments(closure.basis, group, closure.wake)) for group in groups]
    return scores(groups, [predicted(closure, *one) for one in zip(groups, values, strict=True)])


def scores(
    groups: Sequence[SphereGroup], found: Sequence[Targets], whole: Sequence[SphereGroup] | None = None
) -> dict[str, dict[str, Any]]:
    """R2 of the fluctuations about the mean force of each group, by group, and "all" with their means.

    R2 = 1 - sum (found - data)^2 / sum data^2, data the force less the mean of its group, over the spheres and, across,
    over the two components. The scatter of the forces differs by a factor of ten among the groups, so that "all" is the
    mean of the R2 and not the R2 of all spheres.

    Args:
        groups: spheres with their forces.
        found: fluctuations that a closure gives for them.
        whole: the groups that these are parts of; the groups themselves if None.

    Returns:
        By the name of the group, or "all": `reynolds`, `solid_fraction`, `arrays`, `spheres`; `along`, `across`,
        `torque`, `torque_along`: R2 of the force along and across the stream, of the torque across and about it;
        `mean_factor`: one plus the mean of the fluctuation along the stream, over the mean force; `data_factor`: what
        it is to be, the mean force of these arrays over that of the whole group.
    """
    table: dict[str, dict[str, Any]] = {}
    for group, given, all_of_it in zip(groups, found, groups if whole is None else whole, strict=True):
        data = targets_of(group)
        means = [one.force[:, 0].mean(dtype=np.float64) for one in (group, all_of_it)]
        table[group.name] = {
            "reynolds": group.reynolds,
            "solid_fraction": group.solid_fraction,
            "arrays": group.arrays,
            "spheres": len(group.position),
            "along": _r2(data.along, given.along),
            "across": _r2(data.across, given.across),
            "torque": _r2(data.torque[:, 1:], given.torque[:, 1:]),
            "torque_along": _r2(data.torque[:, 0], given.torque[:, 0]),
            "mean_factor": 1.0 + float(np.mean(given.along, dtype=np.float64)),
            "data_factor": float(means[0] / means[1]),
        }
    rows = list(table.values())
    table["all"] = {
        **{name: sum(row[name] for row in rows) for name in ("arrays", "spheres")},
        **{name: float(np.mean([row[name] for row in rows])) for name in (*QUANTITIES, "torque_along")},
        "mean_factor": max((row["mean_factor"] for row in rows), key=lambda factor: abs(factor - 1.0)),
    }
    return table


def _r2(data: NDArray[np.floating], found: NDArray[np.floating]) -> float:
    error, scatter = (np.sum(part.astype(np.float64) ** 2) for part in (found - data, data))
    return float(1.0 - error / scatter) if scatter > 0 else math.nan
