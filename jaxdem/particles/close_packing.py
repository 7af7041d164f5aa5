"""Densest disordered packing of spheres of any sizes, estimated from rods on a line. Host, numpy.

A line through a packing meets a sphere of diameter D with a probability that goes as D^2, and the part of it inside, a
chord, is shorter than L with probability (L / D)^2. Chords of all spheres are laid on a line, the longest first, each
into the longest gap; to either side of a rod stays a gap of at least `FREE` times the shorter of the two rods. The part
of the line that rods cover is the solid fraction.

Source: R. S. Farr, R. D. Groot, J. Chem. Phys. 131 (2009) 244104. It agrees with their simulated packings of spheres
of two and three sizes, ratios up to 10, and of lognormal ones to about 0.01, and is exact for ratios without bound.
"""

from __future__ import annotations

import heapq

import numpy as np

FREE = 0.7654
"""Gap beside a rod over its length, which makes 0.6435 of equal spheres."""

RODS = 10_000
"""Chords that stand for all of them."""


def close_packing(radius: np.ndarray, number: np.ndarray | None = None) -> float:
    """Solid fraction of the densest disordered packing of spheres in a large space without walls [-].

    Args:
        radius: (N,) [m].
        number: (N,) how many there are of each, in any unit; one of each if None.
    """
    rods = _chords(radius, np.ones_like(radius) if number is None else number)
    longest_first = [-FREE * rods[0]]  # gaps of a line that closes on itself, with their signs turned for the heap
    for rod in rods[1:]:
        left = -heapq.heappop(longest_first) - (1.0 + FREE) * rod
        heapq.heappush(longest_first, -FREE * rod)
        heapq.heappush(longest_first, -max(left, FREE * rod))
    solid = float(np.sum(rods))
    return solid / (solid - sum(longest_first))


def _chords(radius: np.ndarray, number: np.ndarray) -> np.ndarray:
    """(`RODS`,) lengths of chords, the longest first [m]: as many of every size as its area says, evenly in L^2 within
    each, which the steps by the golden section make."""
    order = np.argsort(radius, kind="stable")
    diameter = 2.0 * np.asarray(radius, float)[order]
    area = np.cumsum(number[order] * diameter**2)
    place = (np.arange(RODS) + 0.5) / RODS
    sphere = np.searchsorted(area, place * area[-1])
    part = np.mod(np.arange(RODS) * (np.sqrt(5.0) - 1.0) / 2.0 + 0.5, 1.0)
    return np.sort(diameter[np.minimum(sphere, len(diameter) - 1)] * np.sqrt(part))[::-1]
