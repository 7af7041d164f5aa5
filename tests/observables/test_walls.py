"""Forces and torques on walls: the third law, balances of momentum, and closed forms of flows."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.fluid.grid import along, face_average, face_control_volume
from jaxdem.fluid.side_forces import pressure_on_sides
from jaxdem.observables import (
    contact_table,
    fluid_force,
    fluid_torque,
    measuring_walls,
    side_walls,
    surface_walls,
    wall_load,
)
from tests.cases.tiers import COMBINATION, tiered

MASS = 2500.0 * 4.0 / 3.0 * np.pi * 0.01**3

GRAINS = {
    "precision": "float64",
    "domain": {"size": [0.12, 0.1, 0.11], "gravity": [0.3, 0.0, -9.81]},
    "particles": {
        "radius": 0.01,
        "density": 2500.0,
        "position": [
            [0.02, 0.03, 0.025], [0.09, 0.08, 0.03], [0.06, 0.05, 0.08], [0.03, 0.07, 0.09], [0.05, 0.05, 0.03],
        ],
        "velocity": [[-1.0, 0.4, -0.5], [1.2, 0.8, -0.3], [0.2, -0.4, 1.5], [-0.8, 1.0, 0.7], [0.5, 0.1, -1.0]],
    },
    "contact": {
        "law": "linear_spring_dashpot", "normal_stiffness": 2e4, "restitution": 0.7, "friction": 0.4, "speed": 2.0,
        "rolling_friction": 0.1,
    },
    "walls": [{"kind": "plane", "point": [0.0, 0.0, 0.02], "normal": [0.3, 0.1, 1.0]}],
    "time": {"end": 0.005, "output_interval": 0.005},
}  # fmt: skip


def steps_of(tables, number, rests=False):
    """Simulation, parameters, and states, reports and lists of a number of intervals; whether contacts carry each
    weight."""
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    simulation = measuring_walls(simulation)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    if rests:
        held = jnp.broadcast_to(-MASS * parameters.gravity, state.particles.velocity.shape)
        state = state._replace(particles=state.particles._replace(contact_force=held))
    step = jax.jit(simulation.step)
    states, reports, lists = [state], [], [neighbors]
    for _ in range(number):
        state, neighbors, report = step(parameters, state, neighbors)
        states.append(state)
        reports.append(report)
        lists.append(neighbors)
    return simulation, parameters, states, reports, lists


def angular_momentum(state):
    particles = state.particles
    inertia = 0.4 * MASS * 0.01**2
    return np.cross(particles.position, MASS * particles.velocity) + inertia * np.asarray(particles.angular_velocity)


@pytest.fixture(scope="module")
def bouncing():
    return steps_of({**GRAINS, "domain": {**GRAINS["domain"], "gravity": [0.0, 0.0, 0.0]}}, 12)


def test_momentum_lost_is_what_the_walls_have_got(bouncing):
    """Of grains that bounce, slide and roll: linear and angular, in every interval, over all walls."""
    simulation, _, states, reports, _ = bouncing
    walls = tuple(range(simulation.contact.model.walls))
    touched = set()
    for before, after, report in zip(states[:-1], states[1:], reports, strict=True):
        load = wall_load(report, walls, jnp.zeros(3))
        impulse = MASS * np.sum(after.particles.velocity - before.particles.velocity, axis=0)
        scale = MASS * 2.0
        np.testing.assert_allclose(impulse, -simulation.interval * np.asarray(load.force), atol=1e-13 * scale)
        turned = (angular_momentum(after) - angular_momentum(before)).sum(axis=0)
        np.testing.assert_allclose(turned, -simulation.interval * np.asarray(load.torque), atol=1e-13 * 0.1 * scale)
        touched |= {k for k, force in enumerate(zip(*report.particles.walls.force, strict=True)) if any(force)}
    assert len(touched) >= 5


def test_torque_about_another_point(bouncing):
    simulation, _, _, reports, _ = bouncing
    walls = (*side_walls(simulation, 2, True), *surface_walls(simulation, (0,)))
    about = np.array([0.03, -0.2, 0.1])
    for report in reports:
        own, other = wall_load(report, walls, jnp.zeros(3)), wall_load(report, walls, jnp.asarray(about))
        np.testing.assert_allclose(own.torque - np.cross(about, own.force), other.torque, rtol=1e-12, atol=1e-18)


@pytest.fixture(scope="module")
def column():
    """Three grains on each other in 2-D, each pressed down by its weight and those above."""
    overlap = MASS * 9.81 * np.array([3.0, 2.0, 1.0]) / 2e4
    heights = np.cumsum([0.01, 0.02, 0.02] - overlap)
    tables = {
        **GRAINS,
        "domain": {"size": [0.1, 0.1], "depth": 0.02},
        "particles": {"radius": 0.01, "density": 2500.0, "position": [[0.03, z] for z in heights]},
    }
    del tables["walls"]
    return steps_of(tables, 1, rests=True)


def test_a_column_at_rest_weighs_on_the_bottom(column):
    simulation, _, _, reports, _ = column
    weight = 3.0 * MASS * 9.81
    bottom = wall_load(reports[0], side_walls(simulation, 1, False), jnp.zeros(2))
    np.testing.assert_allclose(bottom.force, [0.0, -weight], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(bottom.torque, [-0.03 * weight], rtol=1e-9)
    for wall in (side_walls(simulation, 1, True), side_walls(simulation, 0, False)):
        assert not np.any(wall_load(reports[0], wall, jnp.zeros(2)).force)


LIQUID = {
    "precision": "float64",
    "domain": {"size": [0.3, 0.2], "depth": 0.1},
    "fluid": {"cells": [6, 5], "density": 1000.0, "viscosity": 1e-3, "time_step": 0.01},
    "boundary": {"top": {"kind": "moving_wall", "velocity": [0.5, 0.0]}, "right": {"kind": "free_slip"}},
    "time": {"end": 0.1, "output_interval": 0.1},
}


def fluid_momentum(simulation, fluid, density):
    """Of the faces whose velocity is solved for."""
    grid, found = simulation.fluid.solver.grid, []
    void = face_average(grid, 1.0 if fluid.void_fraction is None else fluid.void_fraction)
    for axis, (g, u) in enumerate(zip(void, fluid.face_velocity, strict=True)):
        carried = g * u * face_control_volume(grid, axis)
        ends = (0, -1) if grid.periodic[axis] else (1, -1)
        found.append(density * float(jnp.sum(along(carried, axis, *ends))))
    return np.array(found)


def on_all_sides(simulation, report):
    sides = [(axis, upper) for axis in range(len(simulation.box)) for upper in (False, True)]
    return sum(np.asarray(fluid_force(report, *side)) for side in sides)


@pytest.mark.parametrize(
    ("fluid", "precision", "rounding"),
    [
        pytest.param({}, "float64", 1e-12, marks=COMBINATION),
        ({"smagorinsky": 0.2}, "float64", 1e-12),
        pytest.param({}, "float32", 1e-6, marks=COMBINATION),
    ],
)
def test_a_cavity_gains_what_its_sides_give(fluid, precision, rounding):
    """A lid that has just begun to move, walls and a free-slip side: in every interval, to rounding.

    That is of the momentum of 6 kg of the liquid at the lid's speed.
    """
    tables = {**LIQUID, "precision": precision, "fluid": {**LIQUID["fluid"], **fluid}}
    simulation, _, states, reports, _ = steps_of(tables, 6)
    for before, after, report in zip(states[:-1], states[1:], reports, strict=True):
        change = fluid_momentum(simulation, after.fluid, 1000.0) - fluid_momentum(simulation, before.fluid, 1000.0)
        lid = abs(float(fluid_force(report, 1, True)[0]))
        assert lid > 0.0
        expected = -simulation.interval * on_all_sides(simulation, report)
        np.testing.assert_allclose(change, expected, atol=rounding * 6.0 * 0.5)
    assert float(fluid_force(reports[-1], 0, True)[1]) == 0.0  # the free-slip side drags nothing


@pytest.mark.parametrize("model", tiered(["A", "B"], first=["A"]))
def test_momentum_of_grains_and_fluid_in_a_closed_box(model):
    """Grains that fall through water on a wall and along a side: fluid, grains, sides and weight balance."""
    tables = {
        **{key: GRAINS[key] for key in ("precision", "contact", "time")},
        "domain": {"size": [0.2, 0.2], "depth": 0.02, "gravity": [0.0, -9.81]},
        "particles": {
            "radius": 0.01, "density": 2500.0, "position": [[0.0105, 0.012], [0.05, 0.1], [0.1895, 0.05]],
            "velocity": [[-0.3, -0.5], [0.2, -0.1], [0.5, 0.3]],
        },
        "fluid": {"cells": [5, 5], "density": 1000.0, "viscosity": 1e-4, "time_step": 0.0025, "model": model},
    }  # fmt: skip
    simulation, parameters, states, reports, _ = steps_of(tables, 4)
    mass, volume = float(parameters.bodies.mass), float(parameters.bodies.volume)
    weight = 3.0 * (mass - 1000.0 * volume) * np.array([0.0, -9.81])
    walls = tuple(range(simulation.contact.model.walls))
    for before, after, report in zip(states[:-1], states[1:], reports, strict=True):
        change = fluid_momentum(simulation, after.fluid, 1000.0) - fluid_momentum(simulation, before.fluid, 1000.0)
        change = change + mass * np.sum(after.particles.velocity - before.particles.velocity, axis=0)
        forces = weight - on_all_sides(simulation, report) - np.asarray(wall_load(report, walls, jnp.zeros(2)).force)
        np.testing.assert_allclose(change, simulation.interval * forces, atol=1e-9 * mass)


def channel_report(height, top, pressure_gradient):
    """The report of a step once the flow is steady."""
    tables = {
        **LIQUID,
        "domain": {"size": [0.1, 0.1, height]},
        "fluid": {
            "cells": [2, 2, 8], "density": 2.0, "viscosity": 0.5, "time_step": 1e-4,
            "pressure_gradient": [pressure_gradient, 0.0, 0.0],
        },
        "boundary": {
            "left": {"kind": "periodic"}, "front": {"kind": "periodic"},
            "top": {"kind": "moving_wall", "velocity": [top, 0.0, 0.0]},
        },
        "time": {"end": 0.04, "output_interval": 0.04},
    }  # fmt: skip
    return after_some_time(tables, 400)


def after_some_time(tables, number):
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    simulation = measuring_walls(simulation)
    state, _ = jaxdem.initial_state(scene, simulation, parameters)

    @jax.jit
    def some(state):
        return jax.lax.scan(lambda s, _: simulation.step(parameters, s, None)[::2], state, None, length=number)

    return jax.tree.map(lambda a: a[-1], some(state)[1])


def test_couette_and_poiseuille_flow():
    """Shear of a moving top, mu U / h, and half of the pressure drop at either wall, G h / 2; together in one flow."""
    viscosity, height, top, gradient = 2.0 * 0.5, 0.1, 0.3, -5.0
    report = channel_report(height, top, gradient)
    bottom, upper = (np.asarray(fluid_force(report, 2, upper)) / 0.01 for upper in (False, True))
    shear, drop = viscosity * top / height, -gradient * height / 2.0
    np.testing.assert_allclose(bottom[0], shear + drop, rtol=1e-6)
    np.testing.assert_allclose(upper[0], drop - shear, rtol=1e-6)
    np.testing.assert_allclose([bottom[1], upper[1]], 0.0, atol=1e-12)


def test_torque_of_couette_flow():
    """Shear mu U / h on either plate, at its height, and no pressure: the arm in height times the force along x."""
    report, area = channel_report(0.1, 0.3, 0.0), 0.01
    force, about = 1.0 * 0.3 / 0.1 * area, np.array([0.02, 0.07, 0.03])
    for upper, sign, height in ((False, 1.0, 0.0), (True, -1.0, 0.1)):
        torque = fluid_torque(report, 2, upper, jnp.asarray(about))
        np.testing.assert_allclose(fluid_force(report, 2, upper), [sign * force, 0.0, 0.0], rtol=1e-6, atol=1e-9)
        # (x - a) cross (F, 0, 0) = (0, (z - a_z) F, -(y - a_y) F), with the middle of the plate at y = 0.05.
        expected = [0.0, (height - about[2]) * sign * force, -(0.05 - about[1]) * sign * force]
        np.testing.assert_allclose(torque, expected, rtol=1e-6, atol=1e-10)


def test_torque_of_a_pressure_on_the_sides_of_a_box():
    """Hydrostatic, p = c (H - z): force c H^2 b / 2 on a side, at a third of its height; on the bottom in its middle.

    The sum over 40 cells is off by 1 / (2 n^2) of the torque."""
    scene = jaxdem.load_scene({**LIQUID, "fluid": {**LIQUID["fluid"], "cells": [6, 40]}})
    simulation, _ = jaxdem.build(scene)
    grid, head, depth = simulation.fluid.solver.grid, 9810.0, 0.1
    height = (np.arange(40) + 0.5) * 0.2 / 40
    load = pressure_on_sides(grid, (0, 1, 2), jnp.broadcast_to(head * (0.2 - height), (6, 40)))
    report = jaxdem.state.Diagnostics(None, Reported(load), None, None)
    push = 0.5 * head * 0.2**2 * depth
    for upper, sign in ((False, -1.0), (True, 1.0)):
        np.testing.assert_allclose(fluid_force(report, 0, upper), [sign * push, 0.0], rtol=1e-12)
        torque = fluid_torque(report, 0, upper, jnp.asarray([0.7, 0.05]))
        np.testing.assert_allclose(torque, [-(0.2 / 3.0 - 0.05) * sign * push], rtol=2e-3)
    weight = head * 0.2 * 0.3 * depth * (1.0 - 0.5 / 40)  # the pressure in the middle of the lowest cells
    bottom = fluid_torque(report, 1, False, jnp.asarray([0.04, 0.9]))
    np.testing.assert_allclose(bottom, [-(0.15 - 0.04) * weight], rtol=1e-12)


class Reported(NamedTuple):
    """What a fluid reports of its sides."""

    side_load: jax.Array


def test_rows_of_contacts_of_bouncing_grains(bouncing):
    """Each row is a contact with its place, its force in parts and Coulomb's limit, along with the springs' history."""
    simulation, parameters, states, _, lists = bouncing
    found = 0
    for state, neighbors in zip(states, lists, strict=True):
        table = contact_table(simulation, parameters, state, neighbors)
        found += len(table["first"])
        numbers = list(zip(table["first"], table["second"], table["wall"], strict=True))
        assert numbers == sorted(numbers)
        force = np.stack([table[f"force_{axis}"] for axis in "xyz"], axis=1)
        normal = np.stack([table[f"normal_{axis}"] for axis in "xyz"], axis=1)
        position = np.stack([table[f"position_{axis}"] for axis in "xyz"], axis=1)
        centre = np.asarray(state.particles.position)[table["first"]]
        arm = 0.01 - 0.5 * table["overlap"]
        np.testing.assert_allclose(position, centre - arm[:, None] * normal, atol=1e-15)
        along = (force * normal).sum(axis=1)
        np.testing.assert_allclose(table["normal_force"], along, atol=1e-12)
        np.testing.assert_allclose(table["tangential_force"] ** 2 + along**2, (force**2).sum(axis=1), rtol=1e-10)
        assert np.all(table["mobilised"] <= 1.0 + 1e-9) and np.all((table["second"] < 0) == (table["wall"] >= 0))
    assert found > 3


def test_contacts_of_a_grain_add_up_to_the_contact_force_of_a_frame(column):
    """At rest the mean over the last interval is that of the moment."""
    simulation, parameters, states, _, lists = column
    state, neighbors = states[-1], lists[-1]
    table = contact_table(simulation, parameters, state, neighbors)
    assert (table["first"].tolist(), table["second"].tolist()) == ([0, 0, 1], [-1, 1, 2])
    assert table["wall"].tolist() == [2, -1, -1]
    total = np.zeros((3, 2))
    for i, j, *force in zip(*(table[name] for name in ("first", "second", "force_x", "force_z")), strict=True):
        total[i] += force
        if j >= 0:
            total[j] -= force
    np.testing.assert_allclose(total, state.particles.contact_force, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(table["normal_force"].max(), 3.0 * MASS * 9.81, rtol=1e-9)


def test_only_scenes_that_ask_for_it_measure_walls():
    """What a step reports, by its shapes: without such a probe there is nothing of it in the program."""
    probe = {"name": "floor", "kind": "wall", "side": "bottom"}
    for probes, measured in (([], False), ([{"name": "all", "kind": "contacts"}], False), ([probe], True)):
        scene = jaxdem.load_scene({**GRAINS, "probes": probes})
        simulation, parameters = jaxdem.build(scene)
        state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
        report = jax.eval_shape(simulation.step, parameters, state, neighbors)[2]
        assert (report.particles.walls is not None) == measured
    for probes, measured in (([], False), ([probe], True)):
        solver = jaxdem.build(jaxdem.load_scene({**LIQUID, "probes": probes}))[0].fluid.solver
        assert solver.measured_sides == ((2,) if measured else ())
