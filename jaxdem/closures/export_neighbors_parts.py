"""What the exported forms of a closure of neighbours share: moments of one pair, and rows that hold the sums."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.closures.moments import Offset, carried_moments
from jaxdem.closures.neighbor_range import conditions, presence
from jaxdem.closures.neighbors import NeighborClosure, Response

THERE: Any = np.ones((1, 1), bool)
"""One sphere with one neighbour."""


def one_neighbor(place: Array) -> Offset:
    """Offset of one neighbour (3,) of one sphere."""
    return place[0:1][None], place[1:2][None], place[2:3][None]


def carried_of_pair(closure: NeighborClosure, place: Array, vector: Array) -> tuple[Array, ...]:
    """Moments of the vector (3,) that the neighbour at a place (3,) carries, for the second level."""
    assert closure.carried is not None
    return carried_moments(closure.carried, one_neighbor(place), THERE, one_neighbor(vector))


def handed_on(closure: NeighborClosure, found: Sequence[Array], *flow: Array) -> Array:
    """(3,) force that a sphere hands on to its neighbours, in its own frame, from its moments and (1,) Re and solid
    fraction."""
    level = closure.levels[0]
    return presence(found[0][:, 0, 0]) * level.values(level.mixed(found), conditions(*flow))[0, :3]


def response_of(
    closure: NeighborClosure, found: Sequence[Array], carried: Sequence[Array] | None, *flow: Array
) -> Response:
    """What the closure gives for one sphere, from its moments, those of forces if there is a second level, and (1,) Re
    and solid fraction."""
    level = closure.levels[-1]
    mixed = level.mixed(found)
    if carried is not None:
        more = level.mixed(carried, further=True)
        mixed = (*(one + other for one, other in zip(mixed, more, strict=False)), *mixed[len(more) :])
    return closure.response(level.values(mixed, conditions(*flow)), found[0][:, 0, 0], *flow)


def shapes_of(function: Callable[[Array], tuple[Array, ...]], inputs: int) -> list[tuple[int, ...]]:
    """Shapes of the moments of each order."""
    return [one.shape for one in jax.eval_shape(function, jax.ShapeDtypeStruct((inputs,), jnp.float32))]


def flat(parts: Sequence[Array]) -> Array:
    """The moments of all orders in a row."""
    return jnp.concatenate([part.reshape(-1) for part in parts])


def cut(values: Array, shapes: Sequence[tuple[int, ...]]) -> tuple[Array, ...]:
    """The inverse of `flat`."""
    found, first = [], 0
    for shape in shapes:
        size = int(np.prod(shape))
        found.append(values[first : first + size].reshape(shape))
        first += size
    return tuple(found)
