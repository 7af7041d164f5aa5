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

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxdem.numerics import vectors
from jaxdem.numerics.placement import Placement
from jaxdem.particles.contact_model import ContactModel
from jaxdem.particles.contact_step import Surroundings
from jaxdem.particles.contact_sums import WallLoads
from jaxdem.particles.integrate import ParticleState, split_low
from jaxdem.particles.loop import ContactInterval, ContactMeans
from jaxdem.particles.mesh_contact import MeshMemory
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


def buried(
    model: ContactModel,
    particles: ParticleState,
    radius: Array,
    middle: Array,
    interval: Array,
    placed: tuple[Placement | None, ...] = (),
) -> Array:
    """(L, N) bool, particles that each of the L `late_walls` overlaps by more than the maximum as it comes.

    Args:
        model: with walls that are there for a part of the time; static.
        particles: at the start of the interval.
        radius: () or (N,) [m].
        middle: () of the interval [s].
        interval: () its length [s].
        placed: of each surface at the start of the interval; empty where all are at rest.
    """
    late, times = late_walls(model), model.wall_times
    if times is None or not late:
        return jnp.zeros((0, particles.position.shape[0]), bool)
    position = vectors.components(particles.position)
    low = split_low(particles.position_low, len(position))
    there = tuple(placed[k] for k in late) if placed else ()
    overlap, _ = surface_contacts(tuple(model.surfaces[k] for k in late), position, low, radius, there)
    begin = jnp.asarray([times.windows[k].begin for k in late], middle.dtype)[:, None]
    comes = (begin <= middle) & (begin > middle - interval)
    # Not "deeper": an overlap that is not a number counts too.
    limit = jnp.reshape(2.0 * times.maximum_overlap * radius, (1, -1))
    found = comes & ~(overlap <= limit)
    return found if particles.active is None else found & particles.active[None]
