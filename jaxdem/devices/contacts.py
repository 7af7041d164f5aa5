"""Contacts by the identity of their particles, as they are kept when the slabs change. Host, numpy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from jaxdem.errors import required
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.neighbors import Neighbors


class Contacts(NamedTuple):
    """Pairs of a list that keep something.

    Attributes:
        first, second: (P,) identities, first < second.
        values: (c, P), what is kept; see `ParticleState.contact_spring`.
    """

    first: np.ndarray
    second: np.ndarray
    values: np.ndarray


def contacts_of_list(spring: Vector, neighbors: Neighbors) -> Contacts:
    """Of a list on one device."""
    pairs = neighbors.pairs
    return _with_something(np.asarray(pairs.first), np.asarray(pairs.second), np.stack(spring))


def contacts_of_slabs(spring: Vector, neighbors: Neighbors) -> Contacts:
    """Of a distributed list on the host; a pair across a border is that of its first particle's slab."""
    ghosts: Any = required(neighbors.ghosts, "ghosts of a list")
    pairs: Any = neighbors.pairs
    rows = ghosts.identity.shape[1] - 2 * ghosts.lower.shape[1]
    return contacts_of_rows(spring, rows, ghosts.identity, pairs.first, pairs.second)


def contacts_of_rows(
    spring: Sequence[Any], rows: int, identity: np.ndarray, first: np.ndarray, second: np.ndarray
) -> Contacts:
    """`contacts_of_slabs` from arrays.

    Args:
        spring: (B, P) each.
        rows: R, of own particles.
        identity: (B, n) of all rows, those of ghosts last.
        first, second: (B, P), rows of each pair.
    """
    found = []
    for slab, number in enumerate(identity):
        own = np.flatnonzero((first[slab] < rows) & (first[slab] != second[slab]))
        values = np.stack([component[slab][own] for component in spring])
        found.append(_with_something(number[first[slab][own]], number[second[slab][own]], values))
    return Contacts(*(np.concatenate(part, axis=-1) for part in zip(*found, strict=True)))


def _with_something(first: np.ndarray, second: np.ndarray, values: np.ndarray) -> Contacts:
    kept = np.any(values != 0.0, axis=0) & (first != second)
    return Contacts(first[kept], second[kept], values[:, kept])


def history_tables(contacts: Contacts, slab: np.ndarray, row: np.ndarray, shape: tuple[int, int, int]) -> tuple:
    """What the particles of all slabs keep, as in `History`: (B, K, R) partners, and components (B, K, R) of values.

    Args:
        contacts: all of them.
        slab, row: (N,) of every particle.
        shape: B slabs, K slots, R rows.
    """
    owner = np.concatenate((contacts.first, contacts.second))
    partner = np.concatenate((contacts.second, contacts.first))
    values = np.concatenate((contacts.values, contacts.values), axis=1)
    order = np.argsort(owner, kind="stable")
    owner, partner, values = owner[order], partner[order], values[:, order]
    slot = np.arange(len(owner)) - np.searchsorted(owner, owner)
    partners = np.full(shape, -1, np.int32)
    place = slab[owner], slot, row[owner]
    partners[place] = partner
    components = []
    for component in values:
        table = np.zeros(shape, values.dtype)
        table[place] = component
        components.append(table)
    return partners, tuple(components)
