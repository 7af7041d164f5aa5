"""Quotients of small numbers, without squares that single precision does not hold.

JAX differentiates a / b by b with b^-2. In single precision that is infinite for b below 1e-19, as forces of small
grains in newtons and squares of springs in metres are, and infinite times zero is NaN in reverse mode.
"""

from __future__ import annotations

import jax
from jax import Array


@jax.custom_jvp
def quotient(a: Array, b: Array) -> Array:
    """a / b, with the slopes 1/b and -(a/b)/b; elementwise."""
    return a / b


@quotient.defjvp
def _slope(primals: tuple[Array, Array], tangents: tuple[Array, Array]) -> tuple[Array, Array]:
    found = quotient(*primals)
    return found, (tangents[0] - found * tangents[1]) / primals[1]


def harmonic(a: Array, b: Array) -> Array:
    """1/(1/a + 1/b), elementwise; a b / (a + b) would be 0 for moments of inertia of grains below 20 um."""
    return a * quotient(b, a + b)
