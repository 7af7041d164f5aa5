"""Rolling friction: a torque against the relative rotation of two bodies in contact."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import jax.numpy as jnp
from jax import Array

from jaxdem.numerics import vectors
from jaxdem.numerics.quotients import quotient
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector
from jaxdem.particles import tangent
from jaxdem.particles.contact import Contact, ContactForce, ContactMaterial


class Rotation(NamedTuple):
    """How two bodies in contact turn against each other.

    Attributes:
        normal: unit vector towards the particle.
        spin: angular velocity relative to the other body [rad/s].
        spring: torque kept from the step before; () without a spring [N m].
    """

    normal: Vector
    spin: Vector
    spring: Vector


class RollingFriction(Protocol):
    """A model of rolling friction; immutable, without numbers."""

    @property
    def has_spring(self) -> bool:
        """Whether contacts keep a torque from step to step."""
        ...

    def stiffness(self, lever: Array, elastic: Array, overlap: Array) -> Array:
        """Torque of the spring over its angle, for the balance of energy; not asked for without a spring [N m].

        Args:
            lever: mu_r R* [m].
            elastic: normal force [N].
            overlap: positive [m].
        """
        ...

    def __call__(
        self,
        contact: Contact,
        force: ContactForce,
        material: ContactMaterial,
        rotation: Rotation,
        time_step: Array,
    ) -> tuple[Vector, Vector]:
        """Torque on the particle [N m], and the torque that the contact keeps.

        Args:
            contact: geometry and history.
            force: of the contact law.
            material: numbers.
            rotation: of the two bodies against each other.
            time_step: [s].
        """
        ...


@static
class ConstantDirectionalTorque:
    """Torque of constant size against the relative rotation (CDT, model A of Ai et al.).

    T = -mu_r F_e R* w / |w| with the elastic normal force F_e and the relative angular velocity w; in 3-D its part in
    the contact plane, the rotation that rolls: a twist about the normal is free, and takes nothing of the torque. Where
    this would reverse w within the step it is reduced to what stops it, -I* w / dt with I* = 2/5 m* R*^2:
    otherwise a particle at rest would be kicked back and forth by the full torque. I* is the smallest
    reduced inertia the pair can have, so the reduced torque never overshoots in a single contact. Walls, whose I* are
    the particle's own inertia, share it among those that touch: in a corner each would stop it, and all three turn it
    the other way, twice as fast. Equal spheres have an eighth of the inertia in each of at most twelve contacts.

    Source: J. Ai et al., Powder Technol. 206 (2011) 269-282, eq. 8.
    """

    has_spring = False

    def stiffness(self, lever: Array, elastic: Array, overlap: Array) -> Array:
        """See `RollingFriction`."""
        return jnp.zeros_like(overlap)

    def __call__(
        self,
        contact: Contact,
        force: ContactForce,
        material: ContactMaterial,
        rotation: Rotation,
        time_step: Array,
    ) -> tuple[Vector, Vector]:
        """See `RollingFriction`."""
        rolling = tangent.rolling_part(rotation.spin, rotation.normal)
        rate = vectors.length(rolling)
        stopping = 0.4 * contact.effective_mass * contact.effective_radius**2 / (contact.sharing * time_step)
        full = material.rolling_friction * force.elastic * contact.effective_radius
        # Divided only where it limits: a rotation that dies out, to 1e-163 rad/s, would have an infinite slope in the
        # other branch.
        limited = full < stopping * rate
        coefficient = jnp.where(limited, quotient(full, jnp.where(limited, rate, 1.0)), stopping)
        return vectors.scale(-coefficient, rolling), ()


@static
class ElasticPlasticSpringDashpot:
    """A rolling spring that yields, and a dashpot that acts while it does not (EPSD, model C of Ai et al.).

    T = T_k + T_d: T_k grows by -k_r w dt and is cut back to |T_k| <= mu_r R* F_e; T_d = -C_r w while T_k is
    below that limit and 0 at it; k_r = 9/4 mu_r^2 R*^2 F_e / d, d the overlap, and
    C_r = 2 eta_r sqrt(I k_r) with the rolling inertia I of the contact. A grain comes to rest, and stays at rest
    on a slope with tan(a) < mu_r. In 3-D w is the relative rotation in the contact plane: twisting is free.

    Source: J. Ai et al., Powder Technol. 206 (2011) 269-282, model C, with k_r = 9/4 k_n (mu_r R*)^2 after
    M. J. Jiang et al., Comput. Geotech. 32 (2005) 340-357; k_n is the secant stiffness F_e / d.
    """

    has_spring = True

    def stiffness(self, lever: Array, elastic: Array, overlap: Array) -> Array:
        """See `RollingFriction`: k_r."""
        return 2.25 * lever**2 * elastic / overlap

    def __call__(
        self,
        contact: Contact,
        force: ContactForce,
        material: ContactMaterial,
        rotation: Rotation,
        time_step: Array,
    ) -> tuple[Vector, Vector]:
        """See `RollingFriction`."""
        rolling = tangent.rolling_part(rotation.spin, rotation.normal)
        arm = material.rolling_friction * contact.effective_radius
        stiffness = self.stiffness(arm, force.elastic, contact.overlap)
        turned = tangent.turned_into_plane(rotation.spring, rotation.normal)
        trial = vectors.add_scaled(turned, -stiffness * time_step, rolling)
        size, limit = vectors.length(trial), arm * force.elastic
        yields = size > limit
        kept = vectors.scale(jnp.where(yields, quotient(limit, jnp.where(yields, size, 1.0)), 1.0), trial)
        positive = stiffness > 0
        # The product of both underflows in single precision for grains of a few micrometres.
        critical = 2.0 * jnp.sqrt(jnp.where(positive, stiffness, 1.0)) * jnp.sqrt(contact.rolling_inertia)
        damping = jnp.where(positive & ~yields, material.rolling_damping * critical, 0.0)
        return vectors.add_scaled(kept, -damping, rolling), kept
