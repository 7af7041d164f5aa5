"""Tang and co-workers' drag from immersed-boundary simulations."""

from __future__ import annotations

from jax import Array

from jaxdem.closures.beetstra import creeping_drag
from jaxdem.closures.correlation import Correlation
from jaxdem.numerics.host import namespace
from jaxdem.numerics.powers import power


class Tang(Correlation):
    """Static random arrays of equal spheres, to higher Re than the lattice-Boltzmann fits.

    With s the solid and g the void fraction, F = g F_T, force = 3 pi mu d g (u - v) F_T,
    F_T = 10 s / g^2 + g^2 (1 + 1.5 sqrt(s))
          + (0.11 s (1 + s) - 0.00456 / g^4 + (0.169 g + 0.0644 / g^4) Re^-0.343) Re.
    The slopes of sqrt(s) and Re^0.657 are infinite at 0; the derivatives taken there are 0.

    Valid for s up to 0.6 and Re up to 1000. For dilute beds at very large Re the inertial part of the fit would
    become negative; it is cut off at zero there.
    Source: Y. Tang, E. A. J. F. Peters, J. A. M. Kuipers, S. H. L. Kriebitzsch & M. A. van der Hoef (2015),
    AIChE J. 61, 688-698.
    """

    def stokes_multiple(self, solid_fraction: Array, reynolds: Array) -> Array:
        """F(s, Re) = g F_T(s, Re) [-]."""
        void_fraction = 1.0 - solid_fraction
        linear = 0.11 * solid_fraction * (1.0 + solid_fraction) - 0.00456 / void_fraction**4
        inertial = linear * reynolds + (0.169 * void_fraction + 0.0644 / void_fraction**4) * power(reynolds, 0.657)
        return void_fraction * (creeping_drag(solid_fraction) + namespace(reynolds).maximum(inertial, 0.0))
