"""Rolling friction and the friction of the box's walls, against closed forms."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.particles import tangent
from jaxdem.particles.rolling import ConstantDirectionalTorque
from tests.cases.tiers import tiered
from tests.cases.worlds import batch, constants, track, world

RADIUS, DENSITY, MODULUS, POISSON, GRAVITY = 0.01, 2500.0, 1e7, 0.3, 9.81
MASS = DENSITY * 4 / 3 * np.pi * RADIUS**3
EFFECTIVE = MODULUS / (1 - POISSON**2)  # a rigid wall
SHEAR = MODULUS / (2 * (1 + POISSON)) / (2 - POISSON)


def static_overlap(force):
    """Inverse of F = 4/3 E* sqrt(R) d^1.5."""
    return (0.75 * force / (EFFECTIVE * np.sqrt(RADIUS))) ** (2 / 3)


# --- Rolling -------------------------------------------------------------------------------------------

SPEED, TIME_STEP, FRAMES, EVERY = 0.05, 5e-5, 100, 50


def rolling_sphere(coefficient, model):
    """A sphere that rolls without slip on the floor, at its static overlap."""
    height = RADIUS - static_overlap(MASS * GRAVITY)
    arm = RADIUS - 0.5 * static_overlap(MASS * GRAVITY)
    return world(
        [[0.5, height]], [[SPEED, 0.0]], [[-SPEED / arm]], radius=RADIUS, density=DENSITY,
        periodic=(True, False), gravity=(0.0, -GRAVITY), rolling=model,
        material=constants(
            young_modulus=MODULUS, restitution=0.5, friction=0.5, rolling_friction=coefficient,
            wall_young_modulus=np.inf,
        ),
    )  # fmt: skip


@pytest.fixture(scope="module")
def rolling():
    """Rolling at mu_r = 0.02 and 0.05, in one program: (B, frames) speed and spin, and the time."""
    values = (0.02, 0.05)
    scenes = [rolling_sphere(value, ConstantDirectionalTorque()) for value in values]
    _, seen = track(batch(scenes), np.full(len(values), TIME_STEP), FRAMES, EVERY)
    time = TIME_STEP * EVERY * np.arange(1, FRAMES + 1)
    return values, time, seen.velocity[:, :, 0, 0], seen.spin[:, :, 0, 0]


def test_rolling_friction_decelerates_at_the_closed_form_rate(rolling):
    """a = 5/7 mu_r g for a sphere that rolls without slip under the torque T = mu_r F R.

    m a = f and 2/5 m r^2 (a / r) = T - f r give 7/5 m a = T / r; R* = r here. The arm r - d/2 instead of
    r, d/r = 1.6e-3, changes that by under 0.2 %.
    """
    values, time, speed, _ = rolling
    for k, value in enumerate(values):
        moving = (speed[k] > 0.2 * SPEED) & (time > 0.01)
        rate = -np.polyfit(time[moving], speed[k][moving], 1)[0]
        np.testing.assert_allclose(rate, 5 / 7 * value * GRAVITY, rtol=3e-3)


def test_rolling_comes_to_rest_without_chatter(rolling):
    """At mu_r = 0.05 the sphere stops at v / a = 0.143 s; afterwards the torque does not kick it about.

    What is left is the rocking on the tangential spring, damped: under 1 % of the speed at once, 1e-3 at the
    end.
    """
    _, time, speed, spin = rolling
    rest = time > 1.05 * SPEED / (5 / 7 * 0.05 * GRAVITY)
    assert rest.sum() > 20
    assert np.abs(speed[1][rest]).max() < 1e-2 * SPEED
    assert np.abs(speed[1][-5:]).max() < 1e-3 * SPEED
    assert np.abs(spin[1][-5:]).max() < 1e-3 * SPEED / RADIUS


@pytest.mark.parametrize("dimension", tiered([2, 3], first=[3]))
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_a_sphere_in_a_corner_comes_to_rest(dimension, friction):
    """Two or three walls press on it, each with a torque that would stop it; together they must not turn it the other
    way."""
    depth = static_overlap(MASS * GRAVITY)
    scene = world(
        [[RADIUS - depth] * dimension], None, [[1e-6] * (1 if dimension == 2 else 3)], radius=RADIUS, density=DENSITY,
        gravity=(-GRAVITY,) * dimension, rolling=ConstantDirectionalTorque(),
        material=constants(
            young_modulus=MODULUS, restitution=0.5, friction=friction, rolling_friction=0.1, wall_young_modulus=np.inf,
        ),
    )  # fmt: skip
    _, seen = track(scene, TIME_STEP, 20, 100)
    assert np.abs(seen.spin).max() < 1e-6 and np.abs(seen.spin[-1]).max() < 1e-9


def test_a_floor_that_moves_takes_a_sphere_along():
    """It slides under mu g up to 2/7 of the floor's speed, where it rolls: mu g t = U - 7/2 v; with a scene of no
    fluid."""
    scene = jaxdem.load_scene(
        dict(
            precision="float64",
            domain=dict(size=[1.0, 0.2]),
            particles=dict(radius=0.01, density=2500.0, position=[[0.2, 0.01]]),
            contact=dict(young_modulus=1e7, friction=0.5, restitution=0.5),
            boundary=dict(bottom=dict(kind="moving_wall", velocity=[1.0, 0.0])),
            time=dict(end=0.1, output_interval=0.01),
        )
    )
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    step = jax.jit(lambda s, n: simulation.step(parameters, s, n)[:2])
    speeds = []
    for _ in range(10):
        state, neighbors = step(state, neighbors)
        speeds.append(float(state.particles.velocity[0, 0]))
    # Slides for 58 ms; the floor is not hard: it sinks in by 1e-4 m.
    assert speeds[2] == pytest.approx(0.5 * 9.81 * 0.03, rel=0.02)
    assert speeds[9] == pytest.approx(2.0 / 7.0, rel=0.01)


def test_without_rolling_friction_it_rolls_on():
    """Negative control, and a law of its own: rolling without slip goes on for ever at the same speed."""
    _, seen = track(rolling_sphere(0.05, None), TIME_STEP, FRAMES, EVERY)
    # The list of forces is at rest from the start but for round-off in the static overlap.
    np.testing.assert_allclose(seen.velocity[:, 0, 0], SPEED, rtol=1e-6)


# --- A sphere between two walls ------------------------------------------------------------------------

SQUEEZE = 2e-5
"""Overlap with either wall [m]."""


def squeezed(friction):
    """A sphere held by friction between the left and the right wall, that gravity pulls down.

    The two friction forces have no torque together, so it cannot roll: a block.
    """
    return world(
        [[RADIUS - SQUEEZE, 0.5]], radius=RADIUS, density=DENSITY, box=(2 * (RADIUS - SQUEEZE), 1.0),
        gravity=(0.0, -GRAVITY),
        material=constants(
            young_modulus=MODULUS, restitution=0.5, friction=friction, wall_young_modulus=np.inf
        ),
    )  # fmt: skip


NORMAL = 4 / 3 * EFFECTIVE * np.sqrt(RADIUS) * SQUEEZE**1.5
NEEDED = MASS * GRAVITY / (2 * NORMAL)  # the coefficient at which friction just carries the weight


def test_block_between_walls_sticks_or_slides():
    """Above mu = m g / (2 F_n) it hangs at m g / (2 S_t) below, below it falls with g - 2 mu F_n / m.

    S_t = 8 G* sqrt(R d) of either wall: both keep a spring of their own.
    """
    factors = np.array([0.3, 0.7, 0.95, 1.05, 1.5, 4.0])
    scenes = [squeezed(factor * NEEDED) for factor in factors]
    _, seen = track(batch(scenes), np.full(6, TIME_STEP), 40, 50)
    time = TIME_STEP * 50 * np.arange(1, 41)
    fallen = 0.5 - seen.position[:, :, 0, 1]
    assert np.abs(seen.spin).max() < 1e-9  # the two torques cancel to round-off
    hanging = MASS * GRAVITY / (2 * 8 * SHEAR * np.sqrt(RADIUS * SQUEEZE))
    for k, factor in enumerate(factors):
        if factor < 1:
            # The springs load up at first; from then on a constant force. Overlaps and time are exact to
            # round-off.
            late = time > 0.02
            rate = -np.polyfit(time[late], seen.velocity[k, late, 0, 1], 1)[0]
            np.testing.assert_allclose(rate, (1 - factor) * GRAVITY, rtol=1e-9)
        elif factor > 1.1:
            # Damped to 1e-4 within 0.1 s; at 1.05 the first swing overshoots and slips once, and then it
            # hangs.
            np.testing.assert_allclose(fallen[k, -1], hanging, rtol=1e-3)
        if factor > 1:
            assert np.abs(seen.velocity[k, -1]).max() < 1e-5


def test_walls_without_memory_let_it_creep(monkeypatch):
    """Negative control: with the springs forgotten at every step the block at mu = 4 m g / (2 F_n) sinks."""
    monkeypatch.setattr(tangent, "turned_into_plane", lambda spring, normal: tuple(jnp.zeros_like(x) for x in spring))
    _, seen = track(squeezed(4 * NEEDED), TIME_STEP, 40, 50)
    assert seen.velocity[-1, 0, 1] < -1e-3
