"""Lift on the particles, and the torque of the fluid on them.

A lift law is an immutable object; lift is part of what drag laws call the remainder, a force given for the
interval, so that the fluid loses what the particles gain.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple, Protocol

import jax.numpy as jnp
from jax import Array

from jaxdem.coupling.interpolation import Weights, interpolate
from jaxdem.fluid.grid import FaceField, Grid, cell_average, gradient
from jaxdem.particles import vectors
from jaxdem.particles.vectors import Vector


class LiftInputs(NamedTuple):
    """What the fluid does around every particle; vectors have D, angular ones A components (N,).

    Attributes:
        slip: fluid velocity less particle velocity [m/s].
        vorticity: curl of the fluid velocity [1/s].
        spin: angular velocity of the particle [rad/s].
        diameter: () or (N,) [m].
        density: of the fluid () [kg/m3].
        viscosity: dynamic () [Pa s].
    """

    slip: Vector
    vorticity: Vector
    spin: Vector
    diameter: Array
    density: Array
    viscosity: Array


class LiftLaw(Protocol):
    """A lift law."""

    def __call__(self, inputs: LiftInputs) -> Vector:
        """Force on every particle [N]; zero without slip."""
        ...


@dataclasses.dataclass(frozen=True)
class SaffmanMei:
    """Lift on a sphere that lags in a shear: towards the faster fluid if the fluid overtakes it.

    F = 1.615 d^2 sqrt(rho mu / |w|) C (u - v) x w, w the vorticity; with Re = rho |u - v| d / mu and
    b = d |w| / (2 |u - v|),
        C = (1 - 0.3314 sqrt(b)) exp(-Re/10) + 0.3314 sqrt(b)   for Re <= 40,
        C = 0.0524 sqrt(b Re)                                   for Re > 40.
    Source: P. G. Saffman, J. Fluid Mech. 22 (1965) 385-400, with the corrigendum in 31 (1968) 624; R. Mei, Int.
    J. Multiphase Flow 18 (1992) 145-147. Mei's fit is for 0.005 < b < 0.4 and jumps by a few per cent at
    Re = 40: kept as published.
    """

    def __call__(self, inputs: LiftInputs) -> Vector:
        """See `LiftLaw`."""
        speed, rate = vectors.length(inputs.slip), vectors.length(inputs.vorticity)
        acts = (speed > 0) & (rate > 0)
        speed, rate = jnp.where(acts, speed, 1.0), jnp.where(acts, rate, 1.0)
        reynolds = inputs.density * speed * inputs.diameter / inputs.viscosity
        shear = 0.5 * inputs.diameter * rate / speed
        slow = (1.0 - 0.3314 * jnp.sqrt(shear)) * jnp.exp(-reynolds / 10.0) + 0.3314 * jnp.sqrt(shear)
        factor = jnp.where(reynolds <= 40.0, slow, 0.0524 * jnp.sqrt(shear * reynolds))
        size = 1.615 * inputs.diameter**2 * jnp.sqrt(inputs.density * inputs.viscosity / rate) * factor
        return vectors.scale(jnp.where(acts, -size, 0.0), vectors.rotate(inputs.vorticity, inputs.slip))


@dataclasses.dataclass(frozen=True)
class Magnus:
    """Lift on a sphere that turns relative to the fluid.

    F = pi/8 d^2 rho C |u - v| (W x (u - v)) / |W|, W = w/2 - omega the relative rotation, w the vorticity; with
    Re = rho |u - v| d / mu and Re_r = rho |W| d^2 / mu,
        C = 0.45 + (Re_r / Re - 0.45) exp(-0.05684 Re_r^0.4 Re^0.3).
    At small Re that is pi/8 d^3 rho W x (u - v), Rubinow and Keller's.

    Source: B. Oesterle & T. Bui Dinh, Exp. Fluids 25 (1998) 16-22, for Re < 140; S. I. Rubinow & J. B. Keller, J.
    Fluid Mech. 11 (1961) 447-459.
    """

    def __call__(self, inputs: LiftInputs) -> Vector:
        """See `LiftLaw`."""
        relative = _relative_rotation(inputs)
        speed, rate = vectors.length(inputs.slip), vectors.length(relative)
        acts = (speed > 0) & (rate > 0)
        speed, rate = jnp.where(acts, speed, 1.0), jnp.where(acts, rate, 1.0)
        reynolds = inputs.density * speed * inputs.diameter / inputs.viscosity
        rotation = inputs.density * rate * inputs.diameter**2 / inputs.viscosity
        decay = jnp.exp(-0.05684 * rotation**0.4 * reynolds**0.3)
        factor = 0.45 + (rotation / reynolds - 0.45) * decay
        size = 0.125 * jnp.pi * inputs.diameter**2 * inputs.density * factor * speed / rate
        return vectors.scale(jnp.where(acts, size, 0.0), vectors.rotate(relative, inputs.slip))


def rotational_drag(inputs: LiftInputs, inertia: Array, duration: Array) -> Vector:
    """Mean torque of the fluid on a sphere that turns relative to it, over an interval [N m].

    T = c W, W = w/2 - omega, c = pi mu d^3 C Re_r / (64 pi), with C = 64 pi / Re_r up to Re_r = rho |W| d^2 / mu
    = 32 and C = 12.9 / sqrt(Re_r) + 128.4 / Re_r beyond. The rotation relaxes exactly over the interval with c of
    its start: T = I W (1 - exp(-c t / I)) / t. The fluid does not feel this torque: its cells carry no spin.

    Args:
        inputs: at the start of the interval.
        inertia: moment of inertia of the particles () or (N,) [kg m2].
        duration: t () [s].

    Source: S. C. R. Dennis, S. N. Singh & D. B. Ingham, J. Fluid Mech. 101 (1980) 257-279.
    """
    relative = _relative_rotation(inputs)
    rotation = inputs.density * vectors.length(relative) * inputs.diameter**2 / inputs.viscosity
    fast = rotation > 32.0
    inside = jnp.where(fast, rotation, 32.0)
    factor = jnp.where(fast, (12.9 * jnp.sqrt(inside) + 128.4) / (64.0 * jnp.pi), 1.0)
    coefficient = jnp.pi * inputs.viscosity * inputs.diameter**3 * factor
    return vectors.scale(-inertia / duration * jnp.expm1(-coefficient * duration / inertia), relative)


def vorticity(grid: Grid, weights: Weights, face_velocity: FaceField) -> Vector:
    """Curl of the velocity at the particles, A arrays (N,) [1/s].

    Central differences of the cells' mean velocities, exact for a uniform shear; at a side of the box that of the
    nearest inner face counts twice, as the wall's own velocity is not looked at.
    """
    slopes = [cell_average(gradient(grid, component)) for component in cell_average(face_velocity)]
    curl: Vector = (slopes[1][0] - slopes[0][1],)
    if grid.dimension == 3:
        curl = (
            slopes[2][1] - slopes[1][2],
            slopes[0][2] - slopes[2][0],
            slopes[1][0] - slopes[0][1],
        )
    return vectors.components(interpolate(weights, curl))


def _relative_rotation(inputs: LiftInputs) -> Vector:
    return vectors.subtract(vectors.scale(0.5, inputs.vorticity), inputs.spin)
