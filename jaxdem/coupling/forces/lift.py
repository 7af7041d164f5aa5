"""Lift: forces across the slip on particles in a shear, or that turn."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

import jax.numpy as jnp

from jaxdem.coupling.forces.protocol import Contribution, FluidForce, IntervalStart
from jaxdem.coupling.forces.rotation import FlowAround, flow_around, relative_rotation
from jaxdem.numerics import vectors
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector


class Lift(FluidForce):
    """A lift law: a force for given slip, vorticity and spin, constant over the coupling interval."""

    @abstractmethod
    def force(self, around: FlowAround) -> Vector:
        """Force on every particle, D arrays (N,) [N]; zero without slip."""

    def begin(self, start: IntervalStart, memory: None) -> Contribution:
        """See `FluidForce`."""
        return Contribution(force=start.bodies.of_all_grains(vectors.stack(self.force(flow_around(start)))))


@static
class SaffmanMei(Lift):
    """Lift on a sphere that lags in a shear: towards the faster fluid if the fluid overtakes it.

    F = 1.615 d^2 sqrt(rho mu / |w|) C (u - v) x w, w the vorticity; with Re = rho |u - v| d / mu and
    b = d |w| / (2 |u - v|),
        C = (1 - 0.3314 sqrt(b)) exp(-Re/10) + 0.3314 sqrt(b)   for Re <= 40,
        C = 0.0524 sqrt(b Re)                                   for Re > 40.
    Source: P. G. Saffman, J. Fluid Mech. 22 (1965) 385-400, with the corrigendum in 31 (1968) 624; R. Mei, Int.
    J. Multiphase Flow 18 (1992) 145-147. Mei's fit is for 0.005 < b < 0.4 and jumps by a few per cent at
    Re = 40: kept as published.
    """

    name: ClassVar[str] = "saffman_mei"
    label: ClassVar[str] = "Saffman-Mei lift"

    def force(self, around: FlowAround) -> Vector:
        """See `Lift`."""
        speed, rate = vectors.length(around.slip), vectors.length(around.vorticity)
        acts = (speed > 0) & (rate > 0)
        speed, rate = jnp.where(acts, speed, 1.0), jnp.where(acts, rate, 1.0)
        reynolds = around.density * speed * around.diameter / around.viscosity
        shear = 0.5 * around.diameter * rate / speed
        slow = (1.0 - 0.3314 * jnp.sqrt(shear)) * jnp.exp(-reynolds / 10.0) + 0.3314 * jnp.sqrt(shear)
        factor = jnp.where(reynolds <= 40.0, slow, 0.0524 * jnp.sqrt(shear * reynolds))
        size = 1.615 * around.diameter**2 * jnp.sqrt(around.density * around.viscosity / rate) * factor
        return vectors.scale(jnp.where(acts, -size, 0.0), vectors.rotate(around.vorticity, around.slip))


@static
class Magnus(Lift):
    """Lift on a sphere that turns relative to the fluid.

    F = pi/8 d^2 rho C |u - v| (W x (u - v)) / |W|, W = w/2 - omega the relative rotation, w the vorticity; with
    Re = rho |u - v| d / mu and Re_r = rho |W| d^2 / mu,
        C = 0.45 + (Re_r / Re - 0.45) exp(-0.05684 Re_r^0.4 Re^0.3).
    At small Re that is pi/8 d^3 rho W x (u - v), Rubinow and Keller's.

    Source: B. Oesterle & T. Bui Dinh, Exp. Fluids 25 (1998) 16-22, for Re < 140; S. I. Rubinow & J. B. Keller, J.
    Fluid Mech. 11 (1961) 447-459.
    """

    name: ClassVar[str] = "magnus"
    label: ClassVar[str] = "Magnus lift"

    def force(self, around: FlowAround) -> Vector:
        """See `Lift`."""
        relative = relative_rotation(around)
        speed, rate = vectors.length(around.slip), vectors.length(relative)
        acts = (speed > 0) & (rate > 0)
        speed, rate = jnp.where(acts, speed, 1.0), jnp.where(acts, rate, 1.0)
        reynolds = around.density * speed * around.diameter / around.viscosity
        rotation = around.density * rate * around.diameter**2 / around.viscosity
        decay = jnp.exp(-0.05684 * rotation**0.4 * reynolds**0.3)
        factor = 0.45 + (rotation / reynolds - 0.45) * decay
        size = 0.125 * jnp.pi * around.diameter**2 * around.density * factor * speed / rate
        return vectors.scale(jnp.where(acts, size, 0.0), vectors.rotate(relative, around.slip))
