"""Parcels: every model scales as the grains that a parcel stands for."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.check.check import check_scene
from jaxdem.check.unit_warnings import unit_warnings
from jaxdem.closures import DRAG_LAWS, DragInputs, PaperNetwork
from jaxdem.coupling.forces.lift import SaffmanMei
from jaxdem.particles.integrate import ParticleState
from jaxdem.study import SCENES
from tests.cases.tiers import tiered

RADIUS = 1e-3
OPEN = {"boundary": {"top": {"kind": "outlet"}}}


def scene_of(tables):
    return jaxdem.load_scene({"precision": "float64"} | tables)


def after(tables, intervals):
    """State after so many coupling intervals, with what the last one reported."""
    scene = scene_of(tables)
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    step = jax.jit(simulation.step)
    for _ in range(intervals):
        state, neighbors, report = step(parameters, state, neighbors)
    return state, report, parameters


def crowd(dimension, ratio, law):
    """Spheres with friction that meet on the floor, in a world `ratio` times as large and as slow."""
    width, generator = 12.0 * RADIUS, np.random.default_rng(3)
    grid = np.stack(np.meshgrid(*[np.arange(2 if dimension == 3 else 3)] * dimension), axis=-1).reshape(-1, dimension)
    position = RADIUS * (2.2 + 2.3 * grid + 0.1 * generator.uniform(size=grid.shape))
    velocity = generator.normal(0.0, 0.5, grid.shape)
    linear = {"law": "linear_spring_dashpot", "normal_stiffness": 2e3} if law == "linear" else {"young_modulus": 1e7}
    return {
        "domain": {"size": [ratio * width] * dimension, "gravity": [0.0] * (dimension - 1) + [-9.81 / ratio]},
        "particles": {
            "radius": RADIUS,
            "density": 2500.0,
            "position": (ratio * position).tolist(),
            "velocity": velocity.tolist(),
            "coarse_grain": ratio,
        },
        "contact": linear
        | {
            "restitution": 0.7,
            "friction": 0.4,
            "rolling_friction": 0.1,
            "rolling_model": "epsd",
            "speed": 3.0,
            "maximum_overlap": 0.2,
        },
        "coupling": {"interval": ratio * 5e-3},
        "time": {"end": ratio * 0.02, "output_interval": ratio * 5e-3},
    }


@pytest.mark.parametrize("dimension, law", tiered([(2, "hertz"), (3, "hertz"), (2, "linear")], first=[(2, "hertz")]))
def test_contacts_are_those_of_the_grains_in_a_larger_world(dimension, law):
    """Dimensional analysis: with lengths and times l times as large, and velocities, moduli and densities as they are,
    l x(t) and w(t)/l are the motion; overlap over diameter and restitution with it. Stresses are equal."""
    grains, _, of_grains = after(crowd(dimension, 1.0, law), 4)
    parcels, _, of_parcels = after(crowd(dimension, 3.0, law), 4)
    assert np.abs(np.asarray(grains.particles.contact_force)).max() > 0.0
    np.testing.assert_allclose(parcels.particles.position / 3.0, grains.particles.position, rtol=1e-9)
    np.testing.assert_allclose(parcels.particles.velocity, grains.particles.velocity, rtol=1e-7, atol=1e-9)
    spin = grains.particles.angular_velocity
    np.testing.assert_allclose(3.0 * parcels.particles.angular_velocity, spin, rtol=1e-7, atol=1e-6)
    # A force over the area that it acts on: in 2-D the layer is as deep as before.
    area = 3.0 ** (dimension - 1)
    force = np.asarray(grains.particles.contact_force)
    np.testing.assert_allclose(
        parcels.particles.contact_force / area, force, rtol=1e-6, atol=1e-9 * np.abs(force).max()
    )
    np.testing.assert_allclose(of_parcels.bodies.mass, 3.0**dimension * of_grains.bodies.mass, rtol=1e-14)


def cloud(ratio, **coupling):
    """A uniform cloud in a uniform shear, as grains or as parcels: the kernels add up to a uniform solid fraction."""
    cells, cell = 4, 8e-3
    number = 2 * cells if ratio == 1.0 else cells
    places = (np.arange(number) + 0.5) * (cells * cell / number)
    position = np.stack(np.meshgrid(places, places, places, indexing="ij"), axis=-1).reshape(-1, 3)
    return {
        "domain": {"size": [cells * cell] * 3, "gravity": [0.0, 0.0, 0.0]},
        "particles": {
            "radius": RADIUS,
            "density": 2500.0,
            "position": position.tolist(),
            "velocity": [[0.1, 0.0, -0.2]] * len(position),
            "coarse_grain": ratio,
        },
        "contact": {"young_modulus": 1e6, "speed": 1.0},
        "boundary": {name: {"kind": "periodic"} for name in ("left", "right", "front", "back", "bottom", "top")},
        "fluid": {"cells": [cells] * 3, "density": 1000.0, "viscosity": 1e-6, "velocity": [0.3, 0.0, 0.0]},
        "coupling": {"interval": 1e-3, "kernel_width": {"diameters": 0.0, "cells": 1.0}} | coupling,
        "time": {"end": 2e-3, "output_interval": 1e-3},
    }


@pytest.fixture(scope="module")
def clouds():
    more = {"virtual_mass": 0.5, "basset": 3}
    return after(cloud(1.0, **more), 2), after(cloud(2.0, **more), 2)


def test_the_cloud_of_parcels_is_the_cloud_of_grains(clouds):
    """Volume, void fraction, drag, virtual mass and Basset force per volume, and the motion under them."""
    (grains, of_grains, _), (parcels, of_parcels, numbers) = clouds
    assert float(numbers.bodies.parcels.grains) == 8.0
    assert 8 * len(parcels.particles.position) == len(grains.particles.position)
    np.testing.assert_allclose(parcels.fluid.void_fraction, grains.fluid.void_fraction, rtol=1e-13)
    np.testing.assert_allclose(8.0 * of_grains.forces.drag[0], of_parcels.forces.drag[0], rtol=1e-9, atol=1e-20)
    for name in ("virtual_mass", "basset"):
        one, all_ = (np.asarray(x.forces.further[name].given)[0] for x in (of_grains, of_parcels))
        assert np.abs(one).max() > 0.0
        np.testing.assert_allclose(8.0 * one, all_, rtol=1e-8, atol=1e-20)
    np.testing.assert_allclose(parcels.particles.velocity[0], grains.particles.velocity[0], rtol=1e-10, atol=1e-15)
    for a, b in zip(parcels.fluid.face_velocity, grains.fluid.face_velocity, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-15)


def test_drag_is_the_law_of_the_grain_times_the_grains(clouds):
    """Koch and Hill's law of the grain's diameter, by hand."""
    _, (state, report, _) = clouds
    inputs = report.forces.inputs
    slip = np.asarray(inputs.slip_velocity)[0]
    solids = float(inputs.solid_fraction[0])
    speed, diameter = np.linalg.norm(slip), 2.0 * RADIUS
    reynolds = (1.0 - solids) * speed * diameter / 1e-6
    multiple = float(DRAG_LAWS["koch_hill"]().stokes_multiple(np.float64(solids), np.float64(reynolds)))
    expected = 8.0 * 3.0 * np.pi * 1e-3 * diameter * multiple * slip
    np.testing.assert_allclose(report.forces.law[0], expected, rtol=1e-12, atol=1e-20)


def test_the_whole_force_of_a_learned_closure_is_that_of_the_grain_times_the_grains():
    """Both parts, the coefficient and the remainder, of a network of random weights."""
    simulation, parameters = jaxdem.build(scene_of(cloud(2.0)))
    rows = jnp.asarray(np.random.default_rng(1).normal(size=(4, 5, 3)))
    numbers = (jnp.asarray(value) for value in (2.0 * RADIUS, 8e-3, 1000.0, 1e-3))
    inputs = DragInputs(rows[0], rows[1], jnp.full(5, 0.2), rows[2], rows[3], *numbers)
    closure, start = PaperNetwork.initial(3, seed=2), SimpleNamespace(bodies=parameters.bodies)
    of_grain = closure(inputs)
    of_parcel = simulation.coupling.drag.law(closure, jnp.asarray(1.0), start)(inputs)
    assert np.abs(of_grain.remainder).min() > 0.0
    np.testing.assert_allclose(of_parcel.coefficient, 8.0 * of_grain.coefficient, rtol=1e-14)
    np.testing.assert_allclose(of_parcel.remainder, 8.0 * of_grain.remainder, rtol=1e-14)


def test_lift_in_a_shear_is_that_of_the_grain_times_the_grains():
    """Saffman and Mei's force of the grain's diameter in u = (k z, 0, 0), by hand at Re = 0.6 and a small shear."""
    position, velocity, rate, nu = jnp.array([[0.016, 0.016, 0.016]]), jnp.zeros((1, 3)), 2.0, 1e-4
    scene = scene_of(cloud(2.0, lift=["saffman_mei"]))
    simulation, parameters = jaxdem.build(scene)
    grid, bodies = simulation.coupling.interval.solver.grid, parameters.bodies
    heights = (jnp.arange(4) + 0.5) * 8e-3
    shape = grid.face_shape(0)
    faces = (jnp.broadcast_to(rate * heights, shape), *(jnp.zeros(grid.face_shape(axis)) for axis in (1, 2)))
    weights = simulation.coupling.deposition.weights(grid, position, bodies.radius)
    particles = ParticleState(position, None, velocity, jnp.zeros((1, 3)), (), (), velocity, None)
    slip, properties = jnp.array([[0.03, 0.0, 0.0]]), parameters.mixture.properties._replace(viscosity=nu)
    start = SimpleNamespace(
        particles=particles, bodies=bodies, slip=slip, grid=grid, weights=weights, face_velocity=faces,
        properties=properties,
    )  # fmt: skip
    found = SaffmanMei().begin(start, None).force
    diameter, speed = 2.0 * RADIUS, 0.03
    re, b = speed * diameter / nu, 0.5 * diameter * rate / speed
    factor = (1.0 - 0.3314 * np.sqrt(b)) * np.exp(-re / 10.0) + 0.3314 * np.sqrt(b)
    grain = 1.615 * diameter**2 * 1000.0 * np.sqrt(nu * rate) * factor * speed
    np.testing.assert_allclose(found[0], [0.0, 0.0, 8.0 * grain], rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("key, value", [("lift", ["magnus"]), ("rotational_drag", True), ("self_disturbance", True)])
def test_models_without_a_rule_are_refused(key, value):
    with pytest.raises(jaxdem.InputError, match=key):
        jaxdem.build(scene_of(cloud(2.0, **{key: value})))


def test_impacts_of_parcels_keep_the_rate_of_loss():
    """Two parcels that meet head-on part with e_p of 1 - e_p^2 = l (1 - e^2), and one leaves a wall with e."""
    ratio, e, speed, width = 3.0, 0.9, 0.2, 60.0 * RADIUS
    gap = [[0.3 * width, 0.5 * width], [0.3 * width + 6.3 * RADIUS, 0.5 * width], [width - 3.3 * RADIUS, 0.2 * width]]
    tables = crowd(2, ratio, "linear")
    tables["domain"] = {"size": [width, width], "gravity": [0.0, 0.0]}
    tables["particles"] |= {"position": gap, "velocity": [[speed, 0.0], [-speed, 0.0], [speed, 0.0]]}
    tables["contact"] |= {"restitution": e, "parcel_loss": "rate", "rolling_friction": 0.0, "time_step": 5e-6}
    state, _, _ = after(tables, 1)
    pair = np.sqrt(1.0 - ratio * (1.0 - e**2))
    np.testing.assert_allclose(state.particles.velocity[:, 0] / speed, [-pair, pair, -e], rtol=2e-3)


@pytest.mark.parametrize(
    ("changes", "key"),
    [({"restitution": 0.7}, "contact.restitution"), ({"restitution": 0.9, "wall_material": "glass"}, "parcel_loss")],
)
def test_a_rate_of_loss_that_cannot_be_kept_is_refused(changes, key):
    """Parcels of l = 2 would lose 1.02 of the energy with e = 0.7; several materials have no rule."""
    tables = crowd(2, 2.0, "hertz")
    if "wall_material" in changes:
        tables |= {"materials": [{"name": "glass"}]}
        tables["particles"] |= {"material": "glass"}
    tables["contact"] |= {"parcel_loss": "rate"} | changes
    with pytest.raises(jaxdem.InputError, match=key):
        jaxdem.build(scene_of(tables))


@pytest.mark.parametrize(
    ("keys", "key", "words"),
    [
        ({"count": 20}, "particles.count", "lower particles.count (of parcels, 4 grains each)"),
        ({"count": 1, "coarse_grain": 40.0}, "particles.radius", "lower particles.coarse_grain, which is 40"),
    ],
)
def test_a_pack_without_room_says_that_it_is_of_parcels(keys, key, words):
    """A scene of grains that is given a coarse_grain alone has as many parcels as grains, and these do not fit."""
    pack = {"kind": "random", "start": [0.0, 0.0], "stop": [12.0 * RADIUS, 12.0 * RADIUS], "spacing": 1.02}
    tables = crowd(2, 1.0, "hertz")
    tables["particles"] = {"radius": RADIUS, "density": 2500.0, "coarse_grain": 2.0, "pack": pack} | keys
    with pytest.raises(jaxdem.InputError) as caught:
        check_scene(scene_of(tables))
    assert caught.value.key == key and words in str(caught.value).replace("Lower", "lower")


def test_check_tells_of_the_grain():
    """Terminal speed and relaxation time are of a grain, not of the sphere that stands for it."""
    of_grains, of_parcels = (
        check_scene(scene_of(cloud(ratio) | {"domain": {"size": [32e-3] * 3, "gravity": [0.0, 0.0, -9.81]}} | OPEN))
        for ratio in (1.0, 2.0)
    )
    assert (of_grains.grains_per_parcel, of_parcels.grains_per_parcel) == (None, 8.0)
    assert of_parcels.relaxation_time == pytest.approx(of_grains.relaxation_time, rel=1e-12)
    for one, other in zip(of_grains.numbers, of_parcels.numbers, strict=True):
        assert (one.name, one.low) == (other.name, pytest.approx(other.low, rel=1e-9))
    assert "terminal velocity" in [number.name for number in of_parcels.numbers]


@pytest.mark.parametrize("changes", [{}, {"particles.coarse_grain": 2.0}])
def test_check_says_where_a_gradient_does_not_carry_what_is_in_the_box(changes):
    """The demonstration's grains are carried. As many parcels of four weigh four times as much, and all of it falls."""
    warnings = check_scene(jaxdem.load_scene(SCENES / "clusters_demo.toml", changes)).warnings
    found = [text for text in warnings if text.startswith("fluid.pressure_gradient")]
    assert len(found) == len(changes)
    if found:
        # s = 2752 * 4 (pi/6) d^3 / (9 mm x 18 mm x d)
        solids = 2752 * 4 * np.pi / 6.0 * 75e-6**2 / (9e-3 * 18e-3)
        load = 9.81 * (1500.0 * solids + 1.3 * (1.0 - solids))
        assert f"[0, {-load:.6g}] Pa/m" in found[0]
        assert f"gain {9.81 * (1.0 - 747.08 / load):.3g} m/s" in found[0]


@pytest.mark.parametrize(("radius", "warnings"), [(0.1, 0), (0.3, 1)])
def test_a_warning_about_the_radius_is_about_that_of_the_scene(radius, warnings):
    particles = {"count": 1, "position": [[5.0, 5.0]], "radius": radius, "density": 2500.0, "coarse_grain": 3.0}
    tables = {"domain": {"size": [10.0, 10.0]}, "particles": particles, "time": {"end": 1.0, "output_interval": 1.0}}
    found = [text for text in unit_warnings(jaxdem.load_scene(tables)) if "diameter. If" in text]
    assert len(found) == warnings
    assert all("particles.radius = 0.3 m: this is a grain of 0.6 m" in text for text in found)


@pytest.mark.parametrize("dimension", tiered([2, 3], first=[2]))
def test_the_contact_force_in_the_history_is_that_of_a_grain(dimension, tmp_path):
    """A parcel at rest on the floor: each of its grains is carried by its own weight."""
    weight = 4.0 / 3.0 * np.pi * RADIUS**3 * 2500.0 * 9.81
    # Linear contact, k z = m g: both have the factor l^(D-2) of stiffness and l^D of mass.
    depth = 2.0**dimension * weight / (2.0 ** (dimension - 2) * 2e3)
    middle = [12.0 * RADIUS] * (dimension - 1) + [2.0 * RADIUS - depth]
    tables = crowd(dimension, 2.0, "linear")
    tables["domain"]["gravity"] = [0.0] * (dimension - 1) + [-9.81]
    tables["particles"] |= {"position": [middle], "velocity": [[0.0] * dimension]}
    run = jaxdem.simulate(scene_of(tables), tmp_path / "run")
    np.testing.assert_allclose(run.history["collision_force_mean"][1:], weight, rtol=1e-6)
