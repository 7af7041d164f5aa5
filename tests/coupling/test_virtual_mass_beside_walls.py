"""Virtual mass of a grain in fluid that walls set in motion or stop, against the closed form without drag.

A grain in fluid whose velocity changes by du changes its own by K du, K = (1 + C) rho/(rho_p + C rho).
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem import build, initial_state, load_scene
from tests.cases.tiers import COMBINATION

STEP, RHO, HEAVY, STREAM = 0.005, 1000.0, 1500.0, 0.2
SHARE = 1.5 * RHO / (HEAVY + 0.5 * RHO)
FREE = {"top": {"kind": "free_slip"}, "bottom": {"kind": "free_slip"}}
POST = {"kind": "cylinder", "center": [0.13, 0.05], "inside": False, "fluid": "free_slip"}


def march(wall, steps, speed=0.0, coefficient=0.5, **sides):
    """Velocity along x of a grain and of the fluid round it after every interval, (steps, 2) [m/s]; in a slab so deep
    that the grain does nothing to the fluid."""
    given = {
        "precision": "float64",
        "domain": {"size": [0.4, 0.1], "depth": 100.0, "gravity": [0.0, 0.0]},
        "particles": {"radius": 0.002, "density": HEAVY, "position": [[0.25, 0.05]], "velocity": [[speed, 0.0]]},
        "contact": {"young_modulus": 1e5, "speed": 0.3},
        "fluid": {"cells": [20, 5], "density": RHO, "viscosity": 1e-20, "time_step": STEP, "velocity": [speed, 0.0]},
        "boundary": FREE | {name: side if isinstance(side, dict) else {"kind": side} for name, side in sides.items()},
        "coupling": {"drag": "stokes", "interval": STEP, "virtual_mass": coefficient},
        "walls": [wall],
        "time": {"end": 1.0, "output_interval": 0.1},
    }
    scene = load_scene(given)
    simulation, parameters = build(scene)
    parameters = parameters._replace(drag_scale=jnp.zeros(()))
    state, neighbors = initial_state(scene, simulation, parameters)
    step, found = jax.jit(simulation.step), []
    for _ in range(steps):
        state, neighbors, _ = step(parameters, state, neighbors)
        found.append([float(state.particles.velocity[0, 0]), float(state.fluid.face_velocity[0][12, 2])])
    return np.asarray(found)


@COMBINATION
def test_a_piston_accelerates_a_grain_with_its_water():
    """The column before a piston that swings has its mean speed. Without virtual mass the grain has rho/rho_p of it."""
    swing = {"kind": "oscillation", "direction": [1.0, 0.0], "amplitude": 0.01, "frequency": 4.0}
    piston = {"kind": "plane", "point": [0.053, 0.0], "normal": [1.0, 0.0], "fluid": "free_slip", "motion": [swing]}
    grain, fluid = march(piston, 12, left="free_slip", right="outlet").T
    speed = np.diff(0.01 * np.sin(8.0 * np.pi * STEP * np.arange(13))) / STEP
    np.testing.assert_allclose(fluid, speed, rtol=1e-6)
    np.testing.assert_allclose(grain, SHARE * speed, rtol=1e-6)
    without, _ = march(piston, 3, coefficient=0.0, left="free_slip", right="outlet").T
    np.testing.assert_allclose(without, RHO / HEAVY * speed[:3], rtol=1e-6)


@COMBINATION
def test_a_gate_that_shuts_a_duct_stops_a_grain_with_its_water():
    """All of the stream stops in the interval in which the gate comes; a grain that went along keeps 1 - K of its
    speed. Before and after nothing acts on it. The stream between two outlets loses 1e-3 in an interval."""
    post = POST | {"radius": 0.06, "begin": 3 * STEP}
    grain, fluid = march(post, 6, STREAM, left="outlet", right="outlet").T
    assert fluid[2] == pytest.approx(STREAM, rel=0.01) and np.abs(fluid[3:]).max() < 1e-6
    assert grain[2] == pytest.approx(STREAM + SHARE * (fluid[2] - STREAM), rel=1e-5)
    np.testing.assert_allclose(grain[3:], STREAM - SHARE * STREAM, rtol=1e-5)


@COMBINATION
def test_a_gate_that_vanishes_does_not_move_a_grain():
    """In water at rest; and in a stream that the gate moves with."""
    grain, fluid = march(POST | {"radius": 0.06, "end": 3 * STEP}, 5, left="outlet", right="outlet").T
    assert not grain.any() and not fluid.any()
    along = [{"kind": "translation", "velocity": [STREAM, 0.0]}]
    moving = POST | {"radius": 0.03, "end": 3 * STEP, "motion": along}
    inlet = {"kind": "inlet", "velocity": [STREAM, 0.0], "ramp_time": 0.0}
    found = march(moving, 6, STREAM, left=inlet, right="outlet")
    np.testing.assert_allclose(found, STREAM, rtol=1e-6)
