"""One contact step of position Verlet, and what it hands to the next."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics import vectors
from jaxdem.numerics.blocks import any_of, total
from jaxdem.numerics.placement import Placement
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.clump_forces import clump_forces, on_bodies, touching_motion
from jaxdem.particles.clumps import kicked, normalised, turned
from jaxdem.particles.contact_interval import ContactInterval
from jaxdem.particles.contact_model import ContactModel
from jaxdem.particles.contact_step import ContactStep, PairSizes, Surroundings
from jaxdem.particles.contact_sums import Sums, WallLoads
from jaxdem.particles.energy import EnergyTally, heat_of_step, no_tally, with_step, work_by_contact, work_on_bodies
from jaxdem.particles.forces import contact_forces
from jaxdem.particles.ghosts import NEVER
from jaxdem.particles.integrate import Motion, ParticleProperties, ParticleState, drift, kick
from jaxdem.particles.moving_walls import PistonState, change_of_walls, pushed
from jaxdem.particles.neighbors import Neighbors, way_of_meshes
from jaxdem.particles.pair_forces import pair_sizes
from jaxdem.particles.slab_steps import SlabCarry, moved_ghosts, refreshed, with_own_due
from jaxdem.particles.stored_energy import spin_energies
from jaxdem.particles.wear import no_wear


class Carry(NamedTuple):
    """What a contact step hands to the next.

    Attributes:
        motion: of the particles or bodies.
        contact_force: D arrays (N,) of the step before [N]; itself and not the acceleration: XLA writes what a loop
            carries to memory once, and would otherwise sum all contacts anew for everything that needs the sum.
        contact_impulse: D arrays (N,) of the steps so far [N s].
        collision: () sum over particles and steps of |sum of contact forces| [N].
        step: () int32, contact steps done.
        walls: sum over the steps of what each particle does to the walls that are measured; None without.
        slab: of a box that is cut; None on one device.
        pistons: None without.
        crowded: () bool, a particle had more contacts with a mesh than there is room for; None without meshes.
        wear: volume taken from the triangles of each mesh that wears [m3].
        energy: what was given and taken, in a slab by what is counted there; None where no balance is kept [J].
        heat: (N,) what contacts took, see `heat_of_step`; None where it warms nothing [J].
    """

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
    energy: EnergyTally | None = None
    heat: Array | None = None


@dataclasses.dataclass(frozen=True)
class Verlet:
    """What the contact steps of an interval share; in a slab the rows are those of its particles and of the ghosts.

    Attributes:
        interval: static description.
        surroundings: material numbers and walls.
        properties: size and density.
        force: D arrays (N,) constant over the interval [N].
        torque: A arrays (N,) the same; None for none [N m].
        time_step: contact step [s].
        active: (N,) bool, particles that are present; None where all are.
    """

    interval: ContactInterval
    surroundings: Surroundings
    properties: ParticleProperties
    force: Vector
    torque: Vector | None
    time_step: Array
    active: Array | None

    def first(self, state: ParticleState, neighbors: Neighbors) -> Carry:
        """What the first step is handed."""
        model, clumps, division = self.interval.model, self.properties.clumps, self.interval.division
        zero = jnp.zeros_like(self.force[0])
        touching = zero if clumps is None else clumps.rows(zero, len(zero))
        carry = Carry(
            Motion.of(state) if clumps is None else normalised(Motion.of(state)),
            vectors.components(state.contact_force),
            (zero,) * len(self.force),
            jnp.zeros((), zero.dtype),
            jnp.zeros((), jnp.int32),
            _no_loads(model, touching, len(self.force)) if model.measured else None,
            pistons=state.pistons,
            crowded=jnp.zeros((), bool) if model.meshes else None,
            wear=no_wear(model.worn_cells, zero.dtype) if model.wears else (),
            energy=no_tally(model, zero, neighbors.room.pairs if neighbors.room.slots else 0, len(touching))
            if model.energy
            else None,
            heat=zero if model.heats else None,
        )
        if division is not None:
            blank = SlabCarry(jnp.full((), NEVER, jnp.int32), self.properties)
            carry = self._with_due(carry._replace(slab=blank), neighbors)
            slab = required(carry.slab, "carry of a slab")
            late = any_of(division.blocks, slab.due < NEVER)
            carry = carry._replace(slab=slab._replace(due=jnp.where(late, 0, jnp.int32(NEVER))))
        return carry

    def sizes_of_pairs(self, neighbors: Neighbors) -> PairSizes | None:
        """Of a list that stays for some steps; None where all particles are alike, and in a slab, whose ghosts change.

        Gathered in every step they took a third of its time.
        """
        bodies = self.properties
        if neighbors.room.slots == 0 or self.interval.division is not None:
            return None
        if bodies.clumps is None and bodies.radius.ndim == 0 and bodies.mass.ndim == 0:
            return None
        return pair_sizes(bodies.spheres(len(self.force[0])), neighbors.pairs)

    def step(self, carry: Carry, neighbors: Neighbors, sizes: PairSizes | None = None) -> Carry:
        """Half a drift, the contacts at the places between, the kick, and the other half; see `loop`.

        `sizes` are those of the pairs, gathered where they are None.
        """
        model, clumps, time_step = self.interval.model, self.properties.clumps, self.time_step
        (motion, expected, slab), energy = self._half_way(carry, neighbors)
        bodies = self.properties if carry.slab is None else carry.slab.properties
        pistons = None if carry.pistons is None else carry.pistons.drifted(0.5 * time_step)
        elapsed = (carry.step + 0.5) * time_step if model.motions else carry.step
        around = self.surroundings.after(model, elapsed, pistons)
        forces_of = contact_forces if clumps is None else clump_forces
        # The balance of energy looks at all contacts at once, and tiles are slower to run backwards.
        tiled = not (self.interval.reversible or model.energy)
        given = model, around, bodies, motion, expected, time_step, self.active
        now = ContactStep(*given, tiled=tiled, pair_sizes=sizes)
        sums, before = forces_of(now, neighbors)
        motion = self._kicked(sums, before, bodies)
        pushed_pistons = None if pistons is None else self._pushed(pistons, elapsed, sums.walls)
        held = None
        if pistons is not None and pushed_pistons is not None and energy is not None:
            held = change_of_walls(model.motions, len(model.sides), pistons, pushed_pistons)
        energy, heat = self._with_work((energy, carry.heat), sums, (before, motion), neighbors, held)
        impulse = vectors.add_scaled(carry.contact_impulse, time_step, sums.force)
        size = vectors.length(sums.force)
        if slab is not None and self.active is not None:
            size = jnp.where(self.active, size, 0.0)  # ghosts belong to another slab
        collision = carry.collision + jnp.sum(size)
        walls = jax.tree.map(jnp.add, carry.walls, sums.walls)
        motion, number = drift(motion, 0.5 * time_step), carry.step + 1
        if clumps is not None:
            motion, energy = self._turned(motion, bodies, False, energy)
        crowded = jax.tree.map(jnp.logical_or, carry.crowded, sums.crowded)
        wear = jax.tree.map(jnp.add, carry.wear, sums.wear)
        carry = Carry(
            motion, sums.force, impulse, collision, number, walls, slab, pushed_pistons, crowded, wear, energy, heat
        )
        return self._with_due(carry, neighbors)

    def meshes_placed(self, carry: Carry, steps: int = 1) -> tuple[Placement | None, ...]:
        """Where each mesh is at the end of the coming steps, None for one at rest; empty where all are.

        Of a scene some of whose walls are not there yet, or not any more, also those.
        """
        model = self.interval.model
        if not any(model.motions[len(model.surfaces) :]):
            return ()
        ahead = self.time_step if steps == 1 else steps * self.time_step
        pistons = None if carry.pistons is None else carry.pistons.drifted(ahead)
        elapsed = (carry.step + steps) * self.time_step
        placed = self.surroundings.after(model, elapsed, pistons).placements[len(model.surfaces) :]
        found: list[Placement | None] = [None] * model.lists
        for mesh, one in zip(model.meshes, placed, strict=True):
            found[mesh.number] = one
        return tuple(found)

    def _half_way(
        self, carry: Carry, neighbors: Neighbors
    ) -> tuple[tuple[Motion, Vector, SlabCarry | None], EnergyTally | None]:
        """Motion in the middle of the step, the velocity to expect there, and the slab with its ghosts there; and the
        balance of energy."""
        motion, slab = drift(carry.motion, 0.5 * self.time_step), carry.slab
        bodies, energy = self.properties if slab is None else slab.properties, carry.energy
        if bodies.clumps is not None:
            motion, energy = self._turned(motion, bodies, True, energy)
        acceleration = vectors.scale(1.0 / bodies.mass, vectors.add(carry.contact_force, self.force))
        expected = vectors.add_scaled(motion.velocity, 0.5 * self.time_step, acceleration)
        if self.interval.division is not None and slab is not None:
            motion, expected, slab = refreshed(self.interval.division, neighbors, motion, expected, slab)
        return (motion, expected, slab), energy

    def _turned(
        self, motion: Motion, bodies: ParticleProperties, forwards: bool, energy: EnergyTally | None
    ) -> tuple[Motion, EnergyTally | None]:
        """Clumps turned freely for half a step, and the energy that its error gives them."""
        after = turned(motion, bodies.rigid, 0.5 * self.time_step, forwards)
        if energy is None:
            return after, None
        gained = spin_energies(after, bodies) - spin_energies(motion, bodies)
        if self.interval.division is not None and self.active is not None:
            gained = jnp.where(self.active, gained, 0.0)  # ghosts belong to another slab
        return after, energy.with_parts(turning=jnp.sum(gained))

    def _kicked(self, sums: Sums, motion: Motion, bodies: ParticleProperties) -> Motion:
        """The motion after the impulses of a step."""
        acting = vectors.add(sums.force, self.force)
        torque = sums.torque if self.torque is None else vectors.add(sums.torque, self.torque)
        push = kick if self.properties.clumps is None else kicked
        return push(motion, acting, torque, bodies, self.time_step)

    def _with_work(
        self,
        so_far: tuple[EnergyTally | None, Array | None],
        sums: Sums,
        motions: tuple[Motion, Motion],
        neighbors: Neighbors,
        held: Array | None,
    ) -> tuple[EnergyTally | None, Array | None]:
        """Balance and heat with what contacts, bonds and given forces do in a step between two motions; None where none
        is kept. `held` is (S, D) by which the velocities of walls change that a force holds."""
        energy, heat = so_far
        if energy is None:
            return None, None
        given, clumps = work_on_bodies(self.force, self.torque, *motions, self.time_step), self.properties.clumps
        if self.interval.division is not None:
            motions = motions[0], moved_ghosts(self.interval.division, neighbors, motions[1])
        if clumps is not None:
            motions = touching_motion(clumps, neighbors, motions[0]), touching_motion(clumps, neighbors, motions[1])
        by_contact = work_by_contact(self.interval.model, sums, motions, self.time_step, held)
        energy = with_step(energy.with_parts(fluid=given), sums, by_contact, motions, self.time_step)
        if heat is not None:
            heat = heat + on_bodies(clumps, heat_of_step(sums, by_contact, motions, self.time_step))
        return energy, heat

    def _pushed(self, state: PistonState, elapsed: Array, loads: WallLoads | None) -> PistonState:
        """The pistons after a contact step, under the loads (M, N) of the particles on their surfaces."""
        model, division = self.interval.model, self.interval.division
        found = required(loads, "loads on the walls")
        motions = required(self.surroundings.motions, "motions of the walls")
        on_walls = jnp.stack([jnp.sum(component, axis=1) for component in found.force], axis=1)
        on_walls = total(None if division is None else division.blocks, on_walls)
        rows = [[model.measured.index(wall) for wall in piston.walls] for piston in model.pistons]
        on_pistons = jnp.stack([jnp.sum(on_walls[np.asarray(row)], axis=0) for row in rows])
        moved = pushed(model.pistons, motions, state, elapsed, on_pistons, self.time_step)
        return moved.drifted(0.5 * self.time_step)

    def _with_due(self, carry: Carry, neighbors: Neighbors) -> Carry:
        """In a slab, with the step before which its list has to be made anew."""
        division = self.interval.division
        if division is None or carry.slab is None:
            return carry
        way = way_of_meshes(neighbors, self.meshes_placed(carry, division.hops + 1))
        given = neighbors, carry.motion, carry.slab, (carry.step, self.time_step), way
        return carry._replace(slab=with_own_due(division, self.interval.search, *given))


def _no_loads(model: ContactModel, like: Array, dimension: int) -> WallLoads:
    """Of the measured walls and all particles, none of which touch; `like` is a number of each particle."""
    blank = jnp.zeros((len(model.measured), *like.shape), like.dtype)
    return WallLoads((blank,) * dimension, (blank,) * vectors.angular_size(dimension), (blank,), (blank,))
