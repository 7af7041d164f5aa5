"""Contacts of grains with a mesh: which of the parts in reach count, and what each contact has kept.

A grain touches a mesh at every nearest point of the surface; see `jaxdem.solids.features`. Of nearest points on one
smooth patch, and less than `SPREAD` apart as seen from the centre, the deepest alone counts: on a plane of many
triangles, and in a bend of many, a grain has one contact. What a contact keeps goes to the contact of the same grain
whose direction is nearest to its own a step later: over edges, over the build of a list, from one triangle to the next.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxdem.numerics import vectors
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.mesh_list import MeshList
from jaxdem.particles.pairs import at

SPREAD = math.radians(30.0)
"""Nearest points of a smooth patch whose directions differ by less are one contact [rad]."""

SAME = 1e-3
"""Nearest points whose directions differ by less are one contact wherever they lie [rad]."""


class MeshMemory(NamedTuple):
    """What the contacts of M rows with a mesh keep, C of each.

    Attributes:
        normal: D arrays (C, M), direction of each contact in the box; zero where there was none.
        spring: arrays (C, M), see `ContactModel.history_size`.
        overlap: one array (C, M), or none, see `ContactModel.tracks_meshes`; 0 where no step has been [m].
    """

    normal: Vector
    spring: Vector
    overlap: Vector = ()


class MeshTouch(NamedTuple):
    """Contacts of M rows with a mesh, C of each, the deepest first.

    Attributes:
        overlap: (C, M), minus the radius where there is no contact [m].
        normal: D arrays (C, M), unit vectors towards the grains, in the frame of the mesh.
        found: (C, M) bool, whether there is a contact.
        crowded: () bool, a grain has more contacts than there is room for.
        cell: (C, M) int32, the triangle of each contact; None without wear.
    """

    overlap: Array
    normal: Vector
    found: Array
    crowded: Array
    cell: Array | None = None


def touching(listed: MeshList, moved: Vector, radius: Array, reach: Array) -> MeshTouch:
    """The contacts of the grains of a list.

    Args:
        listed: the list.
        moved: D arrays (M,), motion of the grains since its build, in the frame of the mesh [m].
        radius: () or (M,) [m].
        reach: (M,) gap up to which a contact counts that is about to begin [m].
    """
    shift = tuple(x[None] for x in moved)
    size = radius[None] if radius.ndim else radius
    all_of = [kind.now(shift, size) for kind in listed.near]
    overlap = jnp.concatenate([overlap for overlap, _, _ in all_of])
    normal = tuple(jnp.concatenate(x) for x in zip(*(_full(n, o) for o, n, _ in all_of), strict=True))
    within = jnp.concatenate([within for _, _, within in all_of])
    patch = jnp.concatenate([kind.patch for kind in listed.near])
    candidate = within & (overlap + reach[None] > 0)
    place, crowded = _chosen(*lax.stop_gradient((overlap, normal, candidate)), patch, listed.contacts)
    found = place >= 0
    rows = jnp.arange(overlap.shape[1], dtype=jnp.int32)[None]
    flat = jnp.maximum(place, 0) * overlap.shape[1] + rows
    # A place without a contact is out of reach by a radius, whatever the speed.
    deep = jnp.where(found, at((overlap.reshape(-1),), flat)[0], -size * jnp.ones_like(flat, overlap.dtype))
    directions = at(tuple(x.reshape(-1) for x in normal), flat)
    cells = [kind.cell for kind in listed.near if kind.cell is not None]
    cell = at((jnp.concatenate(cells).reshape(-1),), flat)[0] if cells else None
    return MeshTouch(deep, directions, found, crowded, cell)


def _full(normal: Vector, overlap: Array) -> Vector:
    return tuple(jnp.broadcast_to(x, overlap.shape) for x in normal)


def _chosen(overlap: Array, normal: Vector, candidate: Array, patch: Array, contacts: int) -> tuple[Array, Array]:
    """(C, M) int32 place among the K of each row of its contacts, the deepest first, -1 for none; and whether there
    were more."""
    slots, rows = overlap.shape
    lowest = jnp.asarray(-jnp.inf, overlap.dtype)
    place = jnp.arange(slots, dtype=jnp.int32)[:, None]
    near, far = (2.0 * math.sin(0.5 * angle) for angle in (SAME, SPREAD))

    def more(going: tuple[Array, Array, Array]) -> Array:
        number, left, _ = going
        return (number < contacts) & jnp.any(left)

    def choose(going: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        number, left, chosen = going
        depth = jnp.where(left, overlap, lowest)
        deepest = jnp.max(depth, axis=0)
        some = deepest > lowest
        first = jnp.min(jnp.where(left & (depth == deepest[None]), place, slots), axis=0)
        first = jnp.where(some, first, -1)
        flat = jnp.maximum(first, 0) * rows + jnp.arange(rows, dtype=jnp.int32)
        own = at(tuple(x.reshape(-1) for x in normal), flat)
        own_patch = at((patch.reshape(-1),), flat)[0]
        apart = tuple(x - y[None] for x, y in zip(normal, own, strict=True))
        distance = vectors.dot(apart, apart)
        limit = jnp.where(patch == own_patch[None], far**2, near**2)
        left = left & ~((distance < limit) & some[None])
        left = left & (place != first[None])
        return number + 1, left, chosen.at[number].set(first)

    start = (jnp.zeros((), jnp.int32), candidate, jnp.full((contacts, rows), -1, jnp.int32))
    _, left, chosen = lax.while_loop(more, choose, start)
    return chosen, jnp.any(left)


def remembered(memory: MeshMemory, touch: MeshTouch, normal: Vector, among: Array | None = None) -> Vector:
    """What the contacts of a step have kept, (C, M) components: of the contact of the step before with the nearest
    direction, if that is less than `SPREAD` away and nearest to no other.

    Args:
        memory: of the step before.
        touch: contacts now.
        normal: their directions in the frame of the box.
        among: (C, M) bool, which of the step before; None for all.
    """
    taken = same_contacts(memory, touch, normal, among)

    def gathered(kept: Array) -> Array:
        return jnp.sum(jnp.where(taken, kept[None], 0.0), axis=1)

    springs: Vector = jax.tree.map(gathered, memory.spring)
    return springs


def begins(memory: MeshMemory, touch: MeshTouch, normal: Vector, among: Array | None = None) -> Array:
    """(C, M) bool, which contacts of a step go on with none of the step before; see `remembered`."""
    return touch.found & ~jnp.any(same_contacts(memory, touch, normal, among), axis=1)


def same_contacts(memory: MeshMemory, touch: MeshTouch, normal: Vector, among: Array | None = None) -> Array:
    """(C, C', M) bool, whether a contact of a step is that of the step before; see `remembered`."""
    limit = (2.0 * math.sin(0.5 * SPREAD)) ** 2
    before, now = lax.stop_gradient((memory.normal, normal))
    apart = tuple(x[:, None] - y[None] for x, y in zip(now, before, strict=True))
    distance = vectors.dot(apart, apart)
    there = vectors.dot(before, before) > 0.5
    there = there if among is None else there & among
    distance = jnp.where(there[None] & touch.found[:, None], distance, jnp.inf)
    best = jnp.min(distance, axis=1, keepdims=True)
    best_of_former = jnp.min(distance, axis=0, keepdims=True)
    return (distance < limit) & (distance <= best) & (distance <= best_of_former)
