"""The neighbour list of a slab: over its own particles and the ghosts, with what contacts keep found by identity."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array, lax

from jaxdem.errors import required
from jaxdem.numerics.placement import Placement
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.ghosts import Division, Ghosts, chosen_ghosts
from jaxdem.particles.mesh_contact import MeshMemory
from jaxdem.particles.mesh_list import MeshList, by_grain, of_grain
from jaxdem.particles.mesh_surface import MeshSurface
from jaxdem.particles.neighbor_search import NeighborSearch
from jaxdem.particles.neighbors import Neighbors, Room, with_radius
from jaxdem.particles.pairs import Pairs, at, repeated
from jaxdem.particles.slab_rows import Standing, rows_beside


class Meshes(NamedTuple):
    """Meshes and where each of them is, None for one at rest; of all at rest empty."""

    surfaces: tuple[MeshSurface, ...]
    placed: tuple[Placement | None, ...]


NO_MESHES = Meshes((), ())


class History(NamedTuple):
    """What R particles keep of their contacts, whoever the first of a pair is.

    Attributes:
        partner: (K, R) int32, identity of the other as in `Ghosts.touching`; -1 where there is none. Of clumps with m
            members (K m, R): row k m + j is of member j.
        values: components of the same shape, of the pair.
    """

    partner: Array
    values: Vector


def history_of(values: Vector, neighbors: Neighbors) -> History:
    """What the own particles of a slab keep, from values (P,) of the pairs of its list."""
    ghosts = required(neighbors.ghosts, "ghosts of a list")
    row = jnp.broadcast_to(jnp.arange(neighbors.index.shape[1], dtype=jnp.int32)[None], neighbors.index.shape)
    index, entry, itself = (ghosts.of_own(x) for x in (neighbors.index, neighbors.pairs.entry, row))
    partner = jnp.where(index == itself, -1, ghosts.touching[index])
    count = neighbors.overlap.shape[0]
    return History(partner, at(values, jnp.where(entry < count, entry, entry - count)))


def of_pairs(history: History, ghosts: Ghosts, pairs: Pairs) -> Vector:
    """Components (P,), what the pairs of a list keep; zero for those that have nothing.

    Args:
        history: of the R own particles, which stand before the ghosts.
        ghosts: of the list, with the identities of all rows.
        pairs: of the list; at least one of the two is an own particle.
    """
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


def memory_of_rows(memory: tuple[MeshMemory, ...], neighbors: Neighbors) -> tuple[MeshMemory, ...]:
    """What the R own particles keep of their contacts with meshes, arrays (C m, R), from those of the list's rows."""
    ghosts = required(neighbors.ghosts, "ghosts of a list")
    rows = ghosts.members * ghosts.rows

    def of(values: Vector, listed: MeshList) -> Vector:
        numbered = dataclasses.replace(listed, row=ghosts.own_number(listed.row))
        return tuple(x.reshape(-1, ghosts.rows) for x in by_grain(values, numbered, rows))

    pairs = zip(memory, neighbors.meshes, strict=True)
    return tuple(MeshMemory(*(of(part, listed) for part in kept)) for kept, listed in pairs)


def memory_of_slab(memory: tuple[MeshMemory, ...], neighbors: Neighbors) -> tuple[MeshMemory, ...]:
    """The inverse of `memory_of_rows`."""
    ghosts = required(neighbors.ghosts, "ghosts of a list")
    rows = ghosts.members * ghosts.rows

    def of(values: Vector, listed: MeshList) -> Vector:
        numbered = dataclasses.replace(listed, row=ghosts.own_number(listed.row))
        return of_grain(tuple(x.reshape(-1, rows) for x in values), numbered)

    pairs = zip(memory, neighbors.meshes, strict=True)
    return tuple(MeshMemory(*(of(part, listed) for part in kept)) for kept, listed in pairs)


def slab_list(
    search: NeighborSearch,
    division: Division,
    standing: Standing,
    room: Room,
    ghosts: Ghosts,
    meshes: Meshes = NO_MESHES,
) -> Neighbors:
    """A first list of a slab; jittable, within `shard_map`.

    Args:
        search: for the whole box.
        division: of the box.
        standing: the R own particles.
        room: for the list.
        ghosts: with the identities of the own particles; who is a ghost is found here.
        meshes: of the scene, whole on every device.
    """
    standing = lax.stop_gradient(standing)
    ghosts = chosen_ghosts(division, ghosts, standing.position, standing.low, search.body_reach)
    bodies, position, low, radius = rows_beside(division.blocks, ghosts, standing).spheres()
    there = ghosts.identity >= 0
    if bodies is not None:
        there = required(bodies.active_rows(there), "rows of a list")
    index, crowded = search.in_reach(position, low, room, there)
    row = jnp.arange(there.shape[0], dtype=jnp.int32)
    # Two ghosts are no pair of this slab.
    of_ghosts = ghosts.body(row) >= ghosts.rows
    index = jnp.where(of_ghosts[None] & (ghosts.body(index) >= ghosts.rows), row[None], index)
    lacking = ghosts.narrow | (ghosts.needed[1] > ghosts.lower.shape[0])
    listed = search.listed(index, position, low, radius, room, crowded | lacking, ghosts.touching)
    if meshes.surfaces:
        listed = search.with_meshes(listed, meshes.surfaces, room, there & ~of_ghosts, meshes.placed)
    return dataclasses.replace(listed, ghosts=ghosts, bodies=bodies)


def renewed_list(
    search: NeighborSearch,
    division: Division,
    standing: Standing,
    old: Neighbors,
    ghosts: Ghosts,
    placed: tuple[Placement | None, ...] = (),
) -> Neighbors:
    """A list of the own particles where they are, with the room of another one.

    `placed` is where each mesh is, None for one at rest; empty where all are.
    """
    new = slab_list(search, division, standing, old.room, ghosts, Meshes(old.surfaces, placed))
    ghosts = required(new.ghosts, "ghosts of a list")
    sizes = standing.sizes._replace(radius=rows_beside(division.blocks, ghosts, standing.sizes.radius))
    radius = sizes.rows(ghosts.identity.shape[0])
    return dataclasses.replace(with_radius(new, radius), builds=old.builds + 1, overflow=old.overflow | new.overflow)
