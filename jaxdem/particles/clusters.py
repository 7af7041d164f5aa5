"""Clusters of points that are compact and hold equally much. Host, numpy.

Recursive coordinate bisection: a set is cut across the longest side of its bounds, so that each part holds its share of
the clusters, until every part is one cluster. Source: M. J. Berger & S. H. Bokhari, IEEE Trans. Comput. C-36 (1987)
570-580.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

SLIVER = 1e-9
"""Parts of a particle below this are rounding, and belong to the other side of a cut."""


class Membership(NamedTuple):
    """Which part of which particle is in which cluster; K entries.

    Attributes:
        particle: (K,) number of the particle.
        cluster: (K,) number of the cluster, in rising order.
        part: (K,) part of the particle; the parts of a particle add up to what was given of it [-].
    """

    particle: np.ndarray
    cluster: np.ndarray
    part: np.ndarray


def equal_clusters(position: np.ndarray, part: np.ndarray, count: int) -> Membership:
    """Compact clusters of points that hold equally much each.

    A particle that lies on a cut belongs to both sides, in parts. Where a cluster holds a whole number of whole
    particles, none is divided.

    Args:
        position: (N, D) [m].
        part: (N,) how much of every particle is shared out [-].
        count: number of clusters, 1 or more.
    """
    particle, part, node = np.arange(len(position)), np.asarray(part, float), np.zeros(len(position), int)
    held, size = np.array([count]), float(np.sum(part)) / count
    while held.max() > 1:
        first = np.searchsorted(node, np.arange(len(held)))
        points = position[particle]
        extent = np.maximum.reduceat(points, first) - np.minimum.reduceat(points, first)
        along = np.take_along_axis(points, np.argmax(extent, axis=1)[node][:, None], axis=1)[:, 0]
        order = np.lexsort((along, node))
        particle, part = particle[order], part[order]
        before = np.cumsum(part) - part
        before -= before[first][node]
        left = np.clip((held // 2 * size)[node] - before, 0.0, part)
        left = np.where(left < SLIVER, 0.0, np.where(part - left < SLIVER, part, left))
        parts, nodes = np.concatenate([left, part - left]), np.concatenate([2 * node, 2 * node + 1])
        kept = np.flatnonzero(parts > 0.0)
        kept = kept[np.argsort(nodes[kept], kind="stable")]
        particle, part = np.concatenate([particle, particle])[kept], parts[kept]
        numbers, node = np.unique(nodes[kept], return_inverse=True)
        held = np.stack([held // 2, held - held // 2], axis=1).ravel()[numbers]
    return Membership(particle, node, part)
