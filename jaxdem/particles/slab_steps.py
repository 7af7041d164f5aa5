"""Contact steps of a slab: rows of ghosts beside its own, kept in date, and lists that all slabs build at once.

A list is in date until a particle of any slab has moved half the skin. That all slabs learn of it in time costs no
message of its own: with the ghosts travels the number of the step before which all build their lists, and a slab that
will need it sets it so many steps ahead as the number needs to reach all.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxdem.errors import required
from jaxdem.numerics import vectors
from jaxdem.numerics.compensated import Low
from jaxdem.numerics.placement import Placement
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.clumps import farthest_way
from jaxdem.particles.ghosts import NEVER, Division, Ghosts, exchanged
from jaxdem.particles.integrate import Motion, ParticleProperties, ParticleState
from jaxdem.particles.neighbor_search import NeighborSearch
from jaxdem.particles.neighbors import Neighbors, displacement_since_build
from jaxdem.particles.slab_bonds import noted, relisted
from jaxdem.particles.slab_history import history_of, of_pairs
from jaxdem.particles.slab_list import renewed_list
from jaxdem.particles.slab_rows import Sizes, Standing, rows_beside


class SlabCarry(NamedTuple):
    """What a slab carries from one contact step to the next, beside what one device does.

    Attributes:
        due: () int32, contact step before which all slabs build their lists, as far as this one knows.
        properties: size and density of all rows.
    """

    due: Array
    properties: ParticleProperties


def padded_rows(ghosts: Ghosts, rows: Array) -> Array:
    """(n, ...) of (R, ...), zeros for the ghosts."""
    return jnp.pad(rows, [(0, ghosts.identity.shape[0] - ghosts.rows), *[(0, 0)] * (rows.ndim - 1)])


def _walls_of_all(ghosts: Ghosts, spring: Array) -> Array:
    """(S, m n) springs at the walls of the rows of a list, of (S, m R)."""
    own = spring.reshape(len(spring) * ghosts.members, ghosts.rows)
    return padded_rows(ghosts, own.T).T.reshape(len(spring), ghosts.members * ghosts.identity.shape[0])


def _walls_of_own(ghosts: Ghosts, spring: Array) -> Array:
    """The inverse of `_walls_of_all`."""
    return ghosts.of_own(spring).reshape(len(spring), ghosts.members * ghosts.rows)


def padded(ghosts: Ghosts, state: ParticleState) -> ParticleState:
    """What contact steps read of a state, with rows for the ghosts; these meet no wall, the first step fills them."""

    def wider(rows: Array) -> Array:
        return padded_rows(ghosts, rows)

    bonds = state.bonds
    if bonds is not None:
        turned = jax.tree.map(wider, (bonds.orientation, bonds.orientation_low))
        bonds = bonds._replace(orientation=turned[0], orientation_low=turned[1])
    low, liquid, lying = jax.tree.map(wider, (state.position_low, state.liquid, _lying(state)))
    return state._replace(
        position=wider(state.position),
        position_low=low,
        liquid=liquid,
        velocity=wider(state.velocity),
        angular_velocity=wider(state.angular_velocity),
        orientation=lying[0],
        orientation_low=lying[1],
        wall_spring=tuple(_walls_of_all(ghosts, spring) for spring in state.wall_spring),
        contact_force=wider(state.contact_force),
        active=wider(required(state.active, "active of the particles")),
        bonds=bonds,
    )


def own_rows(ghosts: Ghosts, rows: ParticleState, before: ParticleState) -> ParticleState:
    """The state of a slab after contact steps; the inverse of `padded`."""
    count, bonds = ghosts.rows, rows.bonds
    low, liquid, lying = jax.tree.map(lambda x: x[:count], (rows.position_low, rows.liquid, _lying(rows)))
    if bonds is not None:
        turned = jax.tree.map(lambda x: x[:count], (bonds.orientation, bonds.orientation_low))
        bonds = noted(bonds)._replace(orientation=turned[0], orientation_low=turned[1])
    return before._replace(
        position=rows.position[:count],
        position_low=low,
        liquid=liquid,
        velocity=rows.velocity[:count],
        angular_velocity=rows.angular_velocity[:count],
        orientation=lying[0],
        orientation_low=lying[1],
        contact_spring=rows.contact_spring,
        wall_spring=tuple(_walls_of_own(ghosts, spring) for spring in rows.wall_spring),
        contact_force=rows.contact_force[:count],
        pistons=rows.pistons,
        mesh_memory=rows.mesh_memory,
        mesh_wear=rows.mesh_wear,
        bonds=bonds,
    )


def _lying(state: ParticleState) -> tuple[Array | None, Low]:
    """How clumps lie."""
    return state.orientation, state.orientation_low


def ghosts_beside(division: Division, ghosts: Ghosts, properties: ParticleProperties) -> ParticleProperties:
    """The properties with those of the ghosts, (n,) of (R,) or of another list's (n,); of equal particles unchanged."""
    both = rows_beside(division.blocks, ghosts, properties._replace(identity=None))
    return both._replace(identity=ghosts.identity)


def seen_in_slab(
    division: Division, neighbors: Neighbors, properties: ParticleProperties, state: ParticleState
) -> tuple[ParticleProperties, ParticleState]:
    """Bodies and state (R,) of a slab with those of the ghosts behind them, (n,), as the pairs of the list need them.

    Of a ghost position, velocity, spin and how it lies are filled in; it is not active.
    """
    ghosts = required(neighbors.ghosts, "ghosts of a list")
    rows, bodies = padded(ghosts, state), ghosts_beside(division, ghosts, properties)
    motion, carry = Motion.of(rows), SlabCarry(jnp.full((), NEVER, jnp.int32), bodies)
    motion, _, _ = refreshed(division, neighbors, motion, motion.velocity, carry)
    return bodies, motion.into(rows)._replace(identity=ghosts.identity)


def refreshed(
    division: Division, neighbors: Neighbors, motion: Motion, expected: Vector, slab: SlabCarry
) -> tuple[Motion, Vector, SlabCarry]:
    """Motion and expected velocity (n,) with what the neighbours have of the ghosts, and when they build lists.

    A bridge of liquid across a border takes from the films of both grains, which both slabs know as they are now.
    """
    ghosts = required(neighbors.ghosts, "ghosts of a list")
    low = () if motion.low[0] is None else tuple(x for x in motion.low if x is not None)
    film: Vector = () if motion.liquid is None else (motion.liquid,)
    bonds = motion.bonds
    turned: Vector = () if bonds is None else bonds.orientation
    turned_low: Vector = () if bonds is None else tuple(x for x in bonds.orientation_low if x is not None)
    lying_low = tuple(x for x in motion.orientation_low if x is not None)
    parts = (
        motion.position, motion.velocity, motion.angular_velocity, expected, low, film, turned, turned_low,
        motion.orientation, lying_low,
    )  # fmt: skip
    flat = tuple(x for part in parts for x in part)
    new, due = exchanged(division.blocks, ghosts, flat, slab.due)
    filled = iter([x.at[ghosts.rows :].set(values) for x, values in zip(flat, new, strict=True)])
    position, velocity, spin, expected, low, film, *turning, lying, lying_low = (
        tuple(next(filled) for _ in part) for part in parts
    )
    if film:
        motion = motion._replace(liquid=film[0])
    if bonds is not None:
        lows = turning[1] or bonds.orientation_low
        motion = motion._replace(bonds=bonds._replace(orientation=turning[0], orientation_low=lows))
    motion = motion._replace(position=position, velocity=velocity, angular_velocity=spin, low=low or motion.low)
    motion = motion._replace(orientation=lying, orientation_low=lying_low or motion.orientation_low)
    return motion, expected, slab._replace(due=due)


def moved_ghosts(division: Division, neighbors: Neighbors, motion: Motion) -> Motion:
    """The motion (n,) after a step with the velocities and spins that the ghosts have got from all of their contacts.

    A slab knows only some of these; the balance of energy needs what comes of all.
    """
    ghosts, count = required(neighbors.ghosts, "ghosts of a list"), len(motion.velocity)
    both = (*motion.velocity, *motion.angular_velocity)
    new, _ = exchanged(division.blocks, ghosts, both, None)
    filled = tuple(x.at[ghosts.rows :].set(values) for x, values in zip(both, new, strict=True))
    return motion._replace(velocity=filled[:count], angular_velocity=filled[count:])


def with_own_due(
    division: Division,
    search: NeighborSearch | None,
    neighbors: Neighbors,
    motion: Motion,
    slab: SlabCarry,
    now: tuple[Array, Array],
    way: Array | float = 0.0,
) -> SlabCarry:
    """The carry with the step before which this slab needs another list, which its neighbours learn in the next step.

    What is to come is bounded by the fastest particle, of clumps with the turn of each: in the steps until all know of
    it, and the one after.

    Args:
        division, search, neighbors: of the slab.
        motion: after a step.
        slab: with what is known so far.
        now: () int32, contact steps done; and () contact step [s].
        way: how far a point of a mesh will have moved since the list was built, in that time [m].
    """
    if search is None:
        return slab
    ghosts, (step, time_step) = required(neighbors.ghosts, "ghosts of a list"), now
    motion = lax.stop_gradient(motion)

    def largest(vector: Vector) -> Array:
        squared = vectors.dot(vector, vector)[: ghosts.rows]
        return jnp.sqrt(jnp.max(jnp.where(ghosts.own, squared, 0.0), initial=0.0))

    coming = (division.hops + 1) * time_step
    if neighbors.bodies is None:
        moved = largest(displacement_since_build(motion.position, motion.low, neighbors))
    else:
        moved = largest((farthest_way(neighbors.bodies, motion, coming),))
    most = moved + coming * largest(motion.velocity)
    if not isinstance(way, float):
        most = most + way
    needed = most > 0.5 * search.geometry.skin
    return slab._replace(due=jnp.minimum(slab.due, jnp.where(needed, step + division.hops, jnp.int32(NEVER))))


def rebuilt(
    division: Division,
    search: NeighborSearch,
    motion: Motion,
    neighbors: Neighbors,
    slab: SlabCarry,
    placed: tuple[Placement | None, ...] = (),
) -> tuple[Neighbors, Motion, SlabCarry]:
    """A list at this motion, the motion with the springs of its pairs and the bonds of its rows, and the carry with the
    properties of the new ghosts.

    `placed` is where each mesh is then, None for one at rest; empty where all are.
    """
    ghosts = required(neighbors.ghosts, "ghosts of a list")
    standing = Standing.of(motion, Sizes.of(slab.properties), ghosts.rows)
    new = renewed_list(search, division, standing, neighbors, ghosts, placed)
    bonds = None if motion.bonds is None else noted(motion.bonds)
    new, bonds = relisted(division.blocks, new, bonds)
    ghosts = required(new.ghosts, "ghosts of a list")
    springs = of_pairs(division.blocks, history_of(motion.contact_spring, neighbors), ghosts, new.pairs)
    properties = ghosts_beside(division, ghosts, slab.properties)
    motion = motion._replace(contact_spring=springs, bonds=bonds)
    return new, motion, SlabCarry(jnp.full((), NEVER, jnp.int32), properties)
