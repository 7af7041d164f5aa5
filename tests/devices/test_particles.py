"""Particles in slabs against one device."""

import jax
import numpy as np
import pytest

import jaxdem
from jaxdem import devices


def scene_of(**changes):
    """Grains that fly and collide in a box, periodic along x."""
    tables = {
        "precision": "float64",
        "domain": {"size": [0.4, 0.1, 0.1], "gravity": [2.0, 0.0, -9.81]},
        "particles": {
            "count": 60,
            "radius": 0.01,
            "density": 2500.0,
            "pack": {"kind": "lattice", "start": [0, 0, 0], "stop": [0.4, 0.1, 0.1], "jitter": 0.003},
        },
        "contact": {"young_modulus": 1e6, "friction": 0.4, "restitution": 0.6},
        "boundary": {"left": {"kind": "periodic"}, "right": {"kind": "periodic"}},
        "time": {"end": 0.05, "output_interval": 0.005},
    }
    return jaxdem.load_scene(tables | changes)


def stirred(state, speed, seed=1):
    """The state with random velocities added."""
    particles = state.particles
    noise = np.random.default_rng(seed).normal(size=particles.velocity.shape)
    return state._replace(particles=particles._replace(velocity=particles.velocity + speed * noise))


def run(simulation, parameters, state, neighbors, steps):
    """After so many intervals."""
    step = jax.jit(lambda s, n: simulation.step(parameters, s, n))
    for _ in range(steps):
        state, neighbors, report = step(state, neighbors)
        assert not report.particles.overflow
    return state, neighbors, report


@pytest.mark.parametrize("number", [1, 2, 4])
def test_grains_that_change_slabs_move_as_on_one_device(number):
    scene = scene_of()
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    state = stirred(state, 0.5)
    divided, _ = jaxdem.build(scene, devices=number)
    apart, lists = devices.distributed(divided, parameters, state, neighbors)
    state, neighbors, report = run(simulation, parameters, state, neighbors, 20)
    apart, lists, same = run(divided, parameters, apart, lists, 20)
    whole, contacts = devices.gathered(divided, apart, lists)
    if number > 1:
        assert devices.counts(lists).migrations > 0
    for one, other in zip(jax.tree.leaves(whole.particles), jax.tree.leaves(state.particles), strict=False):
        if one.dtype == float and one.shape == other.shape:
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-11 * np.abs(other).max())
    np.testing.assert_allclose(same.particles.collision_force, report.particles.collision_force, rtol=1e-11)
