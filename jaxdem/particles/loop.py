"""Contact steps over one coupling interval, with the neighbour list kept in date."""

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
from jaxdem.numerics.blocks import any_of, total
from jaxdem.numerics.placement import Placement
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.clump_forces import clump_forces, displacement_ahead, updated
from jaxdem.particles.clumps import kicked, normalised, turned
from jaxdem.particles.contact_model import ContactModel
from jaxdem.particles.contact_step import Surroundings
from jaxdem.particles.contact_sums import WallLoads
from jaxdem.particles.energy import EnergyFlow, flow_of_step, no_flow, work_on_bodies
from jaxdem.particles.forces import contact_forces
from jaxdem.particles.ghosts import NEVER, Division
from jaxdem.particles.integrate import Motion, ParticleProperties, ParticleState, drift, kick
from jaxdem.particles.moving_walls import PistonState, pushed
from jaxdem.particles.neighbor_search import NeighborSearch
from jaxdem.particles.neighbors import (
    Neighbors,
    carry_history,
    carry_memory,
    out_of_date,
    way_of_meshes,
    with_radius,
)
from jaxdem.particles.slab_steps import (
    SlabCarry,
    ghosts_beside,
    own_rows,
    padded,
    padded_rows,
    rebuilt,
    refreshed,
    with_own_due,
)
from jaxdem.particles.wear import no_wear, with_wear


@static
class ContactInterval:
    """A coupling interval seen by the particles; static.

    Attributes:
        model: contact laws and walls.
        search: builder of the neighbour list; without one the list that is given serves for good.
        steps: number of contact steps.
        reversible: loops that reverse-mode differentiation can run backwards. Without it the loop skips
            what the interval does not need, and is faster; the numbers are the same.
        division: of a box that is cut into slabs; None on one device.
    """

    model: ContactModel
    search: NeighborSearch | None
    steps: int
    reversible: bool
    division: Division | None = None


class _Carry(NamedTuple):
    # The contact force itself, not the acceleration: XLA writes what a loop carries to memory once, and would
    # otherwise sum all contacts anew for everything that needs the sum.
    motion: Motion
    contact_force: Vector
    contact_impulse: Vector
    collision: Array
    step: Array
    walls: WallLoads | None
    slab: SlabCarry | None = None
    pistons: PistonState | None = None
    crowded: Array | None = None
    wear: tuple[Array | None, ...] = ()
    energy: EnergyFlow | None = None


class ContactMeans(NamedTuple):
    """Means over the contact steps of an interval.

    Attributes:
        collision_force: () over particles present and steps, of |sum of contact forces| [N].
        walls: force and torque on every wall, NaN where it is not measured; None where none is.
        energy: a sum and not a mean, what contacts and the given forces have given and taken, the latter under `fluid`;
            None where no balance is kept [J].
    """

    collision_force: Array
    walls: WallLoads | None
    energy: EnergyFlow | None = None


_Step = Callable[[_Carry, Neighbors], _Carry]


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
    if interval.division is None:
        return _advanced(interval, surroundings, properties, state, neighbors, body_force, time_step, body_torque)
    ghosts = required(neighbors.ghosts, "ghosts of a list")
    properties = ghosts_beside(interval.division, ghosts, properties)
    rows, load, turning = padded(ghosts, state), padded_rows(ghosts, body_force), body_torque
    if turning is not None:
        turning = padded_rows(ghosts, turning)
    rows, neighbors, means = _advanced(interval, surroundings, properties, rows, neighbors, load, time_step, turning)
    return own_rows(ghosts, rows, state), neighbors, means


def _advanced(
    interval: ContactInterval,
    surroundings: Surroundings,
    properties: ParticleProperties,
    state: ParticleState,
    neighbors: Neighbors,
    body_force: Array,
    time_step: Array,
    body_torque: Array | None,
) -> tuple[ParticleState, Neighbors, ContactMeans]:
    """See `contact_interval`; in a slab the rows are those of its particles and of the ghosts."""
    division = interval.division
    active, count = state.active, max(state.position.shape[0], 1)
    if active is not None:
        body_force = jnp.where(active[:, None], body_force, 0.0)
        body_torque = None if body_torque is None else jnp.where(active[:, None], body_torque, 0.0)
    force = vectors.components(body_force)
    turning = None if body_torque is None else vectors.components(body_torque)
    clumps = properties.clumps
    forces_of, pushed_by = (contact_forces, kick) if clumps is None else (clump_forces, kicked)

    def step(carry: _Carry, neighbors: Neighbors) -> _Carry:
        motion, slab = drift(carry.motion, 0.5 * time_step), carry.slab
        bodies = properties if slab is None else slab.properties
        if clumps is not None:
            motion = turned(motion, clumps, 0.5 * time_step, forwards=True)
        acceleration = vectors.scale(1.0 / bodies.mass, vectors.add(carry.contact_force, force))
        expected = vectors.add_scaled(motion.velocity, 0.5 * time_step, acceleration)
        if division is not None and slab is not None:
            motion, expected, slab = refreshed(division, neighbors, motion, expected, slab)
        pistons = None if carry.pistons is None else carry.pistons.drifted(0.5 * time_step)
        elapsed = (carry.step + 0.5) * time_step if interval.model.motions else carry.step
        around = surroundings.after(interval.model, elapsed, pistons)
        sums, motion = forces_of(interval.model, around, bodies, motion, neighbors, time_step, expected, active)
        acting = vectors.add(sums.force, force)
        torque = sums.torque if turning is None else vectors.add(sums.torque, turning)
        before, motion = motion, pushed_by(motion, acting, torque, bodies, time_step)
        energy = carry.energy
        if energy is not None:
            given = work_on_bodies(force, turning, before, motion, time_step)
            flow = flow_of_step(interval.model, sums.found, before, motion, time_step)
            energy = jax.tree.map(jnp.add, energy, flow._replace(fluid=given))
        impulse = vectors.add_scaled(carry.contact_impulse, time_step, sums.force)
        size = vectors.length(sums.force)
        if slab is not None and active is not None:
            size = jnp.where(active, size, 0.0)  # ghosts belong to another slab
        collision = carry.collision + jnp.sum(size)
        walls = jax.tree.map(jnp.add, carry.walls, sums.walls)
        motion, number = drift(motion, 0.5 * time_step), carry.step + 1
        if clumps is not None:
            motion = turned(motion, clumps, 0.5 * time_step, forwards=False)
        if pistons is not None:
            pistons = _pushed(interval, surroundings, pistons, elapsed, sums.walls, time_step)
        crowded = jax.tree.map(jnp.logical_or, carry.crowded, sums.crowded)
        wear = jax.tree.map(jnp.add, carry.wear, sums.wear)
        carry = _Carry(motion, sums.force, impulse, collision, number, walls, slab, pistons, crowded, wear, energy)
        return with_due(carry, neighbors)

    def with_due(carry: _Carry, neighbors: Neighbors) -> _Carry:
        if division is None or carry.slab is None:
            return carry
        way = way_of_meshes(neighbors, _meshes_placed(interval, surroundings, time_step, carry, division.hops + 1))
        given = neighbors, carry.motion, carry.slab, (carry.step, time_step), way
        return carry._replace(slab=with_own_due(division, interval.search, *given))

    zero = jnp.zeros_like(force[0])
    touching = zero if clumps is None else clumps.rows(zero, len(zero))
    carry = _Carry(
        Motion.of(state) if clumps is None else normalised(Motion.of(state)),
        vectors.components(state.contact_force),
        (zero,) * len(force),
        jnp.zeros((), zero.dtype),
        jnp.zeros((), jnp.int32),
        _no_loads(interval.model, touching, len(force)) if interval.model.measured else None,
        pistons=state.pistons,
        crowded=jnp.zeros((), bool) if interval.model.meshes else None,
        wear=no_wear(interval.model.worn_cells, zero.dtype) if interval.model.wears else (),
        energy=no_flow(zero) if interval.model.energy else None,
    )
    if division is not None:
        carry = with_due(carry._replace(slab=SlabCarry(jnp.full((), NEVER, jnp.int32), properties)), neighbors)
        slab = required(carry.slab, "carry of a slab")
        late = any_of(division.blocks, slab.due < NEVER)
        carry = carry._replace(slab=slab._replace(due=jnp.where(late, 0, jnp.int32(NEVER))))
    loop = _reversible_loop if interval.reversible else _fast_loop
    neighbors = with_radius(neighbors, properties.spheres(len(zero)).radius)
    carry, neighbors = loop(interval, surroundings, step, time_step, carry, neighbors, active)
    if carry.crowded is not None:
        neighbors = dataclasses.replace(neighbors, overflow=neighbors.overflow | carry.crowded)
    duration, blocks = interval.steps * time_step, None if division is None else division.blocks
    state = carry.motion.into(state)._replace(contact_force=vectors.stack(carry.contact_impulse) / duration)
    state = state._replace(pistons=carry.pistons)
    if carry.wear:
        numbers = tuple(mesh.number for mesh in interval.model.meshes)
        state = state._replace(mesh_wear=with_wear(state.mesh_wear, numbers, total(blocks, carry.wear)))
    present = count if active is None else jnp.maximum(total(blocks, jnp.sum(active)), 1)
    # Sums over the particles once an interval: in every contact step they would take a tenth of its time.
    loads = None if carry.walls is None else total(blocks, carry.walls.summed(interval.model))
    walls = jax.tree.map(lambda sum_: sum_ / interval.steps, loads)
    collision = total(blocks, carry.collision) / (interval.steps * present)
    return state, neighbors, ContactMeans(collision, walls, carry.energy)


def _no_loads(model: ContactModel, like: Array, dimension: int) -> WallLoads:
    """Of the measured walls and all particles, none of which touch; `like` is a number of each particle."""
    blank = jnp.zeros((len(model.measured), *like.shape), like.dtype)
    return WallLoads((blank,) * dimension, (blank,) * vectors.angular_size(dimension), (blank,), (blank,))


def _pushed(
    interval: ContactInterval,
    surroundings: Surroundings,
    state: PistonState,
    elapsed: Array,
    loads: WallLoads | None,
    time_step: Array,
) -> PistonState:
    """The pistons after a contact step, under the loads (M, N) of the particles on their surfaces."""
    model, division = interval.model, interval.division
    found, motions = required(loads, "loads on the walls"), required(surroundings.motions, "motions of the walls")
    on_walls = jnp.stack([jnp.sum(component, axis=1) for component in found.force], axis=1)
    on_walls = total(None if division is None else division.blocks, on_walls)
    rows = [[model.measured.index(wall) for wall in piston.walls] for piston in model.pistons]
    on_pistons = jnp.stack([jnp.sum(on_walls[np.asarray(row)], axis=0) for row in rows])
    return pushed(model.pistons, motions, state, elapsed, on_pistons, time_step).drifted(0.5 * time_step)


def _reversible_loop(
    interval: ContactInterval,
    around: Surroundings,
    step: _Step,
    time_step: Array,
    carry: _Carry,
    neighbors: Neighbors,
    active: Array | None,
) -> tuple[_Carry, Neighbors]:
    """A scan of fixed length."""

    @jax.checkpoint
    def checked_step(both: tuple[_Carry, Neighbors], _: None) -> tuple[tuple[_Carry, Neighbors], None]:
        carry, neighbors = _with_list_in_date(interval, around, time_step, *both, active)
        return (step(carry, neighbors), neighbors), None

    return lax.scan(checked_step, (carry, neighbors), None, length=interval.steps)[0]


def _fast_loop(
    interval: ContactInterval,
    around: Surroundings,
    step: _Step,
    time_step: Array,
    carry: _Carry,
    neighbors: Neighbors,
    active: Array | None,
) -> tuple[_Carry, Neighbors]:
    """Stretches of steps between rebuilds: within a stretch the list is constant and never copied."""

    def stretch(both: tuple[_Carry, Neighbors]) -> tuple[_Carry, Neighbors]:
        carry, neighbors = _with_list_in_date(interval, around, time_step, *both, active)

        # Whether the list covers the next step is found at the end of a step, beside its last drift: in the
        # condition of the loop the positions would be read again.
        def step_on(going: tuple[_Carry, Array]) -> tuple[_Carry, Array]:
            carry = step(going[0], neighbors)
            return carry, _stale(interval, around, time_step, carry, neighbors)

        carry, _ = lax.while_loop(
            lambda going: (going[0].step < interval.steps) & ~going[1],
            step_on,
            (carry, jnp.zeros((), bool)),
        )
        return carry, neighbors

    return lax.while_loop(lambda both: both[0].step < interval.steps, stretch, (carry, neighbors))


def _stale(
    interval: ContactInterval, around: Surroundings, time_step: Array, carry: _Carry, neighbors: Neighbors
) -> Array:
    """() bool: the list does not cover the coming step, up to its end."""
    # A list of nothing is never out of date: the loop would wait for it for ever.
    if interval.search is None or neighbors.lists_nothing:
        return jnp.zeros((), bool)
    if carry.slab is not None:
        return carry.step >= carry.slab.due
    displacement = displacement_ahead(interval.search, carry.motion, neighbors, time_step)
    way = way_of_meshes(neighbors, _meshes_placed(interval, around, time_step, carry))
    return out_of_date(displacement, interval.search.geometry, way)


def _meshes_placed(
    interval: ContactInterval, around: Surroundings, time_step: Array, carry: _Carry, steps: int = 1
) -> tuple[Placement | None, ...]:
    """Where each mesh is at the end of the coming steps, None for one at rest; empty where all are.

    Of a scene some of whose walls are not there yet, or not any more, also those.
    """
    model = interval.model
    if not any(model.motions[len(model.surfaces) :]):
        return ()
    ahead = time_step if steps == 1 else steps * time_step
    pistons = None if carry.pistons is None else carry.pistons.drifted(ahead)
    placed = around.after(model, (carry.step + steps) * time_step, pistons).placements[len(model.surfaces) :]
    found: list[Placement | None] = [None] * model.lists
    for mesh, one in zip(model.meshes, placed, strict=True):
        found[mesh.number] = one
    return tuple(found)


def _with_list_in_date(
    interval: ContactInterval,
    around: Surroundings,
    time_step: Array,
    carry: _Carry,
    neighbors: Neighbors,
    active: Array | None,
) -> tuple[_Carry, Neighbors]:
    """The list rebuilt if it is stale, and the springs moved to its slots."""

    search = interval.search
    if search is None or neighbors.lists_nothing:
        return carry, neighbors

    def rebuild(both: tuple[_Carry, Neighbors]) -> tuple[_Carry, Neighbors]:
        carry, neighbors = both
        # Where `_stale` looks: the new list is in date whatever the speed, and the loop goes on.
        motion = drift(carry.motion, time_step)
        placed, slab = _meshes_placed(interval, around, time_step, carry), carry.slab
        if interval.division is not None and slab is not None:
            new, springs, slab = rebuilt(interval.division, search, motion, neighbors, slab, placed)
        else:
            new = updated(search, motion, neighbors, active, placed)
            springs = carry_history(carry.motion.contact_spring, neighbors, new)
        motion = carry.motion._replace(contact_spring=springs)
        if neighbors.meshes:
            motion = motion._replace(mesh_memory=carry_memory(motion.mesh_memory, neighbors, new))
        return carry._replace(motion=motion, slab=slab), new

    stale = _stale(interval, around, time_step, carry, neighbors)
    return cond_in_batch(stale, rebuild, (carry, neighbors))
