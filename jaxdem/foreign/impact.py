"""The coefficient of restitution of a contact law whose damping is given as a coefficient.

A head-on impact at speed v: m d'' = -F(d) - c(d) d' from d = 0, d' = v; it ends where the overlap d is 0 again, as
LAMMPS ends a contact, and e = -d'/v. For a linear spring k and a dashpot c it is exp(-pi b/sqrt(1 - b^2)), b = c/(2
sqrt(k m)).
"""

from __future__ import annotations

import math
from collections.abc import Callable

STEPS = 2000
"""Of the integration (Runge and Kutta, fourth order) in an undamped contact."""

LONGEST = 10
"""Undamped contacts after which an impact has no rebound: it is overdamped."""


def restitution(
    mass: float, elastic: Callable[[float], float], damping: Callable[[float], float], speed: float, duration: float
) -> float:
    """Coefficient of restitution [-].

    Args:
        mass: effective m [kg].
        elastic: F of the overlap [N].
        damping: c of the overlap [N s/m].
        speed: v [m/s].
        duration: about that of the undamped contact [s].
    """

    def slope(overlap: float, rate: float) -> tuple[float, float]:
        depth = max(overlap, 0.0)
        return rate, -(elastic(depth) + damping(depth) * rate) / mass

    overlap, rate, step = 0.0, speed, duration / STEPS
    for _ in range(LONGEST * STEPS):
        first = slope(overlap, rate)
        second = slope(overlap + 0.5 * step * first[0], rate + 0.5 * step * first[1])
        third = slope(overlap + 0.5 * step * second[0], rate + 0.5 * step * second[1])
        last = slope(overlap + step * third[0], rate + step * third[1])
        changes = [
            step / 6.0 * (a + 2.0 * b + 2.0 * c + d) for a, b, c, d in zip(first, second, third, last, strict=True)
        ]
        if overlap + changes[0] <= 0.0 and rate < 0.0:
            part = overlap / -changes[0]  # of the last step, up to the end of the contact
            return min(1.0, -(rate + part * changes[1]) / speed)
        overlap, rate = overlap + changes[0], rate + changes[1]
    return 0.0


def hertz_duration(mass: float, stiffness: float, speed: float) -> float:
    """Of an undamped contact with F = stiffness d^(3/2): 2.94 d/v, d the largest overlap [s]."""
    return 2.94 * (1.25 * mass * speed**2 / stiffness) ** 0.4 / speed


def linear_duration(mass: float, stiffness: float) -> float:
    """Of an undamped contact with F = stiffness d [s]."""
    return math.pi * math.sqrt(mass / stiffness)
