"""Vectors as tuples of component arrays, so that one formula serves 2-D and 3-D.

A vector field over pairs or particles is a tuple of D arrays, components apart: contiguous memory for
every component, and no stacking inside the contact kernel. An angular quantity has one component in
2-D (about the axis normal to the plane, positive from the first axis to the second) and three in 3-D.

These are functions on plain tuples and no class with operators: a tuple passes through every transformation of JAX as
it is, into checkpoints under the names of its places, and `+` of two tuples puts one behind the other.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.numerics.host import namespace

Vector = tuple[Array, ...]


def components(array: Array) -> Vector:
    """Components of an (N, D) array as D arrays (N,)."""
    return tuple(array[:, k] for k in range(array.shape[1]))


def stack(vector: Vector) -> Array:
    """The (N, D) array of D component arrays (N,)."""
    return jnp.stack(vector, axis=1)


def dot(a: Vector, b: Vector) -> Array:
    """Scalar product."""
    total = a[0] * b[0]
    for x, y in zip(a[1:], b[1:], strict=True):
        total = total + x * y
    return total


def add(a: Vector, b: Vector) -> Vector:
    """Sum of two vectors."""
    return tuple(x + y for x, y in zip(a, b, strict=True))


def subtract(a: Vector, b: Vector) -> Vector:
    """Difference of two vectors."""
    return tuple(x - y for x, y in zip(a, b, strict=True))


def scale(factor: Array | float, a: Vector) -> Vector:
    """Vector times scalar."""
    return tuple(factor * x for x in a)


def add_scaled(a: Vector, factor: Array | float, b: Vector) -> Vector:
    """a + factor b."""
    return tuple(x + factor * y for x, y in zip(a, b, strict=True))


def where(condition: Array, a: Vector, b: Vector | float) -> Vector:
    """Components of `a` where the condition holds, of `b` (a vector or a number) elsewhere."""
    others: tuple[Array | float, ...] = b if isinstance(b, tuple) else (b,) * len(a)
    return tuple(jnp.where(condition, x, y) for x, y in zip(a, others, strict=True))


def rotate(angular: Vector, a: Vector) -> Vector:
    """angular x a, the velocity of the point `a` of a body that turns with `angular`."""
    if len(a) == 2:
        return (-angular[0] * a[1], angular[0] * a[0])
    return cross(angular, a)


def moment(arm: Vector, force: Vector) -> Vector:
    """arm x force: one component in 2-D, three in 3-D."""
    if len(arm) == 2:
        return (arm[0] * force[1] - arm[1] * force[0],)
    return cross(arm, force)


def cross(a: Vector, b: Vector) -> Vector:
    """Cross product of 3-D vectors."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def safe_sqrt(squared: Array) -> Array:
    """sqrt with value and gradient zero at zero (double where: no NaN in reverse mode)."""
    xp, positive = namespace(squared), squared > 0
    return xp.where(positive, xp.sqrt(xp.where(positive, squared, 1.0)), 0.0)


def row_lengths(rows: Array) -> Array:
    """(N,) Euclidean norms of (N, D), with gradient zero at zero."""
    return safe_sqrt(jnp.sum(rows**2, axis=-1))


def length(a: Vector) -> Array:
    """Euclidean norm, with gradient zero at zero."""
    return jnp.abs(a[0]) if len(a) == 1 else safe_sqrt(dot(a, a))


def angular_size(dimension: int) -> int:
    """Number of components of an angular quantity: 1 in 2-D, 3 in 3-D."""
    return 1 if dimension == 2 else 3
