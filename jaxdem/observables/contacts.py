"""Contacts of a state: who touches whom, with which overlap and force."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.observables.arguments import require_arguments
from jaxdem.particles.contact_model import ContactModel
from jaxdem.particles.contact_step import ContactStep
from jaxdem.particles.contact_sums import Touching
from jaxdem.particles.forces import contacts_now
from jaxdem.particles.integrate import Motion, ParticleProperties, ParticleState
from jaxdem.particles.materials import surroundings
from jaxdem.particles.neighbors import Neighbors, with_radius
from jaxdem.particles.pair_forces import counted_pairs
from jaxdem.state import Parameters, State
from jaxdem.structure import Structure


class Contacts(NamedTuple):
    """Contacts of a state. Pairs of the list that do not touch have a negative overlap and no force.

    Attributes:
        first, second: (P,) int32, the particles of each pair.
        between: of these pairs, arrays (P,), with the normal and the force on the first; None for a single particle.
        walls: with the S walls, sides of the box first, arrays (S, N); None without walls.
        counted: on several devices (P,) bool, which pairs belong to this slab, see `counted_pairs`; None on one
            device.
    """

    first: Array
    second: Array
    between: Touching | None
    walls: Touching | None
    counted: Array | None = None


def particles_seen(
    structure: Structure, parameters: Parameters, state: State, neighbors: Neighbors
) -> tuple[ParticleState, ParticleProperties]:
    """The particles that the pairs of a list are of, and what they are: on several devices those of a slab with the
    ghosts of its neighbours behind them, which are not active.

    Arguments are those of `contacts`.
    """
    require_arguments(structure=structure, parameters=parameters, state=state, neighbors=neighbors)
    particles, bodies = required(state.particles, "particles"), required(parameters.bodies, "parameters.bodies")
    return required(structure.contact, "particles").seen(bodies, particles, neighbors)


def contacts(structure: Structure, parameters: Parameters, state: State, neighbors: Neighbors) -> Contacts:
    """The contacts of a state, with their law evaluated once and springs as they are.

    The dashpots act on the velocities of the state, which in a step they do on those in the middle of the step.

    Args:
        structure: or a `Simulation`.
        parameters: that go with it.
        state: with particles.
        neighbors: its list.
    """
    particles, bodies = particles_seen(structure, parameters, state, neighbors)
    return contacts_of(structure, parameters, state, neighbors, particles, bodies)


def contacts_of(
    structure: Structure,
    parameters: Parameters,
    state: State,
    neighbors: Neighbors,
    particles: ParticleState,
    bodies: ParticleProperties,
) -> Contacts:
    """`contacts` with what `particles_seen` gives."""
    model = required(structure.contact, "particles").model
    if structure.coupling is not None:
        bodies = structure.coupling.moved_bodies(parameters._replace(bodies=bodies).mixture)
    materials = surroundings(
        parameters.materials, structure.wall_velocity(parameters, structure.time(parameters, state))
    )
    materials = materials._replace(placements=structure.placed(parameters, particles, state.step))
    neighbors = with_radius(neighbors, bodies.radius)
    present = _present(model, structure.middle(parameters, state.step))
    motion, still = Motion.of(particles), jnp.zeros((), particles.position.dtype)
    step = ContactStep(model, materials, bodies, motion, motion.velocity, still, particles.active, present)
    between, walls = contacts_now(step, neighbors)
    return Contacts(neighbors.pairs.first, neighbors.pairs.second, between, walls, counted_pairs(neighbors))


def _present(model: ContactModel, middle: Array) -> Array | None:
    """(S,) bool, which walls are there in an interval with this middle [s]; None where all always are."""
    if model.wall_times is None:
        return None
    return jnp.concatenate([jnp.ones(len(model.sides), bool), model.wall_times.present(middle)])
