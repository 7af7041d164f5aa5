"""Two bodies in contact: what the law is told of them, and what it says of them."""

from __future__ import annotations

from typing import NamedTuple

from jax import Array

from jaxdem.numerics import vectors
from jaxdem.numerics.vectors import Vector
from jaxdem.particles import tangent


class ContactPair(NamedTuple):
    """Two bodies that may touch, the one and the other.

    Attributes:
        overlap: negative for a gap [m].
        normal: unit vector from the other to the one.
        approach: velocity of the one relative to the other, expected in the middle of the step: of the dashpots [m/s].
        velocity: the same at the start of the step, in the middle between two forces: of the springs [m/s].
        spin: angular velocity of the one [rad/s].
        other_spin: of the other; None for a wall.
        radius: of the one [m].
        other_radius: of the other [m].
        effective_radius, effective_mass, rolling_inertia: of both, see `Contact`.
        wall_spin: angular velocity of a wall; None for particles, and for walls that do not turn [rad/s].
    """

    overlap: Array
    normal: Vector
    approach: Vector
    velocity: Vector
    spin: Vector
    other_spin: Vector | None
    radius: Array
    other_radius: Array
    effective_radius: Array
    effective_mass: Array
    rolling_inertia: Array
    wall_spin: Vector | None = None


class LoadParts(NamedTuple):
    """Parts of a `ContactLoad` that take energy out of the motion, for the balance of energy.

    Attributes:
        dashpot: of the law, along the normal [N].
        liquid: of bridges and films against approach and parting, along the normal; None without [N].
        across: of the law's tangential dashpot, in the contact plane: what is not of the spring [N].
        film: force in the contact plane [N] and torque against rolling [N m] of a film; None without.
    """

    dashpot: Array
    liquid: Array | None
    across: Vector
    film: tuple[Vector, Vector] | None = None


class ContactLoad(NamedTuple):
    """What a contact does to the one of two bodies, and what it keeps.

    Attributes:
        along: force along the normal, positive away from the other [N].
        across: force in the contact plane [N].
        resistance: torque against rolling [N m]; empty without rolling friction.
        spring: what the contact keeps; see `ContactModel.history_size`.
        adhesion: what Coulomb's limit counts beside `along`; None without cohesion [N].
        parts: of these; None where no balance of energy is kept, and where all that acts is the contact law.
    """

    along: Array
    across: Vector
    resistance: Vector
    spring: Vector
    adhesion: Array | None = None
    parts: LoadParts | None = None


def on_bodies(load: ContactLoad, pair: ContactPair) -> tuple[Vector, Vector, Vector]:
    """Force and torque on the one, and torque on the other, of all contacts [N, N m]."""
    normal = pair.normal
    force = vectors.add_scaled(tangent.in_space(load.across, normal), load.along, normal)
    # The tangential force turns both bodies the same way, rolling resistance one against the other.
    moment = tangent.moment(normal, load.across)
    arm, other_arm = pair.radius - 0.5 * pair.overlap, pair.other_radius - 0.5 * pair.overlap
    torque, other_torque = vectors.scale(-arm, moment), vectors.scale(-other_arm, moment)
    if load.resistance:
        torque = vectors.add(torque, load.resistance)
        other_torque = vectors.subtract(other_torque, load.resistance)
    return force, torque, other_torque


def sum_slots(array: Array) -> Array:
    """Sum of a (K, N) array over the slots, written out: XLA hands a reduction to a library that is slower."""
    total = array[0]
    for k in range(1, array.shape[0]):
        total = total + array[k]
    return total


def row(quantity: Array) -> Array:
    """() unchanged, (N,) as (1, N)."""
    return quantity if quantity.ndim == 0 else quantity[None]


def rows(vector: Vector) -> Vector:
    """Components (N,) as (1, N)."""
    return tuple(x[None] for x in vector)
