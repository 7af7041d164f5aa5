"""Every pair once: the flat list that the contact kernel runs over, and where a particle finds its own pairs in it.

A contact costs most of a step, so it is computed once and its force given to both particles. What a particle gathers
are sums over its pairs: nothing is scattered, and nothing is computed for slots that are empty.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeVar

import jax.numpy as jnp
from jax import Array, lax

from jaxdem.numerics.stages import stage
from jaxdem.numerics.vectors import Vector

UNROLL = 4
"""Slots that loops over the slots treat at once: half the time of one by one, and the program stays short."""

WRITTEN_OUT = 32
"""Up to so many slots are gone through one by one, which is fastest. One large particle among many small ones has
thousands of neighbours, and what is sought in so many is sought by halving."""

Value = TypeVar("Value")


class Owned(NamedTuple):
    """Who owns the pairs of a list by levels of size: the smaller particle of each.

    Attributes:
        start: (N,) int32, place of the first pair that a particle owns; all of them stand there in a row.
        owner: (P,) int32, of every pair; 0 where there is none.
        row: (E,) int32, the particle that each further row of entries is of, ascending; N for none.
    """

    start: Array
    owner: Array
    row: Array


class Pairs(NamedTuple):
    """The pairs of a list, ordered by their first particle or by their owner; P of them, the last always empty.

    Attributes:
        first: (P,) int32, the particle with the lower index; 0 where there is no pair.
        second: (P,) int32, the other; 0 where there is no pair.
        entry: (K, N) int32, the pairs of every particle: p where it is the first of pair p, P + p where it is the
            second, and P - 1, the empty pair, where it has none. In a list by levels (K, N + E), see `owned_pairs`.
        owned: who owns them, in a list by levels of size; None in others.
    """

    first: Array
    second: Array
    entry: Array
    owned: Owned | None = None


def repeated(count: int, body: Callable[[int | Array, Value], Value], value: Value) -> Value:
    """The value after value = body(k, value) for k = 0 ... count - 1.

    Written out where it is short, a loop of the program where that would compile for minutes.
    """
    if count > WRITTEN_OUT:
        return lax.fori_loop(0, count, body, value, unroll=UNROLL)
    for k in range(count):
        value = body(k, value)
    return value


def at(vector: Vector, index: Array) -> Vector:
    """Values (P,) of the components (N,) at indices (P,) that are known to be in range; nothing is checked."""
    return tuple(x.at[index].get(mode="promise_in_bounds", wrap_negative_indices=False) for x in vector)


def last_up_to(table: Array, column: Array, value: Array) -> Array:
    """Row of the last entry of a column that is no larger than the value; 0 where there is none.

    Args:
        table: (R, N) whose columns ascend.
        column: of each value; broadcast against it.
        value: any shape.
    """
    row = jnp.zeros(jnp.broadcast_shapes(value.shape, column.shape), jnp.int32)
    for power in reversed(range((len(table) - 1).bit_length())):
        further = jnp.minimum(row + (1 << power), len(table) - 1)
        entry = at((table.reshape(-1),), further * table.shape[1] + column)[0]
        row = jnp.where(entry <= value, further, row)
    return row


def pairs_of(index: Array, room: int, identity: Array | None = None) -> tuple[Pairs, Array]:
    """The pairs of a list, and whether they are more than there is room for.

    Args:
        index: (K, N) int32, the others in reach of every particle, itself in empty slots; symmetric.
        room: P, one more than the number of pairs that can be held.
        identity: (N,) int32 by which the first of a pair is the lower one; the row if None.

    Returns:
        the pairs; and () bool, there was not enough room.
    """
    slots, count = index.shape
    own, ranks = jnp.arange(count, dtype=jnp.int32), jnp.arange(slots, dtype=jnp.int32)[:, None]
    # The slots in which the particle is the first, and what none of them holds.
    later, nobody = index > own[None], 0
    if identity is not None:
        later, nobody = identity[index] > identity[None], count
    upto = jnp.cumsum(later, axis=0, dtype=jnp.int32)
    number, before = upto[-1], upto - later
    start = jnp.cumsum(number, dtype=jnp.int32) - number

    # Column i has the others of the pairs that i is the first of, from the top; of rows 0 is never one of them.
    if slots > WRITTEN_OUT:
        others = jnp.sort(jnp.where(later, index, count), axis=0)
    else:

        def place_slot(k: int, table: Array) -> Array:
            return jnp.where(later[k][None] & (before[k][None] == ranks), index[k][None], table)

        others = lax.fori_loop(0, slots, place_slot, jnp.full_like(index, nobody), unroll=UNROLL)
    table = others.reshape(-1)

    # Who owns a stretch of the list is written at its start; of several that start there all but the last own none.
    marks = jnp.zeros(room, jnp.int32).at[start].max(own, mode="drop")
    first = lax.cummax(marks)
    place = jnp.arange(room, dtype=jnp.int32)
    total = start[-1] + number[-1]
    filled = (place < total) & (place < room - 1)
    first = jnp.where(filled, first, 0)
    second = jnp.where(filled, table[(place - start[first]) * count + first], 0)

    if slots > WRITTEN_OUT:
        low, high = jnp.minimum(index, own[None]), jnp.maximum(index, own[None])
        if identity is not None:
            low, high = jnp.where(later, own[None], index), jnp.where(later, index, own[None])
        as_first = start[low] + last_up_to(others, low, high)
        as_second = room + as_first
    else:

        def find_rank(rank: int, found: Array) -> Array:
            return jnp.where(at((table,), rank * count + index)[0] == own[None], rank, found)

        # Where the particle is the second: its rank among the pairs of the other.
        rank = lax.fori_loop(1, slots, find_rank, jnp.zeros_like(index), unroll=UNROLL)
        as_first, as_second = start[None] + before, room + start[index] + rank
    entry = jnp.where(later, as_first, jnp.where(index == own[None], room - 1, as_second))
    return Pairs(first, second, jnp.minimum(entry, 2 * room - 1)), total > room - 1


def place_of(pairs: Pairs, first: Array, second: Array) -> tuple[Array, Array]:
    """Where pairs stand in a list of many slots, whose pairs ascend by both particles; and whether they are in it.

    Args:
        pairs: P of them, over N particles with more than `WRITTEN_OUT` slots.
        first, second: (P',) the particles of the pairs that are sought; the same one twice is no pair.

    Returns:
        (P',) int32 place, anything where there is none; (P',) bool.
    """
    slots, count = pairs.entry.shape
    owner = jnp.where(pairs.first != pairs.second, pairs.first, count)
    start = jnp.searchsorted(owner, jnp.arange(count + 1, dtype=jnp.int32)).astype(jnp.int32)
    place, last = start[first], jnp.maximum(start[first + 1] - 1, 0)
    for power in reversed(range(slots.bit_length())):
        further = jnp.minimum(place + (1 << power), last)
        place = jnp.where((further > place) & (pairs.second[further] <= second), further, place)
    same = (pairs.first[place] == first) & (pairs.second[place] == second)
    return place, same & (first != second)


def sum_over_pairs(on_first: Array, on_second: Array, pairs: Pairs) -> Array:
    """(N,) what every particle gets from its pairs, of (P,) for the first and (P,) for the second of each pair.

    The empty pair must give nothing.
    """
    # Joined, because XLA then writes the values to memory; it would compute them anew for every slot otherwise.
    both = jnp.concatenate((on_first, on_second))

    def add(k: int | Array, total: Array) -> Array:
        return total + at((both,), pairs.entry[k + 1])[0]

    def of_rows() -> Array:
        return repeated(len(pairs.entry) - 1, add, at((both,), pairs.entry[0])[0])

    if pairs.owned is None:
        return of_rows()
    # A stage: for first and further rows apart it would compute the values anew for every entry all the same.
    total, count = stage(pairs.first[0] != pairs.second[0], of_rows), len(pairs.owned.start)
    return total[:count].at[pairs.owned.row].add(total[count:], mode="drop", indices_are_sorted=True)
