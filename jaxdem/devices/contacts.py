"""Contacts by the identity of their particles, as they are kept when the slabs change. Host, numpy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from jaxdem.errors import required
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.ghosts import member_stride
from jaxdem.particles.integrate import ParticleState
from jaxdem.particles.level_room import owns_first
from jaxdem.particles.mesh_contact import MeshMemory
from jaxdem.particles.neighbors import Neighbors


class Contacts(NamedTuple):
    """Pairs of a list that keep something.

    Attributes:
        first, second: (P,) identities, first < second; of clumps k N + i, member k of the body i of N.
        values: (c, P), what is kept; see `ParticleState.contact_spring`.
        meshes: of the contacts with each mesh, arrays (C, N) by identity; of clumps with m members (C, m N).
    """

    first: np.ndarray
    second: np.ndarray
    values: np.ndarray
    meshes: tuple[MeshMemory, ...] = ()


def contacts_of_list(spring: Vector, neighbors: Neighbors, memory: Sequence[MeshMemory] = ()) -> Contacts:
    """Of a list on one device, and what contacts with its meshes keep."""
    pairs, number = neighbors.pairs, np.arange(neighbors.reference[0].shape[0])
    found = _with_something(np.asarray(pairs.first), np.asarray(pairs.second), np.stack(spring))
    rows = [np.asarray(mesh.row)[None] for mesh in neighbors.meshes]
    kept = jax.tree.map(lambda x: np.asarray(x)[None], tuple(memory))
    return found._replace(meshes=memory_by_identity(kept, rows, number[None], len(number)))


def memory_by_identity(
    memory: Sequence[MeshMemory], rows: Sequence[np.ndarray], identity: np.ndarray, count: int
) -> tuple[MeshMemory, ...]:
    """`kept_by_identity` of all that is kept of each mesh, in the rows of each."""
    pairs = zip(memory, rows, strict=True)
    found: Any = tuple(
        jax.tree.map(lambda x, row=row: kept_by_identity(x, row, identity, count), kept) for kept, row in pairs
    )
    return found


def kept_by_identity(values: Any, row: np.ndarray, identity: np.ndarray, count: int) -> np.ndarray:
    """(C, N) by identity of what contacts with a mesh keep in slabs.

    Args:
        values: (B, C, M).
        row: (B, M), rows of the grains; as many as there are identities, or more, where there is none.
        identity: (B, R) of the rows; -1 for none.
        count: N, of clumps m N with the identities of their members.
    """
    whole = np.zeros((values.shape[1], count), values.dtype)
    for slab, number in enumerate(identity):
        listed = np.flatnonzero(row[slab] < len(number))
        owner = number[row[slab][listed]]
        whole[:, owner[owner >= 0]] = np.asarray(values[slab])[:, listed[owner >= 0]]
    return whole


def contacts_of_slabs(particles: ParticleState, neighbors: Neighbors, count: int) -> Contacts:
    """Of a distributed state and list of N particles on the host; a pair across a border is that of its first
    particle's slab."""
    ghosts: Any = required(neighbors.ghosts, "ghosts of a list")
    pairs: Any = neighbors.pairs
    rows = ghosts.identity.shape[1] - 2 * ghosts.lower.shape[1]
    owned = np.arange(ghosts.identity.shape[1]) < rows
    owned, number = np.tile(owned, ghosts.members), of_members(ghosts.identity, ghosts.members, count)
    found = contacts_of_rows(particles.contact_spring, owned, number, pairs.first, pairs.second)
    of_mesh, every = [np.asarray(mesh.row) for mesh in neighbors.meshes], ghosts.members * count
    return found._replace(meshes=memory_by_identity(particles.mesh_memory, of_mesh, number, every))


def of_members(identity: np.ndarray, members: int, count: int) -> np.ndarray:
    """(B, m n) number k N + i of member k of body i, from the identities (B, n) of N bodies; -1 where there is none."""
    found = np.where(identity[:, None] >= 0, identity[:, None] + count * np.arange(members)[:, None], -1)
    return found.reshape(len(identity), -1)


def contacts_of_rows(
    spring: Sequence[Any], owned: np.ndarray, identity: np.ndarray, first: np.ndarray, second: np.ndarray
) -> Contacts:
    """`contacts_of_slabs` from arrays.

    Args:
        spring: (B, P) each.
        owned: (n,) bool, rows that are not of ghosts.
        identity: (B, n) of all rows.
        first, second: (B, P), rows of each pair.
    """
    found = []
    for slab, number in enumerate(identity):
        own = np.flatnonzero(owned[first[slab]] & (first[slab] != second[slab]))
        values = np.stack([component[slab][own] for component in spring])
        found.append(_with_something(number[first[slab][own]], number[second[slab][own]], values))
    lower, upper, values = (np.concatenate(part, axis=-1) for part in zip(*(one[:3] for one in found), strict=True))
    return Contacts(lower, upper, values)


def _with_something(first: np.ndarray, second: np.ndarray, values: np.ndarray) -> Contacts:
    kept = np.any(values != 0.0, axis=0) & (first != second)
    return Contacts(first[kept], second[kept], values[:, kept])


class Keepers(NamedTuple):
    """Who keeps what, see `particles.slab_history`: (C,) each.

    Attributes:
        owner: who keeps it.
        partner: the other of its pair.
        number: of the pair among the contacts.
    """

    owner: np.ndarray
    partner: np.ndarray
    number: np.ndarray


def keepers_of(contacts: Contacts, radius: np.ndarray | None) -> Keepers:
    """Both particles of every pair; with radii (N,) the owner of each alone, as in a list by levels of size."""
    first, second, number = contacts.first, contacts.second, np.arange(len(contacts.first))
    if radius is not None:
        low, high = np.minimum(first, second), np.maximum(first, second)
        lower = owns_first(radius, low, high)
        return Keepers(np.where(lower, low, high), np.where(lower, high, low), number)
    return Keepers(np.concatenate((first, second)), np.concatenate((second, first)), np.concatenate((number, number)))


def history_tables(
    contacts: Contacts, kept: Keepers, slab: np.ndarray, row: np.ndarray, shape: tuple[int, int, int], members: int
) -> tuple:
    """What the particles of all slabs keep, as in `History`: (B, K m, R) partners, and components of values alike.

    Args:
        contacts: all of them.
        kept: who keeps them.
        slab, row: (N,) of every particle.
        shape: B slabs, K slots, R rows.
        members: m, of a clump; 1 of spheres.
    """
    shape = shape[0], shape[1] * members, shape[2]
    owner, partner = kept.owner, kept.partner
    values = contacts.values[:, kept.number]
    order = np.argsort(owner, kind="stable")
    owner, partner, values = owner[order], partner[order], values[:, order]
    slot = np.arange(len(owner)) - np.searchsorted(owner, owner)
    partners = np.full(shape, -1, np.int32)
    (member, body), (of_partner, other) = divmod(owner, len(slab)), divmod(partner, len(slab))
    place = slab[body], slot * members + member, row[body]
    partners[place] = of_partner * member_stride(members) + other
    components = []
    for component in values:
        table = np.zeros(shape, values.dtype)
        table[place] = component
        components.append(table)
    return partners, tuple(components)
