"""Contact steps over one coupling interval, with the neighbour list kept in date."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxdem.errors import required
from jaxdem.numerics import vectors
from jaxdem.numerics.blocks import total
from jaxdem.particles.contact_interval import ContactInterval, ContactMeans
from jaxdem.particles.contact_step import Surroundings
from jaxdem.particles.integrate import ParticleProperties, ParticleState
from jaxdem.particles.list_in_date import stale, with_list_in_date
from jaxdem.particles.neighbors import Neighbors, with_radius
from jaxdem.particles.slab_steps import ghosts_beside, own_rows, padded, padded_rows
from jaxdem.particles.verlet import Carry, Verlet
from jaxdem.particles.wear import with_wear


def contact_interval(
    interval: ContactInterval,
    surroundings: Surroundings,
    properties: ParticleProperties,
    state: ParticleState,
    neighbors: Neighbors,
    body_force: Array,
    time_step: Array,
    body_torque: Array | None = None,
) -> tuple[ParticleState, Neighbors, ContactMeans]:
    """Particles moved through `interval.steps` contact steps of position Verlet.

    x += v dt/2;  F(x, v');  v += F dt/m;  x += v dt/2. Symplectic and of second order for forces without
    damping. The dashpots act on v' = v + a dt/2, the velocity to expect in the middle of the step, with
    the acceleration a of the step before; that makes restitution second order too (with v for v' the rebound is
    1 % off at a hundred steps per contact, e = 0.5). The spin in the tangential ones is that at the start of the step:
    one to expect would shorten the stable step of rough packs, by half at e = 0.2. An interval starts from the state's
    mean contact force: exact at rest and in free flight, and elsewhere one step in many is of first order.

    Args:
        interval: static description.
        surroundings: material numbers.
        properties: size and density.
        state: at the start of the interval.
        neighbors: list that `state.contact_spring` belongs to.
        body_force: (N, D) constant over the interval: gravity and fluid forces [N].
        time_step: contact step [s].
        body_torque: (N, A) constant over the interval, None for none [N m].

    Returns:
        state at the end, with `contact_force` the mean over the interval; the list; and other means.
    """
    rows, load, turning = state, body_force, body_torque
    if interval.division is not None:
        ghosts = required(neighbors.ghosts, "ghosts of a list")
        properties = ghosts_beside(interval.division, ghosts, properties)
        rows, load = padded(ghosts, state), padded_rows(ghosts, body_force)
        turning = None if body_torque is None else padded_rows(ghosts, body_torque)
    if rows.active is not None:
        load = jnp.where(rows.active[:, None], load, 0.0)
        turning = None if turning is None else jnp.where(rows.active[:, None], turning, 0.0)
    force, torque = vectors.components(load), None if turning is None else vectors.components(turning)
    verlet = Verlet(interval, surroundings, properties, force, torque, time_step, rows.active)
    carry = verlet.first(rows, neighbors)
    neighbors = with_radius(neighbors, properties.spheres(len(rows.position)).radius)
    loop = _reversible_loop if interval.reversible else _fast_loop
    carry, neighbors = loop(verlet, carry, neighbors)
    rows, neighbors, means = _at_end(verlet, rows, carry, neighbors)
    if interval.division is None:
        return rows, neighbors, means
    if means.heat is not None:
        means = means._replace(heat=means.heat[: ghosts.rows])
    return own_rows(ghosts, rows, state), neighbors, means


def _at_end(
    verlet: Verlet, state: ParticleState, carry: Carry, neighbors: Neighbors
) -> tuple[ParticleState, Neighbors, ContactMeans]:
    """State, list and means after the last step; `state` is that before the first one."""
    interval, active = verlet.interval, verlet.active
    count, model = max(state.position.shape[0], 1), interval.model
    if carry.crowded is not None:
        neighbors = dataclasses.replace(neighbors, overflow=neighbors.overflow | carry.crowded)
    duration, blocks = (
        interval.steps * verlet.time_step,
        None if interval.division is None else interval.division.blocks,
    )
    state = carry.motion.into(state)._replace(contact_force=vectors.stack(carry.contact_impulse) / duration)
    state = state._replace(pistons=carry.pistons)
    if carry.wear:
        numbers = tuple(mesh.number for mesh in model.meshes)
        state = state._replace(mesh_wear=with_wear(state.mesh_wear, numbers, total(blocks, carry.wear)))
    present = count if active is None else jnp.maximum(total(blocks, jnp.sum(active)), 1)
    # Sums over the particles once an interval: in every contact step they would take a tenth of its time.
    loads = None if carry.walls is None else total(blocks, carry.walls.summed(model))
    walls = jax.tree.map(lambda sum_: sum_ / interval.steps, loads)
    collision = total(blocks, carry.collision) / (interval.steps * present)
    energy = None if carry.energy is None else carry.energy.summed()
    return state, neighbors, ContactMeans(collision, walls, energy, carry.heat)


def _reversible_loop(verlet: Verlet, carry: Carry, neighbors: Neighbors) -> tuple[Carry, Neighbors]:
    """A scan of fixed length."""

    @jax.checkpoint
    def checked_step(both: tuple[Carry, Neighbors], _: None) -> tuple[tuple[Carry, Neighbors], None]:
        carry, neighbors = with_list_in_date(verlet, *both)
        return (verlet.step(carry, neighbors), neighbors), None

    return lax.scan(checked_step, (carry, neighbors), None, length=verlet.interval.steps)[0]


def _fast_loop(verlet: Verlet, carry: Carry, neighbors: Neighbors) -> tuple[Carry, Neighbors]:
    """Stretches of steps between rebuilds: within a stretch the list is constant and never copied."""
    steps = verlet.interval.steps

    def stretch(both: tuple[Carry, Neighbors]) -> tuple[Carry, Neighbors]:
        carry, neighbors = with_list_in_date(verlet, *both)
        sizes = verlet.sizes_of_pairs(neighbors)

        # Whether the list covers the next step is found at the end of a step, beside its last drift: in the
        # condition of the loop the positions would be read again.
        def step_on(going: tuple[Carry, Array]) -> tuple[Carry, Array]:
            carry = verlet.step(going[0], neighbors, sizes)
            return carry, stale(verlet, carry, neighbors)

        carry, _ = lax.while_loop(
            lambda going: (going[0].step < steps) & ~going[1], step_on, (carry, jnp.zeros((), bool))
        )
        return carry, neighbors

    return lax.while_loop(lambda both: both[0].step < steps, stretch, (carry, neighbors))
