"""One axis after the other: the order in which a step of transport takes them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import jax.numpy as jnp
from jax import Array, lax

ORDERS = {2: ((0, 1), (1, 0)), 3: ((0, 1, 2), (2, 1, 0), (1, 2, 0), (0, 2, 1), (2, 0, 1), (1, 0, 2))}
"""Orders of the sweeps in 2-D and 3-D; a step has one, the next step the next, each followed by its reverse."""

Carry = TypeVar("Carry")


def in_order(sweeps: Sequence[Callable[[Carry, Array], Carry]], order: Array, carry: Carry) -> Carry:
    """`carry` after the sweeps of a step.

    Args:
        sweeps: of every axis, functions of carry and of () bool, whether it is the last one.
        order: () int, number of the step.
        carry: at its start.
    """
    dimension = len(sweeps)
    orders = ORDERS[dimension]
    axes = jnp.asarray(orders)[order % len(orders)]

    def body(carry: Carry, place: Array) -> tuple[Carry, None]:
        return lax.switch(axes[place], sweeps, carry, place == dimension - 1), None

    return lax.scan(body, carry, jnp.arange(dimension))[0]  # type: ignore[no-any-return]
