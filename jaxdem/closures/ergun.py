"""Ergun's drag in a packed bed."""

from __future__ import annotations

from jax import Array

from jaxdem.closures.correlation import Correlation


class Ergun(Correlation):
    """Packed beds of spheres.

    beta = 150 s^2 mu / (g d^2) + 1.75 rho s |u - v| / d and force = V_p beta / s (u - v), hence
    F = 150 s / (18 g) + 1.75 Re / (18 g), with s the solid and g the void fraction.
    In a fixed bed (g grad p = -beta u) this is Ergun's pressure drop for the superficial velocity U = g u,
    dp/L = 150 mu U s^2 / (g^3 d^2) + 1.75 rho U^2 s / (g^3 d).

    Valid for 0.3 < g < 0.6, Re / s from 1 to 2500; in dilute flow it goes to zero drag and is wrong: use
    Gidaspow's laws there.
    Source: S. Ergun (1952), Chem. Eng. Prog. 48, 89-94; as interphase exchange of model A: D. Gidaspow
    (1994), Multiphase Flow and Fluidization, Academic Press.
    """

    def stokes_multiple(self, solid_fraction: Array, reynolds: Array) -> Array:
        """F(s, Re) = (150 s + 1.75 Re) / (18 g) [-]."""
        return (150.0 * solid_fraction + 1.75 * reynolds) / (18.0 * (1.0 - solid_fraction))
