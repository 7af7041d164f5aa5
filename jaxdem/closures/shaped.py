"""Drag of particles that are no spheres, by their sphericity; Di Felice's power of the void fraction for neighbours."""

from __future__ import annotations

from abc import abstractmethod
from typing import NamedTuple

from jax import Array

from jaxdem.closures.base import Drag, DragInputs
from jaxdem.closures.correlation import Correlation
from jaxdem.closures.di_felice import log_reynolds
from jaxdem.numerics.host import namespace
from jaxdem.numerics.powers import power
from jaxdem.numerics.vectors import safe_sqrt


class ParticleShape(NamedTuple):
    """What a law is told of the shape of particles.

    Attributes:
        sphericity: () or (N,) surface of the sphere of the same volume over that of the particle [-].
        crosswise: () or (N,) area of the projection of that sphere over that of the particle, along the slip [-].
    """

    sphericity: Array
    crosswise: Array


class ShapedCorrelation(Correlation):
    """A law of particles of any shape: F = C_D Re / 24 g^(1 - chi), Re with the sphere of the same volume.

    chi = 3.7 - 0.65 exp(-(1.5 - log10 Re)^2 / 2) as in `di_felice`. Of particles whose shape the law is not told, as
    spheres are, both sphericities are 1.
    """

    @abstractmethod
    def single_multiple(self, reynolds: Array, shape: ParticleShape) -> Array:
        """C_D Re / 24 of one particle [-]."""

    def stokes_multiple(self, solid_fraction: Array, reynolds: Array) -> Array:
        """F of spheres [-]."""
        one = namespace(reynolds).ones((), reynolds.dtype)
        return self.shaped_multiple(solid_fraction, reynolds, ParticleShape(one, one))

    def shaped_multiple(self, solid_fraction: Array, reynolds: Array, shape: ParticleShape) -> Array:
        """F [-]."""
        chi = 3.7 - 0.65 * namespace(reynolds).exp(-0.5 * (1.5 - log_reynolds(reynolds)) ** 2)
        return self.single_multiple(reynolds, shape) * (1.0 - solid_fraction) ** (1.0 - chi)

    def of_shape(self, inputs: DragInputs, shape: ParticleShape) -> Drag:
        """The drag of particles of a shape; see `Correlation.__call__`."""
        return self.evaluated(inputs, lambda fraction, reynolds: self.shaped_multiple(fraction, reynolds, shape))


class HaiderLevenspiel(ShapedCorrelation):
    """Haider & Levenspiel's drag of isometric particles, with Di Felice's power of the void fraction g.

    C_D = 24 / Re (1 + A Re^B) + C / (1 + D / Re), with the sphericity s

    A = exp(2.3288 - 6.4581 s + 2.4486 s^2), B = 0.0964 + 0.5565 s,
    C = exp(4.905 - 13.8944 s + 18.4222 s^2 - 10.2599 s^3), D = exp(1.4681 + 12.2584 s - 20.7322 s^2 + 15.8855 s^3),

    hence F = (1 + A Re^B + C Re^2 / (24 (Re + D))) g^(1 - chi). It does not depend on how a particle lies. (At s = 1 it
    is the law of spheres to 3 %.)

    Valid for sphericities 0.67 ... 1, Re up to 2.5e4; less exact for discs, and not for rods.
    Source: A. Haider & O. Levenspiel (1989), Powder Technol. 58, 63-70, eq. 10; R. Di Felice (1994), Int. J. Multiphase
    Flow 20, 153-159, for g.
    """

    def single_multiple(self, reynolds: Array, shape: ParticleShape) -> Array:
        """C_D Re / 24 [-]."""
        s, xp = shape.sphericity, namespace(reynolds)
        a = xp.exp(2.3288 - 6.4581 * s + 2.4486 * s**2)
        c = xp.exp(4.905 - 13.8944 * s + 18.4222 * s**2 - 10.2599 * s**3)
        d = xp.exp(1.4681 + 12.2584 * s - 20.7322 * s**2 + 15.8855 * s**3)
        positive = reynolds > 0
        grown = xp.where(positive, xp.where(positive, reynolds, 1.0) ** (0.0964 + 0.5565 * s), 0.0)
        return 1.0 + a * grown + c * reynolds**2 / (24.0 * (reynolds + d))


class HoelzerSommerfeld(ShapedCorrelation):
    """Hoelzer & Sommerfeld's drag by how a particle lies in the stream, with Di Felice's power of the void fraction g.

    C_D = 8 / (Re sqrt(s_c)) + 16 / (Re sqrt(s)) + 3 / (sqrt(Re) s^(3/4)) + 0.42 10^(0.4 (-log10 s)^0.2) / s_c,

    with the sphericity s and the crosswise sphericity s_c; the simpler form of the two, without the lengthwise one.
    F = C_D Re / 24 g^(1 - chi). (For a sphere at Re = 1000 that is 8 % above Schiller and Naumann.)

    Valid for all shapes, Re up to 1e5, mean deviation 14 %.
    Source: A. Hoelzer & M. Sommerfeld (2008), Powder Technol. 184, 361-365, eq. 10; with Di Felice's power as in
    J. E. Hilton, L. R. Mason & P. W. Cleary (2010), Chem. Eng. Sci. 65, 1584-1596.
    """

    def single_multiple(self, reynolds: Array, shape: ParticleShape) -> Array:
        """C_D Re / 24 [-]."""
        s, across, xp = shape.sphericity, shape.crosswise, namespace(reynolds)
        low = (8.0 / xp.sqrt(across) + 16.0 / xp.sqrt(s)) / 24.0
        bent = 0.4 * power(-xp.log10(xp.minimum(s, xp.ones_like(s))), 0.2)
        newton = 0.42 * 10.0**bent / across
        return low + 3.0 * safe_sqrt(reynolds) / (24.0 * s**0.75) + newton * reynolds / 24.0
