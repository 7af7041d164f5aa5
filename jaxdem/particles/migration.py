"""Particles that go to the neighbouring slab at the end of a coupling interval, and cut planes that move for balance.

All that a row has goes along: motion, springs at walls, springs of contacts by the identity of the other, and what
forces of the fluid keep. A row that is left is free for who comes. Rows of the others stay where they are.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxdem.errors import required
from jaxdem.numerics import vectors
from jaxdem.numerics.batches import cond_in_batch
from jaxdem.numerics.blocks import Blocks
from jaxdem.numerics.placement import Placement
from jaxdem.particles.ghosts import Division, Ghosts
from jaxdem.particles.integrate import Motion, ParticleState, split_low
from jaxdem.particles.mesh_contact import MeshMemory
from jaxdem.particles.neighbor_search import NeighborSearch
from jaxdem.particles.neighbors import Neighbors
from jaxdem.particles.slab_bonds import relisted, rows_first, rows_last, without_ghosts_gone
from jaxdem.particles.slab_history import History, history_of, of_pairs
from jaxdem.particles.slab_list import memory_of_rows, memory_of_slab, renewed_list
from jaxdem.particles.slab_rows import Sizes, Standing

IMBALANCE = 1.02
"""The cut planes move where the fullest slab has this many times its share of the particles, ..."""

LEAST_EXCESS = 8
"""... and so many particles more than its share at least."""

NARROWEST = 2.0
"""A slab stays this many times as wide as the list reaches, of clumps from centre to centre."""


class _Rows(NamedTuple):
    """What goes along with a particle, the first axis of every array is that of the R rows."""

    particles: ParticleState
    history: History
    meshes: tuple[MeshMemory, ...]
    along: Any


def settled(
    division: Division,
    search: NeighborSearch,
    sizes: Sizes,
    particles: ParticleState,
    neighbors: Neighbors,
    placed: tuple[Placement | None, ...] = (),
    along: Any = None,
) -> tuple[ParticleState, Neighbors, Any]:
    """Particles, list and what goes along at the end of an interval, every particle in the slab where it is; within
    `shard_map`.

    Nothing happens where all are near enough to their slab, nobody has left or come, and the slabs are balanced.

    Args:
        division: of the box; static.
        search: of the list; static.
        sizes: of all particles by identity.
        particles: of this slab, R rows.
        neighbors: their list.
        placed: where each mesh is, None for one at rest; empty where all are.
        along: arrays (R, ...) of what else belongs to the particles.
    """
    blocks, ghosts = division.blocks, required(neighbors.ghosts, "ghosts of a list")
    position, low = _positions(particles)
    active = required(particles.active, "active of the particles")
    away, half = division.from_middle(ghosts.planes, position, low)
    steps = division.steps_to(ghosts.planes, position, low)
    out = active & (steps != 0)
    if division.stray:
        out = out & (jnp.abs(away) - half > division.stray * search.geometry.cutoff)
    # Particles that have left or come are not yet in the list.
    changed = jnp.any(~_listed(particles, ghosts))
    numbers, any_out = _numbers(blocks, active, jnp.any(out) | changed)
    planes = ghosts.planes
    if division.balanced and blocks.number > 1:
        share = jnp.sum(numbers) / blocks.number
        fullest = jnp.max(numbers)
        uneven = (fullest > IMBALANCE * share) & (fullest > share + LEAST_EXCESS)
        planes = cond_in_batch(
            uneven, lambda planes: _balanced(division, search, planes, away, active, numbers, ghosts.migrating), planes
        )
        any_out = any_out | jnp.any(planes != ghosts.planes)

    def move(all_: tuple[ParticleState, Neighbors, Any]) -> tuple[ParticleState, Neighbors, Any]:
        return _moved(division, search, sizes, all_, planes, placed)

    return cond_in_batch(any_out, move, (particles, neighbors, along))


def _positions(particles: ParticleState) -> tuple[vectors.Vector, tuple[Any, ...]]:
    position = lax.stop_gradient(vectors.components(particles.position))
    return position, lax.stop_gradient(split_low(particles.position_low, len(position)))


def _listed(particles: ParticleState, ghosts: Ghosts) -> Array:
    """(R,) bool, rows that have the particle with which the list was made, or none as then."""
    return required(particles.identity, "identity of the particles") == ghosts.identity[: ghosts.rows]


def _numbers(blocks: Blocks, active: Array, condition: Array) -> tuple[Array, Array]:
    """(B,) int32, particles of every slab; and () bool, whether a condition holds in any: in one message."""
    own = (jnp.arange(blocks.number + 1) == blocks.index()).astype(jnp.int32) * jnp.sum(active, dtype=jnp.int32)
    all_ = blocks.total(own.at[-1].set(condition.astype(jnp.int32)))
    return all_[:-1], all_[-1] > 0


def _balanced(
    division: Division, search: NeighborSearch, planes: Array, away: Array, active: Array, numbers: Array, most: int
) -> Array:
    """(B - 1,) cut planes for equal numbers on both sides, as far as they can move at once.

    Of what a slab has too many, up to a quarter of its particles and half of `most` go to a neighbour; a slab gives up
    no more than leaves it `NARROWEST`.
    """
    blocks, number = division.blocks, division.blocks.number
    lower, upper = division.bounds(planes)
    middle, own = 0.5 * (lower + upper), blocks.index()
    targets = jnp.sum(numbers) * jnp.arange(1, number) // number
    surplus = jnp.cumsum(numbers)[:-1] - targets.astype(jnp.int32)
    giver = jnp.where(surplus > 0, numbers[:-1], numbers[1:])
    given = jnp.clip(surplus, -jnp.minimum(giver // 4, most // 2), jnp.minimum(giver // 4, most // 2))
    ordered = jnp.sort(jnp.where(active, away, jnp.inf))
    count, last = numbers[own], ordered.shape[0] - 1

    def between(place: Array) -> Array:
        """Halfway between two particles, so many of which are below."""
        place = jnp.clip(place, 1, last)
        return middle + 0.5 * (ordered[place - 1] + ordered[place])

    up = between(count - given)  # of every plane, if it were the upper end of this slab
    down = between(-given)  # the same of its lower end
    plane = jnp.arange(number - 1)
    found = jnp.where((given > 0) & (plane == own), up, 0.0) + jnp.where((given < 0) & (plane == own - 1), down, 0.0)
    found = jnp.where(given == 0, planes, blocks.total(found))
    ends = jnp.concatenate((jnp.zeros_like(planes, shape=1), planes, jnp.full_like(planes, division.length, shape=1)))
    spare = jnp.maximum(0.5 * (jnp.diff(ends) - NARROWEST * search.body_reach), 0.0)
    return jnp.clip(found, planes - spare[:-1], planes + spare[1:])


def _moved(
    division: Division,
    search: NeighborSearch,
    sizes: Sizes,
    all_: tuple[ParticleState, Neighbors, Any],
    planes: Array,
    placed: tuple[Placement | None, ...],
) -> tuple[ParticleState, Neighbors, Any]:
    """Particles sent to the slabs where they are, the list of those that are here then, and what goes along."""
    particles, neighbors, along = all_
    ghosts, active = required(neighbors.ghosts, "ghosts of a list"), required(particles.active, "active")
    steps = jnp.where(active, division.steps_to(planes, *_positions(particles)), 0)
    bonds = without_ghosts_gone(division.blocks, ghosts, particles.bonds, _listed(particles, ghosts))
    particles = particles._replace(bonds=bonds)
    rows, needed = _sent(division.blocks, _rows(particles, neighbors, along), steps, ghosts)
    history, meshes = jax.tree.map(jnp.transpose, (rows.history, rows.meshes))
    here, number = required(rows.particles.active, "active"), required(rows.particles.identity, "identity")
    identity = jnp.where(here, number, -1)
    lacking = jnp.any(needed[::2] > jnp.array([ghosts.rows, ghosts.migrating]))
    ghosts = dataclasses.replace(
        ghosts,
        planes=planes,
        identity=ghosts.identity.at[: ghosts.rows].set(identity),
        needed=jnp.maximum(ghosts.needed, needed),
        narrow=ghosts.narrow | jnp.any(jnp.abs(steps) > 1),
        migrations=ghosts.migrations + 1,
        cuts=ghosts.cuts + jnp.any(planes != ghosts.planes).astype(jnp.int32),
    )
    particles = _row_last(rows.particles, particles)._replace(identity=identity)
    standing = Standing.of(Motion.of(particles), sizes.of_rows(jnp.maximum(identity, 0)), ghosts.rows)
    neighbors = dataclasses.replace(neighbors, overflow=neighbors.overflow | lacking)
    new = renewed_list(search, division, standing, neighbors, ghosts, placed)
    new, bonds = relisted(division.blocks, new, particles.bonds)
    particles = particles._replace(bonds=bonds)
    springs = of_pairs(division.blocks, history, required(new.ghosts, "ghosts of a list"), new.pairs)
    memory = memory_of_slab(meshes, new)
    return particles._replace(contact_spring=springs, mesh_memory=memory), new, rows.along


def _rows(particles: ParticleState, neighbors: Neighbors, along: Any) -> _Rows:
    """What goes along; a row whose particle has come since the list was made has no contacts."""
    ghosts = required(neighbors.ghosts, "ghosts of a list")
    same = _listed(particles, ghosts)
    history = history_of(particles.contact_spring, neighbors)
    history = history._replace(partner=jnp.where(same[None], history.partner, -1))
    meshes = tuple(
        MeshMemory(*(tuple(jnp.where(same[None], x, 0.0) for x in part) for part in kept))
        for kept in memory_of_rows(particles.mesh_memory, neighbors)
    )
    history, meshes = jax.tree.map(jnp.transpose, (history, meshes))
    return _Rows(_row_first(particles), history, meshes, along)


def _row_first(particles: ParticleState) -> ParticleState:
    """What goes along with a particle, with the axis of the rows in front."""
    return particles._replace(
        contact_spring=(),
        wall_spring=tuple(x.reshape(-1, len(particles.position)).T for x in particles.wall_spring),
        fluid_memory=jax.tree.map(lambda x: jnp.moveaxis(x, -2, 0), particles.fluid_memory),
        inserted=None,
        coming=None,
        pistons=None,
        mesh_memory=(),
        mesh_wear=(),
        bonds=None if particles.bonds is None else rows_first(particles.bonds),
    )


def _row_last(rows: ParticleState, before: ParticleState) -> ParticleState:
    """The inverse of `_row_first`; what does not go along is that of the state before."""
    return rows._replace(
        contact_spring=before.contact_spring,
        wall_spring=tuple(x.T.reshape(y.shape) for x, y in zip(rows.wall_spring, before.wall_spring, strict=True)),
        fluid_memory=jax.tree.map(lambda x: jnp.moveaxis(x, 0, -2), rows.fluid_memory),
        inserted=before.inserted,
        coming=before.coming,
        pistons=before.pistons,
        mesh_wear=before.mesh_wear,
        bonds=None if rows.bonds is None or before.bonds is None else rows_last(rows.bonds, before.bonds),
    )


def _sent(blocks: Blocks, rows: _Rows, steps: Array, ghosts: Ghosts) -> tuple[_Rows, Array]:
    """Rows after those with `steps` +1 and -1 have gone to the slab above and below; and what there must be room for.

    Rows that are left are at rest where they are.

    Returns:
        rows; and (3,) int32, see `Ghosts.needed`.
    """
    leaves, tree = jax.tree.flatten(rows)
    count, most = ghosts.rows, ghosts.migrating

    def chosen(sent: Array) -> list[Array]:
        places = jnp.nonzero(sent, size=most, fill_value=count)[0]
        return [x.at[places].get(mode="fill", fill_value=0) for x in leaves]

    up, down = steps == 1, steps == -1
    from_below, from_above = _as_one_message(blocks, chosen(down), chosen(up))
    arrived = [jnp.concatenate(both) for both in zip(from_below, from_above, strict=True)]
    coming = required(jax.tree.unflatten(tree, arrived).particles.active, "active")
    staying = required(rows.particles.active, "active") & (steps == 0)
    free = jnp.nonzero(~staying, size=2 * most, fill_value=count)[0]
    place = jnp.where(coming, free[jnp.cumsum(coming) - 1], count)

    def resting(x: Array) -> Array:
        return jnp.where(staying.reshape(-1, *(1,) * (x.ndim - 1)), x, jnp.zeros((), x.dtype))

    left = jax.tree.map(resting, rows)
    unmoved = {"position": rows.particles.position, "position_low": rows.particles.position_low}
    left = left._replace(particles=left.particles._replace(**unmoved))
    new = [x.at[place].set(y, mode="drop") for x, y in zip(jax.tree.leaves(left), arrived, strict=True)]
    numbers = [jnp.sum(staying) + jnp.sum(coming), jnp.maximum(jnp.sum(up), jnp.sum(down))]
    needed = jnp.stack([numbers[0], jnp.zeros_like(numbers[0]), numbers[1]]).astype(jnp.int32)
    return jax.tree.unflatten(tree, new), needed


def _as_one_message(blocks: Blocks, down: list[Array], up: list[Array]) -> tuple[list[Array], list[Array]]:
    """What comes from below and above of arrays (M, ...) that go down and up; one message for each type of numbers."""
    kinds = [jnp.dtype(jnp.int32) if x.dtype == bool else x.dtype for x in up]
    found: tuple[dict[int, Array], dict[int, Array]] = {}, {}
    for kind in dict.fromkeys(kinds):
        those = [k for k, own in enumerate(kinds) if own == kind]
        ends = np.cumsum([up[k][0].size for k in those])[:-1].tolist()

        def joined(arrays: list[Array], those: list[int] = those, kind: Any = kind) -> Array:
            return jnp.concatenate([arrays[k].reshape(len(arrays[k]), -1).astype(kind) for k in those], axis=1)

        for parts, message in zip(found, blocks.from_both(joined(down), joined(up)), strict=True):
            parts.update(zip(those, jnp.split(message, ends, axis=1), strict=True))
    below, above = ([parts[k].astype(x.dtype).reshape(x.shape) for k, x in enumerate(up)] for parts in found)
    return below, above
