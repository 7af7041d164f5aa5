"""The scenes with walls that the fluid sees beside that of the pier: what is open, and that what comes in goes out."""

from pathlib import Path

import jax
import numpy as np
import pytest

import jaxdem
from jaxdem import build, initial_state
from jaxdem.setup.builder import build_case
from tests.cases.tiers import COMBINATION

SCENES = Path(__file__).parents[1] / "scenes"


def scene_of(name, **changes):
    return jaxdem.load_scene(SCENES / f"{name}.toml", changes)


def open_volume(name, **changes):
    """Of the fluid's cells [m3], and the scene's walls of it."""
    case = build_case(scene_of(name, **changes))
    case.first_state()
    grid = case.simulation.fluid.solver.grid
    assert case.fluid_walls.closed_pockets == 0
    return float(np.sum(case.fluid_walls.cut.open_cells)) * grid.cell_volume


def test_the_cone_and_the_pier_take_their_volume():
    # Two corners of 65 mm by 112.6 mm are solid; a cylinder 26 mm high, five cells across, loses 4 % as flat parts.
    corners = 0.065**2 * np.sqrt(3.0)
    found = open_volume("spouted_bed")
    assert found == pytest.approx((0.15 * 0.45 - corners) * 0.004, rel=1e-3)
    solid = 0.048 * 0.032 * 0.026 - open_volume("pier_scour")
    assert 0.93 < solid / (np.pi * 0.005**2 * 0.026) < 1.0


@COMBINATION
def test_what_comes_into_the_bend_leaves_it():
    """Sections of the pipe are 50 mm wide, and its bend is a quarter of a ring."""
    changes = {"fluid.cells": [40, 48], "fluid.time_step": 0.005, "precision": "float64"}
    area = 0.05 * (0.09 + 0.13) + 0.25 * np.pi * (0.09**2 - 0.04**2)
    assert open_volume("pipe_bend", **changes) == pytest.approx(area * 0.001, rel=5e-3)
    given = scene_of("pipe_bend", **changes).tables()
    for name in ("particles", "contact", "coupling", "probes"):
        given.pop(name, None)
    given["walls"][0].pop("wear")
    given["boundary"]["top"].pop("particles")
    scene = jaxdem.load_scene(given)
    simulation, parameters = build(scene)
    state, _ = initial_state(scene, simulation, parameters)
    step = jax.jit(simulation.step)
    for _ in range(4):
        state, _, told = step(parameters, state, None)
    cut, velocity = parameters.fluid.cut, state.fluid.face_velocity
    through = [np.asarray(a * u) for a, u in zip(cut.open_faces, velocity, strict=True)]
    into, out = through[0][0].sum(), through[1][:, -1].sum()
    assert out == pytest.approx(into, rel=1e-9)
    # After 20 ms of the 50 ms in which the inlet's velocity rises.
    assert into * 0.005 == pytest.approx(0.4 * 0.4 * 0.05, rel=0.01) and float(told.fluid.divergence) < 1e-9
