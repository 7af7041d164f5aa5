"""Drag correlations written from the papers once more, in plain numpy, to compare the library's with."""

from __future__ import annotations

import numpy as np


def _sphere(re):
    return 1.0 + 0.15 * re**0.687 if re <= 1000.0 else 0.44 * re / 24.0


def _ergun(s, re):
    return (150.0 * s + 1.75 * re) / (18.0 * (1.0 - s))


def _wen_yu(s, re):
    return _sphere(re) * (1.0 - s) ** -2.65


def _koch_hill(s, re):
    below = 1 + 0.681 * s - 8.48 * s**2 + 8.16 * s**3
    f0 = (1 + 3 * np.sqrt(s / 2) + 135 / 64 * s * np.log(s) + 16.14 * s) / below
    f3 = 0.0673 + 0.212 * s + 0.0232 / (1 - s) ** 5
    return (1 - s) ** 2 * ((f0 if s < 0.4 else 10 * s / (1 - s) ** 3) + f3 * re / 2)


def _di_felice(s, re):
    chi = 3.7 - 0.65 * np.exp(-((1.5 - np.log10(re)) ** 2) / 2)
    return (0.63 + 4.8 / np.sqrt(re)) ** 2 * re / 24 * (1 - s) ** (1 - chi)


def _blended(s, re):
    weight = np.arctan(150 * 1.75 * (0.2 - s)) / np.pi + 0.5
    return (1 - weight) * _ergun(s, re) + weight * _wen_yu(s, re)


def _creeping(s):
    return 10 * s / (1 - s) ** 2 + (1 - s) ** 2 * (1 + 1.5 * np.sqrt(s))


def _beetstra(s, re):
    bracket = 1 / (1 - s) + 3 * s * (1 - s) + 8.4 * re**-0.343
    inertial = 0.413 * re / 24 / (1 - s) ** 2 * bracket / (1 + 10 ** (3 * s) * re ** (-0.5 - 2 * s))
    return (1 - s) * (_creeping(s) + inertial)


def _tang(s, re):
    slope = 0.169 * (1 - s) + 0.0644 / (1 - s) ** 4
    inertial = 0.11 * s * (1 + s) - 0.00456 / (1 - s) ** 4 + slope * re**-0.343
    return (1 - s) * (_creeping(s) + inertial * re)


def _rong(s, re):
    g = 1 - s
    chi = 2.65 * (g + 1) - (5.3 - 3.5 * g) * g**2 * np.exp(-((1.5 - np.log10(re)) ** 2) / 2)
    return (0.63 + 4.8 / np.sqrt(re)) ** 2 * re / 24 * g ** (1 - chi)


# F(s, Re), written from the papers once more in plain numpy, and the range (s, Re) it is tried in.
PLAIN = {
    "stokes": (lambda s, re: 1.0, (0.004,), (1e-3,)),
    "schiller_naumann": (lambda s, re: _sphere(re), (0.004,), (1e-3, 1.0, 300.0, 1e4)),
    "ergun": (_ergun, (0.45,), (1.0, 300.0)),
    "wen_yu": (_wen_yu, (0.004, 0.15), (1e-3, 30.0, 1e4)),
    "gidaspow": (lambda s, re: _ergun(s, re) if s > 0.2 else _wen_yu(s, re), (0.15, 0.45), (1e-3, 30.0, 1e4)),
    "gidaspow_blended": (_blended, (0.15, 0.25), (1e-3, 30.0, 1e4)),
    "di_felice": (_di_felice, (0.004, 0.45), (1e-2, 30.0, 1e4)),
    "koch_hill": (_koch_hill, (0.004, 0.3, 0.45), (1e-3, 30.0, 1e4)),
    "beetstra": (_beetstra, (0.15, 0.45), (1e-3, 30.0, 1e3)),
    "tang": (_tang, (0.15, 0.45), (1e-3, 30.0, 1e3)),
    "rong": (_rong, (0.15, 0.45), (1e-2, 30.0, 3e3)),
}
"""Law: F(s, Re), solid fractions and Reynolds numbers to try."""
