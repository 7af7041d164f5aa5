"""Long thin triangles and long edges, cut into pieces for the bins. Host, numpy.

A box around a sliver, and bins as wide as it is long, would be found by every grain near any part of it. Triangles of a
cylinder from a CAD program are such slivers.
"""

from __future__ import annotations

import numpy as np

ASPECT = 4.0
"""Longest edge over the height on it from which on a triangle is cut [-]."""

CUTS, CUTS_OF_MANY, MANY = 4, 2, 20_000
"""Most times that the length of a part is halved; of more parts fewer times, for the memory of the bins."""


def pieces_of_long(corners: np.ndarray, shortest: float) -> tuple[np.ndarray, np.ndarray]:
    """Parts that are long and thin halved across their longest edge, and again.

    Args:
        corners: (P, K, D) of parts, K = 2 of edges and 3 of triangles [m].
        shortest: length from which on they are cut [m].

    Returns:
        (Q, K, D) pieces, those of a part together and in the order of the parts; (Q,) the part of each.
    """
    part = np.arange(len(corners))
    # A triangle has two long edges, and both must be cut.
    for _ in range((corners.shape[1] - 1) * (CUTS if len(corners) <= MANY else CUTS_OF_MANY)):
        # With the longest edge from corner 0 to corner 1.
        length = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        count = corners.shape[1]
        order = (length.argmax(axis=1)[:, None] + np.arange(count)) % count
        turned = np.take_along_axis(corners, order[..., None], axis=1)
        longest = length.max(axis=1)
        long = longest > shortest
        if count == 3:
            along = (turned[:, 1] - turned[:, 0]) / np.where(longest > 0.0, longest, 1.0)[:, None]
            aside = turned[:, 2] - turned[:, 0]
            height = np.linalg.norm(aside - np.einsum("pd,pd->p", aside, along)[:, None] * along, axis=1)
            long &= longest > ASPECT * height
        if not long.any():
            break
        middle = 0.5 * (turned[long, 0] + turned[long, 1])
        first, second = turned[long].copy(), turned[long].copy()
        first[:, 1], second[:, 0] = middle, middle
        corners = np.concatenate([corners[~long], first, second])
        part = np.concatenate([part[~long], part[long], part[long]])
        kept = np.argsort(part, kind="stable")
        corners, part = corners[kept], part[kept]
    return corners, part
