"""Drag laws in plain mathematics, in the literature's own forms, to compare the library's with: a row a law."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

DENSITY, VISCOSITY, DIAMETER = 1000.0, 1e-3, 2e-3
"""Of the fluid [kg/m3], [Pa s], and of the particle [m]."""


class Row(NamedTuple):
    """A drag law.

    Attributes:
        force: on one particle from the interstitial slip [m/s] and the solid fraction [N].
        solid_fractions, reynolds: that the exchange is tried at, inside the law's range.
        single_creeping: F of one particle at Re = 0, where it is not 1.
        smooth_at: solid fractions at which F has slopes; a law that jumps, as published, has other ones.
    """

    force: Callable[[float, float], float]
    solid_fractions: tuple[float, ...]
    reynolds: tuple[float, ...]
    single_creeping: float = 1.0
    smooth_at: tuple[float, float, float, float] = (0.05, 0.15, 0.3, 0.5)

    def multiple(self, solid_fraction: float, reynolds: float) -> float:
        """F(s, Re), the multiple of Stokes drag, with Re of the superficial slip."""
        slip = reynolds * VISCOSITY / ((1 - solid_fraction) * DENSITY * DIAMETER)
        return self.force(slip, solid_fraction) / stokes(slip, solid_fraction)


def drag_coefficient(reynolds):
    return 24 / reynolds * (1 + 0.15 * reynolds**0.687) if reynolds <= 1000 else 0.44


def cross_section_force(coefficient, slip):
    return coefficient * math.pi / 8 * DIAMETER**2 * DENSITY * slip**2


def exchange_force(beta, slip, s):
    return math.pi / 6 * DIAMETER**3 * beta / s * slip


def stokes(slip, s):
    return 3 * math.pi * VISCOSITY * DIAMETER * slip


def schiller_naumann(slip, s):
    # Re of the superficial slip, F times the interstitial one
    reynolds = (1 - s) * DENSITY * slip * DIAMETER / VISCOSITY
    return cross_section_force(drag_coefficient(reynolds), slip) * (1 - s)


def beta_ergun(slip, s):
    return 150 * s**2 * VISCOSITY / ((1 - s) * DIAMETER**2) + 1.75 * DENSITY * s * slip / DIAMETER


def beta_wen_yu(slip, s):
    g = 1 - s
    coefficient = drag_coefficient(g * DENSITY * slip * DIAMETER / VISCOSITY)
    return 0.75 * coefficient * DENSITY * s * g * slip / DIAMETER * g**-2.65


def ergun(slip, s):
    return exchange_force(beta_ergun(slip, s), slip, s)


def wen_yu(slip, s):
    return exchange_force(beta_wen_yu(slip, s), slip, s)


def gidaspow(slip, s):
    return exchange_force((beta_ergun if 1 - s < 0.8 else beta_wen_yu)(slip, s), slip, s)


def gidaspow_blended(slip, s):
    weight = math.atan(150 * 1.75 * (0.2 - s)) / math.pi + 0.5
    return exchange_force((1 - weight) * beta_ergun(slip, s) + weight * beta_wen_yu(slip, s), slip, s)


def di_felice(slip, s):
    reynolds = (1 - s) * DENSITY * slip * DIAMETER / VISCOSITY
    chi = 3.7 - 0.65 * math.exp(-((1.5 - math.log10(reynolds)) ** 2) / 2)
    coefficient = (0.63 + 4.8 / math.sqrt(reynolds)) ** 2
    return cross_section_force(coefficient, slip) * (1 - s) ** 2 * (1 - s) ** -chi


def koch_hill(slip, s):
    g = 1 - s
    reynolds = g * DENSITY * slip * DIAMETER / VISCOSITY
    if s < 0.4:
        creeping = 1 + 3 * math.sqrt(s / 2) + 135 / 64 * s * math.log(s) + 16.14 * s
        creeping /= 1 + 0.681 * s - 8.48 * s**2 + 8.16 * s**3
    else:
        creeping = 10 * s / g**3
    inertial = 0.0673 + 0.212 * s + 0.0232 / g**5
    beta = 18 * VISCOSITY * g**2 * s / DIAMETER**2 * (creeping + inertial * reynolds / 2)
    return exchange_force(beta, slip, s)


def superficial(slip, s):
    return (1 - s) * slip, (1 - s) * DENSITY * slip * DIAMETER / VISCOSITY


def creeping_arrays(s):
    return 10 * s / (1 - s) ** 2 + (1 - s) ** 2 * (1 + 1.5 * math.sqrt(s))


def beetstra(slip, s):
    velocity, re = superficial(slip, s)
    inertial = 0.413 * re / (24 * (1 - s) ** 2) * (1 / (1 - s) + 3 * s * (1 - s) + 8.4 * re**-0.343)
    inertial /= 1 + 10 ** (3 * s) * re ** (-(1 + 4 * s) / 2)
    return 3 * math.pi * VISCOSITY * DIAMETER * velocity * (creeping_arrays(s) + inertial)


def tang(slip, s):
    velocity, re = superficial(slip, s)
    factor = 0.11 * s * (1 + s) - 0.00456 / (1 - s) ** 4
    factor += (0.169 * (1 - s) + 0.0644 / (1 - s) ** 4) * re**-0.343
    return 3 * math.pi * VISCOSITY * DIAMETER * velocity * (creeping_arrays(s) + max(factor, 0) * re)


def rong(slip, s):
    g, (velocity, re) = 1 - s, superficial(slip, s)
    chi = 2.65 * (g + 1) - (5.3 - 3.5 * g) * g**2 * math.exp(-((1.5 - math.log10(re)) ** 2) / 2)
    coefficient = (0.63 + 4.8 / math.sqrt(re)) ** 2
    return cross_section_force(coefficient, velocity) * g**-chi


def shaped_force(coefficient, slip, s):
    velocity, re = superficial(slip, s)
    chi = 3.7 - 0.65 * math.exp(-((1.5 - math.log10(re)) ** 2) / 2)
    return cross_section_force(coefficient(re), velocity) * (1 - s) ** -chi


def haider_levenspiel_coefficient(re, sphericity=1.0):
    p = sphericity
    a, b = math.exp(2.3288 - 6.4581 * p + 2.4486 * p**2), 0.0964 + 0.5565 * p
    c = math.exp(4.905 - 13.8944 * p + 18.4222 * p**2 - 10.2599 * p**3)
    d = math.exp(1.4681 + 12.2584 * p - 20.7322 * p**2 + 15.8855 * p**3)
    return 24 / re * (1 + a * re**b) + c / (1 + d / re)


def hoelzer_sommerfeld_coefficient(re, sphericity=1.0, crosswise=1.0):
    last = 0.42 * 10 ** (0.4 * abs(math.log10(sphericity)) ** 0.2) / crosswise
    middle = 3 / math.sqrt(re) / sphericity**0.75
    return 8 / re / math.sqrt(crosswise) + 16 / re / math.sqrt(sphericity) + middle + last


ROWS = {
    "stokes": Row(stokes, (0.004,), (1e-3,)),
    "schiller_naumann": Row(schiller_naumann, (0.004,), (1e-3, 1.0, 300.0, 1e4)),
    "ergun": Row(ergun, (0.45,), (1.0, 300.0), single_creeping=0.0),
    "wen_yu": Row(wen_yu, (0.004, 0.15), (1e-3, 30.0, 1e4)),
    "gidaspow": Row(gidaspow, (0.15, 0.45), (1e-3, 30.0, 1e4)),
    "gidaspow_blended": Row(
        gidaspow_blended, (0.15, 0.25), (1e-3, 30.0, 1e4), single_creeping=math.atan(150 * 1.75 * 0.2) / math.pi + 0.5
    ),
    "di_felice": Row(di_felice, (0.004, 0.45), (1e-2, 30.0, 1e4), single_creeping=0.96),
    "koch_hill": Row(koch_hill, (0.004, 0.3, 0.45), (1e-3, 30.0, 1e4)),
    "beetstra": Row(beetstra, (0.15, 0.45), (1e-3, 30.0, 1e3)),
    "tang": Row(tang, (0.15, 0.45), (1e-3, 30.0, 1e3)),
    "rong": Row(rong, (0.15, 0.45), (1e-2, 30.0, 3e3), single_creeping=0.96),
    "haider_levenspiel": Row(
        lambda slip, s: shaped_force(haider_levenspiel_coefficient, slip, s), (0.004, 0.45), (1e-3, 30.0, 1e4)
    ),
    "hoelzer_sommerfeld": Row(
        lambda slip, s: shaped_force(hoelzer_sommerfeld_coefficient, slip, s), (0.004, 0.45), (1e-2, 30.0, 1e4)
    ),
}
"""By the name that a scene has for the law."""
