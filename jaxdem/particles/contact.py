"""Contact laws: overlap, relative velocity and history in, force and new history out.

A law is an immutable object without numbers; its numbers are a `ContactMaterial`, one for pairs of
particles and one for particles and walls. Everything is elementwise, on arrays of any one shape.

Sources:
    H. Hertz, J. reine angew. Math. 92 (1881) 156-171: normal force.
    R. D. Mindlin, J. Appl. Mech. 16 (1949) 259-268: tangential stiffness.
    Y. Tsuji, T. Tanaka, T. Ishida, Powder Technol. 71 (1992) 239-250: damping proportional to
        sqrt(stiffness mass).
    F. Antypov, J. A. Elliott, EPL 94 (2011) 50004: with contact ending at zero overlap that damping gives
        the restitution exactly, at every speed.
    P. A. Cundall, O. D. L. Strack, Geotechnique 29 (1979) 47-65: linear spring-dashpot, Coulomb limit.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable

import jax.numpy as jnp
from jax import Array

from jaxdem.numerics import vectors
from jaxdem.numerics.host import namespace
from jaxdem.numerics.quotients import quotient
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.cohesion import CohesionConstants
from jaxdem.particles.lubrication import LubricationConstants


class ContactMaterial(NamedTuple):
    """Numbers of contacts between two bodies; traced. A law uses those it knows.

    Each () where all contacts have the same, else of the shape of the contacts; with several materials a scene
    holds them as tables (P,) by pair of materials.

    Attributes:
        effective_young_modulus: E*, 1/E* = (1 - nu1^2)/E1 + (1 - nu2^2)/E2 [Pa].
        effective_shear_modulus: G*, 1/G* = (2 - nu1)/G1 + (2 - nu2)/G2 [Pa].
        restitution: rebound over approach speed [-].
        friction: Coulomb coefficient [-].
        rolling_friction: rolling resistance coefficient [-].
        rolling_damping: of the rolling spring over critical [-].
        normal_stiffness: spring of the linear law [N/m].
        tangential_stiffness: tangential spring of the linear law [N/m].
        cohesion: of what pulls the bodies together; None without.
        lubrication: of the liquid in the gap; None without.
    """

    effective_young_modulus: Array
    effective_shear_modulus: Array
    restitution: Array
    friction: Array
    rolling_friction: Array
    rolling_damping: Array
    normal_stiffness: Array
    tangential_stiffness: Array
    cohesion: CohesionConstants | None = None
    lubrication: LubricationConstants | None = None


class Contact(NamedTuple):
    """The state of contacts between a particle and another body; see `tangent` for vectors in the contact plane.

    Attributes:
        overlap: positive; where nothing touches an arbitrary small number [m].
        approach_speed: rate of the overlap, positive while approaching, times the part of the step for which
            the bodies touch [m/s].
        slip: velocity of the particle's surface relative to the other's, in the contact plane, that the tangential
            dashpot acts on, times the part of the step for which they touch [m/s].
        spring: elastic tangential displacement in the contact plane, with what slipped since the step before, or
            since the bodies touch [m].
        effective_radius: R*, 1/R* = 1/R1 + 1/R2 [m].
        effective_mass: m*, 1/m* = 1/m1 + 1/m2 [kg].
        rolling_inertia: of the bodies about their point of contact, 1/I = 1/(7/5 m1 r1^2) + 1/(7/5 m2 r2^2) [kg m2].
        sharing: number of walls that touch the particle; 1 between particles.
        adhesion: what Coulomb's limit counts beside the normal force of the law; None for nothing [N].
    """

    overlap: Array
    approach_speed: Array
    slip: Vector
    spring: Vector
    effective_radius: Array
    effective_mass: Array
    rolling_inertia: Array
    sharing: Array | float = 1.0
    adhesion: Array | None = None


class ContactForce(NamedTuple):
    """Force on the particle.

    Attributes:
        normal: along the normal, away from the other body: positive is repulsive [N].
        elastic: its elastic part, which rolling resistance is proportional to [N].
        tangential: in the contact plane [N].
        spring: the new elastic displacement, cut back where the contact slides [m].
    """

    normal: Array
    elastic: Array
    tangential: Vector
    spring: Vector


class ContactLaw(Protocol):
    """A contact law: stiffness per overlap and the elastic force; Coulomb's limit is shared."""

    def __call__(self, contact: Contact, material: ContactMaterial) -> ContactForce:
        """Force of each contact; values where nothing touches are meaningless and must be finite."""
        ...


@runtime_checkable
class StoringLaw(Protocol):
    """A law that says what its springs store, for the balance of energy; elementwise, on arrays of any one shape."""

    def energy(self, overlap: Array, radius: Array, material: ContactMaterial) -> Array:
        """Of the normal spring at an overlap >= 0 of bodies with R* [J]."""
        ...

    def elastic(self, overlap: Array, radius: Array, material: ContactMaterial) -> Array:
        """Force of the normal spring [N]."""
        ...

    def tangential_stiffness(self, overlap: Array, radius: Array, material: ContactMaterial) -> Array:
        """Force of the tangential spring over its displacement [N/m]."""
        ...


def damping_ratio(restitution: Array) -> Array:
    """|b| = -ln e / sqrt(ln^2 e + pi^2) [-]; 1 for e = 0, 0 for e = 1."""
    positive = restitution > 0
    logarithm = jnp.log(jnp.where(positive, restitution, 1.0))
    return jnp.where(positive, -logarithm / jnp.sqrt(logarithm**2 + jnp.pi**2), 1.0)


def pull_share(damping_ratio: Array) -> Array:
    """Impulse by which a contact pulls before it ends, over the impulse of its dashpot while it is pressed together
    [-].

    Both follow from the damped oscillator x'' + 2 b w x' + w^2 x = 0 of an impact at speed v, with s = sqrt(1 - b^2):
    the force is zero at w s t = p, tan p = -2 b s / (1 - 2 b^2), where the speed is
    v_p = -v exp(-b p / s) (cos p - b sin p / s); the deepest overlap is v/w exp(-b arccos(b) / s). The pull is
    m (v_p - e v), the push of the dashpot 2 b w m times the deepest overlap. Hertz's contact with the damping of Tsuji
    et al. is the same oscillator in another time (Antypov & Elliott 2011), so one curve serves both laws, at every
    speed. The cubic is within 0.005 of it; the impulse of friction in `_with_coulomb_limit` is then right to 0.004.
    """
    b = damping_ratio
    return b * (1.0 + b * (-1.4 + b * (0.98 - 0.4 * b)))


@static
class HertzMindlin:
    """Hertz normal and Mindlin tangential force with history.

    With S_n = 2 E* sqrt(R* d) and S_t = 8 G* sqrt(R* d):
        F_n = 4/3 E* sqrt(R*) d^1.5 + 2 sqrt(5/6) |b| sqrt(S_n m*) dd/dt
        F_t = -S_t xi - 2 sqrt(5/6) |b| sqrt(S_t m*) v_t,   |F_t| <= mu F_n

    The contact ends at zero overlap and F_n may pull just before: that, and only that, gives the
    restitution e at every speed. Keeping the force from pulling returns 0.33 for e = 0.2. While it pulls there is
    no friction; the limit in full: `_with_coulomb_limit`.
    """

    def energy(self, overlap: Array, radius: Array, material: ContactMaterial) -> Array:
        """See `StoringLaw`: 8/15 E* sqrt(R*) d^2.5."""
        return 8.0 / 15.0 * material.effective_young_modulus * vectors.safe_sqrt(radius * overlap) * overlap**2

    def elastic(self, overlap: Array, radius: Array, material: ContactMaterial) -> Array:
        """See `StoringLaw`."""
        return 4.0 / 3.0 * material.effective_young_modulus * vectors.safe_sqrt(radius * overlap) * overlap

    def tangential_stiffness(self, overlap: Array, radius: Array, material: ContactMaterial) -> Array:
        """See `StoringLaw`: S_t."""
        return 8.0 * material.effective_shear_modulus * vectors.safe_sqrt(radius * overlap)

    def __call__(self, contact: Contact, material: ContactMaterial) -> ContactForce:
        """See `ContactLaw`."""
        root = jnp.sqrt(contact.effective_radius * contact.overlap)
        normal_stiffness = 2.0 * material.effective_young_modulus * root
        tangential_stiffness = 8.0 * material.effective_shear_modulus * root
        ratio = damping_ratio(material.restitution)
        normal_damping = 2.0 * jnp.sqrt(5.0 / 6.0) * ratio * jnp.sqrt(normal_stiffness * contact.effective_mass)
        stiffness_ratio = 4.0 * material.effective_shear_modulus / material.effective_young_modulus
        elastic = (2.0 / 3.0) * normal_stiffness * contact.overlap
        return _with_coulomb_limit(
            contact,
            elastic,
            normal_damping * contact.approach_speed,
            tangential_stiffness,
            jnp.sqrt(stiffness_ratio) * normal_damping,
            material.friction,
            pull_share(ratio),
        )


@static
class LinearSpringDashpot:
    """Linear spring and dashpot, normal and tangential.

    F_n = k_n d + 2 |b| sqrt(k_n m*) dd/dt and F_t = -k_t xi - (c_n / 2) v_t, |F_t| <= mu F_n, with the
    tangential dashpot half the normal one, as MFIX has it. The contact ends at zero overlap.
    """

    def energy(self, overlap: Array, radius: Array, material: ContactMaterial) -> Array:
        """See `StoringLaw`: k_n d^2 / 2."""
        return 0.5 * material.normal_stiffness * overlap**2

    def elastic(self, overlap: Array, radius: Array, material: ContactMaterial) -> Array:
        """See `StoringLaw`."""
        return material.normal_stiffness * overlap

    def tangential_stiffness(self, overlap: Array, radius: Array, material: ContactMaterial) -> Array:
        """See `StoringLaw`: k_t."""
        return namespace(overlap).broadcast_to(material.tangential_stiffness, overlap.shape)

    def __call__(self, contact: Contact, material: ContactMaterial) -> ContactForce:
        """See `ContactLaw`."""
        ratio = damping_ratio(material.restitution)
        damping = 2.0 * ratio * jnp.sqrt(material.normal_stiffness * contact.effective_mass)
        return _with_coulomb_limit(
            contact,
            material.normal_stiffness * contact.overlap,
            damping * contact.approach_speed,
            material.tangential_stiffness,
            0.5 * damping,
            material.friction,
            pull_share(ratio),
        )


def _with_coulomb_limit(
    contact: Contact,
    elastic: Array,
    dashpot: Array,
    stiffness: Array,
    damping: Array,
    friction: Array,
    pull: Array,
) -> ContactForce:
    """Normal force elastic + dashpot, and the tangential force -stiffness xi - damping v_t within Coulomb's limit

        L = friction max(elastic + dashpot - pull max(dashpot, 0), 0).

    The spring is cut to stiffness |xi| <= L and keeps its direction, whatever the dashpot adds: so it can only lose
    energy, and never pushes along the slip because a dashpot alone has exceeded the limit.

    A contact that pulls has no friction. The pull takes back a part of the normal impulse, and `pull` (`pull_share`)
    is that part of the dashpot's push, which has no friction either: so an impact that slides throughout has an impulse
    of friction of `friction` times that of the normal force, (1 + e) m v, as for rigid bodies. The limit never exceeds
    friction F_n, and at rest it is friction F_n. Adhesion adds to F_n in it, see `Contact.adhesion`.
    """
    trial = tuple(-stiffness * xi - damping * slip for xi, slip in zip(contact.spring, contact.slip, strict=True))
    normal = elastic + dashpot
    pressing = normal - pull * jnp.maximum(dashpot, 0.0)
    if contact.adhesion is not None:
        pressing = pressing + contact.adhesion
    limit = friction * jnp.maximum(pressing, 0.0)
    tangential = vectors.scale(_cut(vectors.length(trial), limit), trial)
    spring = vectors.scale(_cut(stiffness * vectors.length(contact.spring), limit), contact.spring)
    return ContactForce(normal, elastic, tangential, spring)


def _cut(size: Array, limit: Array) -> Array:
    """limit / size where the size exceeds the limit, else 1."""
    exceeds = size > limit
    return jnp.where(exceeds, quotient(limit, jnp.where(exceeds, size, 1.0)), 1.0)
