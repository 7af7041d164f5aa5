"""Cohesion: what pulls two bodies together, beside the contact law. One more ingredient, whatever the law is.

A kind of cohesion is an immutable object without numbers. It is given the gap of every contact and what the contact
remembers, and returns the pull and, if it changes them, when the contact begins and ends and which overlap the law is
evaluated at. Everything is elementwise, on arrays of any one shape.

The kinds are in `adhesion` (dry bodies) and `capillary_bridge` (wet ones), what they store in `cohesion_energy`.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable

import jax.numpy as jnp
from jax import Array

from jaxdem.numerics.vectors import Vector

TOUCHING = 1e-12
"""Overlap, over R*, at which a law is evaluated where nothing touches: its square roots and their slopes are finite."""


class CohesionConstants(NamedTuple):
    """Numbers of the cohesion of contacts; traced. None for those that the kind does not use.

    Attributes:
        strength: () or such that it goes with the contacts: work of adhesion [J/m2], Hamaker constant [J], surface
            tension of the liquid [N/m] or energy density [J/m3], by kind.
        minimum_gap: () the gap is taken to be at least this, in contact too [m].
        cutoff: () gap beyond which nothing acts [m].
        contact_angle: () of the liquid on the grains [rad].
        liquid_viscosity: () dynamic; None for a bridge that is not viscous [Pa s].
        bridge_share: () part of a grain's liquid that a new bridge takes at most [-].
        largest_film: () a grain gives as if it had no more liquid than this [m3].
    """

    strength: Array
    minimum_gap: Array | None = None
    cutoff: Array | None = None
    contact_angle: Array | None = None
    liquid_viscosity: Array | None = None
    bridge_share: Array | None = None
    largest_film: Array | None = None


class Gap(NamedTuple):
    """Two bodies and how far they are from each other.

    Attributes:
        overlap: negative for a gap [m].
        radius: of the one [m].
        other_radius: of the other; None for a wall [m].
        effective_radius: R*, 1/R* = 1/R1 + 1/R2 [m].
        modulus: E* [Pa].
    """

    overlap: Array
    radius: Array
    other_radius: Array | None
    effective_radius: Array
    modulus: Array


class Attraction(NamedTuple):
    """What cohesion makes of a contact.

    Attributes:
        depth: positive while they touch, which is where the contact law acts; how far they are from beginning or
            ending to [m].
        overlap: that the contact law is evaluated at; positive everywhere [m].
        pull: force that draws the bodies together [N].
        friction: what Coulomb's limit counts beside the force of the contact law; None for nothing [N].
        damping: of the rate of approach, beside the law's dashpot; None for none [N s/m].
        kept: what the contact remembers, arrays of the contacts' shape; as many as `Cohesion.memory`.
        holds: bool, the contact has begun before; None where its overlap tells.
    """

    depth: Array
    overlap: Array
    pull: Array
    friction: Array | None
    damping: Array | None
    kept: Vector = ()
    holds: Array | None = None

    @property
    def touching(self) -> Array:
        """Whether the contact law acts."""
        return self.depth > 0


class Cohesion(Protocol):
    """A kind of cohesion; immutable, without numbers."""

    @property
    def memory(self) -> int:
        """Number of values that a contact keeps from step to step."""
        ...

    @property
    def sudden(self) -> bool:
        """Whether the pull begins or ends at once with the contact: then it counts for the part of the step only."""
        ...

    def reach(self, gap: Gap, constants: CohesionConstants) -> Array:
        """Largest gap at which two bodies act on each other [m]."""
        ...

    def __call__(self, gap: Gap, constants: CohesionConstants, memory: Vector) -> Attraction:
        """What cohesion makes of each contact; see `Attraction`."""
        ...


@runtime_checkable
class BegunByTouch(Protocol):
    """A kind that acts over a gap only on bodies that have touched, so that the others need not be looked at."""

    def begun(self, memory: Vector) -> Array:
        """Bool, whether they have, by what a contact remembers."""
        ...


def at_overlap(gap: Gap, pull: Array) -> Attraction:
    """A contact that begins and ends at zero overlap."""
    touching = gap.overlap > 0
    overlap = jnp.where(touching, gap.overlap, TOUCHING * gap.effective_radius)
    return Attraction(gap.overlap, overlap, pull, None, None)
