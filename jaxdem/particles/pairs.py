"""Every pair once: the flat list that the contact kernel runs over, and where a particle finds its own pairs in it.

A contact costs most of a step, so it is computed once and its force given to both particles. What a particle gathers
are sums over its pairs: nothing is scattered, and nothing is computed for slots that are empty.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array, lax

from jaxdem.particles.vectors import Vector

UNROLL = 4
"""Slots that loops over the slots treat at once: half the time of one by one, and the program stays short."""


class Pairs(NamedTuple):
    """The pairs of a list, ordered by their first particle; P of them, the last of which is always empty.

    Attributes:
        first: (P,) int32, the particle with the lower index; 0 where there is no pair.
        second: (P,) int32, the other; 0 where there is no pair.
        entry: (K, N) int32, the pairs of every particle: p where it is the first of pair p, P + p where it is the
            second, and P - 1, the empty pair, where it has none.
    """

    first: Array
    second: Array
    entry: Array


def at(vector: Vector, index: Array) -> Vector:
    """Values (P,) of the components (N,) at indices (P,) that are known to be in range: without the checks of others."""
    return tuple(x.at[index].get(mode="promise_in_bounds", wrap_negative_indices=False) for x in vector)


def pairs_of(index: Array, room: int) -> tuple[Pairs, Array]:
    """The pairs of a list, and whether they are more than there is room for.

    Args:
        index: (K, N) int32, the others in reach of every particle, itself in empty slots; symmetric.
        room: P, one more than the number of pairs that can be held.

    Returns:
        the pairs; and () bool, there was not enough room.
    """
    slots, count = index.shape
    own, ranks = jnp.arange(count, dtype=jnp.int32), jnp.arange(slots, dtype=jnp.int32)[:, None]
    later = index > own[None]  # the slots in which the particle is the first
    upto = jnp.cumsum(later, axis=0, dtype=jnp.int32)
    number, before = upto[-1], upto - later
    start = jnp.cumsum(number, dtype=jnp.int32) - number

    def place_slot(k: int, table: Array) -> Array:
        return jnp.where(later[k][None] & (before[k][None] == ranks), index[k][None], table)

    # Column i has the others of the pairs that i is the first of, from the top; 0 is never one of them.
    table = lax.fori_loop(0, slots, place_slot, jnp.zeros_like(index), unroll=UNROLL).reshape(-1)

    # Who owns a stretch of the list is written at its start; of several that start there all but the last own none.
    marks = jnp.zeros(room, jnp.int32).at[start].max(own, mode="drop")
    first = lax.cummax(marks)
    place = jnp.arange(room, dtype=jnp.int32)
    total = start[-1] + number[-1]
    filled = (place < total) & (place < room - 1)
    first = jnp.where(filled, first, 0)
    second = jnp.where(filled, table[(place - start[first]) * count + first], 0)

    def find_rank(rank: int, found: Array) -> Array:
        return jnp.where(at((table,), rank * count + index)[0] == own[None], rank, found)

    # Where the particle is the second: its rank among the pairs of the other.
    rank = lax.fori_loop(1, slots, find_rank, jnp.zeros_like(index), unroll=UNROLL)
    as_second = jnp.where(index == own[None], room - 1, room + start[index] + rank)
    entry = jnp.where(later, start[None] + before, as_second)
    return Pairs(first, second, jnp.minimum(entry, 2 * room - 1)), total > room - 1


def sum_over_pairs(on_first: Array, on_second: Array, pairs: Pairs) -> Array:
    """(N,) what every particle gets from its pairs, of (P,) for the first and (P,) for the second of each pair.

    The empty pair must give nothing.
    """
    # Joined, because XLA then writes the values to memory; it would compute them anew for every slot otherwise.
    both = jnp.concatenate((on_first, on_second))
    total = at((both,), pairs.entry[0])[0]
    for slot in pairs.entry[1:]:
        total = total + at((both,), slot)[0]
    return total
