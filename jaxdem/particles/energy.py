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

from jaxdem.numerics import vectors
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.bond_geometry import in_space, spin_in_space
from jaxdem.particles.contact_model import ContactModel
from jaxdem.particles.contact_pair import sum_slots
from jaxdem.particles.contact_sums import FoundBonds, Sums
from jaxdem.particles.contact_work import ContactWork, work_of_contacts
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


class EnergyTally(NamedTuple):
    """The balance while the steps of an interval go on.

    Attributes:
        flow: what is summed already.
        contacts: of those between particles, (P,) pair by pair, and of those with walls that have a formula, (N,) body
            by body, as far as there are any: a sum over all in every step would cost more than what is summed.
    """

    flow: EnergyFlow
    contacts: tuple[ContactWork, ...]

    def with_parts(self, **parts: Array) -> EnergyTally:
        """With so much more of these parts of the flow [J]."""
        return self._replace(flow=_with_parts(self.flow, parts))

    def summed(self) -> EnergyFlow:
        """What all steps have given and taken."""
        flow = self.flow
        for work in self.contacts:
            flow = _with_sum(flow, work)
        return flow


def no_tally(model: ContactModel, like: Array, pairs: int, touching: int) -> EnergyTally:
    """The balance before the first step.

    Args:
        model: laws; static.
        like: of the type of numbers.
        pairs: P, room of the list; 0 where nothing is listed.
        touching: number of bodies that touch, of clumps their members.
    """

    def blank(count: int, of_walls: bool) -> ContactWork:
        def where(there: bool) -> Array | None:
            return jnp.zeros(count, like.dtype) if there else None

        always = jnp.zeros(count, like.dtype)
        liquid = model.cohesion is not None or model.lubrication is not None
        return ContactWork(
            always, always, always, always,
            where(of_walls), where(liquid), where(model.memory > 0), where(model.rolling is not None),
        )  # fmt: skip

    found = [blank(pairs, False)] if pairs else []
    if model.analytic_walls:
        found.append(blank(touching, True))
    return EnergyTally(no_flow(like), tuple(found))


def work_by_contact(
    model: ContactModel, sums: Sums, motions: tuple[Motion, Motion], time_step: Array, pistons: Array | None = None
) -> tuple[ContactWork, ...]:
    """What the contacts of a step give and take, each kind of contacts for itself.

    Args:
        model: laws; static.
        sums: with its contacts one by one.
        motions: the velocities of what touches at the start and end of the step.
        time_step: [s].
        pistons: (S, D) by which the velocity of each wall that a force holds changes in the step; None without
            [m/s].
    """
    found = []
    for contacts in sums.found:
        wall = None if pistons is None or not contacts.walls else pistons[np.asarray(contacts.walls)]
        found.append(work_of_contacts(model, contacts, *motions, time_step, wall))
    return tuple(found)


def with_step(
    tally: EnergyTally,
    sums: Sums,
    by_contact: tuple[ContactWork, ...],
    motions: tuple[Motion, Motion],
    time_step: Array,
) -> EnergyTally:
    """The balance with what the contacts and bonds of a step give and take.

    Args:
        tally: so far.
        sums: with its bonds.
        by_contact: see `work_by_contact`.
        motions, time_step: see there.
    """
    flow, kept = tally.flow, list(tally.contacts)
    for number, (contacts, work) in enumerate(zip(sums.found, by_contact, strict=True)):
        if contacts.counted is not None:
            work = jax.tree.map(lambda part, counted=contacts.counted: jnp.where(counted, part, 0.0), work)
        if number < len(kept):
            if contacts.of_other is None:
                work = jax.tree.map(sum_slots, work)
            kept[number] = jax.tree.map(jnp.add, kept[number], work)
        else:  # of a mesh
            flow = _with_sum(flow, work)
    if sums.bonded is not None:
        flow = _with_bonds(flow, sums.bonded, *motions, time_step)
    return EnergyTally(flow, tuple(kept))


def _with_sum(flow: EnergyFlow, work: ContactWork) -> EnergyFlow:
    """The flow with the work of all contacts of a kind."""
    return _with_parts(flow, {name: jnp.sum(part) for name, part in work._asdict().items() if part is not None})


def _with_parts(flow: EnergyFlow, parts: dict[str, Array]) -> EnergyFlow:
    """The flow with so much more of these parts."""
    return flow._replace(**{name: getattr(flow, name) + part for name, part in parts.items()})


def heat_of_step(
    sums: Sums, by_contact: tuple[ContactWork, ...], motions: tuple[Motion, Motion], time_step: Array
) -> Array:
    """(N,) what contacts and bonds take in a step, by what touches and is to be warmed: half of each, and all of a
    wall's [J]. What tangential and rolling springs store is counted as taken, see `stored_energy.strained`.

    Two equal bodies share the heat of their contact by symmetry; others would by their effusivities, which are alike
    for grains of one material: J. C. Jaeger, Proc. R. Soc. N. S. W. 76 (1942) 203-224.
    """
    total = jnp.zeros_like(motions[0].velocity[0])
    for contacts, work in zip(sums.found, by_contact, strict=True):
        taken = work.taken
        total = total + contacts.onto(taken if contacts.of_other is None else 0.5 * taken)
    if sums.bonded is not None:
        _, taken, lost = _of_bonds(sums.bonded, *motions, time_step)
        half = 0.5 * (taken + lost)
        total = total + sum_over_pairs(half, half, sums.bonded.pairs)
    return total


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
