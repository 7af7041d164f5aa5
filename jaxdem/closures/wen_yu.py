"""Wen-Yu drag in a suspension."""

from __future__ import annotations

from jax import Array

from jaxdem.closures.correlation import Correlation
from jaxdem.closures.schiller_naumann import single_sphere_multiple


class WenYu(Correlation):
    """Fluidised suspensions: the single sphere times a power of the void fraction.

    beta = 3/4 Cd rho s g |u - v| / d g^-2.65 with Cd = 24 / Re (1 + 0.15 Re^0.687) up to Re = 1000, else
    0.44, and
    force = V_p beta / s (u - v), hence F = Cd Re / 24 g^-2.65.

    Valid for void fractions g > 0.8; below it underestimates the drag of a packed bed.
    Source: C. Y. Wen & Y. H. Yu (1966), Chem. Eng. Prog. Symp. Ser. 62 (62), 100-111; in the form with beta:
    D. Gidaspow (1994), Multiphase Flow and Fluidization, Academic Press.
    """

    def stokes_multiple(self, solid_fraction: Array, reynolds: Array) -> Array:
        """F(s, Re) = Cd Re / 24 g^-2.65 [-]."""
        return single_sphere_multiple(reynolds) * (1.0 - solid_fraction) ** -2.65
