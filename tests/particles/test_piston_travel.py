"""Where a wall that a force holds meets another wall: closed forms of the way, and the run that stops there."""

import jax
import numpy as np
import pytest

from jaxdem import build, devices, initial_state, load_scene
from jaxdem.failures import Failure, failures
from jaxdem.particles.walls import box_sides
from jaxdem.run.diagnosis import diagnosis
from jaxdem.setup.particles import particle_setup
from jaxdem.setup.piston_travel import piston_travel
from tests.cases.tiers import COMBINATION

DOWN = {"direction": [0.0, -1.0], "force": 2.0, "mass": 4.0}
LID = {"kind": "plane", "point": [0.5, 0.6], "normal": [0.0, -1.0], "piston": DOWN}
UP = {"kind": "plane", "point": [0.5, 0.1], "normal": [0.0, 1.0], "piston": DOWN | {"direction": [0.0, 1.0]}}
RAMP = {"kind": "plane", "point": [0.0, 0.0], "normal": [-0.4, 1.0]}
TENT = {"kind": "mesh", "points": [[0.2, 0.1], [0.5, 0.25], [0.8, 0.1]]}
TROUGH = {"kind": "mesh", "points": [[0.1, 0.9], [0.1, 0.2], [0.9, 0.2], [0.9, 0.9]]}
PLATE = {"kind": "mesh", "points": [[0.1, 0.7], [0.9, 0.8]], "piston": DOWN}
BALL = {"kind": "cylinder", "center": [0.5, 0.3], "radius": 0.2, "inside": False}
V = {"kind": "wedge", "apex": [0.5, 0.1], "directions": [[-1.0, 2.0], [1.0, 2.0]]}
SHAKEN = {"kind": "oscillation", "direction": [0.0, 1.0], "amplitude": 0.1, "frequency": 1.0}


def scene_of(*walls, **more):
    tables = {
        "precision": "float64",
        "domain": {"size": [1.0, 1.0], "gravity": [0.0, 0.0]},
        "particles": {"radius": 0.02, "density": 1000.0, "position": [[0.03, 0.3]]},
        "contact": {"young_modulus": 1e6, "speed": 1.0},
        "walls": list(walls),
        "time": {"end": 2.0, "output_interval": 0.02},
    }
    return load_scene(tables | {key: tables.get(key, {}) | value for key, value in more.items()})


@pytest.mark.parametrize(
    ("walls", "ways"),
    [
        pytest.param([LID], {"the bottom side of the box": 0.6}, id="floor"),
        pytest.param([LID, RAMP], {"walls.1": 0.2, "the bottom side of the box": 0.6}, id="highest point of a ramp"),
        pytest.param([LID, V], {"walls.1": 0.5}, id="bottom of a wedge"),
        pytest.param([LID, TENT], {"walls.1": 0.35, "the bottom side of the box": 0.6}, id="top of a mesh"),
        pytest.param([LID, TROUGH], {"walls.1": 0.4, "the bottom side of the box": 0.6}, id="bottom of a trough"),
        pytest.param([LID, BALL], {"walls.1": 0.1, "the bottom side of the box": 0.6}, id="circle"),
        pytest.param([PLATE], {"the bottom side of the box": 0.7}, id="mesh"),
        pytest.param([PLATE, RAMP], {"walls.1": 0.44, "the bottom side of the box": 0.7}, id="mesh over a ramp"),
        pytest.param([BALL | {"piston": DOWN}], {"the bottom side of the box": 0.1}, id="circle that is held"),
        pytest.param([UP], {"the top side of the box": 0.9}, id="upwards"),
        pytest.param([LID | {"motion": [SHAKEN]}], {}, id="not one that a motion moves"),
        pytest.param([LID, RAMP | {"end": 0.1}], {"the bottom side of the box": 0.6}, id="not a gate"),
        pytest.param([LID | {"normal": [0.0, 1.0]}], {}, id="not one that leaves the grains"),
    ],
)
def test_way_of_a_piston_to_the_walls_before_it(walls, ways):
    scene = scene_of(*walls)
    found = piston_travel(scene, box_sides(scene.domain.size, scene.periodic), particle_setup(scene).meshes)
    told = {} if found is None else dict(zip([name for _, name in found.names], found.most, strict=True))
    rates = [] if found is None else [rate for (rate,) in found.rates]
    assert dict(zip(told, np.divide(list(told.values()), rates), strict=True)) == pytest.approx(ways, rel=1e-9)


def test_two_lids_that_face_each_other_share_their_way():
    scene = scene_of(LID, UP)
    found = piston_travel(scene, box_sides(scene.domain.size, scene.periodic), ())
    row = found.names.index((0, "walls.1"))
    assert found.rates[row] == (1.0, 1.0) and found.most[row] == pytest.approx(0.5)


def test_a_run_stops_where_a_lid_meets_a_ramp():
    """s = F t^2 / (2 m) = 0.2 m at 0.89 s; the grain lies lower."""
    scene = scene_of(LID, RAMP)
    simulation, parameters = build(scene)
    state, neighbors = initial_state(scene, simulation, parameters)
    step, code, count = jax.jit(simulation.step), 0, 0
    while code == 0:
        before = state
        state, neighbors, told = step(parameters, state, neighbors)
        code, count = int(failures(simulation, told)), count + 1
        way = float(state.particles.pistons.displacement[0])
        assert (code != 0) == (way >= 0.2)
    assert Failure(code) == Failure.PISTON_MEETS
    assert count * simulation.interval == pytest.approx(np.sqrt(2.0 * 0.2 * 4.0 / 2.0), abs=2.0 * simulation.interval)
    reason, where, _ = diagnosis(simulation, parameters, code, before, state, told)
    assert "meets another wall" in reason and "walls.0 (meets walls.1)" in where


@COMBINATION
def test_slabs_know_that_a_lid_meets_a_ramp():
    """As on one device, in an interval in which the way of the lid passes 0.2 m."""
    scene = scene_of(LID, RAMP, particles={"position": [[0.03, 0.3], [0.03, 0.2]]})
    simulation, parameters = build(scene)
    state, neighbors = initial_state(scene, simulation, parameters)
    there = state.particles.pistons._replace(displacement=np.asarray([0.19999]), velocity=np.asarray([0.5]))
    state = state._replace(particles=state.particles._replace(pistons=there))
    divided = devices.divided(simulation, 2, state.particles.position, axis=0)
    own = divided.with_parts(parameters)
    slabs, lists = devices.distributed(divided, own, state, neighbors)
    for step, given in ((simulation.step, (parameters, state, neighbors)), (divided.step, (own, slabs, lists))):
        told = jax.jit(step)(*given)[2]
        assert told.particles.met.shape == (2,) and Failure(int(failures(simulation, told))) == Failure.PISTON_MEETS
