"""Di Felice's voidage function on Dallavalle's single-sphere drag."""

from __future__ import annotations

from jax import Array

from jaxdem.closures.correlation import Correlation
from jaxdem.numerics.host import namespace
from jaxdem.numerics.vectors import safe_sqrt

SMALLEST_LOG_REYNOLDS = 1e-6
"""Below this Re the exponent is its creeping-flow value 3.7 to within 1e-12: no logarithm is needed."""


class DiFeliceDallavalle(Correlation):
    """Di Felice's power of the void fraction g, with the single-sphere drag of Dallavalle.

    force = pi/8 d^2 rho Cd g^2 |u - v| (u - v) g^-chi, Cd = (0.63 + 4.8 / sqrt(Re))^2,
    chi = 3.7 - 0.65 exp(-(1.5 - log10 Re)^2 / 2), hence F = Cd Re / 24 g^(1 - chi) with
    Cd Re / 24 = (0.63 sqrt(Re) + 4.8)^2 / 24, which has no pole at Re = 0. (There it is 0.96, not 1.)
    The slope of sqrt(Re) is infinite at Re = 0; the derivative taken there is 0.
    Di Felice's law with the drag of Schiller and Naumann is a different one.

    Valid for all void fractions from a packed bed to one sphere, Re 1e-2 ... 1e4.
    Source: R. Di Felice (1994), Int. J. Multiphase Flow 20, 153-159; J. M. Dallavalle (1948), Micromeritics,
    Pitman. Used with interstitial slip in model A as in Z. Y. Zhou et al. (2010), J. Fluid Mech. 661,
    482-510.
    """

    def stokes_multiple(self, solid_fraction: Array, reynolds: Array) -> Array:
        """F(s, Re) = (0.63 sqrt(Re) + 4.8)^2 / 24 g^(1 - chi) [-]."""
        chi = 3.7 - 0.65 * namespace(reynolds).exp(-0.5 * (1.5 - log_reynolds(reynolds)) ** 2)
        return single_sphere_drag(reynolds) * (1.0 - solid_fraction) ** (1.0 - chi)


def single_sphere_drag(reynolds: Array) -> Array:
    """Dallavalle's Cd Re / 24 = (0.63 sqrt(Re) + 4.8)^2 / 24 [-]."""
    return (0.63 * safe_sqrt(reynolds) + 4.8) ** 2 / 24.0


def log_reynolds(reynolds: Array) -> Array:
    """log10(Re), bounded below where the exponents do not depend on it any more [-]."""
    xp = namespace(reynolds)
    return xp.log10(xp.maximum(reynolds, SMALLEST_LOG_REYNOLDS))
