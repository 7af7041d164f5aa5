"""Branches that stay branches when many scenes run at once under vmap."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.custom_batching import custom_vmap

Carry = TypeVar("Carry")


@custom_vmap
def in_any(condition: Array) -> Array:
    """() bool: the condition; under vmap, whether it holds in any scene of the batch, one value for all of them."""
    return condition


@in_any.def_vmap  # type: ignore[untyped-decorator, unused-ignore]
def _in_any_of_batch(size: int, batched: list[bool], condition: Array) -> tuple[Array, bool]:
    return in_any(jnp.any(condition, axis=0)), False


def cond_in_batch(condition: Array, change: Callable[[Carry], Carry], carry: Carry) -> Carry:
    """`change(carry)` where the condition holds, else `carry`.

    `lax.cond` with a condition that differs within a batch becomes a select: `change` would be computed at every step
    for all scenes. Here it is computed where the condition holds in any scene, and kept in those where it holds, so
    that every scene of a batch gets what it would get alone.
    """

    def some(carry: Carry) -> Carry:
        return jax.tree.map(lambda new, old: jnp.where(condition, new, old), change(carry), carry)

    return lax.cond(in_any(condition), some, lambda carry: carry, carry)
