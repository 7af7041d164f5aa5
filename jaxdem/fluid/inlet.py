"""Profiles of an inlet along one axis of its side, by their exact integrals. Host side, numpy.

A boundary face gets the mean of the profile over its part in the patch, so that the flow rate is that of the
profile on every mesh, to round-off.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from jaxdem.numerics.static import static


class InletProfile(Protocol):
    """A multiple of the side's velocity along one axis; static."""

    @property
    def peak(self) -> float:
        """Largest size [-]."""
        ...

    def integral(self, position: np.ndarray, start: float, stop: float) -> np.ndarray:
        """Integral from `start` to positions in a patch that ends at `stop`; all [m]."""
        ...


@static
class Parabola:
    """6 s (1 - s), s from 0 to 1 across the patch: the profile of plane Poiseuille flow, of mean 1."""

    @property
    def peak(self) -> float:
        """1.5, in the middle."""
        return 1.5

    def integral(self, position: np.ndarray, start: float, stop: float) -> np.ndarray:
        """(stop - start) (3 s^2 - 2 s^3)."""
        s = (position - start) / (stop - start)
        return (stop - start) * s**2 * (3.0 - 2.0 * s)


@static
class LinearTable:
    """Values at positions, linear between them.

    Attributes:
        positions: increasing, from the lower end of the side; they reach over the whole patch [m].
        values: at these positions [-].
    """

    positions: tuple[float, ...]
    values: tuple[float, ...]

    @property
    def peak(self) -> float:
        """Largest size of a value; between two it is not larger."""
        return max(abs(value) for value in self.values)

    def integral(self, position: np.ndarray, start: float, stop: float) -> np.ndarray:
        """By the trapezoidal rule, which is exact."""
        return self._from_first(position) - self._from_first(np.asarray(start))

    def _from_first(self, position: np.ndarray) -> np.ndarray:
        x, v = np.asarray(self.positions), np.asarray(self.values)
        passed = np.concatenate(([0.0], np.cumsum(0.5 * np.diff(x) * (v[1:] + v[:-1]))))
        below = np.clip(np.searchsorted(x, position, side="right") - 1, 0, len(x) - 2)
        return passed[below] + 0.5 * (position - x[below]) * (v[below] + np.interp(position, x, v))
