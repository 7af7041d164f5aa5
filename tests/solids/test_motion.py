"""Given motions of rigid bodies against closed forms, in single precision too."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.numerics import pair_arithmetic as pairs
from jaxdem.solids.motion import ActiveTime, Oscillation, RigidMotion, Rotation, Table, Translation, Uniform

AXIS = (1.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0)
SLIDE = Translation((0.0, 0.6, 0.8), Uniform(), ActiveTime(0.1, 5.0))
SWING = Rotation((0.1, 0.2, 0.3), AXIS, Oscillation())
TURN = Rotation((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), Table((0.0, 1.0, 2.0, 4.0)))
SOLID = RigidMotion((SWING, SLIDE, TURN))
OF_SOLID = (
    {"amplitude": 0.7, "frequency": 1.3, "phase": 0.4},
    {"rate": 0.9},
    {"values": np.array([0.0, 1.0, -1.0, 3.0])},
)
FLAT = RigidMotion((Rotation((0.2, 0.1), None, Uniform()), Translation((0.6, -0.8), Oscillation())))
OF_FLAT = ({"rate": -2.5}, {"amplitude": 0.05, "frequency": 3.0, "phase": -0.2})
MOTIONS = [(SOLID, OF_SOLID, [0.3, -0.4, 0.5]), (FLAT, OF_FLAT, [0.7, -0.3])]
TIMES = [0.05, 0.5, 1.5, 3.3, 4.5]


def numbers(given, dtype):
    return jax.tree.map(lambda x: jnp.asarray(x, dtype), given)


def split(values):
    leading = np.asarray(values, np.float32)
    return jnp.asarray(leading), jnp.asarray((np.asarray(values) - leading).astype(np.float32))


def double(pair):
    return np.asarray(pair[0], np.float64) + (0.0 if pair[1] is None else np.asarray(pair[1], np.float64))


@pytest.mark.parametrize(("motion", "given", "point"), MOTIONS)
def test_the_velocity_is_the_slope_of_the_position(motion, given, point):
    given, point = numbers(given, jnp.float64), jnp.asarray(point)

    @jax.jit
    def both(time):
        position = motion.at(given, (time, None)).position_of(point)[0]
        return position, jnp.stack(motion.at(given, (time, None)).velocity_at(tuple(position)))

    slope = jax.jit(jax.jacfwd(lambda time: both(time)[0]))
    for time in TIMES:
        np.testing.assert_allclose(both(time)[1], slope(time), atol=1e-10)


@pytest.mark.parametrize(("motion", "given", "point"), MOTIONS)
def test_to_the_body_and_back(motion, given, point):
    given = numbers(given, jnp.float64)

    @jax.jit
    def both(time, point):
        placed = motion.at(given, (time, None))
        place = placed.position_of(point)[0]
        return placed.to_body(tuple(place), (None,) * len(point))[0], placed.to_box(tuple(point))

    for time in TIMES:
        back, arrow = both(time, np.array(point))
        np.testing.assert_allclose(np.stack(back), point, atol=1e-14)
        np.testing.assert_allclose(np.linalg.norm(np.stack(arrow)), np.linalg.norm(point), rtol=1e-14)


def test_motions_on_top_of_each_other():
    """Turned by 90 degrees about the origin, then moved along x; and in the other order."""
    turn, slide = Rotation((0.0, 0.0), None, Uniform()), Translation((1.0, 0.0), Uniform())
    of_turn, of_slide = {"rate": jnp.asarray(0.5 * np.pi)}, {"rate": jnp.asarray(2.0)}
    now = (jnp.asarray(1.0), None)
    first = RigidMotion((turn, slide)).at((of_turn, of_slide), now)
    np.testing.assert_allclose(double(first.position_of(jnp.asarray([1.0, 0.0]))), [2.0, 1.0], atol=1e-15)
    other = RigidMotion((slide, turn)).at((of_slide, of_turn), now)
    np.testing.assert_allclose(double(other.position_of(jnp.asarray([1.0, 0.0]))), [0.0, 3.0], atol=1e-15)
    # The body of the first turns about its own centre, that of the other about the origin.
    np.testing.assert_allclose(np.stack(first.velocity_at((2.0, 0.0))), [2.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(np.stack(other.velocity_at((0.0, 2.0))), [-np.pi, 2.0], atol=1e-14)


def test_courses():
    def at(course, given, time):
        way, rate = course.at(numbers(given, jnp.float64), (jnp.asarray(time), None))
        return float(way[0]), float(rate)

    wave = {"amplitude": 0.2, "frequency": 5.0, "phase": 0.3}
    angle = 2.0 * np.pi * 5.0 * 0.37 + 0.3
    expected = 0.2 * np.sin(angle), 2.0 * np.pi * 5.0 * 0.2 * np.cos(angle)
    np.testing.assert_allclose(at(Oscillation(), wave, 0.37), expected, rtol=1e-12)
    table, values = Table((1.0, 2.0, 4.0)), {"values": np.array([0.5, 1.5, -0.5])}
    times = (0.5, 1.5, 3.0, 4.5)
    np.testing.assert_allclose([at(table, values, t) for t in times], [(0.5, 0), (1, 1), (0.5, -1), (-0.5, 0)])
    placed = Translation((1.0, 0.0), Uniform(), ActiveTime(1.0, 3.0))
    for time, way, speed in ((0.5, 0.0, 0.0), (2.0, 0.7, 0.7), (5.0, 1.4, 0.0)):
        found = placed.at({"rate": jnp.asarray(0.7)}, (jnp.asarray(time), None))
        np.testing.assert_allclose([found.shift[0], found.velocity[0]], [way, speed], atol=1e-15)


@pytest.mark.parametrize(("motion", "given", "point"), MOTIONS)
def test_single_precision_keeps_its_pairs(motion, given, point):
    """After an hour the placement is known to 1e-11 m, and not to the 1e-4 m that a float of the time resolves."""
    single = numbers(given, jnp.float32)
    exact = jax.tree.map(lambda x: np.asarray(x, np.float64), single)
    at = jax.jit(lambda high, low: motion.at(single, (high, low)))
    back = jax.jit(lambda placed, high, low: placed.to_body(tuple(high), tuple(low)))
    for time in [*TIMES, 3600.123456789]:
        high, low = split(time)
        now = double((high, low))
        reference = motion.at(exact, (np.float64(now), None))
        place = reference.position_of(split(point)[0].astype(np.float64))[0]
        found = at(high, low)
        np.testing.assert_allclose(double(found.position_of(split(point)[0])), place, atol=1e-11)
        body = back(found, *split(place))
        np.testing.assert_allclose(sum(np.asarray(part, np.float64) for part in body), split(point)[0], atol=1e-11)
        np.testing.assert_allclose(found.velocity, reference.velocity, atol=2e-5)


def test_derivatives_by_amplitude_frequency_and_rate():
    """Against those of the closed form; in single precision they go through the pairs."""
    motion = RigidMotion((Rotation((0.0, 0.0), None, Uniform()), Translation((1.0, 0.0), Oscillation())))
    time = 0.37

    def place(own, dtype):
        clock = pairs.as_pair(jnp.asarray(time, dtype))
        return motion.at(own, clock).position_of(jnp.asarray([0.0, 1.0], dtype))[0][0]

    def closed(own):
        wave, turn = own[1], own[0]
        angle = 2.0 * jnp.pi * wave["frequency"] * time + wave["phase"]
        return -jnp.sin(turn["rate"] * time) + wave["amplitude"] * jnp.sin(angle)

    given = ({"rate": 0.7}, {"amplitude": 0.05, "frequency": 3.0, "phase": -0.2})
    expected = jax.tree.leaves(jax.jit(jax.grad(closed))(numbers(given, jnp.float64)))
    for dtype, tolerance in ((jnp.float64, 1e-12), (jnp.float32, 3e-6)):
        found = jax.tree.leaves(jax.jit(jax.grad(place), static_argnums=1)(numbers(given, dtype), dtype))
        np.testing.assert_allclose(found, expected, rtol=tolerance)


def test_sine_and_cosine_of_pairs():
    turns = np.random.default_rng(0).uniform(-50.0, 50.0, 500)
    high, low = split(turns)
    sine, cosine = jax.jit(lambda *parts: pairs.sine_and_cosine(parts))(high, low)
    angle = 2.0 * np.pi * double((high, low))
    np.testing.assert_allclose(double(sine), np.sin(angle), atol=1e-13)
    np.testing.assert_allclose(double(cosine), np.cos(angle), atol=1e-13)
