"""A periodic stream that a pressure gradient, a bulk velocity or gravity drives: closed forms, balances, refusals."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.check.cautions import stream_from_rest
from jaxdem.closures import KochHill
from jaxdem.errors import InputError
from jaxdem.train.closures import Closures
from jaxdem.train.dataset import make_dataset
from jaxdem.train.dataset_file import read_dataset
from jaxdem.train.reference import follow
from tests.cases.tiers import tiered

HEIGHT, LENGTH, DENSITY, VISCOSITY = 0.02, 0.03, 800.0, 1e-4
SIDES = {"left": {"kind": "periodic"}, "right": {"kind": "periodic"}}
AROUND = SIDES | {"bottom": {"kind": "periodic"}, "top": {"kind": "periodic"}}


def channel(boundary=SIDES, gravity=(0.0, 0.0), end=8.0, **fluid):
    """Two plates, or others, around a stream along x; 2-D."""
    return {
        "precision": "float64",
        "domain": {"size": [LENGTH, HEIGHT], "depth": 0.01, "gravity": list(gravity)},
        "fluid": {"cells": [3, 16], "density": DENSITY, "viscosity": VISCOSITY, "time_step": 0.002} | fluid,
        "boundary": boundary,
        "time": {"end": end, "output_interval": 0.02},
    }


def start_of(tables):
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    return simulation, parameters, *jaxdem.initial_state(scene, simulation, parameters)


@functools.partial(jax.jit, static_argnums=(0, 4))
def run(simulation, parameters, state, neighbors, steps):
    return jaxdem.rollout(simulation, parameters, state, neighbors, steps, reversible=False).state


def profile(state):
    """Velocity along x by height, and the heights of the cells."""
    u = np.asarray(state.fluid.face_velocity[0])
    np.testing.assert_allclose(u, np.broadcast_to(u[:1], u.shape), atol=1e-13)
    return u[0], (np.arange(u.shape[1]) + 0.5) * HEIGHT / u.shape[1]


def test_plane_poiseuille_flow():
    """u = -G z (H - z) / (2 mu) between two plates, 1 % of the largest; its slope by G is u / G."""
    simulation, parameters, state, neighbors = start_of(channel(pressure_gradient=[-40.0, 0.0]))
    u, z = profile(run(simulation, parameters, state, neighbors, 2000))
    exact = 40.0 * z * (HEIGHT - z) / (2.0 * DENSITY * VISCOSITY)
    assert np.abs(u - exact).max() < 0.01 * exact.max()

    def middle(gradient):
        drive = parameters.fluid.drive._replace(pressure_gradient=jnp.stack([gradient, 0.0 * gradient]))
        changed = parameters._replace(fluid=parameters.fluid._replace(drive=drive))
        return jaxdem.rollout(simulation, changed, state, neighbors, 20).state.fluid.face_velocity[0][0, 8]

    value, slope = jax.jit(jax.value_and_grad(middle))(jnp.asarray(-40.0))
    # At rest before, the flow is a linear function of the gradient: advection is along the streamlines, which are
    # equal.
    assert float(slope) == pytest.approx(float(value) / -40.0, rel=1e-9)


def test_film_on_an_incline():
    """Gravity drives a film with a free surface: u = g_x z (2 H - z) / (2 nu), 1 % of the largest."""
    tilted = channel(SIDES | {"top": {"kind": "free_slip"}}, gravity=(0.05, -9.8), end=30.0)
    u, z = profile(run(*start_of(tilted), 8000))
    exact = 0.05 * z * (2.0 * HEIGHT - z) / (2.0 * VISCOSITY)
    assert np.abs(u - exact).max() < 0.01 * exact.max()


def test_bulk_velocity_is_held():
    """To rounding in every step of a fluid alone; the gradient that it takes is 12 mu U / H^2 between two plates, 1
    %."""
    simulation, parameters, state, neighbors = start_of(channel(bulk_velocity=[0.03, 0.0], velocity=[0.01, 0.0]))
    for steps in (1, 2, 1500):
        state = run(simulation, parameters, state, neighbors, steps)
        assert float(jnp.mean(state.fluid.face_velocity[0])) == pytest.approx(0.03, rel=1e-12)
    gradient = 12.0 * DENSITY * VISCOSITY * 0.03 / HEIGHT**2
    assert float(state.fluid.mean_gradient[0]) == pytest.approx(-gradient, rel=0.01)
    assert float(state.fluid.mean_gradient[1]) == 0.0


@pytest.mark.parametrize(
    ("precision", "within"), tiered([("float32", 0.01), ("float64", 0.001)], first=[("float64", 0.001)])
)
def test_the_gradient_of_a_held_flow_at_every_output(precision, within, tmp_path):
    """12 mu U / H^2 once the flow is steady, after ten times H^2 / (4 pi^2 nu) of the slowest wave that holds U; with
    several fluid steps in an interval."""
    tables = channel(bulk_velocity=[0.03, 0.0], velocity=[0.03, 0.0], end=1.5, cells=[2, 48])
    tables |= {"precision": precision, "time": {"end": 1.5, "output_interval": 0.1}}
    run = jaxdem.simulate(jaxdem.load_scene(tables), tmp_path / "run")
    assert run.summary["counts"]["fluid_steps"] >= 4 * run.summary["counts"]["coupling_intervals"]
    steady = run.history["pressure_gradient_x"][run.history["time"] > 1.05]
    gradient = 12.0 * DENSITY * VISCOSITY * 0.03 / HEIGHT**2
    assert len(steady) == 5
    np.testing.assert_allclose(steady, -gradient, rtol=within)


def test_the_history_has_the_mean_gradient_since_the_last_output(tmp_path):
    """Of a ramp to 80 Pa/m within the first of two outputs: half of it, then all; at the start what acts there."""
    ramp = channel(AROUND, drive_times=[0.0, 0.02], pressure_gradient=[[-8.0, 0.0], [-80.0, 16.0]], end=0.04)
    history = jaxdem.simulate(jaxdem.load_scene(ramp), tmp_path / "run").history
    np.testing.assert_allclose(history["pressure_gradient_x"], [-8.0, -44.0, -80.0], rtol=1e-12)
    np.testing.assert_allclose(history["pressure_gradient_z"], [0.0, 8.0, 16.0], rtol=1e-12)


def test_tables_in_time():
    """A ramp of the gradient, and a bulk velocity that changes: the mean flow is the integral, or the table."""
    ramp = channel(AROUND, drive_times=[0.0, 0.02, 0.04], pressure_gradient=[[0.0, 0.0], [-80.0, 16.0], [-80.0, 16.0]])
    flow = run(*start_of(ramp), 20).fluid.face_velocity  # 0.04 s
    # Half of 80 Pa/m for 0.02 s, then all of it for as long.
    np.testing.assert_allclose([jnp.mean(u) for u in flow], np.asarray([1.0, -0.2]) * 80.0 * 0.03 / DENSITY, rtol=1e-12)
    table = channel(AROUND, drive_times=[0.0, 0.02], bulk_velocity=[[0.0, "free"], [0.04, "free"]])
    assert float(jnp.mean(run(*start_of(table), 5).fluid.face_velocity[0])) == pytest.approx(0.02, rel=1e-12)


def grains(gravity=(0.0, 0.0), drag="ergun", density=1e10, **fluid):
    """Grains on a lattice in a box that is periodic all around; heavy ones stay where they are."""
    spacing, number = 0.004, 5
    places = [[(i + 0.5) * spacing, (j + 0.5) * spacing] for i in range(number) for j in range(number)]
    side = number * spacing
    return channel(AROUND, gravity, **fluid) | {
        "domain": {"size": [side, side], "depth": spacing, "gravity": list(gravity)},
        "particles": {"radius": 0.0015, "density": density, "position": places},
        "contact": {"young_modulus": 1e6 * density / 1500.0},
        "coupling": {"drag": drag, "kernel_width": {"diameters": 0.0, "cells": 1.0}},
        "fluid": {"cells": [5, 5], "density": DENSITY, "viscosity": VISCOSITY, "time_step": 0.002} | fluid,
    }


def test_bed_that_is_flown_through():
    """Ergun's pressure drop along a bed at rest, 0.1 %; the bulk velocity is held within 0.1 %.

    The volume flow over the cross-section is Ergun's superficial velocity."""
    speed, diameter = 0.02, 0.003
    state = run(*start_of(grains(bulk_velocity=[speed, 0.0])), 400)
    g = state.fluid.void_fraction
    solids = 1.0 - float(jnp.mean(g))
    assert float(jnp.std(g)) < 1e-3  # the kernels make the lattice even
    viscous = 150.0 * DENSITY * VISCOSITY * solids**2 / ((1.0 - solids) ** 3 * diameter**2) * speed
    inertial = 1.75 * DENSITY * solids / ((1.0 - solids) ** 3 * diameter) * speed**2
    assert float(state.fluid.mean_gradient[0]) == pytest.approx(-(viscous + inertial), rel=1e-3)
    assert float(jnp.mean(g[0] * state.fluid.face_velocity[0][0])) == pytest.approx(speed, rel=1e-3)


def momentum(parameters, state):
    """(D,) of fluid and grains in the box [kg m/s]."""
    g, fluid = state.fluid.void_fraction, []
    for axis, u in enumerate(state.fluid.face_velocity):
        between = 0.5 * (g + jnp.roll(g, 1, axis))  # face 0 is between the last cell and the first
        fluid.append(jnp.sum(between * jnp.take(u, jnp.arange(5), axis)))
    grains = parameters.bodies.mass * jnp.sum(state.particles.velocity, 0)
    return parameters.fluid.density * 0.004**3 * jnp.stack(fluid) + grains


@pytest.mark.parametrize("model", tiered(["A", "B"], first=["B"]))
def test_momentum_is_what_the_gradient_gives(model):
    """d(momentum)/dt = -G times the volume of the box, to rounding, whatever the grains do."""
    tables = grains(drag="koch_hill", density=1500.0, pressure_gradient=[-300.0, 100.0], model=model)
    simulation, parameters, state, neighbors = start_of(tables)
    end = run(simulation, parameters, state, neighbors, 15)
    assert float(jnp.abs(end.particles.velocity).min()) > 1e-3
    gained = momentum(parameters, end) - momentum(parameters, state)
    volume = 0.02 * 0.02 * 0.004
    np.testing.assert_allclose(gained, np.asarray([300.0, -100.0]) * volume * 15 * simulation.interval, rtol=1e-9)


def test_free_fall_of_everything():
    """Gravity along a periodic axis and nothing that holds: fluid and grains fall together, without a slip."""
    simulation, parameters, state, neighbors = start_of(grains((0.0, -9.0), "koch_hill", 1500.0))
    end = run(simulation, parameters, state, neighbors, 10)
    fallen = -9.0 * 10 * simulation.interval
    np.testing.assert_allclose(end.particles.velocity[:, 1], fallen, rtol=1e-9)
    np.testing.assert_allclose(end.fluid.face_velocity[1], fallen, rtol=1e-9)


def test_a_held_suspension_carries_its_weight():
    """With no net flow the gradient carries the weight of grains and fluid: what is driven does not fall all
    together."""
    simulation, parameters, state, neighbors = start_of(
        grains((0.0, -9.0), "koch_hill", 1500.0, bulk_velocity=["free", 0.0])
    )
    end = run(simulation, parameters, state, neighbors, 60)
    slip = np.asarray(end.particles.velocity[:, 1])
    assert slip.max() < -1e-4  # they settle through the fluid
    solids = 1.0 - float(jnp.mean(end.fluid.void_fraction))
    # Of the reduced pressure, at a steady settling speed: the submerged weight of the grains.
    rest = run(simulation, parameters, end, neighbors, 400)
    assert float(rest.fluid.mean_gradient[1]) == pytest.approx(-9.0 * solids * (1500.0 - DENSITY), rel=0.02)


@pytest.mark.parametrize(
    ("fluid", "key", "message"),
    [
        ({"pressure_gradient": [0.0, 1.0]}, "fluid.pressure_gradient", "not periodic"),
        ({"bulk_velocity": [0.0, 1.0]}, "fluid.bulk_velocity", "not periodic"),
        ({"pressure_gradient": [1.0, 0.0], "bulk_velocity": [0.1, 0.0]}, "fluid.pressure_gradient", "a result"),
        ({"pressure_gradient": [1.0]}, "fluid.pressure_gradient", "needs 2 numbers"),
        ({"pressure_gradient": [[1.0, 0.0]]}, "fluid.pressure_gradient", "drive_times"),
        ({"pressure_gradient": [1.0, 0.0], "drive_times": [0.0, 1.0]}, "fluid.pressure_gradient", "drive_times"),
        ({"drive_times": [0.0, 1.0]}, "fluid.drive_times", "pressure_gradient"),
        ({"drive_times": [0.0, 1.0], "bulk_velocity": [[0.1, 0.0], ["free", 0.0]]}, "fluid.bulk_velocity", "held"),
    ],
)
def test_what_cannot_be_driven_is_refused(fluid, key, message):
    """By the key at fault."""
    with pytest.raises(InputError, match=message) as error:
        jaxdem.load_scene(channel(**fluid))
    assert error.value.key == key


@pytest.mark.parametrize(
    ("fluid", "told"),
    [
        ({"pressure_gradient": [-40.0, 0.0]}, 1),
        ({"pressure_gradient": [-40.0, 0.0], "velocity": [0.1, 0.0]}, 0),
        ({"bulk_velocity": [0.1, 0.0]}, 0),
        ({}, 0),
    ],
)
def test_check_says_that_a_stream_from_rest_has_no_courant_limit(fluid, told):
    """Where no side, bulk velocity or initial velocity tells a speed; nothing in still water."""
    sentences = list(stream_from_rest(jaxdem.load_scene(channel(**fluid))))
    assert len(sentences) == told and all("no limit of the Courant number" in text for text in sentences)


def test_model_b_has_no_gravity_along_a_periodic_axis():
    """Its particles feel no pressure gradient, so that they would not fall with the fluid."""
    with pytest.raises(InputError, match="model"):
        jaxdem.load_scene(channel(gravity=(1.0, -9.8), model="B"))


def test_gravity_that_the_scene_has_not_is_refused():
    """It would act on the grains and not on the fluid."""
    simulation, parameters, state, neighbors = start_of(channel())
    assert simulation.fluid.solver.drive is None and state.fluid.mean_gradient is None
    tilted = parameters._replace(gravity=jnp.asarray([1.0, -9.8]))
    with pytest.raises(InputError, match="periodic"):
        jaxdem.rollout(simulation, tilted, state, neighbors, 1)


def test_a_run_writes_what_drives_it(tmp_path):
    """The history has the gradient and the flow; samples and datasets have the gradient."""
    tables = grains(bulk_velocity=[0.02, "free"], density=2500.0) | {"time": {"end": 0.08, "output_interval": 0.02}}
    scene = jaxdem.load_scene(tables | {"output": {"samples": 0.02}})
    run = jaxdem.simulate(scene, tmp_path / "run")
    history = run.history
    assert set(history) >= {f"{name}_{axis}" for name in ("pressure_gradient", "bulk_velocity") for axis in "xz"}
    assert history["bulk_velocity_x"][1:] == pytest.approx(0.02, rel=0.01)
    assert np.all(history["pressure_gradient_x"][1:] < 0.0) and np.all(history["pressure_gradient_z"] == 0.0)
    sample = run.samples.frame(1)
    gradient, mean = sample["pressure_gradient"][:, 0].mean(), sample["mean_gradient"][0]
    # Around grains that lie alike the periodic part of the pressure has no mean gradient.
    assert mean < 0.0 and gradient == pytest.approx(mean, rel=0.01)
    make_dataset(tmp_path / "run", tmp_path / "data.h5", (1,))
    rows = read_dataset(tmp_path / "data.h5").groups[1].pressure_gradient
    seen = np.concatenate([run.samples.frame(k)["pressure_gradient"] for k in range(len(run.samples))])
    np.testing.assert_allclose(rows, seen, rtol=1e-6, atol=1e-6)
    # A training that follows the run starts from its outputs with the gradient that they had.
    case = follow(scene, run, Closures(KochHill(), None))
    state, neighbors = case.with_list(case.start(2))
    assert float(state.fluid.mean_gradient[0]) == pytest.approx(history["pressure_gradient_x"][2], rel=1e-6)
    assert float(state.fluid.mean_gradient[1]) == 0.0
    assert int(jaxdem.rollout(case.simulation, case.parameters, state, neighbors, 1, reversible=False).failures) == 0
