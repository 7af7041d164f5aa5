"""How much an inlet has brought by a time, and when it has brought so much: a number or a mass. Host, numpy."""

from __future__ import annotations

import numpy as np

ROUNDING = 1e-9
"""Of a number of particles, or of intervals, that should be whole."""


class SteadyFlow:
    """An inlet whose rate is the same from its begin to its end.

    Args:
        rate: q, particles or mass per second [1/s or kg/s].
        begin: t0 [s].
        end: t1 [s].
    """

    def __init__(self, rate: float, begin: float, end: float):
        self._rate, self._begin = rate, begin
        self.total = rate * (end - begin)
        """What it brings in all [- or kg]."""

    def times(self, amounts: np.ndarray) -> np.ndarray:
        """(M,) when it has brought so much: t = t0 + amount / q [s]; also after its end."""
        return self._begin + amounts / self._rate


class FlowOverTime:
    """An inlet whose rate changes: linear between the times of a table, constant before the first and after the last.

    Args:
        times: increasing [s].
        rates: q at these times, particles or mass per second [1/s or kg/s].
        begin: t0, before which nothing comes [s].
        end: t1, after which nothing comes [s].
    """

    def __init__(self, times: tuple[float, ...], rates: tuple[float, ...], begin: float, end: float):
        end = max(begin, end)
        self._nodes = np.unique([begin, *np.clip(times, begin, end), end])
        self._rates = np.interp(self._nodes, times, rates)
        pieces = 0.5 * (self._rates[1:] + self._rates[:-1]) * np.diff(self._nodes)
        self._amounts = np.concatenate([[0.0], np.cumsum(pieces)])
        self.total = float(self._amounts[-1])
        """What it brings in all, the integral of q from t0 to t1 [- or kg]."""

    def times(self, amounts: np.ndarray) -> np.ndarray:
        """(M,) when it has brought so much, the first time at which the integral of q from t0 is the amount [s].

        In a piece with the rate q at its start and the slope s, an amount a is reached after 2 a / (q + sqrt(q^2 + 2 s
        a)), the root of q t + s t^2 / 2 = a that does not cancel. Infinite where the amount is never reached.

        Args:
            amounts: positive, (M,) [- or kg].
        """
        # To rounding: an amount that a piece just reaches belongs to it and not to one after a pause.
        piece = np.searchsorted(self._amounts, amounts * (1.0 - ROUNDING)) - 1
        reached = piece < len(self._nodes) - 1
        found = np.full(len(amounts), np.inf)
        k, amounts = piece[reached], amounts[reached]
        start, rate = self._nodes[k], self._rates[k]
        length = self._nodes[k + 1] - start
        slope = (self._rates[k + 1] - rate) / length
        inside = np.minimum(amounts, self._amounts[k + 1]) - self._amounts[k]
        root = np.sqrt(np.maximum(rate**2 + 2.0 * slope * inside, 0.0))
        found[reached] = start + np.minimum(2.0 * inside / (rate + root), length)
        return found
