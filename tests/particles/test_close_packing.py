"""Densest disordered packing of spheres of any sizes: equal ones, limits in closed form, and published fits."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from jaxdem.particles.close_packing import close_packing

EQUAL = 0.6435


def test_equal_spheres():
    """The number that the constant of the source was made for."""
    assert close_packing(np.full(50, 0.3)) == pytest.approx(EQUAL, abs=2e-4)


@pytest.mark.parametrize("large", [0.4, 0.6435 / 0.8729, 0.9])
def test_small_spheres_fill_the_voids_of_large_ones(large):
    """Towards a ratio without bound, whose limit is exact (C. C. Furnas, Ind. Eng. Chem. 23 (1931) 1052): either the
    large ones are packed and small ones are between them, phi = P / x, or large ones lie in packed small ones,
    phi = P / (P x + 1 - x), with x the part of the large ones by volume and P the packing of either alone.

    It is never passed, and what is missing is less than one over the ratio.
    """
    limit = min(EQUAL / large, EQUAL / (EQUAL * large + 1.0 - large))
    for ratio in (10.0, 50.0):
        found = close_packing(np.array([ratio, 1.0]), np.array([1.0, (1.0 - large) / large * ratio**3]))
        assert limit - 1.0 / ratio < found < limit + 0.002


@pytest.mark.parametrize("sigma", [0.2, 0.5, 0.8])
def test_lognormal_spheres(sigma):
    """R. S. Farr, Powder Technol. 245 (2013) 28, fits what the method gives; diameters of N samples."""
    u = (np.arange(200_000) + 0.5) / 200_000
    waves = np.cos(2.0 * np.pi * (1.0 - np.exp(-0.75 * sigma**0.7 - 0.025 * sigma**4)))
    fit = 1.0 - 0.57 * np.exp(-sigma) + 0.2135 * np.exp(-0.57 * sigma / 0.2135) + 0.0019 * (waves - 1.0)
    assert close_packing(stats.lognorm(sigma).ppf(u)) == pytest.approx(fit, abs=0.004)


@pytest.mark.parametrize(("ratio", "share"), [(1.4, 0.5), (2.0, 0.2), (3.0, 0.05)])
def test_two_sizes_of_spheres(ratio, share):
    """Simulated packings, phi = 0.634 + 0.0658 d + 0.0857 S d^2 with the polydispersity d <= 0.4 and the skewness S of
    the radii: K. W. Desmond, E. R. Weeks, Phys. Rev. E 90 (2014) 022204."""
    radius = np.where(np.arange(2000) < share * 2000, ratio, 1.0)
    spread = np.std(radius) / np.mean(radius)
    fit = 0.634 + 0.0658 * spread + 0.0857 * stats.skew(radius) * spread**2
    assert spread <= 0.41 and close_packing(radius) == pytest.approx(fit, abs=0.012)
