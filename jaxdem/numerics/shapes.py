"""Shapes of what a function gives, and zeros in them, for the branch in which it is left out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp

Result = TypeVar("Result")


def zeros_of(shapes: Result) -> Result:
    """Zeros in the shapes and types of a pytree."""
    found: Result = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shapes)
    return found


def with_shapes(function: Callable[..., Result]) -> tuple[Callable[..., Result], Callable[..., Result]]:
    """The function, and one of the same arguments which gives the shapes of its result, by its last call if there was
    one.

    `lax.cond` traces its first branch before the other, which may ask so for the shapes of the first. By
    `jax.eval_shape` it would trace the function anew, and branches within it as often again on every level.

    Args:
        function: gives a pytree of arrays; for arguments of the same shapes.
    """
    seen: list[Any] = []

    def called(*given: Any) -> Result:
        found = function(*given)
        seen.append(jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype), found))
        return found

    def shapes(*given: Any) -> Result:
        found: Result = seen[-1] if seen else jax.eval_shape(function, *given)
        return found

    return called, shapes
