"""Small worlds for contact cases and tests: particles, walls and materials, run through `contact_interval`."""

from __future__ import annotations

import dataclasses
import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxdem.particles.contact import HertzMindlin
from jaxdem.particles.contact_interval import ContactInterval
from jaxdem.particles.contact_model import ContactModel
from jaxdem.particles.contact_step import ContactStep
from jaxdem.particles.forces import contact_forces
from jaxdem.particles.integrate import Motion, ParticleProperties, ParticleState
from jaxdem.particles.list_room import list_room
from jaxdem.particles.loop import contact_interval
from jaxdem.particles.materials import CohesionParameters, ContactParameters, surroundings
from jaxdem.particles.neighbor_search import NeighborSearch
from jaxdem.particles.neighbors import NeighborGeometry, Neighbors
from jaxdem.particles.pairs import Pairs
from jaxdem.particles.size_levels import SizeLevels
from jaxdem.particles.walls import box_sides

DEFAULTS = {
    "young_modulus": 1e7, "poisson_ratio": 0.3, "restitution": 1.0, "friction": 0.0, "rolling_friction": 0.0,
    "rolling_damping": 0.3,
    "wall_young_modulus": None, "wall_poisson_ratio": None, "wall_friction": None,
    "normal_stiffness": 1e4, "tangential_stiffness": 2e4 / 7,
}  # fmt: skip


def constants(dtype=jnp.float64, **given) -> ContactParameters:
    """Contact constants; walls take the particles' where they have none; arrays are kept for vmap.

    `cohesion` is a dictionary of the fields of `CohesionParameters`.
    """
    cohesion = given.pop("cohesion", None)
    values = DEFAULTS | given
    for name in ("young_modulus", "poisson_ratio", "friction"):
        if values["wall_" + name] is None:
            values["wall_" + name] = values[name]
    shape = np.broadcast_shapes(*(np.shape(value) for value in values.values()))
    found = ContactParameters(
        **{name: jnp.broadcast_to(jnp.asarray(value, dtype), shape) for name, value in values.items()}
    )
    if cohesion is None:
        return found
    own = {name: jnp.asarray(value, dtype) for name, value in ({"wall_factor": 1.0} | cohesion).items()}
    return found._replace(cohesion=CohesionParameters(**own))


class World(NamedTuple):
    """What `contact_interval` needs; `interval` is static, the rest arrays."""

    interval: ContactInterval
    constants: ContactParameters
    properties: ParticleProperties
    state: ParticleState
    neighbors: Neighbors
    gravity: jax.Array
    wall_velocity: tuple[jax.Array, ...]


def world(
    position, velocity=None, spin=None, *, radius=0.01, density=2500.0, box=None, periodic=None, skin=0.2,
    law=None, rolling=None, gravity=None, material=None, walls=True, rebuild=True, room=None,
    dtype=jnp.float64, precise=None, wall_velocity=None, surfaces=(), cohesion=None, liquid=None, reach=0.0,
    levels=None,
) -> World:  # fmt: skip
    """A world of N particles; positions as float64 rows, split into pairs in float32.

    `rebuild=False` lists all pairs once and for ever, by numpy: less to compile, and the reference
    for the search. `skin` counts largest diameters. `precise=False` leaves the low parts of a float32 world
    at zero, as plain float32 would. `reach` is how far `cohesion` acts, `liquid` the films (N,).
    `levels` are the largest radii of the levels of size by which the list is made; one table for all if not given.
    """
    position = np.atleast_2d(np.asarray(position, float))
    count, dimension = position.shape
    box = (1.0,) * dimension if box is None else tuple(box)
    periodic = (False,) * dimension if periodic is None else tuple(periodic)
    largest = 2.0 * float(np.max(radius))
    geometry = NeighborGeometry(box, periodic, largest + reach, skin * largest)
    search = NeighborSearch(geometry, float(np.max(radius)))
    if levels is not None:
        by_size = SizeLevels.of(tuple(levels), reach, geometry.skin, box, geometry.skin)
        search = dataclasses.replace(search, levels=by_size)
    sides = box_sides(box, periodic) if walls else ()
    model = ContactModel(law or HertzMindlin(), rolling, sides, surfaces, cohesion=cohesion)
    leading = jnp.asarray(position.astype(dtype))
    low = None
    if dtype == jnp.float32:
        low = jnp.asarray((position - np.asarray(leading, np.float64)).astype(np.float32))
        low = low if precise is None or precise else jnp.zeros_like(low)
    turning = 1 if dimension == 2 else 3

    def rows(given, width):
        return jnp.zeros((count, width), dtype) if given is None else jnp.asarray(
            np.reshape(given, (count, width)), dtype)  # fmt: skip

    state = ParticleState(
        leading, low, rows(velocity, dimension), rows(spin, turning), (), (), rows(None, dimension), None,
        liquid=None if liquid is None else jnp.asarray(liquid, dtype),
    )  # fmt: skip
    motion = Motion.of(state)
    if rebuild:
        sizes = jnp.asarray(radius, dtype)
        room = list_room(search, motion.position, radius=sizes) if room is None else room
        neighbors = search.allocate(motion.position, motion.low, sizes, room)
    else:
        neighbors = all_pairs(position, radius, box, periodic, motion)
    state = state._replace(
        contact_spring=(jnp.zeros(neighbors.room.pairs, dtype),) * model.history_size(dimension),
        wall_spring=(jnp.zeros((model.walls, count), dtype),) * model.history_size(dimension),
    )
    gravity = jnp.zeros(dimension, dtype) if gravity is None else jnp.asarray(gravity, dtype)
    still = (jnp.zeros(dimension, dtype),) * model.walls
    if wall_velocity is not None:
        still = tuple(jnp.asarray(v, dtype) for v in wall_velocity)
    return World(
        ContactInterval(model, search if rebuild else None, 1, False),
        material or constants(dtype),
        ParticleProperties(jnp.asarray(radius, dtype), jnp.asarray(density, dtype)),
        state, neighbors, gravity, still,
    )  # fmt: skip


def all_pairs(position, radius, box, periodic, motion) -> Neighbors:
    """A list of all N - 1 others of every particle, nearest images, in float64; never rebuilt."""
    count, dimension = position.shape
    dtype, radii = motion.position[0].dtype, np.broadcast_to(radius, (count,))
    rows = [[j for j in range(count) if j != i] for i in range(count)]
    others = np.array(rows, int).reshape(count, max(count - 1, 0)).T
    listed = [(i, j) for i in range(count) for j in range(i + 1, count)]
    number, room = {pair: p for p, pair in enumerate(listed)}, len(listed) + 1
    entry = [[number[i, j] if i < j else room + number[j, i] for i, j in enumerate(row)] for row in others.tolist()]
    first, second = np.array([*listed, (0, 0)], int).T
    difference = position[first] - position[second]
    for axis in range(dimension):
        if periodic[axis]:
            difference[:, axis] -= box[axis] * np.round(difference[:, axis] / box[axis])
    difference[-1, 0] = 10.0 * np.max(radius)  # the empty pair, out of reach
    overlap = radii[first] + radii[second] - np.linalg.norm(difference, axis=1)
    return Neighbors(
        jnp.asarray(others, jnp.int32),
        Pairs(*(jnp.asarray(x, jnp.int32) for x in (first, second, np.reshape(entry, others.shape)))),
        tuple(jnp.asarray(difference[:, k], dtype) for k in range(dimension)),
        jnp.asarray(radius, dtype),
        jnp.asarray(overlap, dtype),
        motion.position, motion.low, jnp.zeros((), bool), jnp.ones((), jnp.int32), 0,
    )  # fmt: skip


def weights(scene: World) -> jax.Array:
    """(N, D) forces of gravity [N]."""
    mass = jnp.broadcast_to(scene.properties.mass, scene.state.position.shape[:1])
    return mass[:, None] * scene.gravity[None]


def advance(scene: World, time_step, steps: int, reversible: bool = False) -> World:
    """The world after `steps` contact steps; not yet compiled."""
    state, neighbors, _ = contact_interval(
        dataclasses.replace(scene.interval, steps=steps, reversible=reversible),
        surroundings(scene.constants, scene.wall_velocity),
        scene.properties, scene.state, scene.neighbors, weights(scene), time_step,
    )  # fmt: skip
    return scene._replace(state=state, neighbors=neighbors)


def forces(scene: World, time_step=0.0):
    """Contact force (N, D) and torque (N, A) where the particles stand, by the list of the scene."""
    motion = Motion.of(scene.state)
    around, duration = (
        surroundings(scene.constants, scene.wall_velocity),
        jnp.asarray(time_step, motion.position[0].dtype),
    )
    step = ContactStep(scene.interval.model, around, scene.properties, motion, motion.velocity, duration)
    sums, _ = contact_forces(step, scene.neighbors)
    return jnp.stack(sums.force, axis=1), jnp.stack(sums.torque, axis=1)


class Track(NamedTuple):
    """Position, velocity, spin and mean contact force of every recorded frame (first axis)."""

    position: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    force: np.ndarray


@functools.cache
def runner(interval: ContactInterval, frames: int, every: int, batched: bool):
    """Compiled `track` for one static description."""

    def one(arrays, time_step):
        scene = World(interval, *arrays)

        def frame(scene_arrays, _):
            new = advance(World(interval, *scene_arrays), time_step, every)
            state = new.state
            position = state.position if state.position_low is None else state.position + state.position_low
            seen = Track(position, state.velocity, state.angular_velocity, state.contact_force)
            return tuple(new[1:]), seen

        arrays, seen = jax.lax.scan(frame, tuple(scene[1:]), None, length=frames)
        return arrays, seen

    return jax.jit(jax.vmap(one) if batched else one)


def track(scene: World, time_step, frames: int, every: int = 1) -> tuple[World, Track]:
    """The world after frames x every contact steps, and what was seen after every `every` of them.

    With a time step (B,) all arrays of the scene have a first axis B (see `batch`): B worlds at once.
    """
    time_step = jnp.asarray(time_step, scene.state.position.dtype)
    compiled = runner(scene.interval, frames, every, time_step.ndim == 1)
    arrays, seen = compiled(tuple(scene[1:]), time_step)
    return World(scene.interval, *arrays), Track(*(np.asarray(x) for x in seen))


def batch(scenes: list[World]) -> World:
    """Worlds of the same shapes stacked for `track`; the static part is that of the first."""
    arrays = [tuple(scene[1:]) for scene in scenes]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *arrays)
    return World(scenes[0].interval, *stacked)
