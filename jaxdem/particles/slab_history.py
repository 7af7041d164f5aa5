"""What contacts keep in a slab, as it goes along with particles: by identity, since rows change.

In a list of one reach for all every particle keeps what its contacts keep, both of a pair the same. In a list by levels
of size a large grain may have thousands of contacts; there the owner of a pair keeps it, the smaller of the two, which
has few. Where the owner is a ghost, its slab sends what it keeps when a list is made.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics.blocks import Blocks
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.ghosts import Ghosts
from jaxdem.particles.neighbors import Neighbors
from jaxdem.particles.pairs import Pairs, at, repeated


class History(NamedTuple):
    """What R particles keep of their contacts, whoever the first of a pair is; by levels of size of those they own.

    Attributes:
        partner: (K, R) int32, identity of the other as in `Ghosts.touching`; -1 where there is none. Of clumps with m
            members (K m, R): row k m + j is of member j.
        values: components of the same shape, of the pair.
    """

    partner: Array
    values: Vector


def history_of(values: Vector, neighbors: Neighbors) -> History:
    """What the own particles of a slab keep, from values (P,) of the pairs of its list."""
    ghosts, owned = required(neighbors.ghosts, "ghosts of a list"), neighbors.pairs.owned
    if owned is not None:
        index, own = neighbors.index[:, : ghosts.rows], jnp.arange(ghosts.rows, dtype=jnp.int32)
        partner = jnp.where(index == own[None], -1, ghosts.identity[index])
        place = owned.start[None, : ghosts.rows] + jnp.arange(len(index), dtype=jnp.int32)[:, None]
        return History(partner, at(values, jnp.minimum(place, neighbors.overlap.shape[0] - 1)))
    row = jnp.broadcast_to(jnp.arange(neighbors.index.shape[1], dtype=jnp.int32)[None], neighbors.index.shape)
    index, entry, itself = (ghosts.of_own(x) for x in (neighbors.index, neighbors.pairs.entry, row))
    partner = jnp.where(index == itself, -1, ghosts.touching[index])
    count = neighbors.overlap.shape[0]
    return History(partner, at(values, jnp.where(entry < count, entry, entry - count)))


def of_pairs(blocks: Blocks, history: History, ghosts: Ghosts, pairs: Pairs) -> Vector:
    """Components (P,), what the pairs of a list keep; zero for those that have nothing.

    Args:
        blocks: the slabs.
        history: of the R own particles, which stand before the ghosts.
        ghosts: of the list, with the identities of all rows.
        pairs: of the list; at least one of the two is an own particle.
    """
    if pairs.owned is not None:
        return _of_owners(blocks, history, ghosts, pairs)
    slots, rows = history.partner.shape[0] // ghosts.members, ghosts.members * ghosts.rows
    first_own = ghosts.body(pairs.first) < ghosts.rows
    one = ghosts.own_number(jnp.where(first_own, pairs.first, pairs.second))
    wanted = ghosts.touching[jnp.where(first_own, pairs.second, pairs.first)]
    partner = history.partner.reshape(-1)

    def look(k: int | Array, found: Array) -> Array:
        place = k * rows + one
        return jnp.where(at((partner,), place)[0] == wanted, place, found)

    none = jnp.full_like(one, -1)
    place = repeated(slots, look, none)
    found = (place >= 0) & (pairs.first != pairs.second)
    kept = at(tuple(x.reshape(-1) for x in history.values), jnp.maximum(place, 0))
    return tuple(jnp.where(found, component, 0.0) for component in kept)


def _of_owners(blocks: Blocks, history: History, ghosts: Ghosts, pairs: Pairs) -> Vector:
    """`of_pairs` of a list by levels of size."""
    if not history.values:
        return ()
    owner = required(pairs.owned, "owners of the pairs").owner
    wanted = ghosts.identity[jnp.where(pairs.first == owner, pairs.second, pairs.first)]
    rows, slots = ghosts.identity.shape[0], len(history.partner)
    partner = _with_ghosts(blocks, ghosts, history.partner, -1).reshape(-1)
    kept = _with_ghosts(blocks, ghosts, jnp.concatenate(history.values), 0).reshape(len(history.values), -1)

    def look(k: int | Array, found: Array) -> Array:
        place = k * rows + owner
        return jnp.where(at((partner,), place)[0] == wanted, place, found)

    place = repeated(slots, look, jnp.full_like(owner, -1))
    found = (place >= 0) & (pairs.first != pairs.second)
    return tuple(jnp.where(found, x, 0.0) for x in at(tuple(kept), jnp.maximum(place, 0)))


def _with_ghosts(blocks: Blocks, ghosts: Ghosts, table: Array, blank: int) -> Array:
    """(C, n) with what the ghosts have behind it of a table (C, R); blank where there is no ghost."""

    def packed(rows: Array) -> Array:
        return table.at[:, rows].get(mode="clip")

    beside = jnp.concatenate(blocks.from_both(ghosts.lower, ghosts.upper, packed), axis=1)
    there = ghosts.identity[ghosts.rows :] >= 0
    return jnp.concatenate((table, jnp.where(there[None], beside, blank)), axis=1)
