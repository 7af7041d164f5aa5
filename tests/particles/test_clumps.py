"""Clumps of spheres as rigid bodies: mass, rotation, impacts, lists."""

from __future__ import annotations

import copy

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.particles.clump_forces import as_members
from jaxdem.particles.clump_shape import Clumps
from jaxdem.particles.clumps import arm_change, member_places, placed, turned
from jaxdem.particles.integrate import Motion
from jaxdem.particles.union import shadows, union_of_spheres
from jaxdem.run.instant import Instant
from jaxdem.run.parts.energy import energy_now
from jaxdem.setup.builder import build_case
from jaxdem.setup.shapes import principal_axes
from tests.cases.clumps import BENT, ROD, built, impulse_on_floor, momenta, two_bodies
from tests.cases.tiers import tiered


@pytest.fixture(scope="module")
def bodies():
    """Two bent clumps in a box, and a compiled interval."""
    simulation, parameters, state, neighbors = built(two_bodies())
    return simulation, parameters, state, neighbors, jax.jit(simulation.step)


def moved(bodies, intervals, parameters=None, **changes):
    """State after some intervals, of particles with other values."""
    simulation, own, state, _, step = bodies
    parameters = own if parameters is None else parameters
    given = {name: jnp.asarray(value) for name, value in changes.items()}
    state = state._replace(particles=state.particles._replace(**given))
    neighbors = simulation.allocate(parameters, state.particles)
    for _ in range(intervals):
        state, neighbors, report = step(parameters, state, neighbors)
        assert not bool(report.particles.overflow)
    return state, neighbors


def test_two_unit_spheres_one_apart():
    """Volume 9 pi/4; moments by hand: two caps of height 1.5 back to back."""
    found = union_of_spheres(np.asarray([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), np.ones(2))
    assert found.volume == pytest.approx(7.06858, abs=5e-6)
    assert found.volume == pytest.approx(2.25 * np.pi, rel=1e-12)
    assert found.moments[0, 0] == pytest.approx(0.4250, abs=1e-9)
    assert np.allclose(found.centre, [0.5, 0.0, 0.0], atol=1e-12)
    assert found.surface == pytest.approx(2.0 * 2.0 * np.pi * 1.5, rel=1e-9)  # two caps of height 1.5
    # Counted twice, the lens would be in the mass.
    assert 2.0 * 4.0 / 3.0 * np.pi > 1.15 * found.volume


def test_union_against_monte_carlo():
    """Volume, centre and moments of six overlapping spheres by a million random points, to four of their errors."""
    rng = np.random.default_rng(3)
    centres, radii = 0.7 * rng.normal(size=(6, 3)), rng.uniform(0.5, 1.0, 6)
    found = union_of_spheres(centres, radii)
    low, high = (centres - radii[:, None]).min(axis=0), (centres + radii[:, None]).max(axis=0)
    points = rng.uniform(low, high, (1_000_000, 3))
    inside = np.zeros(len(points), bool)
    for centre, radius in zip(centres, radii, strict=True):
        inside |= np.sum((points - centre) ** 2, axis=1) < radius**2
    part = inside.mean()
    error = np.sqrt(part * (1.0 - part) / len(points)) / part
    assert found.volume == pytest.approx(np.prod(high - low) * part, rel=4.0 * error)
    kept = points[inside]
    assert np.allclose(kept.mean(axis=0), found.centre, atol=4.0 * kept.std() / np.sqrt(len(kept)))
    away = kept - found.centre
    moments = np.trace(np.cov(away.T)) * np.eye(3) - np.cov(away.T)
    assert np.allclose(moments, found.moments, atol=4.0 * np.trace(moments) / np.sqrt(len(kept)))


def test_union_does_not_depend_on_the_axes():
    rng = np.random.default_rng(4)
    centres, radii = 0.7 * rng.normal(size=(5, 3)), rng.uniform(0.5, 1.0, 5)
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    one, other = union_of_spheres(centres, radii), union_of_spheres(centres @ axes.T + 2.0, radii)
    assert other.volume == pytest.approx(one.volume, rel=1e-9)
    assert np.allclose(axes @ one.moments @ axes.T, other.moments, atol=1e-9)
    # Projections: two discs, or one where one hides the other.
    lens = 2.0 * np.pi - (2.0 * np.pi / 3.0 - np.sqrt(3.0) / 2.0)
    assert np.allclose(shadows(np.asarray([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), np.ones(2)), [lens, np.pi, lens])


def test_spheres_in_one_place_are_the_sphere(bodies):
    """Falling, bouncing and rubbing: the sphere but for the last bits, which the compiler's fused operations decide."""
    tables = two_bodies(
        domain={"gravity": [0.3, -0.2, -9.81]},
        contact={"young_modulus": 1e7, "friction": 0.4, "restitution": 0.7, "speed": 3.0},
        particles={
            "shape": "one",
            "shapes": [{"name": "one", "centres": [[0.5, 0.0, 0.0]] * 3, "radii": [2.0, 2.0, 2.0]}],
            "position": [[0.5, 0.5, 0.035], [0.51, 0.5, 0.11]],
            "angular_velocity": [[5.0, -3.0, 2.0], [0.0, 4.0, 0.0]],
        },
    )
    plain = copy.deepcopy(tables)
    for key in ("shape", "shapes", "orientation"):
        del plain["particles"][key]
    found = []
    for one in (tables, plain):
        simulation, parameters, state, neighbors = built(one)
        step = jax.jit(simulation.step)
        for _ in range(12):
            state, neighbors, _ = step(parameters, state, neighbors)
        found.append(state.particles)
    clump, sphere = found
    assert float(jnp.max(jnp.abs(sphere.contact_force))) > 0.0
    # What is left of an impact is a small force: it counts by the momentum that it gives in the interval.
    momentum = float(parameters.bodies.mass) * np.abs(np.asarray(sphere.velocity)).max()
    scales = {"contact_force": momentum / simulation.interval}
    for name in ("position", "velocity", "angular_velocity", "contact_force"):
        one, other = np.asarray(getattr(clump, name)), np.asarray(getattr(sphere, name))
        assert np.allclose(one, other, rtol=0.0, atol=1e-12 * scales.get(name, np.abs(other).max())), name


@pytest.mark.parametrize("centres", [[[0, 0, 0], [1.1, 0, 0], [1.1, 0.8, 0.3]], [[0, 0, 0], [0.6, 0.5, 0.4]]])
def test_principal_axes_are_the_same_on_every_machine(host_patch, centres):
    """Whatever signs, and vectors of equal moments (of two spheres), the processor's routine gives."""
    centres, radii = np.asarray(centres, float), np.asarray([1.0, 0.8, 0.6][: len(centres)])
    total, eigh, found = union_of_spheres(centres, radii).moments, np.linalg.eigh, []
    for basis in (np.eye(3), np.diag([-1.0, 1.0, -1.0]), np.diag([1.0, -1.0, 1.0])):
        if len(centres) == 2:  # the axis is the eigenvector of the least moment
            basis = basis @ np.asarray([[1.0, 0.0, 0.0], [0.0, 0.6, -0.8], [0.0, 0.8, 0.6]])
        host_patch.setattr(np.linalg, "eigh", lambda m, basis=basis: (eigh(m)[0], eigh(m)[1] @ basis))
        found.append(principal_axes(total, 3))
    moments = found[0].T @ total @ found[0]
    np.testing.assert_allclose(moments, np.diag(np.diag(moments)), atol=1e-9 * np.trace(moments))
    for axes in found:
        assert np.linalg.det(axes) == pytest.approx(1.0)
        np.testing.assert_allclose(axes, found[0], atol=1e-9)


@pytest.mark.parametrize("shape", [0, 1])
def test_first_impact_on_a_floor(bodies, shape):
    """Velocity and spin after a frictionless elastic impact of an inclined body, in closed form."""
    simulation, parameters, state, _, _ = bodies
    place = jnp.asarray([[0.3, 0.5, 0.12], [0.7, 0.5, 0.7]])
    turn = jnp.asarray([[0.6, 0.0, -0.8, 0.0], [0.36, 0.48, 0.8, 0.0]])[jnp.asarray([shape, 1 - shape])]
    given = {"position": place, "orientation": turn, "velocity": jnp.asarray([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0]])}
    spheres = as_members(state.particles._replace(**given), parameters.bodies.clumps)
    radius = np.asarray(parameters.bodies.spheres(2).radius)
    centre, low = np.asarray(spheres.position), np.asarray(spheres.position)[:, 2] - radius
    member = int(np.argmin(low[::2]))
    assert np.sort(low[::2])[1] - low[2 * member] > 2e-3  # one member touches alone
    height = 0.12 - low[2 * member] + 1e-4
    given["position"] = place.at[0, 2].set(height)
    state, _ = moved(bodies, 1, **given)
    arm = centre[2 * member] - np.asarray(place[0]) - np.asarray([0.0, 0.0, radius[2 * member]])
    w, x, y, z = np.asarray(turn[0])
    axes = np.asarray(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    velocity, spin = impulse_on_floor(parameters.bodies, arm, axes, 1.0)
    after = state.particles
    assert np.allclose(after.velocity[0], velocity, atol=5e-3)
    # The spin of the moment after, whose axes have turned since: its angular momentum.
    assert np.linalg.norm(after.angular_velocity[0]) == pytest.approx(np.linalg.norm(spin), rel=2e-2)
    assert np.allclose(after.angular_velocity[0], spin, atol=0.1 * np.linalg.norm(spin))
    assert momenta(parameters.bodies, after)[0] == pytest.approx(0.5 * float(parameters.bodies.mass), rel=1e-3)


def test_clumps_collide(bodies):
    """Momentum and angular momentum are kept with friction and damping, to rounding; energy is lost."""
    _, parameters, state, _, _ = bodies
    contact = parameters.contact._replace(friction=jnp.asarray(0.5), restitution=jnp.asarray(0.6))
    changes = {
        "position": [[0.44, 0.5, 0.5], [0.56, 0.52, 0.49]],
        "velocity": [[1.0, 0.1, 0.0], [-1.0, 0.0, 0.2]],
        "angular_velocity": [[3.0, 5.0, -2.0], [-4.0, 1.0, 6.0]],
    }
    given = {name: jnp.asarray(value) for name, value in changes.items()}
    before = momenta(parameters.bodies, state.particles._replace(**given))
    state, _ = moved(bodies, 5, parameters._replace(contact=contact), **given)
    after = momenta(parameters.bodies, state.particles)
    assert 0.3 * before[0] < after[0] < 0.99 * before[0]
    assert np.allclose(after[1], before[1], atol=1e-13 * np.abs(before[0]))
    assert np.allclose(after[2], before[2], atol=1e-12 * np.linalg.norm(before[2]))


def test_list_has_all_pairs_and_none_within_a_body(bodies):
    simulation, parameters, state, _, _ = bodies
    near = state.particles._replace(position=jnp.asarray([[0.46, 0.5, 0.5], [0.54, 0.5, 0.5]]))
    listed = simulation.allocate(parameters, near)
    pairs = {
        tuple(sorted(pair))
        for pair in zip(listed.pairs.first.tolist(), listed.pairs.second.tolist(), strict=True)
        if pair[0] != pair[1]
    }
    place = np.asarray(as_members(near, parameters.bodies.clumps).position)
    apart = np.linalg.norm(place[:, None] - place[None], axis=2)
    expected = {
        (i, j) for i in range(6) for j in range(i + 1, 6) if i % 2 != j % 2 and apart[i, j] < simulation.search.reach
    }
    assert pairs == expected
    assert expected


@pytest.fixture(scope="module")
def rod():
    """A rod above a floor, in the plane, and another far away."""
    tables = two_bodies(ROD)
    tables["domain"] = {"size": [1.0, 1.0], "gravity": [0.0, 0.0]}
    tables["particles"] |= {
        "shapes": [{"name": "rod", "centres": [[-1.0, 0.0], [0.0, 0.0], [1.0, 0.0]], "radii": [1.0, 1.0, 1.0]}],
        "position": [[0.5, 0.3], [0.5, 0.8]],
        "orientation": [0.5, 0.0],
    }
    union = union_of_spheres(np.asarray(ROD["centres"]), np.ones(3))
    return *built(tables), union, 0.03 / union.radius


def falling_rod(rod, simulation):
    """Height and spin of the rod after it has touched the floor, of its speed."""
    _, parameters, state, _, _, unit = rod
    place = state.particles.position.at[0, 1].set(unit * (np.sin(0.5) + 1.0) + 1e-4)
    particles = state.particles._replace(position=place)
    neighbors = simulation.allocate(parameters, particles)

    def after(speed):
        moving = particles._replace(velocity=particles.velocity.at[0, 1].set(-speed))
        new, _, _ = simulation.step(parameters, state._replace(particles=moving), neighbors)
        return new.particles

    return after


def test_rod_in_the_plane(rod):
    """2-D: the union of spheres with centres in the plane, and the spin after an impact, e = 1."""
    simulation, _, _, _, union, unit = rod
    after = jax.jit(falling_rod(rod, simulation))(1.0)
    inertia, lever = union.moments[1, 1] * unit**2, unit * np.cos(0.5)
    impulse = 2.0 / (1.0 + lever**2 / inertia)
    assert float(after.velocity[0, 1]) == pytest.approx(impulse - 1.0, abs=1e-2)
    assert float(after.angular_velocity[0, 0]) == pytest.approx(-impulse * lever / inertia, rel=1e-2)


def pair(rows, dtype):
    """Rows of float64 as leading and trailing parts."""
    high = tuple(jnp.asarray(row, dtype) for row in rows)
    if dtype == np.float64:
        return high, (None,) * len(rows)
    return high, tuple(jnp.asarray(row - np.asarray(h, float), dtype) for row, h in zip(rows, high, strict=True))


def whole(high, low):
    """The inverse, as one array."""
    parts = zip(high, low, strict=True)
    return np.stack([np.asarray(h, float) + (0.0 if t is None else np.asarray(t, float)) for h, t in parts])


@pytest.mark.parametrize("dimension", tiered([2, 3], first=[3]))
def test_float32_keeps_the_digits_of_small_turns(dimension):
    """Members before and after a turn of 1e-5 rad, in pairs of floats, against float64."""
    rng = np.random.default_rng(5)
    place = rng.uniform(size=(dimension, 4))
    offset = (0.01 * rng.normal(size=(dimension, 2, 4))).astype(np.float32).astype(float)
    start = rng.normal(size=(4, 4)) if dimension == 3 else rng.uniform(-3.0, 3.0, (1, 4))
    start = start / np.linalg.norm(start, axis=0) if dimension == 3 else start
    spin = rng.normal(size=(1 if dimension == 2 else 3, 4))

    def moved(dtype):
        arms, still, one = pair(offset, dtype)[0], (jnp.zeros(4, dtype),) * dimension, jnp.ones((), dtype)
        turning, turning_low = pair(start, dtype)
        motion = Motion(
            *pair(place, dtype), still, pair(spin, dtype)[0], (), (), orientation=turning, orientation_low=turning_low
        )
        clumps = Clumps(arms, one, (one,) * len(spin), arms[0], one, one, ())

        @jax.jit
        def both(motion):
            reference = placed(motion.position, motion.low, motion.orientation, motion.orientation_low, arms, None)
            later = turned(motion, clumps, jnp.asarray(1e-5, dtype), True)
            still = tuple(jnp.zeros_like(x) for x in reference.arm)
            return [member_places(reference, m, c) for m, c in ((motion, still), (later, arm_change(reference, later)))]

        return [whole(*found) for found in both(motion)]

    (before, after), (exact_before, exact) = moved(np.float32), moved(np.float64)
    way = exact - exact_before
    assert np.abs(before - exact_before).max() < 1e-13
    assert np.abs(after - before - way).max() < 1e-6 * np.abs(way).max()


def test_slope_by_speed(rod):
    """Where the rod is after an impact, differentiated by the speed before it, against a difference quotient."""
    after = falling_rod(rod, rod[0].reversible())

    @jax.jit
    @jax.value_and_grad
    def place(speed):
        particles = after(speed)
        return particles.position[0, 1] + 0.1 * particles.orientation[0, 0]

    quotient = float(place(1.5 + 1e-5)[0] - place(1.5 - 1e-5)[0]) / 2e-5
    assert abs(quotient) > 1e-3
    assert float(place(1.5)[1]) == pytest.approx(quotient, rel=1e-4)


def test_bad_shapes_are_refused():
    for change, words in (
        ({"shape": "bend"}, "Did you mean 'bent'"),
        ({"shapes": [{"name": "bent", "centres": [[0.0, 0.0, 0.0]], "radii": [1.0, 2.0]}]}, "one radius for each"),
        ({"shapes": [{"name": "bent", "file": "no_such.csv"}]}, "no such file"),
        ({"coarse_grain": 2.0}, "parcels are spheres"),
    ):
        with pytest.raises(jaxdem.InputError, match=words):
            built(two_bodies(BENT, particles=change))


def test_energy_of_rotation_is_with_the_principal_moments():
    """Where the law does not say what it stores: m r^2 times 4/5 about the line of two spheres that touch, 14/5 across
    it. A mean moment would not know the axis."""
    shape = {"name": "bent", "centres": [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]], "radii": [1.0, 1.0]}
    scene = jaxdem.load_scene(
        two_bodies(BENT, particles={"shapes": [shape], "orientation": [[1.0, 0.0, 0.0, 0.0]] * 2})
    )
    case = build_case(scene)
    state, _ = case.first_state()
    mass = float(case.parameters.bodies.mass) / 2.0
    radius = float(case.parameters.bodies.radius) / 2.0 ** (1.0 / 3.0)
    found = []
    for row in 3.0 * jnp.eye(3):
        particles = state.particles._replace(angular_velocity=jnp.stack([row, jnp.zeros(3)]))
        instant = Instant(0.0, state._replace(particles=particles), None, None)
        found.append(energy_now(case, instant)[1] / (0.5 * mass * radius**2 * 9.0))
    assert sorted(found) == pytest.approx([0.8, 2.8, 2.8], rel=1e-9)
