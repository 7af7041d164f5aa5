"""Walls in the fluid that come and vanish: against runs without them, what rests, and what is refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem import build, initial_state, load_scene
from jaxdem.coupling.walls_in_fluid import WallsInFluid
from tests.cases.steps import compiled_step
from tests.cases.tiers import COMBINATION, tiered
from tests.test_fluid_walls import refusal, tables
from tests.test_moving_fluid_walls import BOX, STREAM, march

GATE = {
    "kind": "mesh", "points": [[0.19, -0.05], [0.25, -0.05], [0.25, 0.12], [0.19, 0.12]], "closed": True,
    "fluid": "no_slip",
}  # fmt: skip
POST = {"kind": "cylinder", "center": [0.22, 0.093], "radius": 0.05, "inside": False, "fluid": "no_slip"}
FLOWING = BOX | {"fluid": BOX["fluid"] | {"velocity": [0.3, 0.0]}, "boundary": STREAM}


def difference(given, other):
    """Largest difference of velocities of two states over the largest velocity."""
    pairs = list(zip(given.fluid.face_velocity, other.fluid.face_velocity, strict=True))
    return max(float(jnp.abs(a - b).max()) for a, b in pairs) / max(float(jnp.abs(b).max()) for _, b in pairs)


def next_of(given, *states):
    """The states after an interval of another scene, from the fluid of each state."""
    scene = load_scene(given)
    simulation, parameters = build(scene)
    own, _ = initial_state(scene, simulation, parameters)
    step = compiled_step(simulation)
    fluids = [s.fluid._replace(pressure_change=own.fluid.pressure_change) for s in states]
    return [step(parameters, own._replace(fluid=fluid), None)[0] for fluid in fluids]


def test_a_gate_that_vanishes_leaves_the_stream_of_a_box_without_it():
    """Until then the stream is that beside a wall that stays; from then on that without, from the same velocity.

    The flux that carries momentum keeps the volume to 1e-3 of a gate's, and is not corrected beside walls at rest.
    """
    _, _, found = march(tables(GATE | {"end": 0.04}, grains=False, **FLOWING), 6)
    states = [state for state, _ in found]
    (stays,) = next_of(tables(GATE, grains=False, **FLOWING), states[2])
    assert difference(states[3], stays) < 1e-4
    assert max(float(told.fluid.divergence) for _, told in found) < 1e-10
    assert np.abs(np.asarray(states[3].fluid.face_velocity[0])[10:12, 3:5]).max() == 0.0  # in the wall, its own
    first, second = next_of(tables(grains=False, **FLOWING), *states[3:5])
    # The pressure that a step begins with is not the same in the place of the wall.
    assert difference(states[4], first) < 0.02
    assert difference(states[5], second) < 1e-4
    assert difference(states[5], stays) > 0.1  # negative control: the gate is felt


@COMBINATION
def test_a_wall_that_comes_stops_the_stream():
    _, _, found = march(tables(POST | {"begin": 0.02}, grains=False, **FLOWING), 5)
    assert float(jnp.abs(found[1][0].fluid.face_velocity[0] - 0.3).max()) < 1e-13
    (stays,) = next_of(tables(POST, grains=False, **FLOWING), found[3][0])
    assert difference(found[4][0], stays) < 1e-4
    # The impulse of the start is on the wall in the interval in which it comes, and gone later.
    force = [float(told.fluid.surface_load[0, 0, 0]) for _, told in found]
    assert force[0] == force[1] == 0.0 and force[2] > 10.0 * abs(force[4])


def resting(monkeypatch=None):
    """Largest velocity of water among grains of its density after a gate beside them has vanished, the error of the
    volume of the grains and the void fraction where it stood."""
    if monkeypatch is not None:
        monkeypatch.setattr(WallsInFluid, "_renewed", lambda *_: None)
    places = [[x, y] for x in (0.15, 0.17, 0.27) for y in (0.02, 0.04, 0.06)]
    grains = {"radius": 0.008, "density": 1000.0, "position": places}
    box = BOX | {"fluid": BOX["fluid"] | {"density": 1000.0, "viscosity": 1e-4}}
    scene = load_scene(tables(GATE | {"end": 0.02}, particles=grains, **box))
    simulation, parameters = build(scene)
    state, neighbors = initial_state(scene, simulation, parameters)
    step = jax.jit(simulation.step)
    for _ in range(3):
        state, neighbors, told = step(parameters, state, neighbors)
    speed = max(float(jnp.abs(u).max()) for u in state.fluid.face_velocity)
    return speed, float(told.exchange.volume), np.asarray(state.fluid.void_fraction)


def test_water_and_grains_rest_when_a_gate_vanishes(monkeypatch):
    """Kernels that reached to the gate now reach across it. That is no motion of the grains."""
    speed, volume, void_fraction = resting()
    assert speed < 1e-14 and volume < 1e-13
    assert void_fraction[9:13, :6].min() < 0.97
    assert resting(monkeypatch)[0] > 1e-3


VANISHING = [(0.004, 0.018), (0.004, 0.058), (0.01, 0.035)]


@pytest.mark.parametrize("interval, end", tiered(VANISHING, first=[(0.01, 0.035)]))
def test_a_gate_that_vanishes_in_the_middle_of_an_interval_vanishes_once(interval, end):
    """For the fluid as for grains: that of the next interval what was there in this one is known to rounding."""
    box = BOX | {"fluid": {"cells": [4, 2], "time_step": interval}, "coupling": {"interval": interval}}
    box["time"] = {"end": 30 * interval, "output_interval": interval}
    scene = load_scene(tables(POST | {"end": end}, particles={"position": [[0.05, 0.05]]}, **box))
    simulation, parameters = build(scene)
    fluid = initial_state(scene, simulation, parameters)[0].fluid

    @jax.jit
    def of_interval(step):
        cut = simulation.with_moved_walls(parameters, fluid, step)[0].fluid.cut
        return cut.renewed, jnp.min(cut.open_cells), simulation.surfaces_present(parameters, step)[0]

    found = [of_interval(jnp.asarray(step)) for step in range(20)]
    renewed, least, there = (np.asarray(x) for x in zip(*found, strict=True))
    assert renewed.sum() == 1
    np.testing.assert_array_equal(least < 1.0, there)
    assert int(np.argmax(renewed)) == int(there.sum())


def test_what_is_not_physical_is_refused():
    comes = {"begin": 0.02}
    assert "walls.0.begin" in refusal(tables(POST | comes, grains=False, **BOX))
    with_outlet = {"boundary": STREAM, **BOX}
    assert "must not come among particles" in refusal(tables(GATE | comes, **with_outlet))
    assert "at least a coupling interval" in refusal(tables(POST | {"end": 0.003}, grains=False, **BOX))
    whole = GATE | {"points": [[0.19, -0.05], [0.25, -0.05], [0.25, 0.25], [0.19, 0.25]], "end": 0.2}
    assert "cells off" in refusal(tables(whole, **BOX))
    assert "shuts the inlet left off" in refusal(tables(whole, grains=False, **with_outlet))
    found = march(tables(whole, grains=False, **BOX), 2)[2]  # without grains both parts are solved for
    assert bool(found[-1][1].fluid.converged)
