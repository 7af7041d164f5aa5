"""Virtual mass: the fluid that a particle has to accelerate along with itself.

    F = a (Du/Dt - dv/dt),   a = C rho V,   Du/Dt = du/dt + u.grad u  at the particle

Where a particle is much lighter than the fluid this is most of its inertia. It is therefore treated as inertia: the
contact steps move a body of mass m + a under the force a Du/Dt and all others, so that a collision in the fluid
rebounds with it and the restitution stays what it is. What the particle has got from the fluid in an interval is
then

    J = a (change of u along the fluid - change of v),

of which the fluid step, which is done before, has handed over what it expected. The rest, due to contacts that it
did not foresee, is owed: it is kept with the particle and handed to the faces in the next interval. Momentum of
particles and fluid together with what is owed is conserved to round-off.

Source: T. R. Auton, J. C. R. Hunt & M. Prud'homme, J. Fluid Mech. 197 (1988) 241-257: C = 1/2 for a sphere, with Du/Dt
along the fluid and not along the particle.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from jax import Array

from jaxdem.coupling.interpolation import Weights, interpolate
from jaxdem.fluid.grid import FaceField, Grid, cell_average, gradient, sum_of
from jaxdem.particles.integrate import ParticleProperties, as_column


class VirtualMassForce(NamedTuple):
    """What the virtual mass does over an interval.

    Attributes:
        given: (N, D) mean force that the fluid step has handed over [N].
        drive: (N, D) mean of a Du/Dt, the force on the body of mass m + a [N].
    """

    given: Array
    drive: Array


class FluidMemory(NamedTuple):
    """What forces of the fluid keep for every particle from one interval to the next; None for what is off.

    Attributes:
        owed: (N, D) impulse of the virtual mass that the particles have got and the faces have not lost yet [kg m/s].
        history: of the Basset force, see `jaxdem.coupling.history`.
    """

    owed: Array | None
    history: Any


def added_mass(coefficient: float, bodies: ParticleProperties, density: Array) -> Array:
    """C rho V, () or (N,) [kg]; density of the fluid [kg/m3]."""
    return coefficient * density * bodies.volume


def with_added_mass(coefficient: float, bodies: ParticleProperties, density: Array) -> ParticleProperties:
    """Bodies whose mass is m + C rho V, and whose moment of inertia is as it was: the fluid slips round a sphere."""
    return bodies._replace(added_density=coefficient * density)


def convective_acceleration(grid: Grid, weights: Weights, face_velocity: FaceField) -> Array:
    """u.grad u at the particles, (N, D) [m/s2]; exact for a linear flow away from walls."""
    velocity = cell_average(face_velocity)
    terms = tuple(
        sum_of(u * slope for u, slope in zip(velocity, cell_average(gradient(grid, component)), strict=True))
        for component in velocity
    )
    return interpolate(weights, terms)


def settle_up(force: VirtualMassForce, added: Array, change: Array, duration: Array) -> tuple[Array, Array]:
    """Mean virtual-mass force that has acted [N], and the impulse that the fluid is owed [kg m/s].

    Args:
        force: of the interval.
        added: a, () or (N,) [kg].
        change: (N, D) of the particles' velocity over the interval [m/s].
        duration: of the interval [s].
    """
    acted = force.drive - as_column(added) * change / duration
    return acted, (acted - force.given) * duration
