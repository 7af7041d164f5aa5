"""Gravity, drag and moving walls that change with time, against their integrals."""

import dataclasses

import jax
import numpy as np
import pytest

import jaxdem

INTERVAL, INTERVALS = 5e-3, 20
TIMES = [0.0213, 0.0487, 0.0731]
GRAVITY = [[0.0, -9.81], [4.0, -2.0], [-3.0, 1.0]]


def grain(**domain):
    """One grain in an empty box, far from its walls."""
    return {
        "precision": "float64",
        "domain": {"size": [1.0, 1.0], "gravity": GRAVITY, "gravity_times": TIMES} | domain,
        "particles": {"radius": 1e-3, "density": 2500.0, "position": [[0.5, 0.5]]},
        "contact": {"young_modulus": 1e6, "speed": 1.0},
        "coupling": {"interval": INTERVAL},
        "time": {"end": INTERVAL * INTERVALS, "output_interval": INTERVAL * INTERVALS},
    }


def marched(tables, intervals=INTERVALS):
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    step, states = jax.jit(simulation.step), [state]
    for _ in range(intervals):
        state, neighbors, _ = step(parameters, state, neighbors)
        states.append(state)
    return states, state, simulation, parameters


def integral(values, end):
    """Of a table that is linear between `TIMES` and constant outside, from 0 to `end`, by the trapezoidal rule at its
    bends."""
    bends = [0.0, *(time for time in TIMES if time < end), end]
    at_bends = np.stack([np.interp(bends, TIMES, column) for column in np.asarray(values, float).T], axis=1)
    return np.trapezoid(at_bends, bends, axis=0)


def test_a_grain_falls_by_the_integral_of_gravity():
    """v(t) = int g dt, exactly, though the bends of the table lie within intervals; and its slope by every number."""
    _, state, simulation, parameters = marched(grain())
    expected = integral(GRAVITY, INTERVAL * INTERVALS)
    np.testing.assert_allclose(state.particles.velocity[0], expected, rtol=1e-12)

    def speed(gravity):
        given, neighbors = jaxdem.initial_state(jaxdem.load_scene(grain()), simulation, parameters)
        final = jaxdem.rollout(simulation, parameters._replace(gravity=gravity), given, neighbors, 4).state
        return final.particles.velocity[0, 0]

    slope = jax.grad(speed)(parameters.gravity)
    # Up to 0.02 s gravity is that of the first time alone.
    np.testing.assert_allclose(slope, [[4 * INTERVAL, 0.0], [0.0, 0.0], [0.0, 0.0]], rtol=1e-12, atol=1e-15)


def test_gravity_that_does_not_change_is_one_vector():
    _, state, simulation, parameters = marched(grain(gravity=[0.0, -9.81], gravity_times=None), 1)
    assert simulation.gravity_times is None and parameters.gravity.shape == (2,)
    _, same, _, _ = marched(grain(gravity=[[0.0, -9.81]] * 3), 1)
    np.testing.assert_allclose(same.particles.velocity, state.particles.velocity, rtol=1e-14)


STREAM = {
    "precision": "float64",
    "domain": {"size": [0.04, 0.04], "gravity": [[g, 0.0] for g, _ in GRAVITY], "gravity_times": TIMES},
    "fluid": {"cells": [4, 4], "density": 1000.0, "viscosity": 0.0, "time_step": INTERVAL},
    "boundary": {"left": {"kind": "periodic"}, "bottom": {"kind": "periodic"}},
    "time": {"end": INTERVAL * INTERVALS, "output_interval": INTERVAL * INTERVALS},
}


def test_a_periodic_fluid_falls_like_a_grain():
    """Without viscosity u(t) = int g dt."""
    _, state, _, _ = marched(STREAM)
    expected = integral(GRAVITY, INTERVAL * INTERVALS)[0]
    np.testing.assert_allclose(state.fluid.face_velocity[0], expected, rtol=1e-12)


def test_the_gradient_that_holds_a_stream_follows_gravity(tmp_path):
    """At rest the pressure carries the weight: G = rho g, its mean since the last output."""
    held = STREAM | {"fluid": STREAM["fluid"] | {"bulk_velocity": [0.0, 0.0]}}
    held = held | {"time": {"end": INTERVAL * 8, "output_interval": INTERVAL * 4}}
    run = jaxdem.simulate(jaxdem.load_scene(held), tmp_path / "run")
    means = [
        (integral(GRAVITY, k * INTERVAL) - integral(GRAVITY, (k - 4) * INTERVAL))[0] / (4 * INTERVAL) for k in (4, 8)
    ]
    np.testing.assert_allclose(run.history["pressure_gradient_x"][1:], 1000.0 * np.asarray(means), rtol=1e-10)


def test_drag_is_switched_off_and_on():
    """Stokes drag on one grain held in place by its inertia: the impulse is that of the time in which it acts."""
    times, factors = [0.02, 0.0201, 0.05, 0.0501], [0.0, 1.0, 1.0, 0.0]
    tables = {
        "precision": "float64",
        "domain": {"size": [0.04, 0.04, 0.04], "gravity": [0.0, 0.0, 0.0]},
        "particles": {"radius": 1e-3, "density": 2500.0, "position": [[0.02, 0.02, 0.02]]},
        "contact": {"young_modulus": 1e6, "speed": 1.0},
        "fluid": {"cells": [4, 4, 4], "density": 1000.0, "viscosity": 1e-4, "velocity": [0.1, 0.0, 0.0]},
        "boundary": {name: {"kind": "periodic"} for name in ("left", "front", "bottom")},
        "coupling": {"interval": INTERVAL, "drag": "stokes", "drag_times": times, "drag_factor": factors},
        "time": {"end": 0.1, "output_interval": 0.1},
    }
    without = tables | {"coupling": {"interval": INTERVAL, "drag": "stokes", "drag_factor": 0.0}}
    states, final, simulation, parameters = marched(tables, 16)
    early, later, eleventh, last = (float(states[k].particles.velocity[0, 0]) for k in (4, 10, 11, 16))
    # Before, it moves by the pressure of the fluid that makes room for it; that is little.
    assert early == pytest.approx(float(marched(without, 4)[1].particles.velocity[0, 0]), rel=1e-12)
    assert later > 1e3 * abs(early)
    # The factor falls to zero within the eleventh interval.
    assert abs(last - eleventh) < 1e-3 * (later - early)
    mass = float(parameters.bodies.mass)

    def momentum(state):
        void, cell = state.fluid.void_fraction, 0.01**3
        faces = 0.5 * (void + np.roll(void, 1, axis=0))
        flow = 1000.0 * cell * np.sum(faces * np.asarray(state.fluid.face_velocity[0])[:-1])
        return flow + mass * float(state.particles.velocity[0, 0])

    assert float(momentum(final)) == pytest.approx(float(momentum(states[0])), rel=1e-12)
    assert dataclasses.replace(simulation, drag_times=None) != simulation


def test_a_plate_that_changes_its_speed_drags_the_fluid():
    """A plate over a thin viscous film: Couette flow at every time, with the plate's speed of that time."""
    times, speeds = [0.0, 0.05, 0.1], [[0.0, 0.0], [0.2, 0.0], [-0.1, 0.0]]
    tables = STREAM | {
        "domain": {"size": [0.04, 0.01], "gravity": [0.0, 0.0]},
        "fluid": {"cells": [4, 8], "density": 1000.0, "viscosity": 1e-2, "time_step": 2.5e-5},
        "boundary": {
            "left": {"kind": "periodic"},
            "top": {"kind": "moving_wall", "times": times, "velocities": speeds},
        },
        "time": {"end": 0.1, "output_interval": 0.05},
    }
    _, state, _, _ = marched(tables, 3000)
    speed = np.interp(3000 * 2.5e-5, times, [row[0] for row in speeds])
    height = (np.arange(8) + 0.5) / 8
    # Slowly: the film follows within h^2/(pi^2 nu) = 1 ms, in which the plate changes by 6 mm/s.
    np.testing.assert_allclose(np.asarray(state.fluid.face_velocity[0])[1], speed * height, atol=6e-3)


@pytest.mark.parametrize(
    "change, key",
    [
        ({"domain": {"gravity_times": [0.0, 1.0]}}, "gravity"),
        ({"domain": {"gravity_times": [0.0, 0.0, 1.0]}}, "gravity_times"),
        ({"domain": {"gravity": [0.0, -9.81]}}, "gravity"),
        ({"domain": {"gravity": [[0.0], [0.0], [0.0]]}}, "gravity"),
    ],
)
def test_tables_that_do_not_fit_are_refused(change, key):
    tables = grain()
    tables["domain"] |= change["domain"]
    with pytest.raises(jaxdem.InputError, match=key):
        jaxdem.load_scene(tables)


def test_factors_and_times_of_the_drag_go_together():
    tables = grain() | {"fluid": {"cells": [10, 10]}}
    for wrong in ({"drag_factor": [1.0, 0.0]}, {"drag_times": [0.0, 1.0]}, {"drag_factor": -1.0}):
        with pytest.raises(jaxdem.InputError, match="drag_"):
            jaxdem.load_scene(tables | {"coupling": wrong})
