"""Virtual mass: the fluid that a particle has to accelerate along with itself.

    F = a (Du/Dt - dv/dt),   a = C rho V,   Du/Dt = du/dt + u.grad u  at the particle

Where a particle is much lighter than the fluid this is most of its inertia. It is therefore treated as inertia: the
contact steps move a body of mass m + a under the force a Du/Dt and all others, so that a collision in the fluid
rebounds with it and the restitution stays what it is. What the particle has got from the fluid in an interval is
then

    J = a (change of u along the fluid - change of v),

of which the fluid steps, which come before, have handed over what they expected. The rest, due to contacts that they
did not foresee, is pending: it is kept with the particle and handed to the faces in the next interval. Momentum of
particles and fluid together with the pending impulse is conserved to round-off.

Source: T. R. Auton, J. C. R. Hunt & M. Prud'homme, J. Fluid Mech. 197 (1988) 241-257: C = 1/2 for a sphere, with Du/Dt
along the fluid and not along the particle.
"""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jax import Array

from jaxdem.coupling.forces.protocol import Contribution, FluidForce, IntervalEnd, IntervalStart, MeanForce
from jaxdem.errors import required
from jaxdem.fluid.fluid_state import FluidProperties
from jaxdem.numerics.static import static
from jaxdem.particles.integrate import ParticleProperties, as_column


@static
class VirtualMass(FluidForce):
    """The virtual mass; it remembers the pending impulse (N, D) [kg m/s].

    Attributes:
        coefficient: C, 1/2 for a sphere [-].
    """

    name: ClassVar[str] = "virtual_mass"
    label: ClassVar[str] = "virtual mass"
    is_inertia: ClassVar[bool] = True

    coefficient: float

    def __str__(self) -> str:
        return f"{self.label} {self.coefficient:g}"

    def start(self, slip: Array) -> Array:
        """See `FluidForce`."""
        return jnp.zeros_like(slip)

    def begin(self, start: IntervalStart, memory: Array) -> Contribution:
        """See `FluidForce`. A particle that is not present has no virtual mass."""
        mass, active = self._mass(start.bodies, start.properties), start.particles.active
        mass = mass if active is None else jnp.where(active, mass, 0.0)
        return Contribution(slip_mass=mass, pending_impulse=memory)

    def end(self, mean: MeanForce, end: IntervalEnd) -> tuple[Array, Array]:
        """See `FluidForce`."""
        mass = as_column(self._mass(end.bodies, end.properties))
        acted = required(mean.drive, "drive of the virtual mass") - mass * end.velocity_change / end.duration
        return acted, (acted - mean.given) * end.duration

    def added_density(self, properties: FluidProperties) -> Array:
        """See `FluidForce`."""
        return self.coefficient * properties.density

    def _mass(self, bodies: ParticleProperties, properties: FluidProperties) -> Array:
        """C rho V, () or (N,) [kg]."""
        return self.coefficient * properties.density * bodies.volume
