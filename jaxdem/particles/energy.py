"""The balance of energy of the particles: what contacts, bonds and other forces give and take in a step.

A step changes the velocity by F dt/m at a fixed position, and the position by the mean of the velocities before and
after. So the work of a force over the step is F dt times that mean velocity, exactly, for every contact and for every
particle: what the contacts take is summed with it, and the kinetic energy has changed by the sum to rounding. What is
not exact is what springs store: at the end of a step that is an integral over the overlap, and the force has acted at
the overlap in its middle. The difference is of the second order in the step and is told apart, see `conservative`.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics import vectors
from jaxdem.numerics.vectors import Vector
from jaxdem.particles import tangent
from jaxdem.particles.bond_geometry import in_space, spin_in_space
from jaxdem.particles.cohesion_energy import energy_lost
from jaxdem.particles.contact_load import gap_of
from jaxdem.particles.contact_model import ContactModel
from jaxdem.particles.contact_sums import FoundBonds, FoundContacts, Sums
from jaxdem.particles.integrate import Motion, ParticleProperties, ParticleState
from jaxdem.particles.pairs import at, sum_over_pairs
from jaxdem.particles.stored_energy import StoredEnergy


class EnergyFlow(NamedTuple):
    """What contacts and other forces give and take over some steps, each () [J].

    Attributes:
        walls: work of moving walls on the particles.
        fluid: of the forces of the fluid.
        population: energy of the particles that have come less that of those that have left.
        wall_changes: of the contacts with walls that come less that of those with walls that go, along their normals.
        gravity: work of gravity; the potential energy falls by it where gravity does not change with time.
        damping: taken by the dashpots along the normal.
        liquid: by the liquid of bridges and in gaps.
        adhesion: lost where cohesion begins or ends at once.
        tangential: by the tangential forces, what they store included.
        tangential_damping: by the dashpots among these.
        rolling: by the torques against rolling, what they store included.
        bond_damping: by the dashpots of bonds.
        breaking: lost with bonds that break.
        conservative: given by the forces along the normal, and of bonds, that have a potential.
        turning: given to clumps by the error of the step in their free rotation.
        carried_normal: of `population` and `wall_changes`, what goes with springs along the normal, surfaces and bonds.
        carried_tangential: of `population`, what goes with tangential springs.
        carried_rolling: the same of rolling springs.
    """

    walls: Array
    fluid: Array
    population: Array
    wall_changes: Array
    gravity: Array
    damping: Array
    liquid: Array
    adhesion: Array
    tangential: Array
    tangential_damping: Array
    rolling: Array
    bond_damping: Array
    breaking: Array
    conservative: Array
    turning: Array
    carried_normal: Array
    carried_tangential: Array
    carried_rolling: Array


def no_flow(like: Array) -> EnergyFlow:
    """Zeros of a type."""
    return EnergyFlow(*(jnp.zeros((), like.dtype) for _ in EnergyFlow._fields))


def flow_by_contact(
    model: ContactModel, sums: Sums, before: Motion, after: Motion, time_step: Array, pistons: Array | None = None
) -> tuple[EnergyFlow, ...]:
    """What the contacts of a step give and take, arrays of the shape of each kind of contacts.

    Args:
        model: laws; static.
        sums: with its contacts and bonds one by one.
        before, after: the velocities of what touches at its start and end.
        time_step: [s].
        pistons: (S, D) by which the velocity of each wall that a force holds changes in the step; None without
            [m/s].
    """
    found = []
    for contacts in sums.found:
        wall = None if pistons is None or not contacts.walls else pistons[np.asarray(contacts.walls)]
        found.append(_of_contacts(model, contacts, before, after, time_step, wall))
    return tuple(found)


def flow_of_step(
    sums: Sums, by_contact: tuple[EnergyFlow, ...], before: Motion, after: Motion, time_step: Array
) -> EnergyFlow:
    """What the contacts and bonds of a step give and take.

    Args:
        sums: with its bonds.
        by_contact: see `flow_by_contact`.
        before, after, time_step: see there.
    """
    flow = no_flow(time_step)
    for contacts, own in zip(sums.found, by_contact, strict=True):
        if contacts.counted is not None:
            own = jax.tree.map(lambda parts, counted=contacts.counted: jnp.where(counted, parts, 0.0), own)
        flow = jax.tree.map(lambda total, parts: total + jnp.sum(parts), flow, own)
    return flow if sums.bonded is None else _with_bonds(flow, sums.bonded, before, after, time_step)


def heat_of_step(
    sums: Sums, by_contact: tuple[EnergyFlow, ...], before: Motion, after: Motion, time_step: Array
) -> Array:
    """(N,) what contacts and bonds take in a step, by what touches and is to be warmed: half of each, and all of a
    wall's [J]. What tangential and rolling springs store is counted as taken, see `stored_energy.strained`.

    Two equal bodies share the heat of their contact by symmetry; others would by their effusivities, which are alike
    for grains of one material: J. C. Jaeger, Proc. R. Soc. N. S. W. 76 (1942) 203-224.
    """
    total = jnp.zeros_like(before.velocity[0])
    for contacts, flow in zip(sums.found, by_contact, strict=True):
        taken = flow.damping + flow.liquid + flow.adhesion + flow.tangential + flow.rolling
        total = total + contacts.onto(taken if contacts.of_other is None else 0.5 * taken)
    if sums.bonded is not None:
        _, taken, lost = _of_bonds(sums.bonded, before, after, time_step)
        half = 0.5 * (taken + lost)
        total = total + sum_over_pairs(half, half, sums.bonded.pairs)
    return total


def _of_contacts(
    model: ContactModel, found: FoundContacts, before: Motion, after: Motion, time_step: Array, wall: Array | None
) -> EnergyFlow:
    """The same of every contact, arrays of their shape; `wall` as `pistons`, of the rows of the contacts."""
    pair, load, normal = found.pair, found.load, found.pair.normal
    parts = required(load.parts, "parts of the load")
    half, half_spin = (
        vectors.scale(0.5, vectors.subtract(getattr(after, name), getattr(before, name)))
        for name in ("velocity", "angular_velocity")
    )
    # Of the mean velocities over the step; those of most walls are what they are in its middle.
    velocity, half_of_wall = vectors.add(pair.velocity, found.of_one(half)), None
    if wall is not None:
        half_of_wall = tuple(0.5 * wall[:, k, None] for k in range(wall.shape[1]))
        velocity = vectors.subtract(velocity, half_of_wall)
    spin = vectors.add(pair.spin, found.of_one(half_spin))
    turning = vectors.scale(pair.radius - 0.5 * pair.overlap, spin)
    relative_spin = spin
    if pair.other_spin is not None and found.of_other is not None:
        velocity = vectors.subtract(velocity, found.of_other(half))
        other = vectors.add(pair.other_spin, found.of_other(half_spin))
        turning = vectors.add(turning, vectors.scale(pair.other_radius - 0.5 * pair.overlap, other))
        relative_spin = vectors.subtract(spin, other)
    elif pair.wall_spin is not None:
        relative_spin = vectors.subtract(spin, pair.wall_spin)
    approach = -vectors.dot(velocity, normal)
    slip = vectors.subtract(tangent.part_in_plane(velocity, normal), tangent.surface_velocity(turning, normal))
    rolling = vectors.dot(load.resistance, relative_spin) if load.resistance else jnp.zeros_like(approach)
    walls = jnp.zeros_like(approach)
    if pair.other_spin is None:
        walls = _power_of_wall(found, before, half_of_wall)
    conservative = load.along - parts.dashpot - parts.liquid
    power = no_flow(approach)._replace(
        walls=walls,
        damping=parts.dashpot * approach,
        liquid=parts.liquid * approach,
        tangential=-vectors.dot(load.across, slip),
        tangential_damping=-vectors.dot(parts.across, slip),
        rolling=-rolling,
        conservative=-conservative * approach,
    )  # fmt: skip
    work: EnergyFlow = jax.tree.map(lambda x: time_step * x, power)
    if found.memory and model.cohesion is not None:
        ((earlier, later),) = found.memory
        closing = 2.0 * approach + vectors.dot(pair.velocity, normal)
        gap = gap_of(pair, found.material)._replace(overlap=pair.overlap + 0.5 * time_step * closing)
        constants = required(found.material.cohesion, "cohesion")
        work = work._replace(adhesion=energy_lost(model.cohesion, gap, constants, earlier, later))
    there = found.there
    return work if there is None else jax.tree.map(lambda x: jnp.where(there, x, 0.0), work)


def _power_of_wall(found: FoundContacts, before: Motion, half: Vector | None) -> Array:
    """Power of a wall's forces on the particles, at the wall's velocity, which changes by twice `half` [W]."""
    pair, load = found.pair, found.load
    wall = vectors.subtract(found.of_one(before.velocity), pair.velocity)
    if half is not None:
        wall = vectors.add(wall, half)
    force = vectors.add_scaled(tangent.in_space(load.across, pair.normal), load.along, pair.normal)
    power = vectors.dot(force, wall)
    if load.resistance and pair.wall_spin is not None:
        power = power + vectors.dot(load.resistance, pair.wall_spin)
    return power


def _with_bonds(flow: EnergyFlow, found: FoundBonds, before: Motion, after: Motion, time_step: Array) -> EnergyFlow:
    """The flow with that of the bonds."""
    given, taken, lost = _of_bonds(found, before, after, time_step)
    if found.counted is not None:
        given, taken, lost = (jnp.where(found.counted, part, 0.0) for part in (given, taken, lost))
    return flow._replace(
        conservative=flow.conservative + jnp.sum(given),
        bond_damping=flow.bond_damping + jnp.sum(taken),
        breaking=flow.breaking + jnp.sum(lost),
    )


def _of_bonds(found: FoundBonds, before: Motion, after: Motion, time_step: Array) -> tuple[Array, Array, Array]:
    """(B,) each: given by the springs of bonds, taken by their dashpots, and lost with those that break [J].

    A bond that breaks gives no force in the step, so it takes with it what it stored at the start of the step.
    """
    pairs, half = found.pairs, 0.5 * time_step

    def power(load: tuple[Vector, Vector, Vector], velocity: Vector, spin: Vector) -> Array:
        apart = in_space(vectors.subtract(at(velocity, pairs.first), at(velocity, pairs.second)))
        one, other = (spin_in_space(at(spin, index)) for index in (pairs.first, pairs.second))
        return vectors.dot(load[0], apart) + vectors.dot(load[1], one) + vectors.dot(load[2], other)

    start = before.velocity, before.angular_velocity
    twice = vectors.add(start[0], after.velocity), vectors.add(start[1], after.angular_velocity)
    given = jnp.where(found.holds, half * power(found.elastic, *twice), 0.0)
    stored = found.energy + half * power(found.elastic, *start)
    taken = jnp.zeros_like(given)
    if found.dashpots is not None:
        taken = jnp.where(found.holds, -half * power(found.dashpots, *twice), 0.0)
    return given, taken, jnp.where(found.broken, stored, 0.0)


def carried(flow: EnergyFlow, kind: str, before: StoredEnergy, after: StoredEnergy) -> EnergyFlow:
    """The flow with what has come and gone beside all forces.

    Args:
        flow: so far.
        kind: `population` or `wall_changes`.
        before, after: what is stored before and after; all of it for the population, for walls what is along the
            normal: what tangential and rolling springs lose with a wall counts as sliding and rolling.
    """
    change: StoredEnergy = jax.tree.map(jnp.subtract, after, before)
    along = change.normal + change.surface + change.bonds
    flow = flow._replace(carried_normal=flow.carried_normal + along)
    if kind == "wall_changes":
        return flow._replace(wall_changes=flow.wall_changes + along)
    return flow._replace(
        population=flow.population + change.total,
        carried_tangential=flow.carried_tangential + change.tangential,
        carried_rolling=flow.carried_rolling + change.rolling,
    )


def work_on_bodies(force: Vector, torque: Vector | None, before: Motion, after: Motion, time_step: Array) -> Array:
    """() work over a step of forces (N,) and torques on the particles, at the mean velocities [J]."""
    work = vectors.dot(force, vectors.add(before.velocity, after.velocity))
    if torque is not None:
        work = work + vectors.dot(torque, vectors.add(before.angular_velocity, after.angular_velocity))
    return 0.5 * time_step * jnp.sum(work)


def flow_of_interval(
    flow: EnergyFlow,
    properties: ParticleProperties,
    moved: ParticleProperties,
    gravity: Array,
    before: ParticleState,
    after: ParticleState,
) -> EnergyFlow:
    """The flow of an interval with what the forces of the fluid have done, of what all given forces have done.

    Args:
        flow: of the contact steps; `fluid` is the work of all given forces.
        properties: of the particles.
        moved: the same with the fluid that moves along, whose kinetic energy is not the particles'.
        gravity: (D,) [m/s2].
        before, after: the particles.
    """
    change = after.position - before.position
    if after.position_low is not None and before.position_low is not None:
        change = change + (after.position_low - before.position_low)
    there = jnp.ones(change.shape[0], bool) if before.active is None else before.active
    work = jnp.sum(jnp.where(there, properties.mass * jnp.sum(gravity[None] * change, axis=1), 0.0))
    gained = 0.5 * jnp.sum(after.velocity**2 - before.velocity**2, axis=1)
    along = jnp.sum(jnp.where(there, (moved.mass - properties.mass) * gained, 0.0))
    return flow._replace(fluid=flow.fluid - work - along, gravity=work)
