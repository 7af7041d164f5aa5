"""Twenty random scenes in slabs against one device: four kinds, five scenes of each, which share its programs.

The scenes of a kind differ by the places, velocities and spins of the grains and by gravity. Scenes at full size, with
random boxes and materials too, are those of `python -m tests.cases.slabs`.
"""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem import devices
from jaxdem.closures import InvariantClosure, KochHill
from jaxdem.devices.contacts import Contacts, contacts_of_list
from jaxdem.failures import failures
from jaxdem.particles.neighbors import Room
from tests.cases.fluid_slabs import ALONG_X, compared, coupled_scene
from tests.cases.slabs import apart
from tests.cases.tiers import COMBINATION

DEVICES, SCENES, DIAMETER = 2, 5, 0.02
PERIODIC = {"kind": "periodic"}
FILM = {"cutoff": 2e-3, "roughness": 2e-5, "viscosity": 0.5}
"""It resists sliding and rolling too, as strongly as the contacts of these grains do."""


def grains(size, count, **more):
    """Tables of grains of three sizes, at places that `scattered` changes."""
    tables = {
        "precision": "float64",
        "domain": {"size": size},
        "particles": {
            "position": lattice(size)[:count].tolist(),
            "radius": (0.5 * DIAMETER * np.array([1.0, 0.9, 0.8])[np.arange(count) % 3]).tolist(),
            "density": 2500.0,
        },
        "contact": {"young_modulus": 1e6, "friction": 0.4, "restitution": 0.6, "speed": 1.0, "skin": 0.2},
        "time": {"end": 0.05, "output_interval": 0.005},
    }
    if len(size) == 2:
        tables["domain"]["depth"] = 0.02
    tables["contact"] |= more.pop("contact", {})
    return tables | more


def lattice(size):
    """Places that are a diameter apart, and from sides."""
    axes = [DIAMETER * (0.6 + np.arange(round(length / DIAMETER - 0.7))) for length in size]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(size))


def with_inlet():
    tables = grains([0.2, 0.1], 1, boundary={"right": {"particles": "remove"}})
    inlet = {"start": [0.02, 0.02], "stop": [0.18, 0.08], "rate": 1200.0, "velocity": [0.8, 0.0]}
    tables["particles"] = {"radius": 0.008, "density": 2500.0, "inlet": [inlet]}
    return tables | {"time": {"end": 0.02, "output_interval": 0.005}}


def with_fluid():
    tables = coupled_scene(2, ALONG_X)
    tables["particles"] |= {"radius": 0.01, "position": lattice([0.4, 0.2])[:40].tolist()}
    tables["contact"] |= {"speed": 1.0, "skin": 0.2}
    return tables | {"time": {"end": 0.05, "output_interval": 0.01}}


def learned():
    """A drag law with a network, of random weights."""
    draw, closure = np.random.default_rng(4), InvariantClosure.initial(KochHill(), hidden=(4,))
    return jax.tree.map(lambda x: jnp.asarray(x + 0.3 * draw.normal(size=np.shape(x))), closure)


RANDOM = {
    "2-D, walls": lambda: (grains([0.2, 0.1], 32), None),
    "3-D, two periodic sides": lambda: (
        grains(
            [0.2, 0.08, 0.06],
            24,
            boundary={name: PERIODIC for name in ("left", "right", "front", "back")},
            contact={"rolling_friction": 0.1, "rolling_model": "epsd", "lubrication": FILM},
        ),
        None,
    ),
    "inlet and exit": lambda: (with_inlet(), None),
    "fluid, learned drag": lambda: (with_fluid(), learned()),
}
INTERVALS = {"inlet and exit": 20}


class Programs(NamedTuple):
    """Of a kind of scene, on one device and in slabs."""

    simulation: Any
    divided: Any
    parameters: Any
    state: Any
    one: Any
    many: Any


@functools.cache
def programs(kind):
    """A kind of scene on one device and in slabs; the gravity is an argument."""
    tables, closure = RANDOM[kind]()
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene, closure)
    divided, _ = jaxdem.build(scene, closure, devices=DEVICES)
    state, _ = jaxdem.initial_state(scene, simulation, parameters)

    def stepping(which):
        return jax.jit(lambda g, s, n: which.step(parameters._replace(gravity=g), s, n))

    return Programs(simulation, divided, parameters, state, stepping(simulation), stepping(divided))


def scattered(state, box, draw):
    """The state with grains at other places, at random velocities and spins."""
    particles = state.particles
    count, dimension = particles.position.shape
    position = particles.position
    if particles.active is None:  # some of the places around the border of the slabs
        places = lattice(box)
        near = np.argsort(np.abs(places[:, 0] - 0.5 * box[0]), kind="stable")[: count + 6]
        position = places[draw.permutation(near)[:count]]
    position = position + 0.02 * DIAMETER * draw.uniform(-1.0, 1.0, (count, dimension))
    velocity = draw.normal(0.0, 0.3, (count, dimension))
    spin = draw.normal(0.0, 10.0, particles.angular_velocity.shape)
    particles = particles._replace(
        position=jnp.asarray(position), velocity=jnp.asarray(velocity), angular_velocity=jnp.asarray(spin)
    )
    return state._replace(particles=particles)


@COMBINATION
@pytest.mark.parametrize("seed", range(SCENES))
@pytest.mark.parametrize("kind", RANDOM)
def test_a_random_scene_is_that_of_one_device(kind, seed):
    """The same grains and contacts; forces, motion and fluid to rounding, which collisions enlarge; momentum kept."""
    simulation, divided, parameters, state, one, many = programs(kind)
    draw = np.random.default_rng(seed)
    state = scattered(state, simulation.box, draw)
    gravity = jnp.asarray(draw.normal(0.0, 5.0, len(simulation.box)))
    count, kept = len(state.particles.position), len(state.particles.contact_spring)
    # Room for all scenes, so that they share programs.
    room = Room(20, 12 * count, 12) if len(simulation.box) == 3 else Room(10, 6 * count, 6)
    neighbors = simulation.allocate(parameters, state.particles, room)
    blank = tuple(jnp.zeros(room.pairs) for _ in range(kept))
    state = state._replace(particles=state.particles._replace(contact_spring=blank))
    nothing = Contacts(np.zeros(0, int), np.zeros(0, int), np.zeros((kept, 0)))
    rows = count + 8
    slab_room = devices.SlabRoom(rows, rows, rows, room)
    slabs, lists = devices.distributed(divided, parameters, state, nothing, slab_room)
    given = devices.SlabRoom.of(lists)
    assert (given.rows, given.ghosts, given.migrating) == (rows, rows, rows), "another room would be another program"
    collisions = 0.0
    for _ in range(INTERVALS.get(kind, 4)):
        state, neighbors, report = one(gravity, state, neighbors)
        slabs, lists, figures = many(gravity, slabs, lists)
        assert int(failures(simulation, report)) == int(failures(divided, figures)) == 0
        collisions += float(report.particles.collision_force)
    whole, contacts = devices.gathered(divided, slabs, lists)
    own = contacts_of_list(state.particles.contact_spring, jax.device_get(neighbors))
    pairs = [{frozenset(pair) for pair in zip(c.first, c.second, strict=True)} for c in (own, contacts)]
    assert pairs[0] == pairs[1] and collisions > 0.0
    alone, parts = state.particles, whole.particles
    there = np.ones(count, bool) if alone.active is None else np.asarray(alone.active)
    np.testing.assert_array_equal(there, np.ones(count, bool) if parts.active is None else parts.active)
    mass = np.broadcast_to(np.asarray(parameters.bodies.mass), count)[there, None]
    momentum = [np.sum(mass * np.asarray(p.velocity)[there], axis=0) for p in (alone, parts)]
    assert np.abs(momentum[0] - momentum[1]).max() < 1e-10 * np.sum(mass * np.abs(np.asarray(alone.velocity)[there]))
    for name in ("contact_force", "velocity", "position", "angular_velocity"):
        assert apart(np.asarray(getattr(alone, name))[there], np.asarray(getattr(parts, name))[there]) < 1e-9, name
    for x, y in zip(alone.wall_spring, parts.wall_spring, strict=True):
        assert apart(np.asarray(x)[:, there], np.asarray(y)[:, there]) < 1e-9
    if alone.inserted is not None:
        np.testing.assert_array_equal(parts.inserted, alone.inserted)
        assert 0 < there.sum() < int(alone.inserted[0])
        assert int(report.particles.waiting) == int(figures.particles.waiting)
    if state.fluid is not None:
        assert np.max(compared(divided.slabs, slabs.fluid, state.fluid)) < 1e-9
    assert devices.counts(lists).particles.min() > 0
