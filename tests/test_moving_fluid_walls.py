"""Walls that move in the fluid: pistons, bodies, oscillating walls; what they sweep, and what is refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem import build, initial_state, load_scene
from jaxdem.fluid.grid import divergence
from tests.cases.steps import compiled_step
from tests.cases.tiers import COMBINATION
from tests.test_fluid_walls import refusal, tables

END = {"time": {"end": 0.4, "output_interval": 0.1}}
BOX = {
    "domain": {"size": [0.4, 0.2], "gravity": [0.0, 0.0]},
    "fluid": {"cells": [20, 10], "time_step": 0.01},
    **END,
}
DEPTH, DENSITY = 0.02, 1000.0


def march(given, steps, change=lambda parameters: parameters):
    """States and reports of a scene without grains, step by step, and the simulation."""
    scene = load_scene(given)
    simulation, parameters = build(scene)
    parameters = change(parameters)
    state, _ = initial_state(scene, simulation, parameters)
    step, found = compiled_step(simulation), []
    for _ in range(steps):
        state, _, told = step(parameters, state, None)
        found.append((state, told))
    return simulation, parameters, found


PISTON = {
    "kind": "plane", "point": [0.053, 0.0], "normal": [1.0, 0.0], "fluid": "free_slip",
    "motion": [
        {"kind": "translation", "velocity": [0.1, 0.0]},
        {"kind": "oscillation", "direction": [1.0, 0.0], "amplitude": 0.005, "frequency": 2.0},
    ],
}  # fmt: skip


def test_a_piston_pushes_out_what_it_sweeps():
    sides = {"right": {"kind": "outlet"}, "top": {"kind": "free_slip"}, "bottom": {"kind": "free_slip"}}
    simulation, _, found = march(tables(PISTON, grains=False, boundary=sides, **BOX), 32)
    step, height = simulation.interval, 0.2
    way = 0.1 * step * np.arange(33) + 0.005 * np.sin(4.0 * np.pi * step * np.arange(33))
    speed = np.diff(way) / step
    outflow = [float(jnp.mean(state.fluid.face_velocity[0][-1])) for state, _ in found]
    assert outflow == pytest.approx(speed.tolist(), rel=1e-12)
    assert max(float(told.fluid.divergence) for _, told in found) < 1e-10
    # The force on it is that on the column of water before it, whose mass shrinks; cells open to 2 % of its length.
    force = np.asarray([float(told.fluid.surface_load[0, 0, 0]) for _, told in found])[1:]
    mass = DENSITY * DEPTH * height * (0.4 - 0.053 - way[2:])
    expected = -mass * np.diff(speed) / step
    assert np.abs(force - expected).max() < 0.03 * np.abs(expected).max()
    assert "no way out" in refusal(tables(PISTON, grains=False, **BOX))


BODY = {
    "kind": "cylinder", "center": [0.1, 0.1], "radius": 0.04, "inside": False, "fluid": "no_slip",
    "motion": [{"kind": "translation", "velocity": [0.3, 0.0]}],
}  # fmt: skip
STREAM = {
    "left": {"kind": "inlet", "velocity": [0.3, 0.0], "ramp_time": 0.0},
    "right": {"kind": "outlet"},
    "top": {"kind": "free_slip"},
    "bottom": {"kind": "free_slip"},
}


def test_a_body_that_moves_with_a_stream_leaves_it_as_it_is():
    """Galilean: cells open and close, and nothing happens. What forgets the wall's motion does not keep the stream."""
    box = BOX | {"fluid": BOX["fluid"] | {"velocity": [0.3, 0.0]}}
    simulation, parameters, found = march(tables(BODY, grains=False, boundary=STREAM, **box), 40)
    for state, told in found:
        along, across = (np.asarray(u) for u in state.fluid.face_velocity)
        assert np.abs(along - 0.3).max() < 1e-14 and np.abs(across).max() < 1e-14
        assert np.abs(np.asarray(told.fluid.surface_load)).max() < 1e-12
    state = found[9][0]
    moved, fluid = jax.jit(simulation.with_moved_walls)(parameters, state.fluid, state.step)
    cut = moved.fluid.cut
    flux = cut.opened(fluid.face_velocity)
    assert float(jnp.abs(divergence(simulation.fluid.solver.grid, flux) + cut.swept).max()) < 1e-12
    # Negative control: without what is swept, or with a wall that is taken for one at rest, the stream does not obey
    # continuity: it would pass through the body.
    still = (({"rate": jnp.zeros(())},),)
    at_rest = jax.jit(simulation.walls_in_fluid.over)(moved.fluid, fluid, still, *now(simulation))[0].cut
    assert float(jnp.abs(divergence(simulation.fluid.solver.grid, flux)).max()) > 1.0
    flux = at_rest.opened(fluid.face_velocity)
    assert float(jnp.abs(divergence(simulation.fluid.solver.grid, flux) + at_rest.swept).max()) > 1.0


def now(simulation):
    """Start of the eleventh interval, as a pair, with its length; and middles of the interval before it and its own
    [s]."""
    length = jnp.asarray(simulation.interval)
    return ((10 * length, None), length), (9.5 * length, 10.5 * length)


@COMBINATION
def test_a_body_that_swings_in_a_closed_box_keeps_the_volume():
    swinging = BODY | {"center": [0.21, 0.093]}
    swinging["motion"] = [{"kind": "oscillation", "direction": [1.0, 0.3], "amplitude": 0.03, "frequency": 1.0}]
    simulation, parameters, found = march(tables(swinging, grains=False, **BOX), 25)
    assert all(bool(told.fluid.converged) for _, told in found)
    assert max(float(told.fluid.divergence) for _, told in found) < 1e-10
    moved, _ = simulation.with_moved_walls(parameters, found[-1][0].fluid, jnp.asarray(25))
    swept = np.asarray(moved.fluid.cut.swept)
    assert abs(swept.sum()) < 1e-12 * np.abs(swept).sum() and np.abs(swept).max() > 0.1
    # The force changes from step to step as the acceleration does: no cell that opens or closes is felt.
    force = np.asarray([float(told.fluid.surface_load[0, 0, 0]) for _, told in found])[2:]
    assert np.abs(np.diff(force, 2)).max() < 0.1 * np.ptp(force)


@COMBINATION
def test_a_wall_that_swings_in_its_own_plane_drives_the_layer_of_stokes():
    """u = U exp(-k y) cos(w t - k y), k = sqrt(w/(2 nu)): 1/k is 3.6 cells, the wall 0.7 of one above a grid line."""
    rate, viscosity, amplitude = 2.0 * np.pi, 4e-3, 0.05
    wall = {"kind": "plane", "point": [0.0, 0.017], "normal": [0.0, 1.0], "fluid": "no_slip"}
    wall["motion"] = [{"kind": "oscillation", "direction": [1.0, 0.0], "amplitude": amplitude, "frequency": 1.0}]
    box = {
        "domain": {"size": [0.02, 0.24], "gravity": [0.0, 0.0]},
        "fluid": {"cells": [2, 24], "viscosity": viscosity, "time_step": 0.0025},
        "boundary": {"left": {"kind": "periodic"}, "right": {"kind": "periodic"}},
        "time": {"end": 2.0, "output_interval": 0.1},
    }
    scene = load_scene(tables(wall, grains=False, **box))
    simulation, parameters = build(scene)
    state, _ = initial_state(scene, simulation, parameters)
    advance = lambda k, state: simulation.step(parameters, state, None)[0]  # noqa: E731
    march_on = jax.jit(lambda state: jax.lax.fori_loop(0, 100, advance, state))
    k, y = np.sqrt(rate / (2.0 * viscosity)), (np.arange(24) + 0.5) * 0.01 - 0.017
    for number in range(1, 7):
        state = march_on(state)
        if number >= 4:
            time = 100 * number * simulation.interval
            exact = rate * amplitude * np.exp(-k * y) * np.cos(rate * time - k * y)
            u = np.asarray(state.fluid.face_velocity[0])[0]
            assert np.abs(u - exact)[y > 0.0].max() < 0.015 * rate * amplitude
    wall["motion"][0]["end"] = 0.25
    simulation, parameters = build(load_scene(tables(wall, grains=False, **box)))
    speeds = [simulation.with_moved_walls(parameters, state.fluid, jnp.asarray(n))[0].fluid.cut for n in (0, 120)]
    assert float(jnp.abs(speeds[0].velocity[0]).max()) > 0.3
    assert float(jnp.abs(speeds[1].velocity[0]).max()) == 0.0


def test_open_parts_and_what_is_swept_have_slopes_by_the_speed_of_a_body():
    """So forces have, by the implicit derivative of the pressure."""
    scene = load_scene(tables(BODY, grains=False, boundary=STREAM, **BOX))
    simulation, parameters = build(scene)
    state, _ = initial_state(scene, simulation, parameters)
    weights = np.random.default_rng(0).standard_normal(simulation.fluid.solver.grid.cells)

    @jax.jit
    def figure(speed):
        given = parameters._replace(wall_motion=(({"rate": speed},),))
        cut = simulation.with_moved_walls(given, state.fluid, jnp.asarray(11))[0].fluid.cut
        return jnp.sum(weights * (cut.open_cells + cut.swept)) + jnp.sum(cut.friction[0] * cut.velocity[0]) / 1e4

    slope, step = float(jax.jit(jax.grad(figure))(0.2)), 1e-7
    assert slope == pytest.approx((float(figure(0.2 + step)) - float(figure(0.2 - step))) / (2.0 * step), rel=1e-5)
