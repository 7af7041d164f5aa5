"""The neighbour list of a slab: over its own particles and the ghosts, with what contacts keep found by identity."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array, lax

from jaxdem.errors import required
from jaxdem.numerics.compensated import Low
from jaxdem.numerics.placement import Placement
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.ghosts import Division, Ghosts, chosen_ghosts, with_ghosts
from jaxdem.particles.mesh_surface import MeshSurface
from jaxdem.particles.neighbor_search import NeighborSearch
from jaxdem.particles.neighbors import Neighbors, Room, with_radius
from jaxdem.particles.pairs import Pairs, at, repeated


class Meshes(NamedTuple):
    """Meshes and where each of them is, None for one at rest; of all at rest empty."""

    surfaces: tuple[MeshSurface, ...]
    placed: tuple[Placement | None, ...]


NO_MESHES = Meshes((), ())


class History(NamedTuple):
    """What R particles keep of their contacts, whoever the first of a pair is.

    Attributes:
        partner: (K, R) int32, identity of the other; -1 where there is none.
        values: components (K, R), of the pair.
    """

    partner: Array
    values: Vector


def history_of(values: Vector, neighbors: Neighbors) -> History:
    """What the own particles of a slab keep, from values (P,) of the pairs of its list."""
    ghosts = required(neighbors.ghosts, "ghosts of a list")
    own = jnp.arange(ghosts.rows, dtype=jnp.int32)
    index, entry = neighbors.index[:, : ghosts.rows], neighbors.pairs.entry[:, : ghosts.rows]
    partner = jnp.where(index == own[None], -1, ghosts.identity[index])
    count = neighbors.overlap.shape[0]
    return History(partner, at(values, jnp.where(entry < count, entry, entry - count)))


def of_pairs(history: History, identity: Array, pairs: Pairs) -> Vector:
    """Components (P,), what the pairs of a list keep; zero for those that have nothing.

    Args:
        history: of the R own particles, which stand before the ghosts.
        identity: (n,) int32 of all rows.
        pairs: of the list; at least one of the two is an own particle.
    """
    slots, rows = history.partner.shape
    first_own = pairs.first < rows
    one = jnp.where(first_own, pairs.first, pairs.second)
    wanted = identity[jnp.where(first_own, pairs.second, pairs.first)]
    partner = history.partner.reshape(-1)

    def look(k: int | Array, found: Array) -> Array:
        place = k * rows + one
        return jnp.where(at((partner,), place)[0] == wanted, place, found)

    none = jnp.full_like(one, -1)
    place = repeated(slots, look, none)
    found = (place >= 0) & (pairs.first != pairs.second)
    kept = at(tuple(x.reshape(-1) for x in history.values), jnp.maximum(place, 0))
    return tuple(jnp.where(found, component, 0.0) for component in kept)


def slab_list(
    search: NeighborSearch,
    division: Division,
    position: Vector,
    low: tuple[Low, ...],
    radius: Array,
    room: Room,
    ghosts: Ghosts,
    meshes: Meshes = NO_MESHES,
) -> Neighbors:
    """A first list of a slab; jittable, within `shard_map`.

    Args:
        search: for the whole box.
        division: of the box.
        position, low: D arrays (R,) of the own particles [m].
        radius: () or (R,) [m].
        room: for the list.
        ghosts: with the identities of the own particles; who is a ghost is found here.
        meshes: of the scene, whole on every device.
    """
    position, low, radius = lax.stop_gradient((position, low, radius))
    ghosts = chosen_ghosts(division, ghosts, position, low, search.reach)
    own = (*position, *(x for x in low if x is not None), *(() if radius.ndim == 0 else (radius,)))
    filled = with_ghosts(division.blocks, ghosts, own)
    dimension, identity = len(position), ghosts.identity
    position, rest = filled[:dimension], filled[dimension:]
    if low[0] is not None:
        low, rest = rest[:dimension], rest[dimension:]
    index, crowded = search.in_reach(position, low, room, identity >= 0)
    row = jnp.arange(identity.shape[0], dtype=jnp.int32)
    # Two ghosts are no pair of this slab.
    index = jnp.where((row[None] >= ghosts.rows) & (index >= ghosts.rows), row[None], index)
    lacking = ghosts.narrow | (ghosts.needed[1] > ghosts.lower.shape[0])
    listed = search.listed(index, position, low, rest[0] if rest else radius, room, crowded | lacking, identity)
    if meshes.surfaces:
        own_rows = (identity >= 0) & (row < ghosts.rows)
        listed = search.with_meshes(listed, meshes.surfaces, room, own_rows, meshes.placed)
    return dataclasses.replace(listed, ghosts=ghosts)


def renewed_list(
    search: NeighborSearch,
    division: Division,
    position: Vector,
    low: tuple[Low, ...],
    radius: Array,
    old: Neighbors,
    ghosts: Ghosts,
    placed: tuple[Placement | None, ...] = (),
) -> Neighbors:
    """A list at these positions with the room of another one; `radius`, () or (n,), is as old as that one.

    `placed` is where each mesh is, None for one at rest; empty where all are.
    """
    own = radius if radius.ndim == 0 else radius[: ghosts.rows]
    new = slab_list(search, division, position, low, own, old.room, ghosts, Meshes(old.surfaces, placed))
    radius = own
    if own.ndim:
        radius = with_ghosts(division.blocks, required(new.ghosts, "ghosts of a list"), (own,))[0]
    return dataclasses.replace(with_radius(new, radius), builds=old.builds + 1, overflow=old.overflow | new.overflow)
