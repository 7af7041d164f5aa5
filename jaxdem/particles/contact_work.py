"""What every contact gives and takes in a step, part by part of its force, for the balance of energy."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics import vectors
from jaxdem.numerics.stages import stage
from jaxdem.numerics.vectors import Vector
from jaxdem.particles import tangent
from jaxdem.particles.cohesion import Cohesion
from jaxdem.particles.cohesion_energy import energy_lost
from jaxdem.particles.contact import StoringLaw
from jaxdem.particles.contact_load import gap_of
from jaxdem.particles.contact_model import ContactModel
from jaxdem.particles.contact_pair import LoadParts
from jaxdem.particles.contact_sums import FoundContacts
from jaxdem.particles.integrate import Motion


class ContactWork(NamedTuple):
    """What contacts of a kind give and take over some steps, each of the shape of the contacts; see `EnergyFlow` [J].

    None where the scene has nothing of it. Where it is summed over steps, a contact stands at its place of the list,
    whoever it is of: what was summed there before the list was made anew stays, for only the sum of all counts.
    """

    damping: Array
    tangential: Array
    tangential_damping: Array
    conservative: Array
    walls: Array | None = None
    liquid: Array | None = None
    adhesion: Array | None = None
    rolling: Array | None = None

    @property
    def taken(self) -> Array:
        """Sum of what is taken from the motion; what tangential and rolling springs store is counted as taken."""
        taken = self.damping + self.tangential
        for part in (self.liquid, self.adhesion, self.rolling):
            taken = taken if part is None else taken + part
        return taken


def work_of_contacts(
    model: ContactModel, found: FoundContacts, before: Motion, after: Motion, time_step: Array, wall: Array | None
) -> ContactWork:
    """What every contact gives and takes in a step.

    Args:
        model: laws; static.
        found: the contacts.
        before, after: the velocities of what touches at the start and end of the step.
        time_step: [s].
        wall: (S, D) by which the velocity of the wall of each row of contacts changes in the step, where a force holds
            it; None without [m/s].
    """
    pair, load = found.pair, found.load
    parts = _parts_of(model, found)
    approach, slip, relative_spin, half_of_wall = _mean_motion(found, before, after, time_step, wall)
    conservative = load.along - parts.dashpot
    if parts.liquid is not None:
        conservative = conservative - parts.liquid
    liquid = None if parts.liquid is None else parts.liquid * approach
    across, resistance = load.across, load.resistance
    if parts.film is not None:
        sheared = vectors.dot(parts.film[0], slip) + vectors.dot(parts.film[1], relative_spin)
        liquid = required(liquid, "liquid") - sheared
        across, resistance = vectors.subtract(across, parts.film[0]), vectors.subtract(resistance, parts.film[1])
    power = ContactWork(
        damping=parts.dashpot * approach,
        tangential=-vectors.dot(across, slip),
        tangential_damping=-vectors.dot(parts.across, slip),
        conservative=-conservative * approach,
        walls=None if pair.other_spin is not None else _power_of_wall(found, before, half_of_wall),
        liquid=liquid,
        rolling=None if model.rolling is None else -vectors.dot(resistance, relative_spin),
    )
    work: ContactWork = jax.tree.map(lambda x: time_step * x, power)
    if found.memory and model.cohesion is not None:
        work = work._replace(adhesion=_lost_to_cohesion(model.cohesion, found, approach, time_step))
    if found.lost is not None:
        work = work._replace(adhesion=found.lost if work.adhesion is None else work.adhesion + found.lost)
    there = found.there
    return work if there is None else jax.tree.map(lambda x: jnp.where(there, x, 0.0), work)


def _mean_motion(
    found: FoundContacts, before: Motion, after: Motion, time_step: Array, wall: Array | None
) -> tuple[Array, Vector, Vector, Vector | None]:
    """Rate of approach, slip and relative spin of every contact by the mean velocities over the step, and half of the
    change of its wall's velocity; see `work_of_contacts`."""
    pair, normal = found.pair, found.pair.normal
    half, spin, other = _half_changes(found, before, after, time_step)
    # The velocities of most walls are what they are in the middle of the step.
    velocity, half_of_wall = vectors.add(pair.velocity, half), None
    if wall is not None:
        half_of_wall = tuple(0.5 * wall[:, k, None] for k in range(wall.shape[1]))
        velocity = vectors.subtract(velocity, half_of_wall)
    spin = vectors.add(pair.spin, spin)
    turning = vectors.scale(pair.radius - 0.5 * pair.overlap, spin)
    relative_spin = spin
    if pair.other_spin is not None:
        other = vectors.add(pair.other_spin, other)
        turning = vectors.add(turning, vectors.scale(pair.other_radius - 0.5 * pair.overlap, other))
        relative_spin = vectors.subtract(spin, other)
    elif pair.wall_spin is not None:
        relative_spin = vectors.subtract(spin, pair.wall_spin)
    approach = -vectors.dot(velocity, normal)
    slip = vectors.subtract(tangent.part_in_plane(velocity, normal), tangent.surface_velocity(turning, normal))
    return approach, slip, relative_spin, half_of_wall


def _lost_to_cohesion(cohesion: Cohesion, found: FoundContacts, approach: Array, time_step: Array) -> Array:
    """What the cohesion of every contact loses in a step with this rate of approach [J]."""
    pair = found.pair
    ((earlier, later),) = found.memory
    along = vectors.dot(pair.velocity, pair.normal)
    closing, former = 2.0 * approach + along, pair.overlap + time_step * along
    gap = gap_of(pair, found.material)._replace(overlap=pair.overlap + 0.5 * time_step * closing)
    constants = required(found.material.cohesion, "cohesion")
    return energy_lost(cohesion, gap, former, constants, earlier, later)


def _half_changes(
    found: FoundContacts, before: Motion, after: Motion, time_step: Array
) -> tuple[Vector, Vector, Vector]:
    """Half of the change over the step of every contact's velocity, and of the spins of the one and of the other."""
    # Outside of the stage, for a gather would compute them anew.
    half, spin = (
        vectors.scale(0.5, vectors.subtract(getattr(after, name), getattr(before, name)))
        for name in ("velocity", "angular_velocity")
    )
    if found.of_other is None:
        return found.of_one(half), found.of_one(spin), ()
    one, other = found.of_one, found.of_other
    # A step of no time changes nothing. Without a stage the sum of every part would gather them anew.
    return stage(time_step > 0.0, lambda: (vectors.subtract(one(half), other(half)), one(spin), other(spin)))


def _parts_of(model: ContactModel, found: FoundContacts) -> LoadParts:
    """Parts of the loads that take energy out of the motion.

    Of plain contacts from what is in memory: the stage of the law computes the law once for each of its results.
    """
    pair, load, law = found.pair, found.load, model.law
    if load.parts is not None:
        return load.parts
    if not isinstance(law, StoringLaw):  # refused before
        raise TypeError("the contact law does not say what its springs store")
    overlap = jnp.where(pair.overlap > 0, pair.overlap, 0.0)
    elastic = jnp.where(pair.overlap > 0, law.elastic(overlap, pair.effective_radius, found.material), 0.0)
    stiffness = law.tangential_stiffness(overlap, pair.effective_radius, found.material)
    kept = load.spring[: len(load.across)]
    return LoadParts(load.along - elastic, None, vectors.add_scaled(load.across, stiffness, kept))


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
