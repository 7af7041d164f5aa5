"""Vectors in the plane of a contact: one component in 2-D, three in 3-D.

In 2-D the plane is a line and a vector in it a number, positive along the normal turned from the first axis
towards the second. It is the same number seen from either particle, and it follows the contact as it turns.
"""

from __future__ import annotations

import jax.numpy as jnp

from jaxdem.numerics import vectors
from jaxdem.numerics.quotients import quotient
from jaxdem.numerics.vectors import Vector


def part_in_plane(vector: Vector, normal: Vector) -> Vector:
    """The part of a vector in the plane normal to the unit vector `normal`."""
    if len(normal) == 2:
        return (vector[1] * normal[0] - vector[0] * normal[1],)
    return vectors.add_scaled(vector, -vectors.dot(vector, normal), normal)


def surface_velocity(spin: Vector, normal: Vector) -> Vector:
    """spin x normal, which lies in the plane: velocity of a surface that turns with spin/radius [m/s]."""
    return spin if len(normal) == 2 else vectors.cross(spin, normal)


def in_space(tangential: Vector, normal: Vector) -> Vector:
    """Cartesian components of a vector in the plane."""
    if len(normal) == 2:
        return (-normal[1] * tangential[0], normal[0] * tangential[0])
    return tangential


def rolling_part(spin: Vector, normal: Vector) -> Vector:
    """The part of an angular velocity that rolls: all of it in 2-D, without the twist about the normal in 3-D."""
    return spin if len(normal) == 2 else part_in_plane(spin, normal)


def moment(normal: Vector, tangential: Vector) -> Vector:
    """normal x tangential: the torque of a tangential force on an arm of length one along the normal."""
    return tangential if len(normal) == 2 else vectors.cross(normal, tangential)


def turned_into_plane(tangential: Vector, normal: Vector) -> Vector:
    """A vector of a former contact plane in the present one: its part in the plane, with its old length."""
    if len(normal) == 2:
        return tangential
    flat = part_in_plane(tangential, normal)
    before, after = vectors.dot(tangential, tangential), vectors.dot(flat, flat)
    stretched = after > 0
    ratio = jnp.where(stretched, quotient(before, jnp.where(stretched, after, 1.0)), 1.0)
    return vectors.scale(jnp.sqrt(ratio), flat)


def turned_by(vector: Vector, angle: Vector) -> Vector:
    """A 3-D vector turned with a body, by a small angle about its axis: v + b cross (v + a cross v), with a half of the
    angle and b = 2 a / (1 + a^2), keeps the length exactly and the angle to its third order (Cayley)."""
    half = vectors.scale(0.5, angle)
    double = vectors.scale(2.0 / (1.0 + vectors.dot(half, half)), half)
    return vectors.add(vector, vectors.cross(double, vectors.add(vector, vectors.cross(half, vector))))
