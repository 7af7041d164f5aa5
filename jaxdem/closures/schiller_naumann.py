"""Schiller-Naumann drag of one sphere, and the single-sphere curve that Wen-Yu builds on."""

from __future__ import annotations

from jax import Array

from jaxdem.closures.correlation import Correlation
from jaxdem.numerics.host import namespace
from jaxdem.numerics.powers import power

NEWTON_REYNOLDS = 1000.0
"""Reynolds number above which the drag coefficient is the constant `NEWTON_DRAG_COEFFICIENT`."""
NEWTON_DRAG_COEFFICIENT = 0.44


def single_sphere_multiple(reynolds: Array) -> Array:
    """Drag of one sphere over its Stokes drag, Cd Re / 24.

    1 + 0.15 Re^0.687 up to Re = 1000, beyond it 0.44 Re / 24 (Newton's regime). The two differ by 0.4 % at
    Re = 1000 and the jump is kept. The slope of Re^0.687 at Re = 0 is infinite; the derivative there is 0.

    Args:
        reynolds: (...,) >= 0 [-].
    """
    newton = NEWTON_DRAG_COEFFICIENT / 24.0 * reynolds
    return namespace(reynolds).where(reynolds <= NEWTON_REYNOLDS, 1.0 + 0.15 * power(reynolds, 0.687), newton)


class SchillerNaumann(Correlation):
    """One sphere in an unbounded fluid; neighbours act only through the superficial slip in Re.

    F = 1 + 0.15 Re^0.687 for Re <= 1000, else 0.44 Re / 24; no function of the void fraction multiplies it.

    Valid for Re up to 2e5 (4 % below Re = 800) and solid fraction << 1.
    Source: L. Schiller & A. Naumann (1933), Z. Ver. Dtsch. Ing. 77, 318-320; the constant 0.44 beyond Re =
    1000 is the usual continuation.
    """

    def stokes_multiple(self, solid_fraction: Array, reynolds: Array) -> Array:
        """F(Re) [-]; the solid fraction does not enter."""
        return single_sphere_multiple(reynolds) + namespace(solid_fraction).zeros_like(solid_fraction)
