"""What cohesion stores: the potential of the pull, and what is lost where a contact begins or ends at once.

The equations of the forces are in `cohesion`; each energy here is the integral of one, zero for bodies far apart. For
JKR the energy beside Hertz's, at the overlap u y^4 that the law is evaluated at, with scale = 2 pi w R* u:

    elastic scale (y^4 - 4/3 y^7),  surface -scale y^4 / 2, which is -w times the area of contact.

At first touch that jumps from 0 to -0.3 scale, where the neck ends from 0.2 scale / 4^(4/3) to 0: both are lost. The
pull-off work of a contact is their sum.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.adhesion import (
    DerjaguinMullerToporov,
    JohnsonKendallRoberts,
    SimplifiedJKR,
    VanDerWaals,
    contact_root,
    jkr_unit,
)
from jaxdem.particles.capillary_bridge import CapillaryBridge, rupture_factor
from jaxdem.particles.cohesion import Cohesion, CohesionConstants, Gap

KINDS = (JohnsonKendallRoberts, DerjaguinMullerToporov, VanDerWaals, CapillaryBridge, SimplifiedJKR)
"""Kinds of cohesion whose energy is known."""


class CohesionEnergy(NamedTuple):
    """Of contacts, beside the energy of the contact law [J].

    Attributes:
        elastic: of the material that the pull strains.
        surface: of the surfaces or the liquid, negative while they hold.
    """

    elastic: Array
    surface: Array


def cohesion_energy(kind: Cohesion, gap: Gap, constants: CohesionConstants, memory: Vector) -> CohesionEnergy:
    """Energy of every contact; zero where none acts.

    Raises:
        TypeError: of a kind that is none of `KINDS`; a scene with one is refused before.
    """
    none = jnp.zeros_like(gap.overlap)
    if isinstance(kind, JohnsonKendallRoberts):
        return _jkr(gap, constants, memory)
    if isinstance(kind, DerjaguinMullerToporov):
        pull = 2.0 * jnp.pi * constants.strength * gap.effective_radius
        return CohesionEnergy(none, -pull * jnp.maximum(gap.overlap, 0.0))
    if isinstance(kind, VanDerWaals):
        return CohesionEnergy(none, _van_der_waals(gap, constants))
    if isinstance(kind, CapillaryBridge):
        return CohesionEnergy(none, _bridge(gap, constants, memory[0]))
    if isinstance(kind, SimplifiedJKR):
        return CohesionEnergy(none, -constants.strength * _common_volume(gap))
    raise TypeError(f"the energy of {type(kind).__name__} is not known")


def energy_lost(
    kind: Cohesion, gap: Gap, former: Array, constants: CohesionConstants, before: Vector, after: Vector
) -> Array:
    """Energy that is gone where what a contact remembers has changed; zero elsewhere [J].

    A contact of JKR that is there from the start, or comes with a wall or at an edge of a mesh, has not lost what one
    loses that begins by a touch.

    Args:
        kind: with a memory.
        gap: at the end of the step.
        former: overlap in the middle of the step before [m].
        constants: numbers.
        before, after: what it remembers.
    """
    if isinstance(kind, JohnsonKendallRoberts):
        scale = _jkr_scale(gap, constants)
        began = (after[0] > 0) & ~(before[0] > 0) & ~(former > 0)
        ended = (before[0] > 0) & ~(after[0] > 0)
        return jnp.where(began, 0.3 * scale, 0.0) + jnp.where(ended, 0.2 * 4.0 ** (-4.0 / 3.0) * scale, 0.0)
    (own, *_), (now, *_) = before, after
    lost = _bridge(gap, constants, own) - _bridge(gap, constants, now)
    return jnp.where(own != now, lost, 0.0)


def _jkr_scale(gap: Gap, constants: CohesionConstants) -> Array:
    return 2.0 * jnp.pi * constants.strength * gap.effective_radius * jkr_unit(gap, constants.strength)


def _jkr(gap: Gap, constants: CohesionConstants, memory: Vector) -> CohesionEnergy:
    attraction = JohnsonKendallRoberts()(gap, constants, memory)
    unit = jkr_unit(gap, constants.strength)
    acts = attraction.touching & (unit > 0)
    root = contact_root(jnp.where(acts, gap.overlap / jnp.where(acts, unit, 1.0), 0.0))
    scale = jnp.where(acts, _jkr_scale(gap, constants), 0.0)
    square = root**4
    return CohesionEnergy(scale * square * (1.0 - 4.0 / 3.0 * root**3), -0.5 * scale * square)


def _van_der_waals(gap: Gap, constants: CohesionConstants) -> Array:
    least, cutoff = required(constants.minimum_gap, "minimum_gap"), required(constants.cutoff, "cutoff")
    distance = jnp.clip(-gap.overlap, least, cutoff)
    nearer = jnp.maximum(least + gap.overlap, 0.0)
    factor = constants.strength * gap.effective_radius / 6.0
    return -factor * (1.0 / distance - 1.0 / cutoff + nearer / least**2)


def _bridge(gap: Gap, constants: CohesionConstants, volume: Array) -> Array:
    """Of a bridge with this volume; zero where it ruptures."""
    exists = volume > 0
    safe, radius = jnp.where(exists, volume, 1.0), 2.0 * gap.effective_radius
    largest = 2.0 * jnp.pi * radius * constants.strength * jnp.cos(required(constants.contact_angle, "contact_angle"))
    length = jnp.sqrt(safe / radius)
    scaled = jnp.maximum(-gap.overlap, 0.0) / length
    work = length * (_pull_up_to(rupture_factor(constants) * jnp.cbrt(safe) / length) - _pull_up_to(scaled))
    return jnp.where(exists, -largest * (work + jnp.maximum(gap.overlap, 0.0)), 0.0)


def _pull_up_to(scaled: Array) -> Array:
    """Integral of 1 / (1 + 1.05 S + 2.5 S^2) from 0."""
    root = jnp.sqrt(4.0 * 2.5 - 1.05**2)
    return 2.0 / root * (jnp.arctan((5.0 * scaled + 1.05) / root) - jnp.arctan(1.05 / root))


def _common_volume(gap: Gap) -> Array:
    """Of two spheres that intersect, or of a sphere and a half-space [m3]."""
    overlap = jnp.maximum(gap.overlap, 0.0)
    if gap.other_radius is None:
        return jnp.pi / 3.0 * overlap**2 * (3.0 * gap.radius - overlap)
    distance = gap.radius + gap.other_radius - overlap
    squared = distance**2 + 2.0 * distance * (gap.radius + gap.other_radius)
    return jnp.pi * overlap**2 * (squared - 3.0 * (gap.radius - gap.other_radius) ** 2) / (12.0 * distance)


def has_energy(kind: Cohesion | None) -> bool:
    """Whether the energy of a kind is known."""
    return kind is None or isinstance(kind, KINDS)
