"""Grown packs of particles of very different sizes: denser than equal ones can be, without overlaps."""

from __future__ import annotations

import numpy as np
import pytest

from jaxdem.particles import growth, packing, regions
from jaxdem.particles.close_packing import close_packing
from jaxdem.particles.growth import grown_pack
from tests.cases.tiers import tiered

CASES = [(2, 600, 60.0, 0.88), (3, 300, 20.0, 0.70)]


def packed(dimension, count, ratio, fraction):
    """Solid fraction reached in a periodic box, and deepest overlap; by volume the sizes are uniform in radius."""
    u = (np.random.default_rng(1).permutation(count) + 0.5) / count
    radius = (1.0 - u * (1.0 - ratio**-2.0)) ** -0.5
    side = (regions.ball_size(dimension) * np.sum(radius**dimension) / fraction) ** (1.0 / dimension)
    region = regions.box([0.0] * dimension, [side] * dimension, [True] * dimension)
    position, part = grown_pack(region, radius, 1.0, 1)
    overlap = packing.deepest_overlap(position, radius, (side,) * dimension, (True,) * dimension)[0]
    return fraction * part**dimension, overlap, close_packing(radius)


@pytest.mark.parametrize(("dimension", "count", "ratio", "fraction"), tiered(CASES, first=CASES[:1]))
def test_levels_and_masses_make_wide_packs_dense(dimension, count, ratio, fraction, monkeypatch):
    """Above the solid fraction at which equal particles jam, and below the densest of spheres that Farr and Groot find.

    Negative control: grown all at once, with equal masses, the pack is not made in as many steps of the minimiser.
    """
    monkeypatch.setattr(growth, "MOST_STEPS", 500)
    reached, overlap, densest = packed(dimension, count, ratio, fraction)
    assert reached == fraction > growth.DISORDERED[dimension] and overlap <= 1e-9
    assert dimension == 2 or fraction < densest
    monkeypatch.setattr(growth, "LEVEL_RATIO", 1e9)
    monkeypatch.setattr(growth, "CROWD", {2: 1e9, 3: 1e9})
    assert packed(dimension, count, ratio, fraction)[0] < 0.98 * fraction
