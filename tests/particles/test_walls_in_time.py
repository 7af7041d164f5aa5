"""Walls that are there for a part of the time: gates that vanish and lids that come."""

from __future__ import annotations

import copy
import dataclasses
import functools
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.check.check import check_scene
from jaxdem.check.stages import check_stages
from jaxdem.errors import InputError, RunError
from jaxdem.failures import failures
from jaxdem.numerics.static import static
from jaxdem.numerics.tables import Window
from jaxdem.observables import contacts
from jaxdem.particle_step import renewed_particles
from jaxdem.particles.contact import ContactForce
from jaxdem.particles.wall_times import WallInTime, WallTimes
from jaxdem.run.time_loop import Interrupted
from tests.cases.tiers import COMBINATION
from tests.physics.test_shipped_program import COMPILER

INTERVAL, OPENED, AFTER = 0.005, 0.03, 24
SLOPE = {"kind": "plane", "point": [0.0, 0.0], "normal": [-0.5, 1.0]}
GATE = {"kind": "plane", "point": [0.1, 0.0], "normal": [1.0, 0.2]}
FAR = {"kind": "plane", "point": [0.39, 0.0], "normal": [-1.0, 0.0]}
BOX = {
    "precision": "float64",
    "domain": {"size": [0.4, 0.4]},
    "particles": {
        "radius": [0.01, 0.012, 0.01, 0.011],
        "density": 2500.0,
        "position": [[0.115, 0.072], [0.14, 0.09], [0.162, 0.1], [0.12, 0.1]],
        "velocity": [[-1.0, -0.5], [-1.0, -0.5], [-1.0, -0.5], [-1.0, -1.0]],
        "angular_velocity": [[3.0], [0.0], [-2.0], [0.0]],
    },
    "contact": {
        "young_modulus": 1e6,
        "friction": 0.5,
        "restitution": 0.1,
        "rolling_friction": 0.1,
        "rolling_model": "epsd",
        "speed": 2.0,
        "time_step": 6e-5,  # of scenes with and without the gate, whose stable steps differ
    },
    "coupling": {"interval": INTERVAL},
    "time": {"end": 0.15, "output_interval": INTERVAL},
}


def tables(*walls, **changes):
    return copy.deepcopy(BOX) | {"walls": [dict(wall) for wall in walls]} | changes


@functools.cache
def _start(text, functions):
    scene = jaxdem.load_scene(eval(text))  # as text, for the cache: what has been built is shared
    simulation, parameters = jaxdem.build(scene, walls=functions)
    return simulation, parameters, *jaxdem.initial_state(scene, simulation, parameters)


def start_of(given, *functions):
    return _start(repr(given), functions)


@functools.partial(jax.jit, static_argnums=0)
def stepped(simulation, parameters, state, neighbors):
    state, neighbors, report = simulation.step(parameters, state, neighbors)
    return state, neighbors, failures(simulation, report)


def run(simulation, parameters, state, neighbors, steps):
    """State and list after so many intervals, each of them sound."""
    for _ in range(steps):
        state, neighbors, code = stepped(simulation, parameters, state, neighbors)
        assert int(code) == 0
    return state, neighbors


def assert_same_bits(one, other):
    """All arrays of two states of particles, the springs of walls apart."""
    for name in one._fields:
        a, b = getattr(one, name), getattr(other, name)
        for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
            np.testing.assert_array_equal(np.asarray(x), np.asarray(y), err_msg=name)


def without_last_wall(particles):
    """The particles where the last wall has been taken away by hand, with what they kept of it."""
    return particles._replace(wall_spring=tuple(spring[:-1] for spring in particles.wall_spring))


def held_by_the_gate(gate):
    """State and list at the time at which the gate vanishes or is taken away."""
    return run(*start_of(tables(SLOPE, gate)), round(OPENED / INTERVAL))


def let_go(state, neighbors):
    """Particles some time after the gate has vanished, and after it has been taken away by hand."""
    simulation, parameters, *_ = start_of(tables(SLOPE, GATE | {"end": OPENED}))
    whole, _ = run(simulation, parameters, state, neighbors, AFTER)
    simulation, parameters, *_ = start_of(tables(SLOPE))
    by_hand = state._replace(particles=without_last_wall(state.particles))
    opened, _ = run(simulation, parameters, by_hand, neighbors, AFTER)
    return whole.particles, opened.particles


def compare_bits():
    """Gone on without the gate, against the scene in which it vanishes."""
    whole, opened = let_go(*held_by_the_gate(GATE | {"end": OPENED}))
    assert_same_bits(without_last_wall(whole), opened)


def test_a_gate_that_vanishes_is_a_gate_taken_away_by_hand():
    """Here to the rounding of programs that are compiled otherwise than users have them; see the next test."""
    timed = held_by_the_gate(GATE | {"end": OPENED})
    held, shut = timed[0].particles, held_by_the_gate(GATE)[0].particles
    whole, opened = let_go(*timed)
    assert (np.abs(np.asarray(held.wall_spring[0][-1])) > 0.0).sum() == 2, "two grains lean on the gate"
    np.testing.assert_allclose(held.position, shut.position, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(whole.position, opened.position, rtol=0.0, atol=1e-10)
    for spring in whole.wall_spring:
        assert not np.asarray(spring[-1]).any(), "what a wall kept is gone with it"
    x, normal = np.asarray(whole.position), np.asarray(GATE["normal"]) / np.hypot(*GATE["normal"])
    assert ((x - GATE["point"]) @ normal).min() < 0.0, "a grain has passed the place of the gate"


@COMBINATION
def test_it_is_so_bit_for_bit_in_the_programs_that_users_have():
    """In a process of its own: as the tests compile, rounding differs from program to program."""
    root = Path(__file__).parents[2]
    shipped = {key: value for key, value in os.environ.items() if key not in COMPILER}
    shipped |= {"PYTHONPATH": str(root), "JAX_ENABLE_X64": "1"}
    modules = ("test_walls_in_time", "test_meshes_in_time")
    code = "; ".join(f"from tests.particles import {name}; {name}.compare_bits()" for name in modules)
    done = subprocess.run(
        [sys.executable, "-c", code], env=shipped, cwd=root, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr


@COMBINATION
def test_a_run_that_is_resumed_across_the_end_of_a_wall_is_the_same(tmp_path):
    """Stopped while the gate is there, with grains that lean on it: the history and all frames to the bit."""
    scene = jaxdem.load_scene(tables(SLOPE, GATE | {"end": OPENED}, time={"end": 0.05, "output_interval": 0.01}))

    def stop(time, end):
        if round(time / INTERVAL) == 3:
            os.kill(os.getpid(), signal.SIGTERM)

    whole = jaxdem.simulate(scene, tmp_path / "whole")
    with pytest.raises(Interrupted), pytest.MonkeyPatch.context() as patch:
        patch.setattr("jaxdem.run.chunk.LONGEST", 0.0)  # the host looks after every interval
        jaxdem.simulate(scene, tmp_path / "resumed", progress=stop)
    stopped = jaxdem.load_run(tmp_path / "resumed")
    assert stopped.times[stopped.number_of_frames - 1] < OPENED
    resumed = jaxdem.simulate(scene, tmp_path / "resumed", resume=True)
    assert (whole.path / "history.csv").read_bytes() == (resumed.path / "history.csv").read_bytes()
    assert whole.number_of_frames == resumed.number_of_frames == 6
    for frame in range(whole.number_of_frames):
        ours, theirs = whole.particles(frame), resumed.particles(frame)
        assert ours.keys() == theirs.keys() and all(ours[name].tobytes() == theirs[name].tobytes() for name in ours)


@pytest.mark.parametrize("wall", [GATE, {"kind": "cylinder", "center": [0.11, 0.0], "radius": 0.02, "inside": False},
                                  {"kind": "wedge", "apex": [0.1, 0.05], "directions": [[1.0, 0.0], [0.0, 1.0]]}],
                         ids=lambda wall: wall["kind"])  # fmt: skip
def test_all_kinds_of_walls_have_times(wall):
    timed, *_ = start_of(tables(wall | {"begin": 0.01, "end": 0.03}))
    model = timed.contact.model
    assert model.wall_times.windows == (Window(0.01, 0.03),) * len(model.surfaces)
    present = [model.wall_times.present(jnp.asarray((k + 0.5) * INTERVAL)).tolist() for k in range(8)]
    assert present == [[2 <= k < 6] * len(model.surfaces) for k in range(8)]


def test_a_function_from_python_has_times():
    """`WallInTime` among the functions of `walls`, beside one that always is there."""
    timed, *_ = start_of(tables(SLOPE), WallInTime(lambda x: x[0] - 0.02, end=OPENED), lambda x: x[0] - 0.01)
    assert timed.contact.model.wall_times.windows == (Window(), Window(end=OPENED), Window())
    assert float(timed.contact.model.surfaces[1].overlap(jnp.ones(2), 0.5)) == pytest.approx(0.5 - 0.98)
    with pytest.raises(InputError, match="at least a coupling interval"):
        start_of(tables(SLOPE), WallInTime(lambda x: x[0], begin=0.2, end=0.1))


def test_a_wall_that_is_not_there_yet_refuses_no_grain_at_the_start():
    floor = {"kind": "plane", "point": [0.0, 0.3], "normal": [0.0, 1.0]}
    with pytest.raises(InputError, match=re.escape("walls.0 (plane)")):
        start_of(tables(floor))
    start_of(tables(floor | {"begin": 0.05}))


def test_walls_in_one_place_at_different_times_are_no_double_wall():
    with pytest.raises(InputError, match="lies on walls.0"):
        start_of(tables(GATE | {"end": 0.05}, GATE | {"begin": 0.04}))
    start_of(tables(GATE | {"end": 0.05}, GATE | {"begin": 0.05}))


def test_a_wall_that_comes_into_grains_stops_the_run(tmp_path):
    """It names the grain and the remedy; a wall that comes beside the grains does not stop it."""
    floor = {"kind": "plane", "point": [0.0, 0.09], "normal": [0.0, 1.0], "begin": 0.01}
    given = tables(floor, time={"end": 0.02, "output_interval": 0.01})
    with pytest.raises(RunError, match=r"a wall comes where particles are") as caught:
        jaxdem.simulate(jaxdem.load_scene(given), tmp_path / "into")
    assert "particle 0, last at (0.105, 0.0665" in str(caught.value) and "begin" in str(caught.value)
    assert "wall that comes at 0.01 s: Plane(point=(0.0, 0.09), normal=(0.0, 1.0))" in str(caught.value)
    assert caught.value.time == pytest.approx(0.01)
    given["walls"][0]["point"] = [0.0, 0.05]
    assert jaxdem.simulate(jaxdem.load_scene(given), tmp_path / "beside").summary["valid"]


def test_an_inlet_finds_room_behind_a_wall_that_is_not_there():
    """A lid over the region of an inlet: no grain comes in before it has gone."""
    lid = {"kind": "plane", "point": [0.0, 0.2], "normal": [0.0, -1.0], "end": 0.02}
    inlet = {"start": [0.1, 0.22], "stop": [0.3, 0.3], "rate": 200.0, "velocity": [0.0, -0.1], "radius": 0.01}
    particles = BOX["particles"] | {"radius": 0.01, "inlet": [inlet]}
    simulation, parameters, state, neighbors = start_of(tables(lid, particles=particles))
    renew = jax.jit(lambda k: renewed_particles(simulation, parameters, state.particles, neighbors, k)[0].inserted[0])
    assert [int(renew(jnp.int32(k))) for k in (3, 4)] == [0, 4], "the interval after the fourth has no lid"


@pytest.mark.parametrize(
    ("change", "key", "word"),
    [
        ({"begin": 0.02, "end": 0.02}, "walls.0.end", "after begin"),
        ({"begin": -0.1}, "walls.0.begin", "greater"),
        ({"end": 0.0}, "walls.0.end", "greater"),
        ({"begin": 0.02, "end": 0.021}, "walls.0.begin", "at least a coupling interval"),
    ],
)
def test_refusals(change, key, word):
    with pytest.raises(InputError) as caught:
        start_of(tables(GATE | change))
    assert caught.value.key == key and word in str(caught.value) and caught.value.remedy


def test_check_tells_the_times():
    scene = jaxdem.load_scene(tables(SLOPE, GATE | {"begin": 0.01, "end": 0.05}))
    parts = check_scene(scene).compiled_in
    assert "additional walls: plane, plane from 0.01 until 0.05 s" in parts


def test_check_warns_of_a_time_that_the_run_does_not_reach():
    """`begin` and `end` at or after `time.end`, and of these alone."""
    end = BOX["time"]["end"]
    walls = (SLOPE | {"end": end - 0.01}, GATE | {"end": 2.0 * end}, FAR | {"begin": end})
    said = [one for one in check_scene(jaxdem.load_scene(tables(*walls))).warnings if one.startswith("walls")]
    assert [one.split(":")[0] for one in said] == ["walls.1.end = 0.3", "walls.2.begin = 0.15"]
    assert "never vanishes" in said[0] and "never comes" in said[1]


def test_check_does_not_warn_of_a_time_that_a_later_stage_reaches():
    """A gate that vanishes in the second stage, and one that vanishes after the last."""
    stages = [{"name": name, "time": {"end": end, "output_interval": 0.01}} for name, end in (("a", 0.02), ("b", 0.04))]
    given = tables(SLOPE, GATE | {"end": 0.03}, FAR | {"end": 1.0}, stages=stages)
    del given["time"]
    said = {
        name: [one for one in report.warnings if "walls" in one]
        for name, report in check_stages(jaxdem.load_scene(given))
    }
    assert said["a"] == [] and len(said["b"]) == 1 and said["b"][0].startswith("walls.2.end = 1")


def test_walls_without_times_ask_nothing():
    """No window, and no look at the time: the program is the one of walls that always are there."""
    simulation, parameters, state, neighbors = start_of(tables(SLOPE, GATE))
    assert simulation.contact.model.wall_times is None
    report = jax.eval_shape(simulation.step, parameters, state, neighbors)[2]
    assert report.particles.buried is None


def test_the_walls_of_one_time_are_held():
    """For packs that settle before the run: those that are there at its start, whatever time passes meanwhile."""
    times = WallTimes((Window(), Window(end=0.3), Window(begin=0.2)), 0.1)
    assert times.changes == (0.2, 0.3) and times.phases == ((0, 1), (0, 1, 2), (0, 2))
    assert times.held(0.1).phases == ((0, 1),) and times.held(0.5).phases == ((0, 2),)
    assert times.held(0.1).present(jnp.asarray(0.9)).tolist() == [True, True, False]


def test_an_absent_wall_is_no_contact():
    """`observables.contacts` of grains that stand where a gate has been: out of reach, and no force."""
    simulation, parameters, state, neighbors = start_of(tables(GATE | {"point": [0.1193, 0.0], "end": 0.01}))
    found = jax.jit(lambda step: contacts(simulation, parameters, state._replace(step=step), neighbors).walls)
    there, gone = found(jnp.int32(1)), found(jnp.int32(2))
    assert float(there.overlap[4].max()) > 0.0 and np.asarray(there.force[0][4]).any()
    assert float(gone.overlap[4].max()) < 0.0 and not any(np.asarray(part[4]).any() for part in gone.force)


@static
class Sharing:
    """A law whose force is the number of walls that share the particle."""

    def __call__(self, contact, material):
        none = jnp.zeros_like(contact.overlap)
        force = none + contact.sharing
        return ContactForce(normal=force, elastic=force, tangential=(none,), spring=contact.spring)


def test_an_absent_wall_is_not_counted_among_those_that_touch_a_grain():
    """Two gates in reach of the first grain, of which one vanishes: two walls share it, then one."""
    gate = GATE | {"point": [0.1193, 0.0]}
    simulation, parameters, state, neighbors = start_of(tables(gate, gate | {"normal": [1.0, 0.19], "end": 0.01}))
    model = dataclasses.replace(simulation.contact.model, law=Sharing())
    asked = dataclasses.replace(simulation, contact=dataclasses.replace(simulation.contact, model=model))
    found = jax.jit(lambda step: contacts(asked, parameters, state._replace(step=step), neighbors).walls)
    before, after = (jnp.hypot(*found(jnp.int32(step)).force)[4:, 0] for step in (1, 2))
    np.testing.assert_allclose(before, [2.0, 2.0])
    np.testing.assert_allclose(after, [1.0, 0.0])
