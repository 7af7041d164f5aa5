"""The rolling spring (EPSD): rest on a slope, rolling beyond its limit, and the rocking of a grain."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.particles.rolling import ConstantDirectionalTorque, ElasticPlasticSpringDashpot
from tests.cases.tiers import tiered
from tests.cases.worlds import batch, constants, track, world

RADIUS, DENSITY, MODULUS, POISSON, GRAVITY = 0.01, 2500.0, 1e7, 0.3, 9.81
MASS = DENSITY * 4 / 3 * np.pi * RADIUS**3
EFFECTIVE = MODULUS / (1 - POISSON**2)  # a rigid wall
SHEAR = MODULUS / (2 * (1 + POISSON)) / (2 - POISSON)
ROLLING, TIME_STEP = 0.2, 5e-5


def static_overlap(force):
    """Inverse of F = 4/3 E* sqrt(R) d^1.5."""
    return (0.75 * force / (EFFECTIVE * np.sqrt(RADIUS))) ** (2 / 3)


def on_slope(slope, model=None, dimension=2, **material):
    """A sphere at rest on a floor tilted by atan(slope), in the frame of the floor."""
    along, across = GRAVITY * np.sin(np.arctan(slope)), GRAVITY * np.cos(np.arctan(slope))
    between = (0.1,) * (dimension - 2)
    position = [[0.5, *between, RADIUS - static_overlap(MASS * across)]]
    given = dict(restitution=0.5, friction=5.0, rolling_friction=ROLLING) | material
    return world(
        position, radius=RADIUS, density=DENSITY, box=(1.0, *(0.2 for _ in between), 0.2),
        periodic=(True,) * (dimension - 1) + (False,), gravity=(along, *(0.0 for _ in between), -across),
        rolling=model or ElasticPlasticSpringDashpot(),
        material=constants(young_modulus=MODULUS, wall_young_modulus=np.inf, **given),
    )  # fmt: skip


def stiffness(slope):
    """Tangential and rolling spring at the static overlap, and the arm."""
    force = MASS * GRAVITY * np.cos(np.arctan(slope))
    overlap = static_overlap(force)
    rolling = 2.25 * (ROLLING * RADIUS) ** 2 * force / overlap
    return 8 * SHEAR * np.sqrt(RADIUS * overlap), rolling, RADIUS - 0.5 * overlap


@pytest.mark.parametrize("dimension", tiered([2, 3], first=[3]))
def test_rests_on_a_slope_below_its_limit(dimension):
    """tan(a) = 0.08 and 0.18 < mu_r = 0.2: at rest, displaced by both springs, m g_t (1/S_t + arm^2/k_r).

    The load comes on at once and overshoots by up to itself: at 0.18 beyond the limit, so that the spring
    yields, and the sphere comes to rest further on.
    """
    slopes = np.array([0.08, 0.18])
    scenes = batch([on_slope(slope, dimension=dimension) for slope in slopes])
    _, seen = track(scenes, np.full(2, TIME_STEP), 40, 500)
    assert np.abs(seen.velocity[:, -1]).max() < 1e-8
    force = MASS * GRAVITY * np.sin(np.arctan(slopes))
    springs = [stiffness(slope) for slope in slopes]
    expected = [f * (1 / sliding + arm**2 / k) for f, (sliding, k, arm) in zip(force, springs, strict=True)]
    moved = seen.position[:, -1, 0, 0] - 0.5
    np.testing.assert_allclose(moved[0], expected[0], rtol=1e-3)
    assert moved[1] > 1.1 * expected[1]


def test_without_the_spring_it_creeps():
    """Negative control: under the constant directional torque the same sphere keeps moving."""
    _, seen = track(on_slope(0.15, ConstantDirectionalTorque()), TIME_STEP, 40, 500)
    assert seen.velocity[-1, 0, 0] > 1e-5


def test_rolls_down_a_slope_above_its_limit():
    """a = 5/7 g (sin a - mu_r cos a) at tan(a) = 0.3 and 0.5; the arm r - d/2 for r changes it by 0.1 %."""
    slopes = np.array([0.3, 0.5])
    _, seen = track(batch([on_slope(slope) for slope in slopes]), np.full(2, TIME_STEP), 20, 100)
    time = TIME_STEP * 100 * np.arange(1, 21)
    angle = np.arctan(slopes)
    expected = 5 / 7 * GRAVITY * (np.sin(angle) - ROLLING * np.cos(angle))
    rate = np.polyfit(time[5:], seen.velocity[:, 5:, 0, 0].T, 1)[0]
    np.testing.assert_allclose(rate, expected, rtol=3e-3)


def test_rocks_at_the_frequency_of_its_springs():
    """Two degrees of freedom, x and the angle, on the tangential and the rolling spring: the lower frequency.

    Without damping, and at an amplitude under the limit. Position Verlet at 1/70 of the shorter period.
    """
    scene = on_slope(0.0, restitution=1.0, rolling_damping=0.0)
    sliding, rolling, arm = stiffness(0.0)
    stiff = np.array([[sliding, sliding * arm], [sliding * arm, sliding * arm**2 + rolling]])
    inertia = np.array([MASS, 0.4 * MASS * RADIUS**2])
    values, vectors = np.linalg.eigh(stiff / np.sqrt(np.outer(inertia, inertia)))
    period, mode = 2 * np.pi / np.sqrt(values[0]), vectors[:, 0] / np.sqrt(inertia)
    start = 1e-5 * mode / abs(mode[0])
    scene = scene._replace(
        state=scene.state._replace(
            velocity=scene.state.velocity.at[0, 0].set(start[0]),
            angular_velocity=scene.state.angular_velocity.at[0, 0].set(start[1]),
        )
    )
    _, seen = track(scene, TIME_STEP, 400, 10)
    time, speed = TIME_STEP * 10 * np.arange(1, 401), seen.velocity[:, 0, 0]
    assert np.abs(speed).max() < 1.05e-5
    down = np.nonzero((speed[:-1] > 0) & (speed[1:] <= 0))[0]
    crossings = time[down] + (time[1] - time[0]) * speed[down] / (speed[down] - speed[down + 1])
    assert len(crossings) > 5
    np.testing.assert_allclose(np.diff(crossings).mean(), period, rtol=3e-3)


def test_a_ball_set_spinning_loses_more_than_the_constant_torque_takes():
    """On a floor without sliding friction: w = w0 - mu_r R F t / I, less what the dashpot takes until the spring
    yields.

    The spring yields at the angle limit / k_r; the impulse of the dashpot until then is C_r times that,
    4/3 eta sqrt(7/5 m r^2 F d) whatever w0, 1.5 rad/s here, and the spring's own torque is on average half of its
    limit.
    """
    start, steps, time_step = 20.0, 2000, 5e-6
    scene = on_slope(0.0, friction=0.0, rolling_damping=0.3)
    scene = scene._replace(state=scene.state._replace(angular_velocity=jnp.full((1, 1), start)))
    _, seen = track(scene, time_step, 1, steps)
    weight, inertia = MASS * GRAVITY, 0.4 * MASS * RADIUS**2
    limit, (_, spring, _) = ROLLING * RADIUS * weight, stiffness(0.0)
    taken = 4 / 3 * 0.3 * np.sqrt(1.4 * MASS * RADIUS**2 * weight * static_overlap(weight)) / inertia
    not_yet = 0.5 * limit * (limit / spring / start) / inertia
    constant = start - limit * steps * time_step / inertia
    assert 0.07 * start < taken < 0.08 * start
    np.testing.assert_allclose(seen.spin[-1, 0, 0], constant - taken + not_yet, atol=0.02 * taken)
