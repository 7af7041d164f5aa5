"""Rong, Dong and Yu's voidage function from lattice-Boltzmann simulations."""

from __future__ import annotations

from jax import Array

from jaxdem.closures.correlation import Correlation
from jaxdem.closures.di_felice import log_reynolds, single_sphere_drag
from jaxdem.numerics.host import namespace


class Rong(Correlation):
    """A power of the void fraction g like Di Felice's, with another exponent, on the drag of Dallavalle.

    force = pi/8 d^2 rho Cd g^2 |u - v| (u - v) g^-chi, Cd = (0.63 + 4.8 / sqrt(Re))^2,
    chi = 2.65 (g + 1) - (5.3 - 3.5 g) g^2 exp(-(1.5 - log10 Re)^2 / 2), hence F = Cd Re / 24 g^(1 - chi).

    Valid for packed and expanded beds of equal spheres, g 0.37 ... 1, Re up to 3000.
    Source: L. W. Rong, K. J. Dong & A. B. Yu (2013), Chem. Eng. Sci. 99, 44-58.
    """

    def stokes_multiple(self, solid_fraction: Array, reynolds: Array) -> Array:
        """F(s, Re) = (0.63 sqrt(Re) + 4.8)^2 / 24 g^(1 - chi) [-]."""
        void_fraction = 1.0 - solid_fraction
        dip = namespace(reynolds).exp(-0.5 * (1.5 - log_reynolds(reynolds)) ** 2)
        chi = 2.65 * (void_fraction + 1.0) - (5.3 - 3.5 * void_fraction) * void_fraction**2 * dip
        return single_sphere_drag(reynolds) * void_fraction ** (1.0 - chi)
