"""Rolling friction: a torque against the relative rotation of two bodies in contact."""

from __future__ import annotations

import dataclasses
from typing import Protocol

import jax.numpy as jnp
from jax import Array

from jaxdem.particles import vectors
from jaxdem.particles.contact import Contact, ContactForce, ContactMaterial
from jaxdem.particles.vectors import Vector


class RollingFriction(Protocol):
    """A model of rolling friction."""

    def __call__(
        self,
        contact: Contact,
        force: ContactForce,
        material: ContactMaterial,
        relative_angular_velocity: Vector,
        time_step: Array,
    ) -> Vector:
        """Torque on the particle [N m]."""
        ...


@dataclasses.dataclass(frozen=True)
class ConstantDirectionalTorque:
    """Torque of constant size against the relative rotation (CDT, model A of Ai et al.).

    T = -mu_r F_e R* w / |w| with the elastic normal force F_e and the relative angular velocity w. Where
    this would reverse w within the step it is reduced to what stops it, -I* w / dt with I* = 2/5 m* R*^2:
    otherwise a particle at rest would be kicked back and forth by the full torque. I* is the smallest
    reduced inertia the pair can have, so the reduced torque never overshoots in a single contact.

    Source: J. Ai et al., Powder Technol. 206 (2011) 269-282, eq. 8.
    """

    def __call__(
        self,
        contact: Contact,
        force: ContactForce,
        material: ContactMaterial,
        relative_angular_velocity: Vector,
        time_step: Array,
    ) -> Vector:
        """See `RollingFriction`."""
        rate = vectors.length(relative_angular_velocity)
        stopping = 0.4 * contact.effective_mass * contact.effective_radius**2 / time_step
        full = material.rolling_friction * force.elastic * contact.effective_radius
        turning = rate > 0
        coefficient = jnp.minimum(stopping, full / jnp.where(turning, rate, 1.0))
        return vectors.scale(-jnp.where(turning, coefficient, stopping), relative_angular_velocity)
