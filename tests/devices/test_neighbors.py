"""A closure of neighbours, which looks farther than contacts reach, on several devices against one device."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem import InputError, devices
from jaxdem.closures import NeighborClosure
from jaxdem.closures.moments import MomentBasis
from jaxdem.closures.neighbor_level import Width
from jaxdem.coupling.far_ghosts import FarGhosts
from jaxdem.devices.mesh import SAME, SLABS, STATE, on_slabs
from tests.cases.tiers import COMBINATION

D, SIZE, COUNT = 0.01, np.array([16.0, 6.0, 6.0]), 130
"""Diameter [m], box in diameters, number of spheres: solid fraction 0.12."""


def places():
    """Centres in diameters of spheres that do not overlap in the periodic box."""
    generator, found = np.random.default_rng(4), np.zeros((0, 3))
    while len(found) < COUNT:
        one = generator.uniform(0.0, SIZE)
        apart = found - one
        apart -= SIZE * np.round(apart / SIZE)
        if (np.sum(apart**2, axis=1) > 1.0).all():
            found = np.vstack([found, one])
    return found


def scene(**changes):
    """Spheres that fall through a liquid, some of them across borders."""
    tables = dict(
        precision="float64",
        domain=dict(size=(SIZE * D).tolist(), gravity=[0.0, -9.81, 0.0]),
        particles=dict(
            radius=D / 2, density=2500.0, position=(places() * D).tolist(), velocity=[[0.8, 0.1, 0.0]] * COUNT
        ),
        contact=dict(young_modulus=2e5, friction=0.0, speed=0.5),
        fluid=dict(cells=[8, 4, 4], viscosity=4e-4, density=1000.0, time_step=0.002),
        boundary={side: dict(kind="periodic") for side in ("left", "right", "bottom", "top", "front", "back")},
        coupling=dict(interval=0.002, kernel_width=dict(diameters=0.5, cells=0.5)),
        closure=dict(hold=2),
        time=dict(end=0.1, output_interval=0.1),
    )
    return jaxdem.load_scene(tables, changes)


@pytest.fixture(scope="module")
def closure():
    """Two levels with random weights, and a scatter as in the data."""
    sizes = [Width(5, 3, (6,))] * 2
    found = NeighborClosure.initial(MomentBasis(2.6, 4, 3, 3), MomentBasis(2.2, 3, 3, 2), sizes, seed=2)
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float64), found)


def effect(simulation, parameters, state):
    """Force across the slip, torque and multiple of the drag, of spheres that have moved by 0.4 diameters: some stand
    outside of their slab."""
    coupling, particles = simulation.coupling, state.particles
    moved = particles._replace(position=particles.position + jnp.array([[0.4 * D, 0.0, 0.0]]))
    mixture = parameters.mixture
    sampled = coupling.sample(mixture, state.fluid, moved)
    start = coupling.start(mixture, state.fluid, moved, sampled)
    found = coupling.drag.neighbors(mixture.closure, mixture.drag_scale, start, sampled.law_inputs)
    return jnp.concatenate([found.across / 1e-6, found.torque / 1e-9, found.multiple[:, None]], axis=1)


@pytest.fixture(scope="module")
def alone(closure):
    """The start on one device, and the effect of the neighbours there."""
    simulation, parameters = jaxdem.build(scene(), closure=closure)
    state, lists = jaxdem.initial_state(scene(), simulation, parameters)
    expected = jax.jit(lambda *given: effect(simulation, *given))(parameters, state)
    return parameters, (state, lists), np.asarray(expected)


def in_slabs(closure, alone, number):
    """Largest difference of the effect from that on one device, over its size there."""
    parameters, start, expected = alone
    divided, _ = jaxdem.build(scene(), closure=closure, devices=number)
    slabs, _ = devices.distributed(divided, parameters, *start)
    one = divided.of_slab()
    program = jax.jit(on_slabs(divided.mesh, lambda *given: effect(one, *given), (SAME, STATE), SLABS))
    found, identity = (np.asarray(x) for x in (program(parameters, slabs), slabs.particles.identity))
    there = identity >= 0
    size = np.abs(expected).max(axis=0)
    return np.max(np.abs(found[there] - expected[identity[there]]) / size)


def test_neighbours_beyond_a_border_are_seen(closure, alone):
    """In a box that is periodic along the axis that is cut, on four devices: force and torque as on one device."""
    assert in_slabs(closure, alone, 4) < 1e-11


def test_forces_on_ghosts_matter(closure, alone, monkeypatch):
    """With ghosts whose own force is forgotten, which the second level sees, force and torque are others."""
    spread = FarGhosts.spread
    monkeypatch.setattr(FarGhosts, "spread", lambda self, own: spread(self, 0.0 * own))
    assert in_slabs(closure, alone, 4) > 1e-3


@COMBINATION
def test_a_run_is_that_of_one_device(closure, alone):
    """Six intervals on two devices, with forces held for two and grains that change slabs."""
    parameters, (state, lists), _ = alone
    divided, _ = jaxdem.build(scene(), closure=closure, devices=2)
    rows, listed = devices.distributed(divided, parameters, state, lists)
    one, many = jax.jit(divided.undivided().step), jax.jit(divided.step)
    assert "all_gather" not in many.lower(parameters, rows, listed).as_text()
    for _ in range(6):
        state, lists, alone_report = one(parameters, state, lists)
        rows, listed, report = many(parameters, rows, listed)
        assert not report.particles.overflow and not alone_report.particles.overflow
    whole, _ = devices.gathered(divided, rows, listed)
    assert devices.counts(listed).migrations > 0
    for name in ("velocity", "angular_velocity", "fluid_force"):
        found, expected = (np.asarray(getattr(particles, name)) for particles in (whole.particles, state.particles))
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


def test_slabs_narrower_than_the_reach_are_refused(closure):
    wide = dataclasses.replace(closure, basis=MomentBasis(2.9, 4, 3, 3))
    tables = {
        "domain.size": [12 * D, 6 * D, 6 * D],
        "fluid.cells": [8, 4, 4],
        "particles.position": [[0.01, 0.01, 0.01]],
    }
    with pytest.raises(InputError) as refused:
        jaxdem.build(scene(**tables), closure=wide, devices=4)
    for word in ("along x slabs of 0.03 m", "0.039 m within which closure.file sees neighbours", "Use 2 devices"):
        assert word in str(refused.value)
