"""Loads on walls: which are measured, sides that move, and gradients."""

from __future__ import annotations

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.errors import InputError
from jaxdem.observables import fluid_force, fluid_torque, measuring_walls, side_walls, surface_walls, wall_load
from jaxdem.particles.contact_sums import WallLoads
from jaxdem.state import Diagnostics

RADIUS, DENSITY = 0.01, 2500.0
MASS = DENSITY * 4.0 / 3.0 * np.pi * RADIUS**3
LID, FLOOR, LEFT, RIGHT = (1, True), (1, False), (0, False), (0, True)

MIXTURE = {
    "precision": "float64",
    "domain": {"size": [0.2, 0.2], "depth": 0.02, "gravity": [0.0, -9.81]},
    "particles": {
        "radius": RADIUS, "density": DENSITY,
        "position": [[0.0098, 0.012], [0.05, 0.0098], [0.1, 0.1902], [0.1748, 0.05]],
        "velocity": [[-0.3, -0.5], [0.2, -0.1], [0.1, 0.3], [0.2, -0.4]],
    },
    "contact": {
        "law": "linear_spring_dashpot", "normal_stiffness": 2e4, "restitution": 0.7, "friction": 0.4, "speed": 2.0,
    },
    "walls": [{"kind": "plane", "point": [0.17, 0.0], "normal": [-1.0, 0.3]}],
    "fluid": {"cells": [4, 4], "density": 1000.0, "viscosity": 1e-3, "time_step": 0.002},
    "boundary": {"top": {"kind": "moving_wall", "velocity": [0.5, 0.0]}},
    "time": {"end": 0.004, "output_interval": 0.002},
}  # fmt: skip


def begun(tables):
    """Simulation, parameters, state and list."""
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    return simulation, parameters, *jaxdem.initial_state(scene, simulation, parameters)


@pytest.fixture(scope="module")
def program():
    """Function of the grains' velocity, what is added to that of the lid, and weights: the weighted sum of loads on
    three sides, these 18 loads and all that was measured; and its slopes. And the state that it starts from."""
    simulation, parameters, state, neighbors = begun(MIXTURE)
    simulation = measuring_walls(simulation.reversible())
    about = jnp.asarray([0.03, 0.07])

    def loads(velocity, lid, weights):
        particles = state.particles._replace(velocity=velocity)
        sides = parameters.fluid.side_velocity
        moved = parameters._replace(fluid=parameters.fluid._replace(side_velocity=(*sides[:3], sides[3] + lid)))
        report = simulation.step(moved, state._replace(particles=particles), neighbors)[2]
        found = []
        for side in (FLOOR, LEFT, LID):
            load = wall_load(report, side_walls(simulation, *side), about)
            found += [load.force, load.torque, fluid_force(report, *side), fluid_torque(report, *side, about)]
        numbers = jnp.concatenate([jnp.ravel(one) for one in found])
        return weights @ numbers, (numbers, report)

    return jax.jit(jax.value_and_grad(loads, argnums=(0, 1), has_aux=True)), state


def test_loads_of_walls_that_are_not_measured_are_nan(program):
    """And those that are measured are the same, to rounding, as where all are."""
    simulation, parameters, state, neighbors = begun(MIXTURE)
    floor = side_walls(simulation, *FLOOR)
    chosen = (*floor, *surface_walls(simulation, (0,)))
    of_all = program[0](state.particles.velocity, jnp.zeros(2), jnp.zeros(18))[0][1][1]
    some = jax.jit(measuring_walls(simulation, chosen, (2,)).step)(parameters, state, neighbors)[2]
    none = jax.eval_shape(measuring_walls(simulation, (), ()).step, parameters, state, neighbors)[2]
    assert none.particles.walls is None and none.fluid.side_load is None
    measured = np.isin(np.arange(simulation.contact.model.walls), chosen)
    for ours, theirs in zip(
        jax.tree.leaves(some.particles.walls), jax.tree.leaves(of_all.particles.walls), strict=True
    ):
        np.testing.assert_array_equal(np.isnan(ours), ~measured)
        np.testing.assert_allclose(ours[measured], theirs[measured], rtol=1e-12, atol=1e-18)
        assert np.all(np.isfinite(theirs))
    assert np.count_nonzero(np.asarray(of_all.particles.walls.force[1])[measured]) == 2
    sides = np.isin(np.arange(4), (2,))
    np.testing.assert_array_equal(np.isnan(some.fluid.side_load).all(axis=(1, 2)), ~sides)
    np.testing.assert_allclose(some.fluid.side_load[2], of_all.fluid.side_load[2], rtol=1e-12, atol=1e-15)
    about = jnp.zeros(2)
    assert np.all(np.isnan(wall_load(some, side_walls(simulation, *LID), about).force))
    assert np.all(np.isnan(fluid_force(some, *LEFT))) and np.all(np.isfinite(fluid_force(some, *FLOOR)))


def test_sides_that_move_get_what_the_grains_lose():
    """A lid that slides: the third law, and it drags the grain that touches it along with Coulomb's friction."""
    tables = {key: MIXTURE[key] for key in ("precision", "domain", "particles", "contact", "time")}
    tables["domain"] = tables["domain"] | {"gravity": [0.0, 0.0]}
    simulation, parameters, state, neighbors = begun(
        tables | {"boundary": {"top": {"kind": "moving_wall", "velocity": [3.0, 0.0]}}}
    )
    simulation = measuring_walls(simulation)
    step, about, walls = jax.jit(simulation.step), jnp.zeros(2), range(simulation.contact.model.walls)
    touched = 0
    for _ in range(4):
        after, neighbors, report = step(parameters, state, neighbors)
        impulse = MASS * np.sum(after.particles.velocity - state.particles.velocity, axis=0)
        total = wall_load(report, tuple(walls), about)
        np.testing.assert_allclose(impulse, -simulation.interval * np.asarray(total.force), atol=1e-13 * MASS)
        lid = np.asarray(wall_load(report, side_walls(simulation, *LID), about).force)
        assert lid[1] >= 0.0
        if lid[1] > 0.0:
            touched += 1
            # It slides, for it is faster than the grain; a step in which they meet or part has a part of the force.
            np.testing.assert_allclose(lid[0], -0.4 * lid[1], rtol=0.02)
        state = after
    assert touched


def test_slopes_of_loads_on_walls(program):
    """Reverse mode against central differences, of forces and torques of grains and fluid on three sides."""
    value_and_slope, start = program
    given = (start.particles.velocity, jnp.zeros(2))
    at = np.asarray(value_and_slope(*given, jnp.zeros(18))[0][1][0])
    assert np.count_nonzero(at) >= 14
    weights = jnp.asarray(np.random.default_rng(3).standard_normal(18) / np.maximum(np.abs(at), 1e-3))
    slopes = value_and_slope(*given, weights)[1]
    random = np.random.default_rng(4)
    for which, slope in enumerate(slopes):
        along, size = jnp.asarray(random.standard_normal(slope.shape)), 1e-6
        ends = []
        for sign in (1.0, -1.0):
            moved = [one + sign * size * along if k == which else one for k, one in enumerate(given)]
            ends.append(float(value_and_slope(*moved, weights)[0][0]))
        numerical = (ends[0] - ends[1]) / (2.0 * size)
        np.testing.assert_allclose(jnp.sum(slope * along), numerical, rtol=1e-5)
        assert abs(numerical) > 1e-3


def test_walls_that_there_are_not_have_no_load():
    """To JAX an index beyond the end is the last one."""
    row = (jnp.ones(3),)
    particles, fluid = (
        SimpleNamespace(walls=WallLoads(row * 2, row, row, row)),
        SimpleNamespace(side_load=jnp.ones((4, 2, 3))),
    )
    diagnostics = Diagnostics(particles, fluid, None, None)
    np.testing.assert_array_equal(wall_load(diagnostics, (0, 2), jnp.zeros(2)).force, [2.0, 2.0])
    for walls in ((3,), (0, -1), (0.0,)):
        with pytest.raises(InputError, match="none of the walls: there are 3"):
            wall_load(diagnostics, walls, jnp.zeros(2))
    np.testing.assert_array_equal(fluid_force(diagnostics, 1, True), [1.0, 1.0])
    with pytest.raises(InputError, match="axis = 2: is the number of none of the axes"):
        fluid_force(diagnostics, 2, True)
