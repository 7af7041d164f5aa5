"""The fluid around particles that turn in it, and its torque on them."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.coupling.forces.protocol import Contribution, FluidForce, IntervalStart
from jaxdem.coupling.interpolation import Weights, interpolate
from jaxdem.fluid.grid import FaceField, Grid, cell_average, gradient
from jaxdem.numerics import vectors
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector


class FlowAround(NamedTuple):
    """What the fluid does around every particle; vectors have D, angular ones A components (N,).

    Attributes:
        slip: fluid velocity less particle velocity [m/s].
        vorticity: curl of the fluid velocity [1/s].
        spin: angular velocity of the particle [rad/s].
        diameter: of the grains () or (N,) [m].
        density: of the fluid () [kg/m3].
        viscosity: dynamic () [Pa s].
    """

    slip: Vector
    vorticity: Vector
    spin: Vector
    diameter: Array
    density: Array
    viscosity: Array


def flow_around(start: IntervalStart) -> FlowAround:
    """The flow around the particles at the start of an interval."""
    density = start.properties.density
    return FlowAround(
        vectors.components(start.slip),
        vorticity(start.grid, start.weights, start.face_velocity),
        vectors.components(start.particles.angular_velocity),
        2.0 * start.bodies.grain_radius,
        density,
        density * start.properties.viscosity,
    )


@static
class RotationalDrag(FluidForce):
    """The torque of the fluid on particles that turn relative to it; see `rotational_drag`."""

    name: ClassVar[str] = "rotational_drag"
    acts_on_velocity: ClassVar[bool] = False
    label: ClassVar[str] = "rotational drag"

    def begin(self, start: IntervalStart, memory: None) -> Contribution:
        """See `FluidForce`."""
        torque = rotational_drag(flow_around(start), start.bodies.inertia, start.duration)
        return Contribution(torque=vectors.stack(torque))


def rotational_drag(around: FlowAround, inertia: Array, duration: Array) -> Vector:
    """Mean torque of the fluid on a sphere that turns relative to it, over an interval [N m].

    T = c W, W = w/2 - omega, c = pi mu d^3 C Re_r / (64 pi), with C = 64 pi / Re_r up to Re_r = rho |W| d^2 / mu
    = 32 and C = 12.9 / sqrt(Re_r) + 128.4 / Re_r beyond. The rotation relaxes exactly over the interval with c of
    its start: T = I W (1 - exp(-c t / I)) / t. The fluid does not feel this torque: its cells carry no spin.

    Args:
        around: at the start of the interval.
        inertia: moment of inertia of the particles () or (N,) [kg m2].
        duration: t () [s].

    Source: S. C. R. Dennis, S. N. Singh & D. B. Ingham, J. Fluid Mech. 101 (1980) 257-279.
    """
    relative = relative_rotation(around)
    rotation = around.density * vectors.length(relative) * around.diameter**2 / around.viscosity
    fast = rotation > 32.0
    inside = jnp.where(fast, rotation, 32.0)
    factor = jnp.where(fast, (12.9 * jnp.sqrt(inside) + 128.4) / (64.0 * jnp.pi), 1.0)
    coefficient = jnp.pi * around.viscosity * around.diameter**3 * factor
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


def relative_rotation(around: FlowAround) -> Vector:
    """Half of the vorticity less the spin [rad/s]."""
    return vectors.subtract(vectors.scale(0.5, around.vorticity), around.spin)
