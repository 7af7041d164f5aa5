"""Gidaspow's drag: Ergun where dense, Wen-Yu where dilute, switched or blended."""

from __future__ import annotations

import math

from jax import Array

from jaxdem.closures.correlation import Correlation
from jaxdem.closures.ergun import Ergun
from jaxdem.closures.wen_yu import WenYu
from jaxdem.numerics.host import namespace

SWITCH_SOLID_FRACTION = 0.2
"""Solid fraction (void fraction 0.8) at which Gidaspow goes from Wen-Yu to Ergun."""


class Gidaspow(Correlation):
    """Ergun for void fractions below 0.8, Wen-Yu from 0.8 on, with the jump that the switch has as published.

    F = F_Ergun(s, Re) for s > 0.2, else F_WenYu(s, Re). At the switch Ergun is the larger, by 15 % at Re = 0
    and by 73 % at Re = 100; `GidaspowBlended` has no jump.

    Valid over all void fractions from a packed bed to one sphere.
    Source: D. Gidaspow (1994), Multiphase Flow and Fluidization, Academic Press.
    """

    def stokes_multiple(self, solid_fraction: Array, reynolds: Array) -> Array:
        """F(s, Re), discontinuous at s = 0.2 [-]."""
        dense = Ergun().stokes_multiple(solid_fraction, reynolds)
        dilute = WenYu().stokes_multiple(solid_fraction, reynolds)
        return namespace(solid_fraction).where(solid_fraction > SWITCH_SOLID_FRACTION, dense, dilute)


class GidaspowBlended(Correlation):
    """Gidaspow's two laws with the smooth weight of Huilin and Gidaspow in place of the switch.

    beta = (1 - w) beta_Ergun + w beta_WenYu, w = arctan(150 * 1.75 (0.2 - s)) / pi + 1/2; the same for F.
    The weight is not quite one at s = 0 (0.994), so that one sphere has 0.6 % less than Stokes drag.

    Valid over all void fractions from a packed bed to one sphere.
    Source: L. Huilin & D. Gidaspow (2003), Chem. Eng. Sci. 58, 3777-3792.
    """

    def stokes_multiple(self, solid_fraction: Array, reynolds: Array) -> Array:
        """F(s, Re), smooth in s [-]."""
        dense = Ergun().stokes_multiple(solid_fraction, reynolds)
        dilute = WenYu().stokes_multiple(solid_fraction, reynolds)
        weight = (
            namespace(solid_fraction).arctan(150.0 * 1.75 * (SWITCH_SOLID_FRACTION - solid_fraction)) / math.pi + 0.5
        )
        return (1.0 - weight) * dense + weight * dilute
