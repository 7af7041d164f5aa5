"""Profiles over slices and boxes, contacts, and the fluid at points, against closed forms."""

from __future__ import annotations

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.errors import InputError
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.fluid.grid import cell_average
from jaxdem.observables import Boxes, contacts, fluid_at, fluid_profile, particle_profile, slices
from jaxdem.state import State

GRAVITY, DENSITY, RADIUS, STIFFNESS = 9.81, 2500.0, 0.01, 1000.0
VOLUME = 4.0 / 3.0 * np.pi * RADIUS**3
MASS = DENSITY * VOLUME

ROOMY = {
    "precision": "float64",
    "domain": {"size": [0.2, 0.2, 0.2]},
    "particles": {"radius": RADIUS, "density": DENSITY, "position": [[0.05, 0.05, 0.05 + 0.03 * k] for k in range(4)]},
    "contact": {
        "law": "linear_spring_dashpot", "normal_stiffness": STIFFNESS, "restitution": 0.5, "friction": 0.3,
        "speed": 0.1, "skin": 0.2,
    },
    "boundary": {"left": {"kind": "periodic"}},
    "time": {"end": 0.001, "output_interval": 0.001},
}  # fmt: skip


def at_places(tables, position, velocity=None):
    """Simulation, parameters, and the state and list of particles at these places."""
    position = np.asarray(position, float)
    apart = [[0.05, 0.05, 0.02 + 0.03 * k] for k in range(len(position))]  # a scene refuses some of what is looked at
    scene = jaxdem.load_scene({**tables, "particles": {**tables["particles"], "position": apart}})
    simulation, parameters = jaxdem.build(scene)
    state = jaxdem.initial_state(scene, simulation, parameters)[0]
    particles = state.particles._replace(position=jnp.asarray(position))
    if velocity is not None:
        particles = particles._replace(velocity=jnp.asarray(velocity))
    neighbors = simulation.allocate(parameters, particles)
    kept = simulation.contact.model.history_size(3)
    particles = particles._replace(contact_spring=(jnp.zeros(neighbors.room.pairs),) * kept)
    return simulation, parameters, state._replace(particles=particles), neighbors


def profile_of(case, boxes):
    simulation, parameters, state, neighbors = case
    return jax.jit(lambda s, n: particle_profile(simulation, parameters, boxes, s, n))(state, neighbors)


@pytest.fixture(scope="module")
def loose():
    """Grains that touch nothing, two of them on the seam of the periodic axis, with velocities."""
    random = np.random.default_rng(1)
    places = [[0.003, 0.05, 0.05], [0.199, 0.15, 0.05], [0.1, 0.1, 0.1003], [0.05, 0.15, 0.15]]
    return at_places(ROOMY, places, random.normal(0.0, 1.0, (4, 3)))


def cap(height):
    """Volume of a cap of a sphere, pi h^2 (3 R - h) / 3."""
    return np.pi * height**2 * (3.0 * RADIUS - height) / 3.0


def test_solid_fraction_of_slices_is_that_of_caps(loose):
    """The third grain is cut at z = 0.105: its cap of 5.3 mm lies above."""
    profile = profile_of(loose, slices((0.2, 0.2, 0.2), 2, (0.0, 0.105, 0.2)))
    above = cap(0.1003 + RADIUS - 0.105)
    slab = 0.2 * 0.2 * np.array([0.105, 0.095])
    np.testing.assert_allclose(profile.solid_fraction * slab, [3 * VOLUME - above, VOLUME + above], rtol=1e-12)
    np.testing.assert_allclose(profile.number, np.array([3 * VOLUME - above, VOLUME + above]) / VOLUME, rtol=1e-12)


def test_what_reaches_over_the_seam_is_seen_at_the_other_end(loose):
    """Slices along the periodic axis hold all volume; the first one the cap of the second grain too."""
    edges = (0.0, 0.007, 0.1, 0.15, 0.2)
    profile = profile_of(loose, slices((0.2, 0.2, 0.2), 0, edges))
    volume = profile.solid_fraction * 0.04 * np.diff(edges)
    np.testing.assert_allclose(volume.sum(), 4 * VOLUME, rtol=1e-12)
    first = VOLUME - cap(RADIUS - 0.003) - cap(RADIUS - 0.004) + cap(0.009) - cap(0.002)
    np.testing.assert_allclose(volume[0], first, rtol=1e-11)


def test_velocities_of_slices_and_boxes(loose):
    """Weighted by mass; the temperature is that of three degrees of freedom about the mean of the slice."""
    state = loose[2]
    lower = np.asarray(state.particles.velocity)[:2]
    profile = profile_of(loose, slices((0.2, 0.2, 0.2), 2, (0.0, 0.08, 0.2)))
    np.testing.assert_allclose(profile.velocity[0], lower.mean(axis=0), rtol=1e-12)
    fluctuation = lower - lower.mean(axis=0)
    np.testing.assert_allclose(profile.granular_temperature[0], (fluctuation**2).sum(axis=1).mean() / 3.0, rtol=1e-12)
    streaming = MASS * np.einsum("pa,pb->ab", fluctuation, fluctuation) / (0.04 * 0.08)
    np.testing.assert_allclose(profile.streaming_stress[0], streaming, rtol=1e-12, atol=1e-12)
    # Boxes cut along two axes take a grain by its centre; one without a grain has no velocity.
    boxes = Boxes(((0.0, 0.0, 0.0), (0.0, 0.12, 0.0)), ((0.2, 0.12, 0.08), (0.2, 0.2, 0.08)), (1, 2))
    profile = profile_of(loose, boxes)
    np.testing.assert_allclose(profile.number, [1.0, 1.0])
    np.testing.assert_allclose(profile.velocity, lower, rtol=1e-12)
    empty = profile_of(loose, Boxes(((0.0, 0.0, 0.18),), ((0.2, 0.2, 0.2),), (2,)))
    assert np.isnan(empty.velocity).all() and np.isnan(empty.coordination).all() and empty.solid_fraction[0] == 0.0


@pytest.fixture(scope="module")
def column():
    """Five grains on top of each other at rest: each contact carries the weight above it, k d = n m g."""
    number = 5
    overlap = MASS * GRAVITY * np.arange(number, 0, -1) / STIFFNESS
    height = np.cumsum(np.r_[RADIUS, np.full(number - 1, 2.0 * RADIUS)] - overlap)
    return at_places(ROOMY, [[0.1, 0.1, z] for z in height]), height


def test_stress_of_a_column_at_rest_is_its_weight(column):
    """Per slice: the mean over its height of the weight of the centres above, over the area."""
    case, height = column
    edges = np.array([0.0, 0.004, 0.013, 0.05, 0.0876, 0.12])
    profile = profile_of(case, slices((0.2, 0.2, 0.2), 2, tuple(edges)))

    def carried(z):  # integral of the weight above, from the bottom to z
        return MASS * GRAVITY * np.minimum(z, height[:, None]).sum(axis=0)

    weight = np.diff(carried(edges)) / np.diff(edges) / 0.04
    np.testing.assert_allclose(profile.stress[:, 2, 2], weight, rtol=1e-9)
    others = np.asarray(profile.stress).copy()
    others[:, 2, 2] = 0.0
    assert np.abs(others).max() < 1e-9 * weight.max()
    np.testing.assert_allclose(profile.coordination[0], 1.0, rtol=1e-12)  # the wall is not counted


def test_contacts_of_a_column(column):
    """Forces on the upper grain of each pair, and of the bottom on the lowest grain, carry what is above."""
    (simulation, parameters, state, neighbors), _ = column
    found = jax.jit(lambda s, n: contacts(simulation, parameters, s, n))(state, neighbors)
    touching = np.asarray(found.between.overlap) > 0
    assert touching.sum() == 4
    force = np.asarray(found.between.force[2])[touching]
    # The first particle of a pair is the lower one here: it is pushed down.
    np.testing.assert_allclose(np.sort(force), -MASS * GRAVITY * np.arange(4, 0, -1), rtol=1e-9)
    walls = np.asarray(found.walls.force[2])
    np.testing.assert_allclose(walls.sum(axis=0)[0], 5.0 * MASS * GRAVITY, rtol=1e-9)


def test_a_cubic_lattice_has_six_neighbours_and_the_stress_of_its_springs():
    """Round three periodic axes; slices that cut between and through layers share the moments of forces."""
    spacing, number = 2.0 * RADIUS - 1e-5, 4
    size = number * spacing
    sides = {name: {"kind": "periodic"} for name in ("left", "front", "bottom")}
    places = (np.array(list(itertools.product(range(number), repeat=3))) + 0.3) * spacing
    tables = {**ROOMY, "domain": {"size": [size] * 3, "gravity": [0.0, 0.0, 0.0]}, "boundary": sides}
    tables["particles"] = {"radius": 0.99 * RADIUS, "density": DENSITY}
    scene = jaxdem.load_scene({**tables, "particles": {**tables["particles"], "position": places.tolist()}})
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    parameters = parameters._replace(bodies=parameters.bodies._replace(radius=jnp.asarray(RADIUS)))
    edges = (0.0, 0.37 * size, 0.6 * size, size)
    profile = profile_of((simulation, parameters, state, neighbors), slices((size,) * 3, 0, edges))
    np.testing.assert_allclose(profile.coordination, 6.0, rtol=1e-9)
    force = STIFFNESS * 1e-5
    # Across the slices every cut meets the same springs; along them a slice has those of the layers in it.
    layers = np.array([2, 1, 1]) * spacing / np.diff(edges)
    stress = force / spacing**2 * np.stack([np.diag([1.0, share, share]) for share in layers])
    np.testing.assert_allclose(profile.stress, stress, rtol=1e-8, atol=1e-8 * stress.max())


def test_slopes_of_a_profile(column):
    """By the position of a grain and by the stiffness, against differences."""
    (simulation, parameters, state, neighbors), _ = column
    boxes = slices((0.2, 0.2, 0.2), 2, (0.0, 0.037, 0.2))

    @jax.jit
    def figure(shift, gain):
        place = state.particles.position.at[2, 2].add(shift)
        stiffness = gain * parameters.contact.normal_stiffness
        contact = parameters.contact._replace(normal_stiffness=stiffness)
        there = state._replace(particles=state.particles._replace(position=place))
        profile = particle_profile(simulation, parameters._replace(contact=contact), boxes, there, neighbors)
        return profile.stress[0, 2, 2] + 1e3 * profile.solid_fraction[0]

    by_place, by_stiffness = jax.jit(jax.grad(figure, (0, 1)))(0.0, 1.0)
    step = 1e-7
    np.testing.assert_allclose(by_place, (figure(step, 1.0) - figure(-step, 1.0)) / (2 * step), rtol=1e-5)
    np.testing.assert_allclose(by_stiffness, (figure(0.0, 1.01) - figure(0.0, 0.99)) / 0.02, rtol=1e-9)


@pytest.fixture(scope="module")
def fluid():
    """A fluid with a periodic axis, in which the velocity is linear and void fraction and pressure depend on height."""
    tables = {
        "precision": "float64",
        "domain": {"size": [0.3, 0.2, 0.4], "gravity": [0.0, 0.0, -9.81]},
        "fluid": {"cells": [3, 4, 5], "time_step": 0.01},
        "boundary": {"front": {"kind": "periodic"}},
        "time": {"end": 0.01, "output_interval": 0.01},
    }
    simulation, parameters = jaxdem.build(jaxdem.load_scene(tables))
    grid = simulation.fluid.solver.grid

    def at(shape, function, staggered=None):
        places = [
            h * (np.arange(n) + (0.0 if axis == staggered else 0.5))
            for axis, (h, n) in enumerate(zip(grid.spacing, shape, strict=True))
        ]
        return jnp.asarray(function(*np.meshgrid(*places, indexing="ij")))

    faces = tuple(at(grid.face_shape(axis), lambda x, y, z: 1.0 + 2.0 * x - z, axis) for axis in range(3))
    pressure, void = at(grid.cells, lambda x, y, z: 50.0 * z + 0 * x), at(grid.cells, lambda x, y, z: 0.5 + z + 0 * x)
    return simulation, parameters, State(None, FluidState(faces, pressure, void), jnp.int32(0))


def test_the_fluid_at_points_is_exact_where_it_is_linear(fluid):
    simulation, _, state = fluid
    points = jnp.asarray([[0.11, 0.199, 0.2], [0.16, 0.001, 0.1234], [0.2, 0.1, 0.36]])
    found = jax.jit(lambda p: fluid_at(simulation, state, p))(points)
    x, _, z = np.asarray(points).T
    np.testing.assert_allclose(found.velocity, np.repeat((1.0 + 2.0 * x - z)[:, None], 3, axis=1), rtol=1e-12)
    np.testing.assert_allclose(found.pressure, 50.0 * z, rtol=1e-12)
    np.testing.assert_allclose(found.void_fraction, 0.5 + z, rtol=1e-12)
    slope = jax.jit(jax.grad(lambda p: fluid_at(simulation, state, p).velocity[0, 0]))(points)[0]
    np.testing.assert_allclose(slope, [2.0, 0.0, -1.0], rtol=1e-12, atol=1e-12)


def test_places_that_there_are_not_are_refused(fluid):
    """An axis that there is not cuts nothing: each slice would be the whole box."""
    for axis, edges, words in ((3, (0.0, 0.2), "there are 3"), (2, (0.2, 0.0), "must ascend"), (2, (0.1,), "two")):
        with pytest.raises(InputError, match=words):
            slices((0.3, 0.2, 0.4), axis, edges)
    for points in ([[0.1, 0.1, 0.1]], jnp.zeros((2, 2)), jnp.zeros(3)):
        with pytest.raises(InputError, match=r"points = .*\(P, 3\)"):
            fluid_at(fluid[0], fluid[2], points)


def test_means_of_the_fluid_take_the_part_of_each_cell(fluid):
    """The cells from 0.08 m and from 0.16 m up, and a quarter of the one above; against sums by NumPy."""
    simulation, parameters, state = fluid
    boxes = slices((0.3, 0.2, 0.4), 2, (0.0, 0.08, 0.26, 0.4))
    profile = jax.jit(lambda s: fluid_profile(simulation, parameters, boxes, s))(state)
    part = np.array([0.0, 1.0, 1.0, 0.25, 0.0])
    void, velocity = np.asarray(state.fluid.void_fraction), np.stack(cell_average(state.fluid.face_velocity), axis=-1)
    fluid_volume = void * part
    np.testing.assert_allclose(profile.void_fraction[1], fluid_volume.sum() / (12 * 2.25), rtol=1e-12)
    weighted = (fluid_volume[..., None] * velocity).sum(axis=(0, 1, 2))
    np.testing.assert_allclose(profile.velocity[1], weighted / fluid_volume.sum(), rtol=1e-12)
    np.testing.assert_allclose(profile.superficial_velocity[1], weighted / (12 * 2.25), rtol=1e-12)
    pressure = (np.asarray(state.fluid.pressure) * part).sum() / (12 * 2.25)
    np.testing.assert_allclose(profile.pressure[1], pressure, rtol=1e-12)


def test_contacts_at_walls_under_a_gravity_that_changes():
    """The walls at rest have one velocity each, not one for each time of the gravity: profiles and tables of contacts
    ended with an error."""
    turned = {"gravity_times": [0.0, 1.0], "gravity": [[0.0, -9.81], [9.81, 0.0]]}
    tables = {
        "domain": {"size": [0.1, 0.1], "depth": 0.02} | turned,
        "particles": {"radius": 0.01, "density": 2500.0, "position": [[0.05, 0.0099], [0.05, 0.0297], [0.08, 0.05]]},
        "contact": {"young_modulus": 1e6, "speed": 1.0},
        "time": {"end": 0.01, "output_interval": 0.01},
    }
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    start = jaxdem.initial_state(scene, simulation, parameters)
    found = jax.eval_shape(lambda *given: contacts(simulation, *given), parameters, *start)
    assert found.walls.overlap.shape == (4, 3)
