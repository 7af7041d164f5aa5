"""A coupling interval with the walls that are there in it.

Every set of walls has a contact loop of its own, which is that of a scene with these walls and no others: so a run
whose wall vanishes is, bit for bit, the run in which it is taken away by hand. Walls come and go between two coupling
intervals. What a grain kept of a contact with a wall is gone with the wall.

Where a wall comes grains must not be: a contact with an overlap that no impact has made would throw them away, so that
is a failure of the run.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxdem.errors import required
from jaxdem.numerics import vectors
from jaxdem.numerics.batches import cond_in_batch
from jaxdem.numerics.placement import Placement
from jaxdem.particles.contact_interval import ContactInterval, ContactMeans
from jaxdem.particles.contact_model import ContactModel
from jaxdem.particles.contact_step import Surroundings
from jaxdem.particles.contact_sums import WallLoads
from jaxdem.particles.integrate import ParticleState, split_low
from jaxdem.particles.mesh_contact import MeshMemory
from jaxdem.particles.mesh_depth import depth_in_mesh
from jaxdem.particles.neighbors import Neighbors
from jaxdem.particles.surfaces import surface_contacts

Result = tuple[ParticleState, Neighbors, ContactMeans]
Advance = Callable[[ContactInterval, Surroundings, ParticleState], Result]


def with_walls_present(
    interval: ContactInterval, surroundings: Surroundings, state: ParticleState, middle: Array, advance: Advance
) -> Result:
    """What `advance` gives with the walls that are there.

    Args:
        interval: with all walls; static.
        surroundings: of all walls.
        state: with the springs of all walls.
        middle: () of the interval [s].
        advance: from the interval, the surroundings and the state of the walls that are there to the state with their
            springs, the neighbour list, and the means of the interval.
    """
    model = interval.model
    times = model.wall_times
    if times is None:
        return advance(interval, surroundings, state)

    def advanced_with(surfaces: tuple[int, ...]) -> Result:
        kept = (*range(len(model.sides)), *(len(model.sides) + k for k in surfaces))
        analytic = tuple(k for k in kept if k < model.analytic_walls)
        around = surroundings._replace(wall_velocity=tuple(surroundings.wall_velocity[k] for k in kept))
        springs = tuple(spring[np.asarray(analytic, int)] for spring in state.wall_spring)
        there = dataclasses.replace(interval, model=model.with_walls(kept))
        after, neighbors, means = advance(there, around, state._replace(wall_spring=springs))
        springs = tuple(_of_all(model.analytic_walls, analytic, spring) for spring in after.wall_spring)
        if model.measured:
            means = means._replace(walls=_loads(model, kept, means.walls, state))
        after = after._replace(wall_spring=springs)
        if model.meshes:
            after = after._replace(mesh_memory=_without_meshes_gone(there.model, after))
        return after, neighbors, means

    sets = tuple(dict.fromkeys(times.phases))
    number = jnp.asarray([sets.index(phase) for phase in times.phases])[times.phase(middle)]
    return lax.switch(number, [lambda one=one: advanced_with(one) for one in sets])  # type: ignore[no-any-return]


def _without_meshes_gone(there: ContactModel, state: ParticleState) -> tuple[MeshMemory, ...]:
    """What contacts with meshes keep, nothing of those that are not there."""
    present = {mesh.number for mesh in there.meshes}
    return tuple(
        memory if number in present else jax.tree.map(jnp.zeros_like, memory)
        for number, memory in enumerate(state.mesh_memory)
    )


def _of_all(walls: int, kept: tuple[int, ...], own: Array) -> Array:
    """(S, ...) springs or loads of all walls, zero at those that are not there."""
    nothing = jnp.zeros_like(own, shape=(1, *own.shape[1:]))
    place = np.full(walls, len(kept))
    place[list(kept)] = np.arange(len(kept))
    return jnp.concatenate([own, nothing])[place]


def _loads(model: ContactModel, kept: tuple[int, ...], own: WallLoads | None, state: ParticleState) -> WallLoads:
    """Loads on all walls: zero on those that are not there, NaN on those that are not measured."""
    if own is None:  # none that is measured is there
        blank = jnp.zeros(len(kept), state.velocity.dtype)
        sizes = (state.velocity.shape[1], state.angular_velocity.shape[1], 1, 1)
        own = WallLoads(*((blank,) * size for size in sizes))
    known = np.isin(np.arange(model.walls), model.measured)
    return WallLoads(
        *(tuple(jnp.where(known, _of_all(model.walls, kept, x), jnp.nan) for x in vector) for vector in own)
    )


def late_walls(model: ContactModel) -> tuple[int, ...]:
    """Numbers of the surfaces that come during a run."""
    times = model.wall_times
    return () if times is None else tuple(k for k, window in enumerate(times.windows) if window.begin > 0.0)


class Buried(NamedTuple):
    """Particles in walls that come.

    Attributes:
        found: (L, N) bool, particles that each of the L `late_walls` overlaps by more than the maximum as it comes.
        crowded: () bool, there was not room enough to look into all meshes; None without meshes that come.
    """

    found: Array
    crowded: Array | None = None


def buried(
    interval: ContactInterval,
    particles: ParticleState,
    neighbors: Neighbors,
    radius: Array,
    times_of: tuple[Array, Array],
    placed: tuple[Placement | None, ...] = (),
) -> Buried:
    """The particles that walls come upon in an interval.

    Args:
        interval: with walls that are there for a part of the time; static.
        particles: at the start of the interval.
        neighbors: their list, of which the meshes and the room for these count.
        radius: () or (N,) [m].
        times_of: middle and length of the interval, () each [s].
        placed: of each surface, and then each mesh, at the start of the interval; empty where all are at rest.
    """
    model = interval.model
    late, times = late_walls(model), model.wall_times
    if times is None or not late:
        return Buried(jnp.zeros((0, particles.position.shape[0]), bool))
    position = vectors.components(particles.position)
    low = split_low(particles.position_low, len(position))
    surfaces = tuple(k for k in late if k < len(model.surfaces))
    there = tuple(placed[k] for k in surfaces) if placed else ()
    overlap = jnp.zeros((0, len(position[0])), position[0].dtype)
    if surfaces:
        overlap, _ = surface_contacts(tuple(model.surfaces[k] for k in surfaces), position, low, radius, there)
    middle, duration = times_of
    begin = jnp.asarray([times.windows[k].begin for k in late], middle.dtype)[:, None]
    comes = (begin <= middle) & (begin > middle - duration)
    crowded = None
    if len(surfaces) < len(late):
        bodies = particles, radius
        within, crowded = _in_meshes(interval, bodies, neighbors, late[len(surfaces) :], comes, placed)
        overlap = jnp.concatenate([overlap, within])
    # Not "deeper": an overlap that is not a number counts too.
    limit = jnp.reshape(2.0 * times.maximum_overlap * radius, (1, -1))
    found = comes & ~(overlap <= limit)
    return Buried(found if particles.active is None else found & particles.active[None], crowded)


def _in_meshes(
    interval: ContactInterval,
    bodies: tuple[ParticleState, Array],
    neighbors: Neighbors,
    late: tuple[int, ...],
    comes: Array,
    placed: tuple[Placement | None, ...],
) -> tuple[Array, Array]:
    """(L, N) overlaps with the meshes among the late walls [m], looked for only as one comes, and whether there was
    not room enough; of particles and their radius."""
    (particles, radius), first = bodies, len(interval.model.surfaces)
    search = required(interval.search, "search").mesh_search
    position = vectors.components(particles.position)
    low = split_low(particles.position_low, len(position))

    def looked(_: tuple[Array, Array]) -> tuple[Array, Array]:
        rows, crowded = [], jnp.zeros((), bool)
        for number in late:
            own = neighbors.surfaces[number - first], neighbors.room.meshes[number - first]
            given = (position, low, radius)
            row, full = depth_in_mesh(search, *own, placed[number] if placed else None, given, particles.active)
            rows.append(row)
            crowded = crowded | full
        return jnp.stack(rows), crowded

    nothing = jnp.full((len(late), len(position[0])), -jnp.inf, position[0].dtype), jnp.zeros((), bool)
    return cond_in_batch(jnp.any(comes[-len(late) :]), looked, nothing)
