"""The neighbour list of a slab: over its own particles and the ghosts; and what contacts with meshes keep."""

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
from jaxdem.particles.slab_rows import Standing, rows_beside


class Meshes(NamedTuple):
    """Meshes and where each of them is, None for one at rest; of all at rest empty."""

    surfaces: tuple[MeshSurface, ...]
    placed: tuple[Placement | None, ...]


NO_MESHES = Meshes((), ())


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
    size = (search.spare_reach, standing.sizes.radius) if division.by_size else (search.body_reach, None)
    ghosts = chosen_ghosts(division, ghosts, standing.position, standing.low, *size)
    bodies, position, low, radius = rows_beside(division.blocks, ghosts, standing).spheres()
    there = ghosts.identity >= 0
    if bodies is not None:
        there = required(bodies.active_rows(there), "rows of a list")
    # Two ghosts are no pair of this slab.
    if search.levels is None:
        index, crowded = search.in_reach(position, low, room, there)
        row, of_ghosts = _of_ghosts(ghosts, there)
        index = jnp.where(of_ghosts[None] & (ghosts.body(index) >= ghosts.rows), row[None], index)
    else:
        _, of_ghosts = _of_ghosts(ghosts, there)
        who = jnp.where(of_ghosts, -1 - ghosts.identity, ghosts.identity)
        index, crowded = search.in_reach(position, low, room, there, radius, who)
    lacking = ghosts.narrow | (ghosts.needed[1] > ghosts.lower.shape[0])
    listed = search.listed(index, position, low, radius, room, crowded | lacking, ghosts.touching)
    if meshes.surfaces:
        listed = search.with_meshes(listed, meshes.surfaces, room, there & ~of_ghosts, meshes.placed)
    return dataclasses.replace(listed, ghosts=ghosts, bodies=bodies)


def _of_ghosts(ghosts: Ghosts, there: Array) -> tuple[Array, Array]:
    """(n,) int32 rows of a list, and (n,) bool which are of ghosts."""
    row = jnp.arange(there.shape[0], dtype=jnp.int32)
    return row, ghosts.body(row) >= ghosts.rows


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
