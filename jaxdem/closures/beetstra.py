"""Beetstra, van der Hoef and Kuipers' drag (BVK) from lattice-Boltzmann simulations."""

from __future__ import annotations

from jax import Array

from jaxdem.closures.correlation import Correlation
from jaxdem.numerics.host import namespace
from jaxdem.numerics.vectors import safe_sqrt


class Beetstra(Correlation):
    """Random arrays of equal spheres.

    With s the solid and g the void fraction, F = g F_B, force = 3 pi mu d g (u - v) F_B,
    F_B = 10 s / g^2 + g^2 (1 + 1.5 sqrt(s))
          + 0.413 Re / (24 g^2) (1/g + 3 s g + 8.4 Re^-0.343) / (1 + 10^(3 s) Re^-(1 + 4 s)/2).
    The slope of sqrt(s) is infinite at s = 0; the derivative taken there is 0.

    Valid for s 0.1 ... 0.6 (and one sphere) and Re up to 1000.
    Source: R. Beetstra, M. A. van der Hoef & J. A. M. Kuipers (2007), AIChE J. 53, 489-501; the creeping
    part: M. A. van der Hoef, R. Beetstra & J. A. M. Kuipers (2005), J. Fluid Mech. 528, 233-254.
    """

    def stokes_multiple(self, solid_fraction: Array, reynolds: Array) -> Array:
        """F(s, Re) = g F_B(s, Re) [-]."""
        void_fraction = 1.0 - solid_fraction
        # Numerator and denominator of the inertial part times Re^((1 + 4 s)/2): no pole at Re = 0.
        power = 0.5 + 2.0 * solid_fraction
        xp, moving = namespace(reynolds), reynolds > 0
        inside = xp.where(moving, reynolds, 1.0)
        ratio = (
            (1.0 / void_fraction + 3.0 * solid_fraction * void_fraction) * inside ** (1.0 + power)
            + 8.4 * inside ** (0.657 + power)
        ) / (inside**power + 10.0 ** (3.0 * solid_fraction))
        inertial = 0.413 / (24.0 * void_fraction**2) * xp.where(moving, ratio, 0.0)
        return void_fraction * (creeping_drag(solid_fraction) + inertial)


def creeping_drag(solid_fraction: Array) -> Array:
    """10 s / g^2 + g^2 (1 + 1.5 sqrt(s)), drag at Re = 0 over 3 pi mu d g (u - v) [-]."""
    void_fraction = 1.0 - solid_fraction
    return 10.0 * solid_fraction / void_fraction**2 + void_fraction**2 * (1.0 + 1.5 * safe_sqrt(solid_fraction))
