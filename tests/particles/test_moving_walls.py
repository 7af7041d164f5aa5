"""Walls that move: frame invariance, gradients, single precision, resume, stages, refusals."""

from __future__ import annotations

import copy
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.check.check import check_scene
from jaxdem.errors import InputError, RunError
from jaxdem.run.differentiable import rollout
from jaxdem.setup.builder import build_case
from jaxdem.setup.start_point import StartPoint, piston_texts, wall_texts
from tests.cases.moving_walls import grain, on_belt, path, pressed
from tests.cases.tiers import COMBINATION

WEDGE = {"kind": "wedge", "apex": [0.2, 0.1], "directions": [[1.0, 0.6], [-1.0, 0.8]]}
GRAINS = {
    "radius": [0.01, 0.012, 0.01],
    "density": 2500.0,
    "position": [[0.2, 0.16], [0.215, 0.18], [0.18, 0.19]],
    "velocity": [[0.3, -0.5], [-0.4, 0.0], [0.0, -1.0]],
    "angular_velocity": [[3.0], [0.0], [-20.0]],
}
SLIDING = {
    "precision": "float64",
    "domain": {"size": [2.0, 2.0]},
    "particles": GRAINS,
    "contact": {
        "young_modulus": 5e6,
        "friction": 0.5,
        "restitution": 0.3,
        "rolling_friction": 0.1,
        "rolling_model": "epsd",
        "speed": 3.0,
    },
    "coupling": {"interval": 0.005},
    "walls": [WEDGE],
    "time": {"end": 0.2, "output_interval": 0.05},
}


def with_motion(tables, *motions, **changes):
    found = copy.deepcopy(tables) | changes
    found["walls"][0]["motion"] = [dict(motion) for motion in motions]
    return found


def moved(tables, shift, velocity):
    """The same grains elsewhere and faster."""
    found = copy.deepcopy(tables)
    for key, change in (("position", shift), ("velocity", velocity)):
        found["particles"][key] = (np.asarray(found["particles"][key]) + np.asarray(change)).tolist()
    return found


def test_nothing_changes_in_a_frame_that_moves():
    """Grains in a wedge, against the same in a wedge that moves with them."""
    velocity = np.array([1.5, 0.7])
    still = path(SLIDING)
    moving = path(with_motion(moved(SLIDING, 0.0, velocity), {"kind": "translation", "velocity": velocity.tolist()}))
    assert still.load.mass.max() > 0.0
    way = still.time[:, None, None] * velocity
    np.testing.assert_allclose(moving.position, still.position + way, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(moving.spin, still.spin, rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(moving.load.power, moving.load.force @ velocity, rtol=1e-9, atol=1e-12)


def test_nothing_changes_in_a_frame_that_turns_with_the_grains():
    """A grain at rest on a plane that turns about an axis through its centre: without gravity it is pressed and turned
    by nothing. Pressed by a second wall it goes round with both; its springs stay what they were."""
    rate, middle = 4.0, [0.5, 0.5, 0.5]
    walls = [
        {"kind": "plane", "point": [0.5, 0.5, 0.5 + sign * 0.00499], "normal": [0.0, 0.0, -sign]} for sign in (1, -1)
    ]
    tables = grain(3, young_modulus=1e7) | {"walls": walls}
    tables["domain"]["gravity"] = [0.0, 0.0, 0.0]
    tables["particles"] |= {
        "position": [middle],
        "velocity": [[0.0, 0.0, 0.0]],
        "angular_velocity": [[rate, 0.0, 0.0]],
    }
    for wall in walls:
        wall["motion"] = [{"kind": "rotation", "rate": rate, "center": middle, "axis": [1.0, 0.0, 0.0]}]
    tables["time"]["end"] = 0.2
    found = path(tables)
    np.testing.assert_allclose(found.position[:, 0], np.broadcast_to(middle, (200, 3)), atol=1e-9)
    np.testing.assert_allclose(found.spin[:, 0], np.broadcast_to([rate, 0.0, 0.0], (200, 3)), atol=1e-4)
    force = found.load.force / np.linalg.norm(found.load.force, axis=1)[:, None]
    angle = rate * (found.time - 0.0005)  # the mean over an interval is that of its middle
    np.testing.assert_allclose(force[:, 1:], np.stack([-np.sin(angle), np.cos(angle)], axis=1), atol=1e-4)


def test_springs_turn_with_the_wall():
    """A grain that is dragged along a table and stands on it afterwards goes round with it: nothing strains."""
    rate = 3.0
    tables = grain(3, friction=5.0, young_modulus=1e7, rolling_friction=5.0, rolling_model="epsd")
    tables["walls"][0]["motion"] = [{"kind": "rotation", "rate": rate, "center": [0.5, 0.5, 0.0], "axis": [0, 0, 1]}]
    position, away = tables["particles"]["position"][0], 0.02
    tables["particles"] |= {
        "position": [[0.5 + away, 0.5, position[2]]],
        "velocity": [[0.0, rate * away, 0.0]],
        "angular_velocity": [[0.0, 0.0, rate]],
    }
    tables["time"] = {"end": 1.0, "output_interval": 1.0}
    found = path(tables)
    x, y = (found.position[:, 0, k] - 0.5 for k in range(2))
    np.testing.assert_allclose(np.unwrap(np.arctan2(y, x)), rate * found.time, atol=2e-3)
    np.testing.assert_allclose(np.hypot(x, y), away, rtol=2e-3)
    inward = found.load.force[100:, :2] @ np.array([1.0, 0.0])
    assert np.abs(inward).max() > 0.0


def test_the_wall_pulls_by_its_velocity():
    """A belt drags a grain; the program that forgets the belt's velocity does not (control). In single precision; the
    case "grain on a belt" has the same in double."""
    tables = on_belt(2) | {"precision": "float32"}
    tables["time"]["end"] = 0.1
    dragged = path(tables)
    assert dragged.velocity[-1, 0, 0] > 0.1
    forgotten = path(tables, lambda p: p._replace(wall_motion=jax.tree.map(jnp.zeros_like, p.wall_motion)))
    assert abs(forgotten.velocity[-1, 0, 0]) < 1e-6
    mass = 2500.0 * 4.0 / 3.0 * np.pi * 0.005**3
    np.testing.assert_allclose(dragged.load.mass[1:], mass, rtol=1e-5)


@COMBINATION
def test_single_precision_follows_double():
    """A wedge that shakes and turns. Velocities in one float alone are worth 6e-7 m in the free flight before."""
    motions = (
        {"kind": "oscillation", "direction": [1.0, 0.3], "amplitude": 0.002, "frequency": 20.0},
        {"kind": "rotation", "rate": 0.5, "center": [0.2, 0.1]},
    )
    tables = with_motion(SLIDING, *motions)
    tables["time"]["end"] = 0.1
    # A grain that has hit the wedge repeats what rounding did to the impact: 2e-7 to 2e-5 m at the end, by the step.
    tables["contact"] = tables["contact"] | {"time_step": 8e-5}
    double, single = path(tables), path(tables | {"precision": "float32"})
    assert double.load.mass.max() > 0.0
    np.testing.assert_allclose(single.position, double.position, rtol=0.0, atol=5e-6)


def test_derivatives_by_the_numbers_of_motions():
    """Against differences, through contacts with a wall that moves and a piston."""
    motion = {"kind": "oscillation", "direction": [0.3, 1.0], "amplitude": 0.002, "frequency": 15.0, "phase": 0.2}
    tables = with_motion(grain(2), motion, {"kind": "rotation", "rate": 0.4, "center": [0.3, 0.0]})
    tables["particles"] |= {"position": [[0.5, 0.018]], "velocity": [[0.1, -0.5]]}
    tables["walls"][0]["piston"] = {"direction": [0.0, 1.0], "force": 2.0, "mass": 0.2, "damping": 0.5}
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)

    def height(numbers):
        motion, pistons = numbers
        changed = parameters._replace(wall_motion=motion, pistons=pistons)
        result = rollout(simulation, changed, state, neighbors, 8)
        return (
            jnp.sum(result.state.particles.position[:, 1] ** 2) * 1e2 + result.state.particles.pistons.displacement[0]
        )

    numbers = parameters.wall_motion, parameters.pistons
    slope = jax.jit(jax.grad(height))(numbers)
    value = jax.jit(height)
    leaves, tree = jax.tree.flatten(numbers)
    for k, (leaf, found) in enumerate(zip(leaves, jax.tree.leaves(slope), strict=True)):
        step = 1e-5 * max(float(abs(leaf)), 1e-3)
        up, down = (
            value(jax.tree.unflatten(tree, [x + sign * step if j == k else x for j, x in enumerate(leaves)]))
            for sign in (1.0, -1.0)
        )
        expected = float(up - down) / (2.0 * step)
        assert np.isfinite(found) and found != 0.0
        np.testing.assert_allclose(found, expected, rtol=1e-4)


def assert_same_files(one, other):
    for name in ("position", "velocity", "angular_velocity"):
        a, b = (np.asarray(run.particles(run.frames - 1)[name]) for run in (one, other))
        np.testing.assert_array_equal(a, b)


def piston_tables(end=0.08):
    tables = pressed(20.0)
    tables["walls"].append(
        {
            "kind": "plane",
            "point": [0.48, 0.0],
            "normal": [1.0, 0.0],
            "motion": [{"kind": "rotation", "rate": 0.3, "center": [0.48, 0.0]}],
        }
    )
    return tables | {"time": {"end": end, "output_interval": 0.02}}


def state_of(folder):
    from jaxdem.io.checkpoint import read_checkpoint

    return read_checkpoint(folder / "checkpoint.h5")[0]


@COMBINATION
def test_a_run_goes_on_bit_for_bit(tmp_path):
    whole, half, staged = (tmp_path / name for name in ("whole", "half", "staged"))
    jaxdem.simulate(jaxdem.load_scene(piston_tables()), whole)
    jaxdem.simulate(jaxdem.load_scene(piston_tables(0.04)), half)
    jaxdem.simulate(jaxdem.load_scene(piston_tables()), half, resume=True)
    jaxdem.simulate(jaxdem.load_scene(piston_tables(0.04)), tmp_path / "first")
    jaxdem.simulate(jaxdem.load_scene(piston_tables() | {"start": {"from": str(tmp_path / "first")}}), staged)
    expected = state_of(whole)
    assert expected["state.particles.pistons.displacement"][0] > 1e-5
    for folder in (half, staged):
        found = state_of(folder)
        for name, array in expected.items():
            if name.startswith("state.particles"):
                np.testing.assert_array_equal(found[name], array, err_msg=name)


def test_a_piston_cannot_be_dropped_between_runs(tmp_path):
    """It goes on where other keys of its wall change than those of its place."""
    jaxdem.simulate(jaxdem.load_scene(piston_tables(0.02)), tmp_path / "first")
    tables = piston_tables() | {"start": {"from": str(tmp_path / "first")}}
    tables["walls"][0] |= {"name": "lid", "temperature": 400.0}
    tables["heat"] = {
        "particle_heat_capacity": 800.0, "particle_temperature": 300.0,
        "particle_conductivity": 1.0, "true_young_modulus": 1e9,
    }  # fmt: skip
    state, _ = build_case(jaxdem.load_scene(tables)).first_state()
    moved = state_of(tmp_path / "first")["state.particles.pistons.displacement"]
    assert moved[0] != 0.0
    np.testing.assert_array_equal(state.particles.pistons.displacement, moved)
    del tables["walls"][0]["piston"]
    with pytest.raises(InputError, match=r"walls\.0\.piston.*was a piston"):
        jaxdem.simulate(jaxdem.load_scene(tables), tmp_path / "second")
    del tables["walls"][0]
    with pytest.raises(InputError, match=r"walls = '1 table': has no wall at the place of the piston \{"):
        jaxdem.simulate(jaxdem.load_scene(tables), tmp_path / "second")


def test_walls_are_told_apart_by_their_places():
    """Of two at one place by their order; and a checkpoint of an earlier version had more keys of each."""
    plane = {"kind": "plane", "point": [0.0, 0.1], "normal": [0.0, 1.0]}
    tables = piston_tables() | {
        "walls": [plane | {"end": 0.01}, plane | {"begin": 0.01}, plane | {"normal": [1.0, 0.0]}]
    }
    first, second, third = wall_texts(jaxdem.load_scene(tables))
    assert second == f"{first} 2" and third not in (first, second)
    tables["walls"] = [plane, plane | {"piston": piston_tables()["walls"][0]["piston"]}]
    assert piston_texts(jaxdem.load_scene(tables), ()) == [second], "numbers are those of all walls"
    before = json.dumps(['{"end": 3.0, "kind": "plane", "material": "steel"} 1', "left"])
    assert StartPoint("run", {}, {"walls": before}).walls == ['{"kind": "plane"} 1', "left"]
    meshes = json.dumps(['{"file": "/drum.stl", "kind": "mesh"}'])
    with pytest.raises(InputError, match=r"start\.from = 'run'.*told meshes apart by their files"):
        _ = StartPoint("run", {}, {"meshes": meshes}).meshes


def test_a_wall_faster_than_a_diameter_an_interval_is_met():
    """A plate that goes 2.4 radii in a coupling interval throws a grain to twice its speed (restitution 1)."""
    tables = grain(2, restitution=1.0, friction=0.0, young_modulus=1e8)
    tables["domain"]["gravity"] = [0.0, 0.0]
    tables["coupling"]["interval"] = 3e-3
    tables["walls"][0]["motion"] = [{"kind": "translation", "velocity": [0.0, 4.0]}]
    tables["particles"]["position"] = [[0.5, 0.05]]
    tables["time"] = {"end": 0.03, "output_interval": 0.03}
    np.testing.assert_allclose(path(tables).velocity[-1, 0], [0.0, 8.0], rtol=2e-3, atol=1e-12)


@COMBINATION
def test_a_wall_that_moves_and_vanishes():
    """A belt that is there until t drags until then."""
    tables = on_belt(2)
    tables["walls"][0]["end"] = 0.05
    tables["domain"]["gravity"] = [0.0, -9.81]
    tables["time"] = {"end": 0.06, "output_interval": 0.02}
    found = path(tables)
    assert found.velocity[49, 0, 0] == found.velocity[-1, 0, 0] > 0.05
    assert found.velocity[-1, 0, 1] < -0.09


def test_a_belt_that_begins_late():
    tables = on_belt(2)
    tables["walls"][0]["motion"][0] |= {"begin": 0.02, "end": 0.05}
    tables["time"] = {"end": 0.08, "output_interval": 0.02}
    found = path(tables)
    assert abs(found.velocity[19, 0, 0]) < 1e-9 < found.velocity[25, 0, 0]
    assert found.load.power[60:].max() == 0.0
    assert found.load.power[30] < 0.0, "the belt drives the grain"


def tables_with(**wall):
    tables = grain(2)
    tables["walls"][0] |= wall
    return tables


SPIN = {"kind": "rotation", "rate": 1.0, "center": [0.5, 0.0]}


@pytest.mark.parametrize(
    ("wall", "key", "words"),
    [
        ({"motion": [{"kind": "rotation", "rate": 1.0}]}, "walls.0.motion.0.center", "turns about it"),
        ({"motion": [SPIN | {"axis": [0.0, 1.0]}]}, "walls.0.motion.0.axis", "3-D scenes only"),
        ({"motion": [SPIN | {"velocity": [1.0, 0.0]}]}, "walls.0.motion.0.velocity", "keys of a motion of kind"),
        ({"motion": [{"kind": "translation"}]}, "walls.0.motion.0.velocity", "is needed"),
        ({"motion": [SPIN | {"begin": 1.0, "end": 0.5}]}, "walls.0.motion.0.end", "after begin"),
        ({"motion": [{"kind": "table", "times": [0.0, 1.0]}]}, "walls.0.motion.0", "angle"),
        (
            {"motion": [{"kind": "table", "times": [0.0, 1.0], "direction": [1.0, 0.0], "displacement": [0.0]}]},
            "walls.0.motion.0.displacement",
            "needs 2 entries",
        ),
        (
            {"motion": [{"kind": "table", "times": [0.0, 1.0], "direction": [1.0, 0.0], "angle": [0.0, 1.0]}]},
            "walls.0.motion.0.angle",
            "there is a direction",
        ),
        ({"motion": [{"kind": "turn"}]}, "walls.0.motion.0.kind", "must be"),
        ({"piston": {"direction": [0.0, 1.0], "force": 1.0}}, "walls.0.piston.mass", "missing"),
        (
            {"piston": {"direction": [0.0, 1.0], "force": [1.0, 2.0], "mass": 1.0}},
            "walls.0.piston.force",
            "force_times",
        ),
        ({"piston": {"direction": [0.0, 1.0], "force": 1.0, "mass": 1.0}, "end": 1.0}, "walls.0.end", "all the time"),
        ({"piston": {"direction": [0.0, 1.0], "force": 1.0, "mass": 1e-6}}, "walls.0.piston.mass", "too light"),
    ],
)
def test_refused(wall, key, words):
    with pytest.raises(InputError) as caught:
        jaxdem.build(jaxdem.load_scene(tables_with(**wall)))
    assert str(caught.value).startswith(key) and words in str(caught.value)


def test_a_wall_that_would_jump_into_grains_is_refused_with_the_step_that_works():
    tables = tables_with(motion=[{"kind": "translation", "velocity": [0.0, 30.0]}])
    tables["contact"] |= {"speed": 1.0}
    with pytest.raises(InputError, match=r"walls\.0\.motion.*jump into grains.*Set contact\.time_step = ") as caught:
        jaxdem.build(jaxdem.load_scene(tables))
    step = float(str(caught.value).split("contact.time_step = ")[1].split()[0])
    tables["contact"]["time_step"] = step
    simulation, _ = jaxdem.build(jaxdem.load_scene(tables))
    assert simulation.steps.contact <= step


def test_the_speed_of_the_wall_counts_in_the_step():
    slow, _ = jaxdem.build(jaxdem.load_scene(tables_with()))
    tables = tables_with(motion=[{"kind": "oscillation", "direction": [0, 1], "amplitude": 0.01, "frequency": 50.0}])
    fast, _ = jaxdem.build(jaxdem.load_scene(tables))
    speed = 2.0 * np.pi * 50.0 * 0.01
    np.testing.assert_allclose(fast.steps.expected_speed - slow.steps.expected_speed, speed, rtol=1e-3)
    assert fast.steps.contact < slow.steps.contact and fast.steps.expected_overlap > slow.steps.expected_overlap


def test_check_names_the_motion():
    tables = tables_with(motion=[SPIN, {"kind": "translation", "velocity": [0.1, 0.0]}])
    parts = check_scene(jaxdem.load_scene(tables)).compiled_in
    assert any("plane moved by rotation, translation" in part for part in parts)


def test_a_grain_in_a_wall_where_the_motion_has_it_at_the_start():
    tables = tables_with(
        motion=[{"kind": "oscillation", "direction": [0, 1], "amplitude": 0.004, "frequency": 5.0, "phase": 1.5}]
    )
    scene = jaxdem.load_scene(tables)
    with pytest.raises(InputError, match="into walls.0"):
        jaxdem.initial_state(scene, *jaxdem.build(scene))


def test_a_grain_pushed_through_a_side_stops_the_run(tmp_path):
    tables = tables_with(motion=[{"kind": "translation", "velocity": [0.0, 2.0]}])
    tables["particles"]["position"] = [[0.5, 0.9]]
    tables["time"] = {"end": 1.0, "output_interval": 0.1}
    with pytest.raises(RunError, match="left|limit|through"):
        jaxdem.simulate(jaxdem.load_scene(tables), tmp_path / "run")
