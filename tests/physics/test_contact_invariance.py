"""What must not change the motion: order, place, orientation, handedness, and a third dimension."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.cases.worlds import batch, constants, track, world

SIDE, FRAMES, EVERY, STEP = 0.5, 20, 100, 2e-5
# Discs of 0.3 to 1 cm that fall on each other and on the floor, with spin: a few collisions each.
RADIUS = np.array([0.01, 0.008, 0.01, 0.003, 0.007])
DENSITY = np.array([2500.0, 1000.0, 2500.0, 7000.0, 2000.0])
POSITION = np.array([[0.10, 0.0101], [0.122, 0.010], [0.111, 0.031], [0.095, 0.027], [0.13, 0.028]])
VELOCITY = np.array([[0.3, -0.1], [-0.4, 0.0], [0.1, -0.6], [0.2, -0.5], [-0.3, -0.4]])
SPIN = np.array([[10.0], [-20.0], [5.0], [0.0], [30.0]])
MATERIAL = constants(young_modulus=5e6, restitution=0.7, friction=0.4)
GRAVITY = np.array([0.0, -9.81])

# Different orders of summation and other rounding of x: 1e-16 of 0.5 m, grown by tens in each of the three
# or four collisions of a particle (measured 8e-12 m). A contact of 1 ms turns an error of place into one of
# velocity 3e3 times as large, and that into one of spin by 2.5 / r of the smallest disc, some 1e3 times.
TOLERANCE = 1e-10


def scene(position, velocity, spin, gravity=GRAVITY, radius=RADIUS, density=DENSITY, periodic=None):
    return world(
        position, velocity, spin, radius=radius, density=density, box=(SIDE,) * position.shape[1],
        gravity=gravity, rebuild=False, material=MATERIAL, periodic=periodic,
    )  # fmt: skip


ORDER = np.array([3, 0, 4, 2, 1])
TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])  # rows times this: (x, y) -> (-y, x)


@pytest.fixture(scope="module")
def runs():
    """The same scene as it is, in another order, further right, turned by 90 degrees, and mirrored; one
    program."""
    middle = SIDE / 2
    mirror = np.array([-1.0, 1.0])
    variants = {
        "plain": scene(POSITION, VELOCITY, SPIN),
        "permuted": scene(
            POSITION[ORDER], VELOCITY[ORDER], SPIN[ORDER], radius=RADIUS[ORDER], density=DENSITY[ORDER]
        ),
        "shifted": scene(POSITION + np.array([0.2, 0.0]), VELOCITY, SPIN),
        "turned": scene((POSITION - middle) @ TURN + middle, VELOCITY @ TURN, SPIN, GRAVITY @ TURN),
        "mirrored": scene((POSITION - middle) * mirror + middle, VELOCITY * mirror, -SPIN),
    }
    _, seen = track(batch(list(variants.values())), np.full(len(variants), STEP), FRAMES, EVERY)
    return {name: type(seen)(*(field[number] for field in seen)) for number, name in enumerate(variants)}


def check(plain, position, velocity, spin):
    np.testing.assert_allclose(position, plain.position, rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(velocity, plain.velocity, rtol=0, atol=1e3 * TOLERANCE)
    np.testing.assert_allclose(spin, plain.spin, rtol=0, atol=1e5 * TOLERANCE)


def test_the_scene_has_contacts(runs):
    """Otherwise nothing below is tested: every disc is hit, and friction turns it."""
    plain = runs["plain"]
    assert (np.abs(plain.force).max(axis=(0, 2)) > 1e-3).all()
    assert (np.ptp(plain.spin, axis=0) > 1.0).all()


def test_order(runs):
    """Particles in another order move the same."""
    there, back = runs["permuted"], np.argsort(ORDER)
    check(runs["plain"], there.position[:, back], there.velocity[:, back], there.spin[:, back])


def test_translation(runs):
    """0.2 m further along the floor everything is the same."""
    there = runs["shifted"]
    check(runs["plain"], there.position - np.array([0.2, 0.0]), there.velocity, there.spin)


def test_rotation(runs):
    """Scene and gravity turned by 90 degrees: another wall is the floor."""
    there, middle = runs["turned"], SIDE / 2
    check(runs["plain"], (there.position - middle) @ TURN.T + middle, there.velocity @ TURN.T, there.spin)


def test_reflection(runs):
    """Left and right exchanged: spins change sign."""
    there = runs["mirrored"]
    mirror = np.array([-1.0, 1.0])
    position = (there.position - SIDE / 2) * mirror + SIDE / 2
    check(runs["plain"], position, there.velocity * mirror, -there.spin)


def test_discs_move_like_a_layer_of_spheres(runs):
    """2-D against spheres in the plane y = 0.25 m of a 3-D box: the same motion, and nothing out of the
    plane.

    The 2-D spin runs from x to z, which is about -y.
    """
    lift = lambda rows: np.insert(rows, 1, 0.0, axis=1)  # noqa: E731
    spin = np.zeros((5, 3))
    spin[:, 1] = -SPIN[:, 0]
    # Periodic across: the side walls are out of reach, and need not be compiled.
    layer = scene(
        lift(POSITION) + np.array([0, 0.25, 0]), lift(VELOCITY), spin, np.array([0, 0, -9.81]),
        periodic=(True, True, False),
    )  # fmt: skip
    _, seen = track(layer, STEP, FRAMES, EVERY)
    check(runs["plain"], seen.position[..., [0, 2]], seen.velocity[..., [0, 2]], -seen.spin[..., 1:2])
    np.testing.assert_array_equal(seen.position[..., 1], 0.25)
    np.testing.assert_array_equal(seen.spin[..., [0, 2]], 0.0)


@pytest.mark.parametrize("restitution", [1.0, 0.6])
def test_head_on_with_size_ratio_ten(restitution):
    """Radii 10 and 1 mm, densities 1000 and 5000: velocities after by momentum and restitution [1e-3].

    And the peak force of Hertz with R*, m* for the elastic case. Steps of t_H/100.
    """
    radius, density = np.array([0.01, 0.001]), np.array([1000.0, 5000.0])
    mass = density * 4 / 3 * np.pi * radius**3
    reduced, curvature = mass.prod() / mass.sum(), radius.prod() / radius.sum()
    modulus, speed = 5e6 / (2 * (1 - 0.3**2)), 0.5
    step = 2.868 * (reduced**2 / (curvature * modulus**2 * speed)) ** 0.2 / 100
    start = np.array([[0.1, 0.1], [0.1 + radius.sum() + 2.4 * step * speed, 0.1]])
    pair = world(
        start, [[0.2, 0.0], [-0.3, 0.0]], radius=radius, density=density, walls=False, rebuild=False,
        material=constants(young_modulus=5e6, restitution=restitution),
    )  # fmt: skip
    _, seen = track(pair, step, 180)
    centre = (mass[0] * 0.2 - mass[1] * 0.3) / mass.sum()
    expected = centre + np.array([-1.0, 1.0]) * restitution * speed * mass[::-1] / mass.sum()
    # The error of restitution at t_H/100 is under 1e-3, as measured in test_contact_closed_forms.
    np.testing.assert_allclose(seen.velocity[-1, :, 0], expected, atol=1e-3 * speed)
    if restitution == 1.0:
        deepest = (15 * reduced * speed**2 / (16 * modulus * np.sqrt(curvature))) ** 0.4
        peak = 4 / 3 * modulus * np.sqrt(curvature) * deepest**1.5
        np.testing.assert_allclose(np.abs(seen.force).max(), peak, rtol=5e-3)
