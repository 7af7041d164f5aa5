"""Which particle the message of a failed interval names, and what it says pushed."""

from __future__ import annotations

import jax.numpy as jnp
import pytest

from jaxdem import build, initial_state, load_scene
from jaxdem.failures import Failure
from jaxdem.run.diagnosis import diagnosis

SCENE = {
    "precision": "float64",
    "domain": {"size": [0.4, 0.4]},
    "particles": {"radius": 0.01, "density": 2650.0, "position": [[0.1, 0.1], [0.2, 0.2], [0.3, 0.3]]},
    "contact": {"young_modulus": 5e6},
    "boundary": {"right": {"particles": "remove"}},
    "time": {"end": 0.01, "output_interval": 0.01},
}


@pytest.fixture(scope="module")
def world():
    scene = load_scene(SCENE)
    simulation, parameters = build(scene)
    return simulation, parameters, initial_state(scene, simulation, parameters)[0]


def told(world, code, **changes):
    simulation, parameters, state = world
    values = {key: jnp.asarray(value) for key, value in changes.items()}
    reached = state._replace(particles=state.particles._replace(**values))
    return diagnosis(simulation, parameters, int(code), state, reached)


def test_too_fast_names_the_fast_one_and_not_one_that_has_been_removed(world):
    """The first has left through its exit, and stands where it left; the third is too fast."""
    outside = [[0.5, 0.1], [0.2, 0.2], [0.3, 0.3]]
    velocity = [[0.0, 0.0], [1.0, 0.0], [0.0, 300.0]]
    reason, where, remedy = told(
        world, Failure.TOO_FAST, position=outside, velocity=velocity, active=[False, True, True]
    )
    assert "so fast" in reason and where.startswith("particle 2, last at (0.3, 0.3) m, at 300 m/s; the limit is")
    assert "contact.speed" in remedy


def test_a_lost_particle_is_the_one_outside_and_its_side_is_named(world):
    position, velocity = [[0.1, 0.1], [0.2, 0.401], [0.3, 0.3]], [[0.0, 9.0], [0.0, 1.5], [0.0, 0.0]]
    both = Failure.PARTICLE_LOST | Failure.TOO_FAST
    reason, where, remedy = told(world, both, position=position, velocity=velocity)
    assert "left the box" in reason
    assert where == "particle 1, last at (0.2, 0.2) m, through the top side at 1.5 m/s"
    assert "contact.speed" in remedy


def test_the_message_says_that_the_fluid_pushed_and_what_to_stiffen(world):
    """30 times the weight: 30 x 4/3 pi (0.01 m)^3 x 2650 kg/m3 x 9.81 m/s2 = 3.267 N upwards."""
    position = [[0.1, 0.1], [0.2, 0.401], [0.3, 0.3]]
    force = [[0.0, 0.0], [0.0, 3.2667], [0.0, 0.0]]
    _, where, remedy = told(world, Failure.PARTICLE_LOST, position=position, fluid_force=force)
    assert "the fluid pushes it out with 30 times its weight" in where
    assert "contact.young_modulus" in remedy and "contact.speed" in remedy


def test_a_particle_that_is_not_a_number_is_named(world):
    spin = [[0.0], [0.0], [float("nan")]]
    assert "particle 2" in told(world, Failure.PARTICLES_NOT_FINITE, angular_velocity=spin)[1]
