"""What the springs of plain contacts store, by NumPy: so the summary of a plain run compiles nothing for it. Host side.

Plain are contacts of spheres with each other and with the sides of the box, of one material and one of the two laws,
without cohesion and rolling springs. All other scenes have `jaxdem.particle_step.stored`.
"""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from jaxdem.particles.contact import HertzMindlin, LinearSpringDashpot
from jaxdem.particles.contact_model import ContactModel
from jaxdem.particles.integrate import ParticleProperties, ParticleState
from jaxdem.particles.materials import ContactParameters, surroundings
from jaxdem.particles.neighbors import Neighbors
from jaxdem.particles.walls import wall_overlap


def is_plain(model: ContactModel, bodies: ParticleProperties) -> bool:
    """Whether `springs_of` knows all that stores energy in the contacts of a scene."""
    known = isinstance(model.law, HertzMindlin | LinearSpringDashpot)
    more = model.surfaces or model.meshes or model.cohesion is not None or model.bonds is not None
    rolling = model.rolling is not None and model.rolling.has_spring
    return known and not more and not rolling and model.materials is None and bodies.clumps is None


def springs_of(
    model: ContactModel,
    parameters: ContactParameters,
    bodies: ParticleProperties,
    particles: ParticleState,
    neighbors: Neighbors,
) -> tuple[float, float]:
    """Energy of the springs along the normal and of the tangential ones [J].

    Args:
        model: plain.
        parameters: of its material.
        bodies: the particles.
        particles: their state.
        neighbors: their list, in date.
    """
    law = model.law
    assert isinstance(law, HertzMindlin | LinearSpringDashpot)  # see `is_plain`
    # Arrays of NumPy, for which the types of JAX have no name.
    around: Any = jax.tree.map(np.asarray, surroundings(_host(parameters), ()))
    bodies, particles = jax.tree.map(np.asarray, (bodies, particles))
    count = particles.velocity.shape[0]
    radius = np.broadcast_to(np.asarray(bodies.radius, float), (count,))
    total = np.zeros(2)

    def add(overlap: Any, effective: Any, material: Any, springs: list[Any]) -> None:
        touches = overlap > 0.0
        depth, own = overlap[touches], effective[touches]
        across = sum((spring[touches].astype(float) ** 2 for spring in springs), np.zeros(depth.shape))
        normal = law.energy(depth, own, material)
        total[:] += np.sum(normal), 0.5 * np.sum(law.tangential_stiffness(depth, own, material) * across)

    in_plane = particles.velocity.shape[1] - 1 if particles.velocity.shape[1] == 2 else 3
    if neighbors.room.slots:
        first, second = np.asarray(neighbors.pairs.first), np.asarray(neighbors.pairs.second)
        there, one, other = first != second, radius[first], radius[second]
        overlap = np.where(there, _overlap(particles, neighbors, first, second, one + other), -1.0)
        springs = list(particles.contact_spring[:in_plane])
        add(overlap, one * other / (one + other), around.pair, springs)
    position: tuple[Any, ...] = tuple(particles.position.T)
    lows: tuple[Any, ...] = (None,) * len(position)
    if particles.position_low is not None:
        lows = tuple(particles.position_low.T)
    present = np.ones(count, bool) if particles.active is None else np.asarray(particles.active)
    for number, side in enumerate(model.sides):
        overlap = np.where(present, wall_overlap(side, position, lows, bodies.radius), -1.0)
        add(overlap, radius, around.wall, [spring[number] for spring in particles.wall_spring[:in_plane]])
    return float(total[0]), float(total[1])


def _host(parameters: ContactParameters) -> ContactParameters:
    found: ContactParameters = jax.tree.map(np.asarray, parameters)
    return found


def _overlap(
    particles: ParticleState, neighbors: Neighbors, first: np.ndarray, second: np.ndarray, reach: np.ndarray
) -> np.ndarray:
    """(P,) overlap of all pairs: that at the build of the list less what the distance has grown since then."""
    apart, squared = [], np.zeros(len(first))
    for k, (reference, low) in enumerate(zip(neighbors.reference, neighbors.reference_low, strict=True)):
        way = np.asarray(particles.position[:, k], float) - np.asarray(reference, float)
        if low is not None and particles.position_low is not None:
            way = way + (np.asarray(particles.position_low[:, k], float) - np.asarray(low, float))
        apart.append((np.asarray(neighbors.separation[k], float), way[first] - way[second]))
    before = reach - np.asarray(neighbors.overlap, float)
    growth = np.zeros(len(first))
    for start, change in apart:
        squared += (start + change) ** 2
        growth += change * (2.0 * start + change)
    overlap: np.ndarray = np.asarray(neighbors.overlap, float) - growth / (np.sqrt(squared) + before)
    return overlap
