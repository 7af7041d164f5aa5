"""Spheres on walls that are signed-distance functions, against closed forms of mechanics."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.particles.rolling import ConstantDirectionalTorque
from jaxdem.particles.surfaces import Cylinder, DistanceFunction, Plane, wedge
from tests.cases.tiers import tiered
from tests.cases.worlds import advance, batch, constants, track, world

RADIUS, DENSITY, MODULUS, POISSON, GRAVITY = 0.01, 2500.0, 1e7, 0.3, 9.81
MASS = DENSITY * 4 / 3 * np.pi * RADIUS**3
EFFECTIVE = MODULUS / (1 - POISSON**2)  # a rigid wall
STEP = 5e-5


def static_overlap(force):
    """Inverse of F = 4/3 E* sqrt(R) d^1.5."""
    return (0.75 * force / (EFFECTIVE * np.sqrt(RADIUS))) ** (2 / 3)


def on_surfaces(surfaces, position, velocity=None, *, rolling=None, walls=False, dtype=jnp.float64, **material):
    """One sphere on a rigid wall, under gravity along the last axis."""
    dimension = len(position)
    values = {"young_modulus": MODULUS, "restitution": 0.5, "friction": 0.5, "wall_young_modulus": np.inf}
    return world(
        [position], None if velocity is None else [velocity], radius=RADIUS, density=DENSITY, walls=walls,
        surfaces=surfaces, gravity=(*(0.0,) * (dimension - 1), -GRAVITY), rolling=rolling, dtype=dtype,
        material=constants(dtype, **(values | material)),
    )  # fmt: skip


# --- An inclined plane ---------------------------------------------------------------------------------

SLOPE = np.deg2rad(30.0)
DOWNHILL, UPWARD = np.array([np.cos(SLOPE), -np.sin(SLOPE)]), np.array([np.sin(SLOPE), np.cos(SLOPE)])


@pytest.fixture(scope="module")
def inclined():
    """Speeds downhill and spins of three spheres on a slope of 30 degrees: held by rolling friction, rolling,
    sliding."""
    start = np.array([0.3, 0.5])
    overlap = static_overlap(MASS * GRAVITY * np.cos(SLOPE))
    plane = Plane(tuple(start), tuple(2.0 * UPWARD))  # any length
    scenes = [
        on_surfaces(
            (plane,), start + (RADIUS - overlap) * UPWARD, rolling=ConstantDirectionalTorque(), friction=mu,
            rolling_friction=mu_r,
        )
        for mu, mu_r in ((1.0, 1.0), (0.5, 0.0), (0.1, 0.0))
    ]  # fmt: skip
    _, seen = track(batch(scenes), np.full(3, STEP), 40, 50)
    lift = (seen.position[:, :, 0] - start) @ UPWARD
    return (
        STEP * 50 * np.arange(1, 41),
        seen.velocity[:, :, 0] @ DOWNHILL,
        seen.spin[:, :, 0, 0],
        lift,
        overlap,
    )


def test_a_sphere_rests_below_the_friction_angle(inclined):
    """tan 30 = 0.58 is under both coefficients: it stays, but for the creep of CDT, 2.5 g sin(a) dt
    (docs/limits), where it would roll with 0.35 m/s; the springs load up in the first 0.03 s."""
    time, speed, _, lift, overlap = inclined
    assert np.abs(speed[0][time > 0.03]).max() < 3.0 * GRAVITY * np.sin(SLOPE) * STEP
    np.testing.assert_allclose(lift[:, -1], RADIUS - overlap, rtol=1e-9)


def test_a_sphere_rolls_down_without_rolling_friction(inclined):
    """a = 5/7 g sin(a) without slip, for mu > 2/7 tan(a); the arm r - d/2 for r changes that by 0.05 %."""
    time, speed, spin, _, _ = inclined
    late = time > 0.02
    np.testing.assert_allclose(np.polyfit(time[late], speed[1][late], 1)[0], 5 / 7 * GRAVITY * 0.5, rtol=1e-3)
    np.testing.assert_allclose(-spin[1][-1] * RADIUS, speed[1][-1], rtol=2e-3)


def test_a_sphere_slides_above_the_friction_angle(inclined):
    """mu = 0.1 < 2/7 tan(a): a = g (sin(a) - mu cos(a)), and 5/2 mu g cos(a) / r of spin."""
    time, speed, spin, _, overlap = inclined
    late = time > 0.02
    rate = np.polyfit(time[late], speed[2][late], 1)[0]
    np.testing.assert_allclose(rate, GRAVITY * (np.sin(SLOPE) - 0.1 * np.cos(SLOPE)), rtol=1e-6)
    turning = -np.polyfit(time[late], spin[2][late], 1)[0]
    arm = RADIUS - 0.5 * overlap
    np.testing.assert_allclose(turning, 2.5 * 0.1 * GRAVITY * np.cos(SLOPE) * arm / RADIUS**2, rtol=1e-6)


# --- A tube --------------------------------------------------------------------------------------------

TUBE = 0.1


@pytest.mark.parametrize("dimension", tiered([2, 3], first=[3]))
def test_a_sphere_rolls_to_and_fro_in_a_tube(dimension):
    """T = 2 pi sqrt(7 (R - r) / (5 g)) for small angles, rolling without slip.

    At 0.02 rad the amplitude adds 2.5e-5; the overlap d = 1.6e-3 r adds 1e-4 by the path R - r + d, and
    2e-4 by the arm r - d/2.
    """
    middle, angle = 0.5, 0.02
    ray = (TUBE - RADIUS + static_overlap(MASS * GRAVITY)) * np.array([np.sin(angle), -np.cos(angle)])
    center, axis = (middle,) * dimension, None if dimension == 2 else (0.0, 3.0, 0.0)
    start = middle + (ray if dimension == 2 else np.array([ray[0], 0.0, ray[1]]))
    _, seen = track(on_surfaces((Cylinder(center, TUBE, axis, True),), start), STEP, 420, 50)
    x, time = seen.position[:, 0, 0] - middle, STEP * 50 * np.arange(1, 421)
    before = np.flatnonzero(np.diff(np.sign(x)) != 0)
    crossing = time[before] - x[before] * STEP * 50 / (x[before + 1] - x[before])
    assert len(crossing) == 3
    expected = 2 * np.pi * np.sqrt(7 * (TUBE - RADIUS) / (5 * GRAVITY))
    np.testing.assert_allclose(crossing[2] - crossing[0], expected, rtol=5e-4)
    assert x.min() < -0.9 * ray[0]  # it loses little
    if dimension == 3:
        np.testing.assert_allclose(seen.position[:, 0, 1], middle, atol=1e-12)


def test_a_rod_carries_a_sphere_on_its_top():
    """Outside of a cylinder: at rest on the top, the overlap of its weight, R + r - d above the axis."""
    overlap = static_overlap(MASS * GRAVITY)
    start = (0.5, 0.5 + TUBE + RADIUS)
    scene = on_surfaces((Cylinder((0.5, 0.5), TUBE, None, False),), start, restitution=0.1)
    _, seen = track(scene, STEP, 1, 4000)
    np.testing.assert_allclose(0.5 + TUBE + RADIUS - seen.position[-1, 0, 1], overlap, rtol=1e-6)
    np.testing.assert_allclose(seen.force[-1, 0, 1], MASS * GRAVITY, rtol=0.05)  # a mean from the drop on


# --- A wedge -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("half_angle", tiered([20.0, 45.0, 70.0], first=[20.0]))
def test_a_ball_in_a_wedge_rests_on_both_planes(half_angle):
    """Either plane carries m g / (2 sin(half angle)): overlaps of that force by Hertz's law."""
    half = np.deg2rad(half_angle)
    apex, directions = (0.4, 0.3), ((-np.sin(half), np.cos(half)), (2 * np.sin(half), 2 * np.cos(half)))
    start = (0.4, 0.3 + RADIUS / np.sin(half))  # it touches both
    _, seen = track(on_surfaces(wedge(apex, directions), start, restitution=0.1, friction=0.0), STEP, 2, 4000)
    expected = static_overlap(MASS * GRAVITY / (2 * np.sin(half)))
    height = (seen.position[-1, 0, 1] - 0.3) * np.sin(half)
    np.testing.assert_allclose(RADIUS - height, expected, rtol=1e-6)
    np.testing.assert_allclose(seen.position[-1, 0, 0], 0.4, rtol=1e-12)
    np.testing.assert_allclose(seen.force[-1, 0], [0.0, MASS * GRAVITY], atol=1e-6 * MASS * GRAVITY)


# --- The sides of the box ------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", tiered([jnp.float32, jnp.float64], first=[jnp.float64]))
def test_planes_on_the_sides_of_the_box_do_what_the_sides_do(dtype):
    """A ball that is thrown into a corner, with spin and friction: the same numbers, bit for bit."""
    planes = (
        Plane((0.0, 0.3), (1.0, 0.0)), Plane((1.0, 0.0), (-2.0, 0.0)),
        Plane((0.7, 0.0), (0.0, 1.0)), Plane((0.0, 1.0), (0.0, -1.0)),
    )  # fmt: skip
    start, velocity = (0.97, 0.03), (1.3, -0.9)
    _, ours = track(on_surfaces(planes, start, velocity, dtype=dtype), STEP, 40, 20)
    _, box = track(on_surfaces((), start, velocity, walls=True, dtype=dtype), STEP, 40, 20)
    assert box.velocity[-1, 0, 0] < 0 < box.velocity[:, 0, 1].max()  # both walls were hit
    assert np.abs(box.spin).max() > 10
    for name in ("position", "velocity", "spin", "force"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(box, name))


# --- A function of the user's --------------------------------------------------------------------------

BOWL = 0.2


def inside_sphere(x):
    """Distance from the inside of a sphere of 0.2 m about (0.5, 0.5, 0.5)."""
    return BOWL - jnp.sqrt(jnp.sum((x - 0.5) ** 2))


def test_a_ball_circles_in_a_sphere_of_the_users():
    """Without friction at 30 degrees from the bottom: omega^2 = g / (L cos), L = R - r + d the pendulum's length.

    It stays at its height, and is where omega t says after more than half a turn.
    """
    angle = np.deg2rad(30.0)
    length = BOWL - RADIUS + static_overlap(MASS * GRAVITY / np.cos(angle))
    omega = np.sqrt(GRAVITY / (length * np.cos(angle)))
    start = 0.5 + length * np.array([np.sin(angle), 0.0, -np.cos(angle)])
    scene = on_surfaces(
        (DistanceFunction(inside_sphere),), start, (0.0, omega * length * np.sin(angle), 0.0), friction=0.0
    )
    _, seen = track(scene, STEP, 10, 1000)
    time = STEP * 1000 * np.arange(1, 11)
    turned = np.unwrap(np.arctan2(seen.position[:, 0, 1] - 0.5, seen.position[:, 0, 0] - 0.5))
    assert turned[-1] > np.pi
    np.testing.assert_allclose(turned, omega * time, rtol=1e-5)
    np.testing.assert_allclose(seen.position[:, 0, 2], start[2], atol=1e-7)


def test_walls_not_in_the_scene_are_not_in_the_program():
    """A plane beside the four sides makes arrays of five walls; without it there are none."""

    def program(surfaces):
        scene = on_surfaces(surfaces, (0.5, 0.5), walls=True)
        return jax.jit(lambda s: advance(scene._replace(state=s), STEP, 3).state).lower(scene.state).as_text()

    assert "tensor<5x1xf64>" in program((Plane((0.0, 0.0), (1.0, 1.0)),))
    assert "tensor<5x1xf64>" not in program(())


def test_gradients_through_a_bounce_in_a_tube():
    """Where a spinning ball is after it has hit the wall, by its starting velocity and the modulus: central
    differences."""
    scene = on_surfaces((Cylinder((0.5, 0.5), TUBE, None, True),), (0.5, 0.5 - TUBE + RADIUS + 1e-4), (0.3, -0.5))

    def end(velocity, modulus):
        start = scene._replace(
            state=scene.state._replace(velocity=velocity[None]),
            constants=scene.constants._replace(young_modulus=modulus),
        )
        state = advance(start, STEP, 60, reversible=True).state
        return jnp.sum(state.position * jnp.asarray([[1.0, 2.0]])) + 1e-3 * jnp.sum(state.angular_velocity)

    compiled = jax.jit(jax.value_and_grad(end, (0, 1)))
    velocity, modulus = scene.state.velocity[0], jnp.asarray(MODULUS)
    slopes = compiled(velocity, modulus)[1]
    for axis, step in ((0, jnp.asarray([1e-5, 0.0])), (1, jnp.asarray([0.0, 1e-5]))):
        ahead, behind = (compiled(velocity + sign * step, modulus)[0] for sign in (1, -1))
        np.testing.assert_allclose(slopes[0][axis], (ahead - behind) / 2e-5, rtol=1e-5)
    ahead, behind = (compiled(velocity, modulus * (1 + sign * 1e-4))[0] for sign in (1, -1))
    np.testing.assert_allclose(slopes[1], (ahead - behind) / (2e-4 * MODULUS), rtol=1e-4)
    assert advance(scene, STEP, 60).state.velocity[0, 1] > 0.1  # it has bounced
