"""Degenerate contacts: coincident centres, exact touching, no slip. Values and gradients stay finite."""

from __future__ import annotations

import dataclasses
import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.particles.adhesion import VanDerWaals
from jaxdem.particles.capillary_bridge import CapillaryBridge
from jaxdem.particles.cohesion import CohesionConstants, Gap
from jaxdem.particles.contact import Contact, ContactForce, ContactMaterial, HertzMindlin, LinearSpringDashpot
from jaxdem.particles.integrate import Motion, ParticleProperties, kick
from jaxdem.particles.lubrication import LubricationConstants, wet_friction
from jaxdem.particles.materials import surroundings
from jaxdem.particles.pair_forces import pair_sizes
from jaxdem.particles.rolling import ConstantDirectionalTorque, ElasticPlasticSpringDashpot, Rotation
from jaxdem.particles.tangent import turned_into_plane
from tests.cases.tiers import COMBINATION
from tests.cases.worlds import advance, constants, forces, world

RADIUS = 0.01
PLACES = {
    "coincident": [[0.1, 0.1], [0.1, 0.1]],
    "touching": [[0.1, 0.1], [0.1 + 2 * RADIUS, 0.1]],
    "apart": [[0.1, 0.1], [0.2, 0.1]],
    "on the wall": [[RADIUS, 0.1], [0.2, RADIUS]],
    "in a corner, overlapping": [[RADIUS / 2, RADIUS / 2], [RADIUS / 2, RADIUS * 2]],
}
STEPS = 3


def pair(place, law):
    material = constants(restitution=0.5, friction=0.4, rolling_friction=0.1)
    return world(
        PLACES[place], radius=RADIUS, law=law, rolling=ConstantDirectionalTorque(), gravity=(0.0, -9.81),
        rebuild=False, material=material,
    )  # fmt: skip


@pytest.fixture(
    scope="module",
    params=[HertzMindlin(), pytest.param(LinearSpringDashpot(), marks=COMBINATION)],
    ids=["hertz", "linear"],
)
def differentiated(request):
    """Compiled: sums of where two particles are after three steps, and gradients by start and constants."""
    static = pair("apart", request.param)

    def end(position, velocity, spin, material, neighbors):
        state = static.state._replace(position=position, velocity=velocity, angular_velocity=spin)
        scene = static._replace(state=state, constants=material, neighbors=neighbors)
        new = advance(scene, 1e-5, STEPS, reversible=True).state
        weights = jnp.asarray([[1.0, 2.0], [3.0, 5.0]])
        total = jnp.sum(weights * (new.position + new.velocity)) + jnp.sum(new.angular_velocity[:, 0])
        return total, new

    compiled = jax.jit(jax.grad(end, (0, 1, 2, 3), has_aux=True))

    def evaluate(place):
        scene = pair(place, request.param)
        s = scene.state
        return compiled(s.position, s.velocity, s.angular_velocity, scene.constants, scene.neighbors)

    return request.param, evaluate


@pytest.mark.parametrize("place", PLACES)
def test_values_and_gradients_are_finite(differentiated, place):
    """Reverse mode through three steps from rest, by positions, velocities, spins and material constants."""
    _, evaluate = differentiated
    gradients, state = evaluate(place)
    for leaf in jax.tree.leaves(gradients) + jax.tree.leaves(state):
        assert np.isfinite(np.asarray(leaf)).all()
    if place == "apart":
        # Free flight: x = x0 + v0 t + ..., so d/dx = 1 and d/dv = 1 + t times the weights, exactly.
        np.testing.assert_allclose(gradients[0], [[1.0, 2.0], [3.0, 5.0]], rtol=1e-12)
        np.testing.assert_allclose(gradients[1], (1 + STEPS * 1e-5) * np.array([[1, 2], [3, 5]]), rtol=1e-12)


def test_coincident_particles_part(differentiated):
    """They are pushed apart along the first axis with opposite forces, the lower index backwards."""
    law, evaluate = differentiated
    _, state = evaluate("coincident")
    velocity = np.asarray(state.velocity)
    assert velocity[0, 0] < 0 < velocity[1, 0]
    np.testing.assert_allclose(velocity[0, 0], -velocity[1, 0], rtol=1e-12)
    force, _ = forces(pair("coincident", law))
    effective = 1e7 / (2 * (1 - 0.3**2))
    expected = 4 / 3 * effective * np.sqrt(RADIUS / 2) * (2 * RADIUS) ** 1.5
    expected = expected if isinstance(law, HertzMindlin) else 1e4 * 2 * RADIUS
    np.testing.assert_allclose(force, [[-expected, 0.0], [expected, 0.0]], rtol=1e-12)


def test_exactly_touching_has_no_force(differentiated):
    """At zero overlap and at rest both laws give exactly nothing."""
    scene = pair("touching", differentiated[0])
    # 0.12 - 0.1 is not 0.02 in binary: the overlap is put to zero.
    neighbors = scene.neighbors
    touching = dataclasses.replace(neighbors, overlap=jnp.zeros_like(neighbors.overlap))
    scene = scene._replace(neighbors=touching)
    force, torque = forces(scene)
    np.testing.assert_array_equal(force, 0.0)
    np.testing.assert_array_equal(torque, 0.0)


def test_both_loops_give_the_same_numbers(differentiated):
    """The reversible loop and the fast one: the same operations, so equal to round-off of fused ones."""
    law, evaluate = differentiated
    _, there = evaluate("in a corner, overlapping")
    here = jax.jit(lambda: advance(pair("in a corner, overlapping", law), 1e-5, STEPS).state)()
    np.testing.assert_allclose(here.position, there.position, rtol=1e-13)
    np.testing.assert_allclose(here.velocity, there.velocity, rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("spin", [0.0, 1e-300, 1e-163, 1e-20, 1.0])
def test_slope_of_a_rotation_that_dies_out_is_finite(spin):
    """Rolling friction that stops a rotation within the step is -I w / dt, whose slope is -I / dt down to the smallest
    spin."""
    mass, radius, step = 1e-3, 0.01, 1e-4
    one = jnp.ones(1)
    contact = Contact(1e-5 * one, 0.0 * one, (0.0 * one,), (0.0 * one,), radius * one, mass * one, one)
    force = ContactForce(one, one, (one,), (one,))
    material = types.SimpleNamespace(rolling_friction=jnp.asarray(0.1))

    def torque(value):
        rotation = Rotation((0.0 * one, one), (value * one,), ())
        torque, _ = ConstantDirectionalTorque()(contact, force, material, rotation, jnp.asarray(step))
        return torque[0][0]

    slope = float(jax.grad(torque)(spin))
    stopping = 0.4 * mass * radius**2 / step
    assert slope == (pytest.approx(-stopping, rel=1e-12) if spin < 0.1 * radius / stopping else 0.0)


def in_single(*values):
    return tuple(jnp.full(1, value, jnp.float32) for value in values)


@pytest.mark.parametrize("slip", [1e-2, 1e-3, 3e-4, 1e-6])
@pytest.mark.parametrize("law", [HertzMindlin(), LinearSpringDashpot()])
def test_small_grains_that_do_not_touch_have_no_slope_in_single_precision(law, slip):
    """The law is evaluated at 1e-12 of the radius where nothing touches, and what it gives is left out: grains of 1 mm
    have forces there whose squares are no numbers in single precision."""
    radius, mass, overlap, approach = in_single(5e-4, 5e-6, 5e-16, 1e-3)
    material = ContactMaterial(*in_single(3e5, 1e5, 0.7, 0.3, 0.0, 0.0, 1e-6, 1e-6))

    def kept(slip, spring):
        given = Contact(overlap, 0.0 * approach, (0.0 * slip,), (spring,), radius, mass, mass)
        return jnp.sum(jnp.where(overlap > radius, law(given, material).spring[0], 0.0))

    slopes = jax.grad(kept, (0, 1))(*in_single(slip, slip * 5e-13))
    assert all(float(slope[0]) == 0.0 for slope in slopes)


def test_slopes_of_wet_friction_of_small_grains_that_do_not_touch_are_finite():
    """At 1e-12 of the radius the force is 1e-20 N, and without slip the Sommerfeld number is zero."""
    film = LubricationConstants(*in_single(1e-3, 1e-7, 1e-5, 0.05, 1e-3))

    def friction(normal, slip, radius):
        return jnp.sum(wet_friction(0.5, normal, slip, radius, film))

    slopes = jax.grad(friction, (0, 1, 2))(*in_single(2e-20, 0.0, 5e-4))
    assert all(np.isfinite(slope[0]) for slope in slopes) and slopes[0][0] == 0.0


@pytest.mark.parametrize(
    ("law", "gap", "volume"), [(VanDerWaals(), 1e-10, ()), (CapillaryBridge(), 1e-7, (1e-20,))], ids=["dry", "bridge"]
)
def test_slopes_of_the_attraction_of_fine_powder_in_contact(law, gap, volume):
    """Of grains of 1 um whose gap is the smallest there is, by their distance, as in double precision."""
    numbers = {"strength": 1e-19, "minimum_gap": gap, "cutoff": 1e-8, "contact_angle": 0.2, "liquid_viscosity": 1e-3}

    def pull(overlap, radius, kept, dtype):
        given = CohesionConstants(**{name: jnp.full(1, value, dtype) for name, value in numbers.items()})
        found = law(Gap(overlap, 2.0 * radius, 2.0 * radius, radius, jnp.ones_like(radius)), given, kept)
        return jnp.sum(found.pull if found.damping is None else found.pull + found.damping)

    slopes = {}
    for dtype in (jnp.float32, jnp.float64):
        state = *(jnp.full(1, value, dtype) for value in (1e-11, 5e-7)), tuple(jnp.full(1, v, dtype) for v in volume)
        slopes[dtype] = np.ravel(jax.tree.leaves(jax.grad(pull, (0, 1, 2))(*state, dtype)))
    np.testing.assert_allclose(slopes[jnp.float32], slopes[jnp.float64], rtol=1e-3)


@pytest.mark.parametrize("size", [1e-6, 1e-10, 1e-14, 1e-18])
def test_slope_of_a_spring_that_is_turned_is_that_of_its_direction(size):
    """The same at every length of the spring, in single precision."""
    zero, sine, cosine = in_single(0.0, 0.6, 0.8)

    def turned(spring):
        return jnp.sum(sum(turned_into_plane(spring, (zero, sine, cosine))))

    slopes, expected = (jax.grad(turned)(in_single(k, 0.5 * k, -0.3 * k)) for k in (size, 1.0))
    np.testing.assert_allclose(np.ravel(slopes), np.ravel(expected), rtol=1e-5)


def test_slope_of_a_kick_by_the_density_of_fine_powder():
    """A grain of 1 um has a moment of inertia of 1e-28 kg m2."""

    def spin(density):
        bodies = ParticleProperties(radius=in_single(5e-7)[0], density=density)
        state = Motion.of(world([[0.1, 0.1]], radius=RADIUS).state)
        return kick(state, in_single(0.0, 0.0), in_single(1e-20), bodies, in_single(1e-9)[0]).angular_velocity[0][0]

    (density,) = in_single(2500.0)
    change = float(spin(density) - spin(jnp.inf * density))
    np.testing.assert_allclose(jax.grad(spin)(density)[0], -change / 2500.0, rtol=1e-5)


def test_rolling_dashpots_of_fine_powder_in_single_precision():
    """-2 eta_r sqrt(I k_r) w of two grains of 1 um, with I = 7/10 m r^2 of both and k_r = 9/4 mu_r^2 R*^2 F_e / d."""
    radius, density, overlap, spin = 5e-7, 2500.0, 1e-9, 100.0
    bodies = ParticleProperties(radius=in_single(radius)[0], density=in_single(density)[0])
    first = jnp.zeros(1, jnp.int32)
    sizes = pair_sizes(bodies, types.SimpleNamespace(first=first, second=first))
    zero, one, elastic, depth = in_single(0.0, 1.0, 1e-7, overlap)
    given = Contact(depth, zero, (zero,), (zero,), sizes.effective_radius, sizes.effective_mass, sizes.rolling_inertia)
    material = types.SimpleNamespace(rolling_friction=0.1 * one, rolling_damping=0.3 * one)
    rotation = Rotation((zero, one), in_single(spin), (zero,))
    torque, _ = ElasticPlasticSpringDashpot()(
        given, ContactForce(elastic, elastic, (zero,), (zero,)), material, rotation, 0.0
    )
    inertia = 0.7 * 4 / 3 * np.pi * density * radius**5
    stiffness = 2.25 * (0.1 * 0.5 * radius) ** 2 * 1e-7 / overlap
    assert float(torque[0][0]) == pytest.approx(-2 * 0.3 * np.sqrt(inertia * stiffness) * spin, rel=1e-5)


@pytest.mark.parametrize(
    ("radius", "speed"),
    [
        pytest.param(RADIUS, 0.0, id="one radius, list kept", marks=COMBINATION),
        pytest.param(RADIUS, 3e3, id="one radius, list rebuilt", marks=COMBINATION),
        pytest.param((RADIUS, 1.5 * RADIUS), 0.0, id="two radii, list kept", marks=COMBINATION),
        pytest.param((RADIUS, 1.5 * RADIUS), 3e3, id="two radii, list rebuilt"),
    ],
)
def test_slope_by_the_radius(radius, speed):
    """A list keeps overlaps as numbers; the slope of the force by the radius is that of Hertz's law all the same.

    F = 4/3 E* sqrt(R*) (R1 + R2 - d)^1.5 of two spheres that fly side by side without friction, over two intervals.
    """
    apart = 1.999 * RADIUS if np.ndim(radius) == 0 else 2.499 * RADIUS
    material = constants(restitution=1.0, friction=0.0)
    start = world(
        [[0.1, 0.1], [0.1, 0.1 + apart]],
        [[speed, 0.0]] * 2,
        radius=radius,
        box=(1.0, 0.3),
        walls=False,
        material=material,
    )

    def force(radius):
        scene = start._replace(properties=start.properties._replace(radius=radius))
        for _ in range(2):
            scene = advance(scene, 1e-6, 1, reversible=True)
        return scene.state.contact_force[1, 1], scene.neighbors.builds

    def hertz(radius):
        one, other = jnp.broadcast_to(radius, (2,))
        modulus = surroundings(material, ()).pair.effective_young_modulus
        reduced, overlap = one * other / (one + other), one + other - apart
        return 4.0 / 3.0 * modulus * jnp.sqrt(reduced) * overlap**1.5

    given = jnp.asarray(radius)
    programs = [jax.jit(jax.value_and_grad(force, has_aux=True)), jax.jit(jax.value_and_grad(hertz))]
    ((found, builds), slope), (expected, by_hertz) = (program(given) for program in programs)
    assert int(builds) == (1 if speed == 0.0 else 3)
    # The spheres part by 1e-8 of the overlap in two steps.
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    np.testing.assert_allclose(slope, by_hertz, rtol=1e-6)
    # The same list for spheres that are a little larger than when it was made.
    ((larger, _), _), (expected, _) = (program(1.0001 * given) for program in programs)
    np.testing.assert_allclose(larger, expected, rtol=1e-6)
