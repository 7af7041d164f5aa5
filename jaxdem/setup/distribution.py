"""Radii by a distribution: inverse transform of uniform numbers. Host, numpy.

A distribution by volume with density v(r) has the number density n(r) ~ v(r) / r^3, because a sphere of radius r has
the volume 4/3 pi r^3. In 2-D the particles are spheres too. Cut-offs keep the part of v or n between them and divide
it by what it adds up to; the part by volume between two radii is the part by number between the same.

Sources: L. Devroye, Non-Uniform Random Variate Generation, Springer 1986, section II.2 (inversion, and inversion of a
truncated distribution); T. Hatch, S. P. Choate, J. Franklin Inst. 207 (1929) 369 (lognormal by number and by volume);
P. Rosin, E. Rammler, J. Inst. Fuel 7 (1933) 29 (the Weibull distribution as a sieve curve).
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr, ndtri

from jaxdem.errors import InputError
from jaxdem.scene.distribution import Distribution

LEAST_PART = 1e-6
"""Of a distribution that may lie between the cut-offs; less is a slip of a unit."""

NODES = 2**14
"""Points of a curve by volume that is inverted as a table: so many evenly spaced in volume, and so many in ln(r)."""


def radii(key: str, distribution: Distribution, u: np.ndarray) -> np.ndarray:
    """Radii at which the distribution by number has reached `u`.

    Closed forms for the normal and the Weibull distribution by number, the lognormal one by both, and tables. The
    normal and the Weibull distribution by volume are inverted as tables of 2 `NODES` points of their exact curve.

    Args:
        key: of the distribution in the scene, for the messages.
        distribution: of a scene.
        u: (N,) between 0 and 1; uniform random numbers for random radii.

    Returns:
        (N,) radii [m].

    Raises:
        InputError: next to nothing of the distribution lies between its cut-offs.
    """
    lower, upper = bounds = distribution.bounds
    part = np.diff(_cumulative(distribution, np.asarray(bounds)))[0]
    if part < LEAST_PART:
        limit = f"only {part:.2g} of the distribution lies between lower and upper, {lower:.6g} ... {upper:.6g} m"
        remedy = f"move the cut-offs to where the distribution is, at least {LEAST_PART:g} of it"
        raise InputError(key, distribution.kind, limit, remedy)
    if distribution.by == "number" or distribution.kind == "lognormal":
        found = _inverse(distribution, u)
    else:
        nodes = _nodes(distribution)
        found = _of_volume_table(nodes, _cumulative(distribution, nodes), u)
    return np.clip(found, lower, upper)


def _cumulative(distribution: Distribution, r: np.ndarray) -> np.ndarray:
    """The part below `r` [m], by number or volume as the distribution is given, before the cut-offs."""
    number = distribution.number
    if distribution.kind == "normal":
        return ndtr((r - number("mean")) / number("standard_deviation"))
    if distribution.kind == "lognormal":
        return ndtr((np.log(r) - np.log(number("median"))) / number("log_standard_deviation"))
    if distribution.kind == "weibull":
        return -np.expm1(-_weibull_power(distribution, r))
    return np.interp(r, distribution.table_radii, distribution.cumulative or ())


def _inverse(distribution: Distribution, u: np.ndarray) -> np.ndarray:
    """Radii below which the part `u` between the cut-offs lies, as the distribution is given; lognormal by number.

    The normal one is m + s z with z a truncated standard normal number. The lognormal one is exp(m + s z); by volume
    with median exp(m) it is by number one with exp(m - 3 s^2) and the same s (Hatch and Choate). The Weibull one,
    1 - exp(-(r / scale)^shape), is r = scale x^(1 / shape) with x a truncated exponential number.
    """
    number, bounds = distribution.number, np.asarray(distribution.bounds)
    if distribution.kind == "normal":
        mean, deviation = number("mean"), number("standard_deviation")
        return mean + deviation * _truncated_normal(u, *(bounds - mean) / deviation)
    if distribution.kind == "lognormal":
        deviation = number("log_standard_deviation")
        mean = np.log(number("median")) - (3.0 * deviation**2 if distribution.by == "volume" else 0.0)
        return np.exp(mean + deviation * _truncated_normal(u, *(np.log(bounds) - mean) / deviation))
    if distribution.kind == "weibull":
        low, high = _weibull_power(distribution, bounds)
        x = low - np.log1p(u * np.expm1(low - high))
        return number("scale") * x ** (1.0 / number("shape"))
    low, high = _cumulative(distribution, bounds)
    return np.interp(low + u * (high - low), distribution.cumulative or (), distribution.table_radii)


def _weibull_power(distribution: Distribution, r: np.ndarray) -> np.ndarray:
    """(r / scale)^shape."""
    with np.errstate(over="ignore", under="ignore"):  # inf: all are smaller
        return (r / distribution.number("scale")) ** distribution.number("shape")


def _truncated_normal(u: np.ndarray, low: float, high: float) -> np.ndarray:
    """Standard normal numbers between low and high below which the part `u` lies; by the lower tail, which is exact."""
    if low > 0.0:
        return -_truncated_normal(1.0 - u, -high, -low)
    return ndtri(ndtr(low) + u * (ndtr(high) - ndtr(low)))


def _nodes(distribution: Distribution) -> np.ndarray:
    """Radii between the cut-offs, both included, between which a curve by volume is taken as linear [m]."""
    lower, upper = distribution.bounds
    if distribution.kind == "table":
        inside = [r for r in distribution.table_radii if lower < r < upper]
        return np.asarray([lower, *inside, upper])
    even = _inverse(distribution, np.linspace(0.0, 1.0, NODES, endpoint=False))
    return np.unique(np.clip(np.concatenate([even, np.geomspace(lower, upper, NODES), [lower, upper]]), lower, upper))


def _of_volume_table(nodes: np.ndarray, cumulative: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Radii below which the part `u` by number lies, where the curve by volume is linear between nodes.

    From a to b the volume grows by V, evenly in r. There are V / (b - a) int_a^b dr / r^3 = V (a + b) / (2 a^2 b^2)
    particles, of unit volume r^3, and the part (a^-2 - r^-2) / (a^-2 - b^-2) of them is smaller than r.

    Args:
        nodes: (M,) increasing [m].
        cumulative: (M,) part by volume below each.
        u: (N,) between 0 and 1.
    """
    a, b = nodes[:-1], nodes[1:]
    numbers = np.diff(cumulative) * (a + b) / (2.0 * a**2 * b**2)
    a, b, numbers = a[numbers > 0.0], b[numbers > 0.0], numbers[numbers > 0.0]
    below = np.concatenate([[0.0], np.cumsum(numbers)])
    wanted = u * below[-1]
    k = np.clip(np.searchsorted(below, wanted, side="right") - 1, 0, len(numbers) - 1)
    part = np.clip((wanted - below[k]) / numbers[k], 0.0, 1.0)
    return 1.0 / np.sqrt((1.0 - part) / a[k] ** 2 + part / b[k] ** 2)
