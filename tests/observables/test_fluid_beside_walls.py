"""Flow and means of the fluid beside walls that it sees, against the room that a floor off the mesh leaves open."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.observables import Boxes, Plane, fluid_flow, fluid_profile
from jaxdem.state import State

HEIGHT, FLOOR, SPEED, DEPTH, DENSITY, INTERVAL = 0.4, 0.13, 2.0, 0.05, 900.0, 0.01
RISE = {"motion": [{"kind": "translation", "velocity": [0.0, 0.5]}]}


def stream(number, **floor):
    """A stream that is uniform over a floor, after this number of intervals; closed faces have a velocity too."""
    tables = {
        "precision": "float64",
        "domain": {"size": [0.3, HEIGHT], "depth": DEPTH, "gravity": [0.0, 0.0]},
        "fluid": {"cells": [3, 8], "density": DENSITY, "viscosity": 1e-3, "time_step": INTERVAL},
        "walls": [{"kind": "plane", "point": [0.0, FLOOR], "normal": [0.0, 1.0], "fluid": "no_slip"} | floor],
        "boundary": {"left": {"kind": "inlet", "velocity": 0.0}, "right": {"kind": "outlet"}},
        "time": {"end": 0.1, "output_interval": INTERVAL},
    }
    simulation, parameters = jaxdem.build(jaxdem.load_scene(tables))
    grid = simulation.fluid.solver.grid
    faces = tuple(jnp.full(grid.face_shape(axis), speed) for axis, speed in enumerate((SPEED, 0.0)))
    fluid = FluidState(faces, jnp.full(grid.cells, 7.0), jnp.full(grid.cells, 0.6))
    return simulation, parameters, State(None, fluid, jnp.int32(number))


@pytest.mark.parametrize(("number", "floor", "height"), [(0, {}, FLOOR), (4, RISE, FLOOR + 4 * INTERVAL * 0.5)])
def test_only_the_open_part_of_the_faces_and_cells_counts(number, floor, height):
    simulation, parameters, state = stream(number, **floor)
    flow = jax.jit(lambda s: fluid_flow(simulation, parameters, Plane((1.0, 0.0), 0.17, 0), s))(state)
    expected = 0.6 * SPEED * (HEIGHT - height) * DEPTH
    np.testing.assert_allclose([flow.volume, flow.mass], [expected, DENSITY * expected], rtol=1e-12)
    # All of the box; a layer that the floor cuts and one above it; and one below the floor.
    lower, upper = np.array([[0.0, 0.0], [0.0, 0.1], [0.0, 0.0]]), np.array([[0.3, HEIGHT], [0.3, 0.22], [0.3, 0.08]])
    found = jax.jit(lambda s: fluid_profile(simulation, parameters, Boxes(lower, upper, (1,), DEPTH), s))(state)
    np.testing.assert_allclose(found.void_fraction, [0.6, 0.6, np.nan], rtol=1e-12)
    np.testing.assert_allclose(found.pressure, [7.0, 7.0, np.nan], rtol=1e-12)
    np.testing.assert_allclose(found.velocity[:, 0], [SPEED, SPEED, np.nan], rtol=1e-12)
    np.testing.assert_allclose(found.superficial_velocity[:, 0], [0.6 * SPEED, 0.6 * SPEED, np.nan], rtol=1e-12)
