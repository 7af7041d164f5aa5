"""Walls that a force holds in the fluid: the added mass, a body that floats, and what is refused.

`tests/cases/pistons_in_fluid.py` has the closed forms.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem import build, initial_state, load_scene, simulate
from jaxdem.coupling.pistons_in_fluid import FluidOnWalls, PistonInFluid, under_load
from jaxdem.errors import RunError
from jaxdem.failures import Failure, failures
from jaxdem.fluid import momentum_step
from jaxdem.fluid.surface_response import SurfaceResponse
from jaxdem.particles.moving_walls import PistonNumbers, PistonState
from jaxdem.run.diagnosis import diagnosis
from jaxdem.setup.builder import build_case
from jaxdem.setup.fluid_surfaces import host_numbers
from tests.cases.pistons_in_fluid import DENSITY, DEPTH, STEP, before_column, column, march, scene_of
from tests.cases.steps import compiled_step
from tests.cases.tiers import COMBINATION, tiered
from tests.test_fluid_walls import refusal


def test_the_added_mass_is_that_of_the_column_and_holds_a_light_piston(monkeypatch):
    """A piston 140 times lighter than the water before it. With the whole load explicit it swings ever wider."""
    found, _, told = march(before_column(0.01), 4)
    exact = column(0.01, 4)
    np.testing.assert_allclose(found[:, 1], exact[:, 1], rtol=0.015)
    added = -STEP * float(told.fluid.response.pressure[0, 0, 0])
    assert added == pytest.approx(DENSITY * DEPTH * 0.2 * (0.35 - exact[-1, 0]), rel=0.015)
    plain = momentum_step.surface_response

    def unknown(*given):
        return jax.tree.map(jnp.zeros_like, plain(*given))

    monkeypatch.setattr(momentum_step, "surface_response", unknown)
    compiled_step.cache_clear()
    found, _, _ = march(before_column(0.01), 4)
    assert np.abs(found[:, 1]).max() > 100.0 * exact[-1, 1]


def test_an_outlet_on_a_wall_does_not_hold_a_piston():
    """It sets no pressure, so that the load on a plane would be off by any constant; on a whole body that cancels."""
    given = before_column(0.01)
    given["domain"]["size"], given["fluid"]["cells"] = [0.44, 0.2], [22, 10]
    del given["boundary"]["right"]
    end = {"kind": "plane", "point": [0.4, 0.0], "normal": [-1.0, 0.0], "fluid": "free_slip"}
    given["walls"].append(end | {"opening": [{"kind": "outlet"}]})
    assert "walls.0.piston" in (found := refusal(given)) and "walls.1.opening.0" in found
    given["walls"][0] = facing(0.2, 2.0)
    build(load_scene(given))


@COMBINATION
def test_the_added_mass_does_not_depend_on_the_number_of_fluid_steps():
    """Four in a coupling interval: the inertia of the water acts in the first one."""
    given = before_column(0.01)
    given["fluid"]["time_step"] = STEP / 4
    found, _, told = march(given, 4)
    assert int(told.fluid.substeps) == 4
    np.testing.assert_allclose(found[:, 1], column(0.01, 4)[:, 1], rtol=0.015)


@pytest.mark.parametrize("force", tiered([-20.0, 20.0], first=[20.0]))
def test_a_piston_that_leaves_the_fluid_stops_the_run(force, tmp_path):
    """Drawn out of the box through the left side, and pushed through it until no cell is open. Beside the one that
    is drawn out there is a second one, at rest above the water, which is not named."""
    given = before_column(10.0)
    lid = {"kind": "plane", "point": [0.0, 0.19], "normal": [0.0, -1.0], "fluid": "free_slip"}
    lid["piston"] = {"direction": [1.0, 0.0], "force": 0.0, "mass": 1.0}
    given["walls"] += [lid] if force < 0.0 else []
    given["walls"][0]["piston"]["force"] = force
    given["boundary"]["right"] = {"kind": "outlet", "particles": "remove"}
    with pytest.raises(RunError, match="no fluid beside it") as caught:
        simulate(load_scene(given), tmp_path / "run")
    assert "walls.0" in caught.value.where and caught.value.time < 1.0
    assert "walls.1" not in caught.value.where


def facing(x, force):
    """A body on the middle line of a box, pushed along it."""
    body = {"kind": "cylinder", "center": [x, 0.093], "radius": 0.03, "inside": False, "fluid": "no_slip"}
    return body | {"piston": {"direction": [1.0, 0.0], "force": force, "mass": 0.06}}


def test_pistons_that_meet_stop_the_run():
    """Two bodies pushed against each other mirror each other until they touch; both are named. Their gap, where the
    interval ends, is what their ways have left of it: off by less than the tenth of a cell that the nearest corners are
    off the line."""
    given = scene_of(facing(0.13, 2.0), [0.4, 0.2], [16, 8], boundary={"top": {"kind": "outlet"}})
    given["walls"].append(facing(0.27, -2.0))
    given["particles"]["position"] = [[0.2, 0.18]]
    scene = load_scene(given)
    simulation, parameters = build(scene)
    state, neighbors = initial_state(scene, simulation, parameters)
    step, code = jax.jit(simulation.step), 0
    while code == 0:
        before = state
        state, neighbors, told = step(parameters, state, neighbors)
        code = int(failures(simulation, told))
        at_end = before.particles.pistons.displacement + STEP * before.particles.pistons.velocity
        left = 0.08 - float(at_end[0] - at_end[1])
        assert float(told.fluid.response.gap[0, 1]) == pytest.approx(left, abs=0.0025)
        assert (code != 0) == (float(told.fluid.response.gap[0, 1]) <= 0.0)
        if left > 0.03:
            np.testing.assert_allclose(*np.abs(state.particles.pistons.velocity), rtol=1e-6)
    assert Failure(code) == Failure.PISTON_MEETS
    reason, where, remedy = diagnosis(simulation, parameters, code, before, state, told)
    assert "meets another wall" in reason and remedy
    assert "walls.0 (meets walls.1)" in where and "walls.1 (meets walls.0)" in where


FLOOR = {"kind": "plane", "point": [0.0, 0.02], "normal": [0.0, 1.0], "fluid": "free_slip"}


def post(x, z, radius, **keys):
    return {"kind": "cylinder", "center": [x, z], "radius": radius, "inside": False, "fluid": "free_slip", **keys}


def piston_among(*walls):
    """The piston before the column, whose front is at x = 0.05 m, as it is compiled beside other walls."""
    given = before_column(0.01)
    given["walls"] += walls
    return build(load_scene(given))[0].walls_in_fluid.pistons[0]


def test_a_piston_may_slide_along_its_guide():
    """It touches it from the start, or cuts it at a small angle. What lies ahead of it, it must not meet."""
    end = {"kind": "plane", "point": [0.39, 0.0], "normal": [-1.0, 0.0], "fluid": "free_slip"}
    given = before_column(0.01)
    given["walls"] += [FLOOR, end, post(0.2, 0.15, 0.02, end=0.1), FLOOR | {"normal": [-0.5, 1.0]}]
    given["boundary"] |= {"top": {"kind": "outlet"}, "right": {"kind": "free_slip"}}
    (piston,) = build(load_scene(given))[0].walls_in_fluid.pistons
    assert piston.apart == ((2, 2), (3, 3))
    assert piston.along == ((1, 1), (4, 4))


def test_a_piston_within_a_wall_ahead_is_refused_and_a_gate_there_is_looked_at_as_it_comes():
    """Of a gate that comes nothing is known before, but for one that is the same all along the way."""
    for wall in (post(0.05, 0.1, 0.03), post(0.02, 0.1, 0.015), post(0.05, 0.1, 0.03, end=0.1)):
        given = before_column(0.01)
        given["walls"].append(wall)
        told = refusal(given)
        assert "walls.0.piston" in told and "walls.1" in told and "overlaps" in told
    late, lifted = FLOOR | {"begin": 0.01}, {"motion": [{"kind": "translation", "velocity": [0.0, 0.01]}]}
    piston = piston_among(post(0.05, 0.1, 0.03, begin=0.01), late, late | {"point": [0.0, 0.01]} | lifted)
    assert piston.apart == ((1, 1), (3, 3)) and piston.along == ((2, 2),)


@COMBINATION
@pytest.mark.parametrize("x", [0.05, 0.09])
def test_a_gate_that_comes_where_a_piston_stands_stops_the_run(x, tmp_path):
    """Where the scene has the piston, and where it has come to: at 0.04 s, by 2 N before 1.4 kg."""
    given = before_column(0.01)
    given["time"]["output_interval"] = STEP
    given["walls"].append(post(x, 0.1, 0.0395, begin=0.04))
    with pytest.raises(RunError, match="meets another wall") as caught:
        simulate(load_scene(given), tmp_path / "run")
    assert caught.value.time == pytest.approx(0.04) and "walls.0 (meets walls.1)" in caught.value.where


def plate_in_a_pipe(height):
    """A plate in a pipe, both meshes, with its front at 0.16 m; the pipe is 0.14 m wide to a shoulder at 0.3 m."""
    low, high = 0.1 - 0.5 * height, 0.1 + 0.5 * height
    corners = [[0.1, low], [0.16, low], [0.16, high], [0.1, high]]
    plate = {"kind": "mesh", "points": corners, "closed": True, "fluid": "free_slip"}
    plate["piston"] = {"direction": [1.0, 0.0], "force": 2.0, "mass": 0.1}
    below = [[-0.1, 0.03], [0.3, 0.03], [0.3, 0.08], [0.5, 0.08]]
    corners = [*below, *([x, 0.2 - z] for x, z in reversed(below))]
    pipe = {"kind": "mesh", "points": corners, "closed": True, "inside": True, "fluid": "free_slip"}
    sides = {"left": {"kind": "outlet"}, "right": {"kind": "outlet"}}
    given = scene_of(plate, [0.4, 0.2], [40, 20], boundary=sides)
    given["walls"].append(pipe)
    return load_scene(given)


@pytest.mark.parametrize("height", [0.14, 0.145])
def test_a_piston_in_a_guide_meets_the_end_of_the_guide(height):
    """It touches the sides of the pipe from the start, or is let into them, and the shoulder is a part of the same
    mesh. A hundredth of a cell is let through; the distance of a mesh that moves is not known far from it."""
    scene = plate_in_a_pipe(height)
    walls = build_case(scene).fluid_walls
    assert walls.moving.pistons[0].along == ((1, 1),) and not walls.moving.pistons[0].apart
    for way in (-0.05, 0.0, 0.08, 0.1, 0.123, 0.136, 0.139, 0.141, 0.147, 0.16):
        span = ((np.asarray(0.0), None), np.asarray(STEP)), np.asarray(0.5 * STEP)
        cut, _ = walls.moving.cut_and_swept(walls.still, host_numbers(scene, 0.0, [way]), *span)
        gap = float(np.asarray(cut.piston_gaps)[0, 1])
        left = 0.14 - way + 1e-4
        assert gap > 0.05 if left > 0.05 else gap == pytest.approx(max(left, -0.02), abs=1e-6)
        assert (gap > 0.0) == (left > 0.0)


def test_light_pistons_that_share_their_fluid_do_not_swing():
    """Three before one column: with the diagonal of the added mass alone they would, the common mode by -2 M_ij/M_ii an
    interval. They come to the acceleration of (m + M) a = F."""
    count, own, shared, mass, force = 3, 1.0, 0.9, 0.1, jnp.asarray([1.0, -0.5, 0.2])
    matrix = jnp.full((count, count), shared) + (own - shared) * jnp.eye(count)
    pistons = tuple(PistonInFluid(k, k, (k,), (1.0, 0.0)) for k in range(count))
    step = jnp.asarray(STEP)

    def along(values):
        return jnp.stack((values, jnp.zeros_like(values)), -1)

    response = SurfaceResponse(along(-matrix / step), jnp.zeros((count, 2)), jnp.ones((count, 2)))
    numbers = tuple(PistonNumbers(f, jnp.asarray(mass), jnp.zeros(())) for f in force)

    def interval(state, _):
        before = state.velocity if state.seen_velocity is None else state.seen_velocity
        load = -matrix @ ((state.velocity - before) / step)
        fluid = FluidOnWalls(along(load), response, jnp.asarray(DENSITY))
        under, state = under_load(pistons, numbers, state, fluid, jnp.zeros(2), step)
        rate = jnp.stack([one.force / one.mass for one in under])
        return state._replace(velocity=state.velocity + rate * step), rate

    start = PistonState(jnp.zeros(count), None, jnp.zeros(count), jnp.zeros(count))
    rates = jax.lax.scan(interval, start, None, 300)[1]
    np.testing.assert_allclose(rates[-1], np.linalg.solve(mass * np.eye(count) + matrix, force), rtol=1e-6)
    assert float(jnp.abs(rates).max()) < 10.0


def test_a_smooth_lid_that_moves_along_itself_has_fluid_beside_it():
    """Its speed makes no load, and it has not left the fluid."""
    lid = {"kind": "plane", "point": [0.0, 0.09], "normal": [0.0, -1.0], "fluid": "free_slip"}
    lid["piston"] = {"direction": [1.0, 0.0], "force": 0.1, "mass": 0.01}
    sides = {"left": {"kind": "periodic"}, "right": {"kind": "periodic"}}
    grain = {"position": [[0.02, 0.02]], "radius": 0.0005}
    given = scene_of(lid, [0.04, 0.1], [4, 10], boundary=sides, particles=grain)
    found, _, told = march(given, 2)
    np.testing.assert_allclose(found[:, 1], 0.1 / 0.01 * STEP * np.arange(1, 3), rtol=1e-12)
    assert not np.any(told.fluid.response.pressure) and not np.any(told.fluid.response.friction)
    assert int(failures(build(load_scene(given))[0], told)) == 0


def test_gradients_know_of_the_added_mass():
    """Of the acceleration (F + L + M' a)/(m + M') by the response of the fluid, against differences."""
    piston, numbers = PistonInFluid(0, 0, (0,), (1.0, 0.0)), PistonNumbers(*map(jnp.asarray, (2.0, 0.3, 0.0)))
    state = PistonState(jnp.zeros(1), None, jnp.asarray([0.02]), jnp.asarray([0.01]))

    def acceleration(response):
        fluid = SurfaceResponse(-response * jnp.ones((1, 1, 2)), jnp.zeros((1, 2)), jnp.ones((1, 2)))
        on_walls = FluidOnWalls(jnp.asarray([[-1.0, 0.0]]), fluid, jnp.asarray(DENSITY))
        (own,), _ = under_load((piston,), (numbers,), state, on_walls, jnp.asarray([0.5, 0.0]), jnp.asarray(STEP))
        return own.force / own.mass

    slope = float(jax.grad(acceleration)(100.0))
    assert slope == pytest.approx(float(acceleration(101.0) - acceleration(99.0)) / 2.0, rel=1e-4)
    assert abs(slope) > 1e-4


def body(mass):
    wall = {"kind": "cylinder", "center": [0.15, 0.1], "radius": 0.05, "inside": False, "fluid": "free_slip"}
    wall["piston"] = {"direction": [0.0, 1.0], "force": 0.0, "mass": mass}
    beside = {"position": [[0.28, 0.1]]}
    return scene_of(wall, [0.3, 0.2], [15, 10], domain={"gravity": [0.0, -10.0]}, particles=beside)


def test_a_body_floats_by_the_water_that_it_displaces():
    """At rest if it is as heavy; a lighter one rises, with an added mass between that of a cylinder in an endless
    fluid, rho V, and twice that."""
    simulation, _ = build(load_scene(body(0.15)))
    displaced = simulation.walls_in_fluid.pistons[0].displaced
    assert displaced == pytest.approx(np.pi * 0.05**2 * DEPTH, rel=0.03)
    resting, _, told = march(body(DENSITY * displaced), 3)
    assert np.abs(resting[:, 1]).max() < 1e-12
    added = -STEP * float(told.fluid.response.pressure[0, 0, 1])
    assert 1.0 < added / (DENSITY * displaced) < 2.0
    mass = 0.5 * DENSITY * displaced
    rising, _, _ = march(body(mass), 6)
    expected = (DENSITY * displaced - mass) * 10.0 / (mass + added) * STEP
    np.testing.assert_allclose(rising[:, 1], expected * np.arange(1, 7), rtol=0.05)


def test_grains_settle_beside_a_piston():
    """Before the run, without the fluid: the piston waits where the scene has it."""
    given = before_column(0.01)
    given["domain"]["gravity"], given["contact"] = [0.0, -10.0], {"young_modulus": 1e6, "speed": 2.0}
    pack = {"kind": "settled", "start": [0.1, 0.0], "stop": [0.3, 0.05], "count": 3}
    given["particles"] = {"radius": 0.004, "density": 2500.0, "pack": pack}
    scene = load_scene(given)
    state, _ = initial_state(scene, *build(scene))
    np.testing.assert_allclose(state.particles.position[:, 1], 0.004, rtol=0.05)
    assert float(state.particles.pistons.displacement[0]) == 0.0


def test_what_is_refused():
    alone = before_column(0.01)
    for name in ("particles", "contact", "coupling"):
        del alone[name]
    assert "scene has none" in refusal(alone)
    closed = before_column(0.01)
    del closed["boundary"]
    assert "no way out" in refusal(closed)
    assert "start" in refusal(before_column(0.01) | {"start": {"from": "runs/none"}})
