"""Koch-Hill drag from lattice-Boltzmann simulations."""

from __future__ import annotations

from jax import Array

from jaxdem.closures.correlation import Correlation
from jaxdem.numerics.host import namespace
from jaxdem.numerics.vectors import safe_sqrt


class KochHill(Correlation):
    """Random arrays of spheres, from lattice-Boltzmann simulations; the law of the source study.

    force = V_p beta / s (u - v), beta = 18 mu g^2 s / d^2 (F0 + F3 Re / 2), hence F = g^2 (F0 + F3 Re / 2),
    with s the solid and g the void fraction,
    F0 = (1 + 3 sqrt(s/2) + 135/64 s ln s + 16.14 s) / (1 + 0.681 s - 8.48 s^2 + 8.16 s^3) for s < 0.4,
    F0 = 10 s / g^3 for s >= 0.4,
    F3 = 0.0673 + 0.212 s + 0.0232 / g^5.

    Kept as published: F0 jumps by about 1 % at s = 0.4. The slopes of sqrt(s) and s ln s are infinite at s =
    0; both terms are 0 for s <= 0 and their derivative taken there is 0, so that gradients stay finite.

    Valid for s up to 0.64 and moderate Re (with the radius for length, Re / 2, up to about 100); used for all
    Re. One sphere gets F = 1 + 0.045 Re: less than Schiller-Naumann below Re = 46, more above (5.5 for 4.5 at
    Re = 100, 46 for 18 at Re = 1000).
    Source: D. L. Koch & R. J. Hill (2001), Annu. Rev. Fluid Mech. 33, 619-647; R. J. Hill, D. L. Koch & A. J.
    C. Ladd (2001), J. Fluid Mech. 448, 213-241 and 243-278. In this form: Davydzenka & Tahmasebi (2022), J.
    Fluid Mech. 938, A20 (which prints 135/2 for 135/64).
    """

    def stokes_multiple(self, solid_fraction: Array, reynolds: Array) -> Array:
        """F(s, Re) = g^2 (F0(s) + F3(s) Re / 2) [-]."""
        void_fraction = 1.0 - solid_fraction
        inertial = 0.0673 + 0.212 * solid_fraction + 0.0232 / void_fraction**5
        return void_fraction**2 * (_creeping(solid_fraction) + 0.5 * inertial * reynolds)


def _creeping(solid_fraction: Array) -> Array:
    """F0(s) of the law, the drag at Re = 0 over g^2 [-]."""
    # Each branch gets arguments of its own range only, so that the other one never spoils a gradient.
    xp = namespace(solid_fraction)
    s = xp.minimum(solid_fraction, 0.4)
    occupied = s > 0
    inside = xp.where(occupied, s, 1.0)
    logarithm = xp.where(occupied, inside * xp.log(inside), 0.0)
    numerator = 1.0 + 3.0 * safe_sqrt(0.5 * s) + 135.0 / 64.0 * logarithm + 16.14 * s
    dilute = numerator / (1.0 + 0.681 * s - 8.48 * s**2 + 8.16 * s**3)
    dense = 10.0 * solid_fraction / (1.0 - solid_fraction) ** 3
    return xp.where(solid_fraction < 0.4, dilute, dense)
