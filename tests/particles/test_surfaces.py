"""Overlaps with walls given by distances: in float32 to 1e-10 m in a box of metres, normals, degenerate points."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.numerics import compensated
from jaxdem.particles.surfaces import Cylinder, DistanceFunction, Plane, surface_contacts, wedge

RADIUS, COUNT, TUBE = float(np.float32(0.01)), 500, 3.3
RESOLVED = 1e-10
"""Error of an overlap of up to 1e-4 m in float32 [m]; measured: 2e-11."""


@pytest.fixture(params=[2, 3])
def dimension(request):
    return request.param


@pytest.fixture
def generator():
    return np.random.default_rng(5)


def overlaps(generator):
    """Overlaps and gaps of 1e-9 to 1e-4 m."""
    return 10.0 ** generator.uniform(-9, -4, COUNT) * generator.choice([-1, 1], COUNT)


def direction(generator, dimension):
    vector = generator.standard_normal(dimension)
    return vector / np.linalg.norm(vector)


def in_float32(surface, position):
    """Overlap and normal in float32; and the positions that the pairs of floats stand for, in longdouble."""
    high = position.astype(np.float32)
    low = (position - high).astype(np.float32)
    compiled = jax.jit(lambda h, l, r: surface_contacts((surface,), tuple(h.T), tuple(l.T), r))  # noqa: E741
    overlap, normal = compiled(high, low, jnp.float32(RADIUS))
    held = high.astype(np.longdouble) + low.astype(np.longdouble)
    return np.asarray(overlap[0]), np.stack([np.asarray(n[0]) for n in normal], axis=1), held


def test_affine_against_exact_arithmetic(generator):
    """r + c + f.x in pairs against longdouble: 3e-14 of terms up to 20, also where the sum is 0.01."""
    factors, x = (
        generator.uniform(-1, 1, 3).tolist(),
        generator.uniform(-12, 12, (COUNT, 3)).astype(np.float32),
    )
    exact = x.astype(np.longdouble) @ np.asarray(factors, np.longdouble)
    constant, addend = -float(exact[0]) + 1e-5, np.float32(0.01)
    one = lambda row, r: compensated.affine(row, factors, constant, r)  # noqa: E731
    high, low = (np.asarray(part) for part in jax.jit(jax.vmap(one, (0, None)))(x, addend))
    truth = exact + np.longdouble(constant) + np.longdouble(addend)
    assert np.abs(high.astype(np.longdouble) + low - truth).max() < 3e-14 * 20
    assert abs(truth[0]) < 0.011


def test_a_plane_in_float32(generator, dimension):
    """Up to 12 m along an inclined plane."""
    normal, point = direction(generator, dimension), generator.uniform(0, 12, dimension)
    along = generator.uniform(-12, 12, (COUNT, dimension))
    along -= (along @ normal)[:, None] * normal
    position = point + along + (RADIUS - overlaps(generator))[:, None] * normal
    overlap, normals, held = in_float32(Plane(tuple(point), tuple(3.0 * normal)), position)
    unit = normal.astype(np.longdouble) / np.sqrt(np.sum(normal.astype(np.longdouble) ** 2))
    assert np.abs(overlap - (RADIUS - (held - point) @ unit)).max() < RESOLVED
    np.testing.assert_allclose(normals, np.broadcast_to(normal, normals.shape), atol=3e-7)


@pytest.mark.parametrize("inside", [True, False])
def test_a_cylinder_in_float32(generator, dimension, inside):
    """A tube and a rod of 3.3 m radius, in 3-D with an inclined axis."""
    center, sign = generator.uniform(4, 6, dimension), -1.0 if inside else 1.0
    axis = None if dimension == 2 else direction(generator, 3)
    across = np.eye(2) if axis is None else np.linalg.svd(axis[None])[2][1:]
    angle, depth = generator.uniform(0, 2 * np.pi, COUNT), overlaps(generator)
    ray = np.stack([np.cos(angle), np.sin(angle)], axis=1) @ across
    position = center + (TUBE + sign * (RADIUS - depth))[:, None] * ray
    if axis is not None:
        position += generator.uniform(-3, 3, (COUNT, 1)) * axis
    given = None if axis is None else tuple(2.0 * axis)
    overlap, normals, held = in_float32(Cylinder(tuple(center), TUBE, given, inside), position)
    separation = held - center
    if axis is not None:
        unit = axis.astype(np.longdouble) / np.sqrt(np.sum(axis.astype(np.longdouble) ** 2))
        separation -= (separation @ unit)[:, None] * unit
    distance = sign * (np.sqrt(np.sum(separation**2, axis=1)) - TUBE)
    assert np.abs(overlap - (RADIUS - distance)).max() < RESOLVED
    np.testing.assert_allclose(normals, sign * ray, atol=1e-6)


def test_a_users_function_resolves_what_its_own_arithmetic_does(generator):
    """The control: the same tube as a plain function is off by 1e-7 to 1e-6 m, a rounding of 3.3 m."""
    angle = generator.uniform(0, 2 * np.pi, COUNT)
    ray = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    position = 5.0 + (TUBE - RADIUS + overlaps(generator))[:, None] * ray
    plain = DistanceFunction(lambda x: TUBE - jnp.sqrt(jnp.sum((x - 5.0) ** 2)))
    overlap, normals, held = in_float32(plain, position)
    error = np.abs(overlap - (np.sqrt(np.sum((held - 5.0) ** 2, axis=1)) - TUBE + RADIUS)).max()
    assert RESOLVED < 1e-7 < error < 1e-6
    np.testing.assert_allclose(normals, -ray, atol=1e-6)


def test_several_radii_and_surfaces():
    """Rows are walls, columns particles: depths of three discs in the two planes of a right angle."""
    position = (jnp.asarray([0.3, 0.4, 0.2]), jnp.asarray([0.1, 0.1, 0.5]))
    planes = wedge((0.2, 0.0), ((2.0, 0.0), (0.5, 0.5)))
    overlap, normal = surface_contacts(planes, position, (None, None), jnp.asarray([0.15, 0.05, 0.1]))
    root = np.sqrt(0.5)  # the second plane is the diagonal through the apex; x - y - 0.2 over sqrt 2 from it
    depth = [[0.05, -0.05, -0.4], [0.15, 0.05 - 0.1 * root, 0.1 + 0.5 * root]]
    np.testing.assert_allclose(overlap, depth, atol=1e-15)
    np.testing.assert_allclose(np.stack(normal, axis=2)[:, 0], [[0.0, 1.0], [root, -root]], atol=1e-15)


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
def test_on_the_axis_nothing_is_infinite(dtype):
    """A disc in the middle of a tube has a gap all round and no normal; value and slopes by radius are finite."""
    low = (jnp.zeros(1, dtype),) * 2 if dtype == jnp.float32 else (None, None)
    position = (jnp.full(1, 0.5, dtype),) * 2
    plain = DistanceFunction(lambda x: 0.1 - jnp.sqrt(jnp.sum((x - 0.5) ** 2)))
    for surface in (Cylinder((0.5, 0.5), 0.1, None, True), plain):
        overlap, normal = surface_contacts((surface,), position, low, jnp.asarray(0.01, dtype))
        np.testing.assert_allclose(overlap, [[-0.09]], rtol=1e-6)
        np.testing.assert_array_equal(np.asarray(normal), 0.0)

    def force(x, radius):
        tube = (Cylinder((0.5, 0.5), 0.1, None, True),)
        overlap, normal = surface_contacts(tube, (x, position[1]), low, radius)
        return jnp.sum(overlap * normal[0])

    for slope in jax.grad(force, (0, 1))(position[0], jnp.asarray(0.01, dtype)):
        assert np.isfinite(np.asarray(slope)).all()


def test_a_contact_without_a_normal_is_not_a_number():
    """A disc on the centre of a rod, or at a kink where the slope is not one: never silently no force."""
    flat = DistanceFunction(lambda x: 0.0 * x[0])
    _, normal = surface_contacts((flat,), (jnp.zeros(1),) * 2, (None, None), jnp.asarray(0.01))
    assert np.isnan(np.asarray(normal)).all()
