"""How deep particles reach into a mesh at a moment: for a mesh that comes while a run goes on."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.numerics.compensated import Low
from jaxdem.numerics.placement import Placement
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.mesh_room import MeshRoom
from jaxdem.particles.mesh_search import MeshSearch, whole
from jaxdem.particles.mesh_surface import MeshSurface


def depth_in_mesh(
    search: MeshSearch,
    surface: MeshSurface,
    room: MeshRoom,
    placed: Placement | None,
    particles: tuple[Vector, tuple[Low, ...], Array],
    active: Array | None,
) -> tuple[Array, Array]:
    """(N,) deepest overlap of every particle with a mesh, minus its radius where it touches nothing [m]; and () bool,
    whether there was not room enough to find all.

    Args:
        search: how particles find it.
        surface: the mesh, touched from both sides.
        room: for the list of what they may touch.
        placed: where it is; None where it does not move.
        particles: positions and their trailing parts, D arrays (N,), and radius () or (N,) [m].
        active: (N,) bool, which particles there are; None for all.
    """
    position, low, radius = particles
    if surface.hull is None:
        listed, crowded = search.listed(surface, search.inside(position, low), radius, room, active)
    else:
        placement = whole(placed, len(position), position[0].dtype)
        listed, crowded = search.listed_beside(surface, placement, position, low, radius, room, active)
    own = listed.radius_of_rows(radius)
    size = own[None] if own.ndim else own
    still = tuple(jnp.zeros_like(x)[None] for x in listed.of_rows(position))
    deepest = -size * jnp.ones((1, listed.row.shape[0]), position[0].dtype)
    for kind in listed.near:
        overlap, _, within = kind.now(still, size)
        deepest = jnp.maximum(deepest, jnp.max(jnp.where(within, overlap, -size), axis=0, keepdims=True))
    blank = -radius * jnp.ones_like(position[0])
    return blank.at[listed.row].set(deepest[0], mode="drop"), crowded
