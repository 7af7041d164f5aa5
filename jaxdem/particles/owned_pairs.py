"""Every pair once, in a list by levels of size: each pair belongs to its smaller particle, and rows have a fixed width.

A large grain may have ten thousand neighbours, and the others must not have as many slots. So the pairs stand owner by
owner, and what a particle gathers is cut into rows of K entries: the first row of everyone, then the further rows of
those who need more. There are N + E rows in all, and few of their entries are empty.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array, lax

from jaxdem.numerics.vectors import Vector
from jaxdem.particles.pairs import Owned, Pairs, at, repeated


def owned_pairs(
    index: Array, room: int, width: int, further: int, identity: Array | None = None
) -> tuple[Pairs, Array]:
    """The pairs of a list by levels, and whether they are more than there is room for.

    Args:
        index: (K, N) int32, the other of the pairs that every particle owns, itself in empty slots, the last ones.
        room: P, one more than the number of pairs that can be held.
        width: of the rows of entries.
        further: E, room for rows beyond the first of every particle.
        identity: (N,) int32 by which the first of a pair is the lower one; the index if None.

    Returns:
        the pairs, of which `first` is the particle with the lower identity; and () bool, there was not enough room.
    """
    count = index.shape[1]
    own, place = jnp.arange(count, dtype=jnp.int32), jnp.arange(room, dtype=jnp.int32)
    number = jnp.sum(index != own[None], axis=0, dtype=jnp.int32)
    upto = jnp.cumsum(number, dtype=jnp.int32)
    start, total = upto - number, upto[-1]
    filled = (place < total) & (place < room - 1)
    owner = _owner_of_places(start, own, room)
    other = jnp.where(filled, index.reshape(-1)[jnp.where(filled, place - start[owner], 0) * count + owner], 0)
    owner = jnp.where(filled, owner, 0)

    # The pairs of every particle that another one owns: sorted by it.
    key, order = lax.sort((jnp.where(filled, other, count), place), num_keys=1, is_stable=True)
    begin = jnp.searchsorted(key, jnp.arange(count + 1, dtype=jnp.int32)).astype(jnp.int32)
    degree = number + begin[1:] - begin[:-1]
    more = jnp.maximum(degree - 1, 0) // width
    upto = jnp.cumsum(more, dtype=jnp.int32)
    before, rows = upto - more, jnp.arange(further, dtype=jnp.int32)
    row = _owner_of_places(jnp.where(more > 0, before, further), own, further)
    whose = jnp.concatenate((own, row))
    part = jnp.concatenate((jnp.zeros_like(own), rows - before[row] + 1))
    wanted = part[None] * width + jnp.arange(width, dtype=jnp.int32)[:, None]
    nobody = room - 1

    def owner_first() -> Array:
        return owner < other if identity is None else identity[owner] < identity[other]

    of_owner = jnp.where(owner_first(), place, room + place)
    of_other = jnp.where(owner_first(), room + place, place)
    owns, has = number[whose][None], degree[whose][None]
    mine = at((of_owner,), jnp.clip(start[whose][None] + wanted, 0, nobody))[0]
    theirs = at((of_other[order],), jnp.clip(begin[whose][None] + wanted - owns, 0, nobody))[0]
    entry = jnp.where(wanted < owns, mine, jnp.where(wanted < has, theirs, nobody))
    needless = jnp.concatenate((jnp.zeros(count, bool), rows >= upto[-1]))
    entry = jnp.where(needless[None], nobody, entry)
    row = jnp.where(rows < upto[-1], row, count)
    if identity is None:
        first, second = jnp.minimum(owner, other), jnp.maximum(owner, other)
    else:
        first, second = jnp.where(owner_first(), owner, other), jnp.where(owner_first(), other, owner)
    pairs = Pairs(first, second, entry, Owned(start, owner, row))
    return pairs, (total > room - 1) | (upto[-1] > further)


def carried_by_owner(history: Vector, index: Array, old: Pairs, new: Pairs) -> Vector:
    """Values (P,) kept per pair, at the places (P',) of a new list; zero for pairs that were not listed before.

    Args:
        history: components (P,).
        index: (K, N) of the old list.
        old, new: pairs of both lists, whose owners are the same.
    """
    before, now = _owned(old), _owned(new)
    first, second, owner = new.first, new.second, now.owner
    other = jnp.where(first == owner, second, first)
    flat, count = index.reshape(-1), index.shape[1]
    begin = at((before.start,), owner)[0]

    def look(k: int | Array, place: Array) -> Array:
        return jnp.where(at((flat,), k * count + owner)[0] == other, begin + k, place)

    place = repeated(len(index), look, jnp.full_like(first, -1))
    last = len(history[0]) - 1 if history else 0
    found = (place >= 0) & (place < last) & (first != second)
    return tuple(jnp.where(found, component, 0.0) for component in at(history, jnp.clip(place, 0, max(last, 0))))


def _owned(pairs: Pairs) -> Owned:
    assert pairs.owned is not None, "of a list by levels"
    return pairs.owned


def _owner_of_places(start: Array, own: Array, room: int) -> Array:
    """(room,) who owns each place; of several whose stretches start at one place the last, for the others own none."""
    return lax.cummax(jnp.zeros(room, jnp.int32).at[start].max(own, mode="drop"))
