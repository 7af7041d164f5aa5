"""Temperatures and other scalars on several devices, against one device."""

import shutil

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem import devices
from jaxdem.failures import failures
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.cut_scalar import ScalarWalls
from jaxdem.fluid.mesh import Grid, next_cells
from jaxdem.fluid.slabs import cells_in_slabs, cells_of_slabs
from jaxdem.numerics.blocks import Blocks
from jaxdem.scalars import moving_cells
from jaxdem.scalars.moving_cells import Change, held_by_cells
from jaxdem.scalars.scalar_state import ScalarState
from jaxdem.setup.builder import build_case
from tests.cases.fluid_slabs import ALONG_X, SLABS, coupled_scene, fluid_scene, places, run_on_slabs
from tests.cases.heat import chain_tables
from tests.cases.slabs import apart
from tests.cases.tiers import COMBINATION, tiered

DYE = {"name": "dye", "diffusivity": 1e-3}
FLUID_HEAT = {"fluid_heat_capacity": 1000.0, "fluid_conductivity": 0.5, "fluid_temperature": 300.0}


def stepped(scene, number, steps, marked=None):
    """State after so many intervals on one device and on several, whole; the second with its list and program."""
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    if marked is not None:
        state = state._replace(scalars=marked(state.scalars))
    divided, _ = jaxdem.build(scene, devices=number)
    slabs, lists = devices.distributed(divided, parameters, state, neighbors)
    step, many = (jax.jit(of.step) for of in (simulation, divided))
    program = many.lower(parameters, slabs, lists).compile().as_text()
    assert "all-gather" not in program
    for _ in range(steps):
        state, neighbors, report = step(parameters, state, neighbors)
        slabs, lists, figures = many(parameters, slabs, lists)
        assert int(failures(simulation, report)) == int(failures(divided, figures)) == 0
    return state, devices.gathered(divided, slabs, lists)[0], lists


def test_conduction_across_a_border():
    """A row of grains of different temperatures between a warm and a cold wall, cut in its middle."""
    tables = chain_tables(6, 4e4, 0.01, left={"temperature": 50.0}, right={"temperature": 0.0})
    first = np.array([20.0, 30.0, 80.0, 10.0, 20.0, 60.0])
    scene = jaxdem.load_scene(tables)
    state, whole, lists = stepped(scene, 2, 20, lambda scalars: scalars._replace(grains=jax.numpy.asarray(first)))
    assert devices.counts(lists).particles.tolist() == [3, 3]
    expected, found = np.asarray(state.scalars.grains), whole.scalars.grains
    np.testing.assert_allclose(found, expected, rtol=1e-13)
    assert first[2] - expected[2] > 10.0 and expected[3] - first[3] > 10.0, "heat has crossed the border"
    walls = float(state.scalars.supplied.walls)
    assert abs(float(whole.scalars.supplied.walls) - walls) < 1e-12 * abs(walls)
    capacity = 2000.0 * 500.0 * np.pi / 6.0 * 0.01**3
    assert abs(capacity * np.sum(found - first) - walls) < 1e-12 * capacity * np.sum(first)


@pytest.mark.parametrize(("periodic", "axis"), tiered([(True, 0), (False, 1)], first=[(True, 0)]))
def test_what_closed_cells_held_goes_over_borders(periodic, axis, monkeypatch):
    """Cells between two and all sides of whose borders have closed: what they hold and that in the open cells beside
    them is that of one device, and kept. Without what the neighbours send it is not."""
    grid, draw = Grid((8, 6), (0.8, 0.6), 1.0, (periodic, False)), np.random.default_rng(4)
    fluid = draw.random(grid.cells) > 0.3
    beside = [np.minimum(np.roll(fluid, 1, k), fluid) for k in range(2)]
    faces = [np.concatenate((b, np.take(b, [0], k)), k) * draw.uniform(0.2, 1.0, grid.face_shape(k))
             for k, b in enumerate(beside)]  # fmt: skip
    for k, a in enumerate(faces):
        a[(slice(None),) * k + (-1,)] = a[(slice(None),) * k + (0,)] = a[(slice(None),) * k + (0,)] * grid.periodic[k]
    flux = [a * draw.normal(size=a.shape) for a in faces]
    flux[0][-1] = flux[0][0]
    cells = np.where(fluid, draw.uniform(0.3, 1.0, grid.cells), 0.0)
    distance = draw.uniform(-0.05, 0.1, (9, 7))
    distance[-1] = distance[0]
    capacity, dye, after = (draw.uniform(0.3, 1.0, grid.cells) for _ in range(3))
    blocks = Blocks(2, axis, grid.periodic[axis])

    def held(grid, cells, faces, flux, distance, capacity, dye, after):
        cut = CutCells(faces, cells, (), (), (), (), cells, distance=distance)
        state = ScalarState((dye,), None, None, capacity=capacity)
        walls = ScalarWalls(*[cells] * 3, None, None)
        found = held_by_cells(grid, walls, state, Change(cut, flux, 1.0, after, jnp.asarray(0.02)))
        return found.capacity, found.fields[0], found.before, found.after, found.walls.exchange, found.walls.area

    def in_slabs(of_grid):
        def parts(fields):
            return tuple(cells_in_slabs(blocks, f, int(k == axis)) for k, f in enumerate(fields))

        alone = (cells_in_slabs(blocks, x) for x in (capacity, dye, after))
        given = cells_in_slabs(blocks, cells), parts(faces), parts(flux), cells_in_slabs(blocks, distance, 1), *alone
        found, _ = run_on_slabs(2, lambda *of_slab: held(of_grid, *of_slab), [SLABS] * 7, given)
        return [cells_of_slabs(blocks, x) for x in found]

    expected = jax.jit(held, static_argnums=0)(grid, cells, tuple(faces), tuple(flux), distance, capacity, dye, after)
    assert abs(jnp.sum(expected[0]) - np.sum(capacity)) < 1e-13 * np.sum(capacity)
    for found, wanted in zip(in_slabs(grid.in_blocks(blocks)), expected, strict=True):
        assert apart(wanted, found) < 1e-13
    monkeypatch.setattr(moving_cells, "next_cells", lambda grid, *given, **ways: next_cells(grid.whole, *given, **ways))
    assert apart(expected[1], in_slabs(grid.in_blocks(blocks))[1]) > 1e-3


def test_fields_in_a_periodic_stream():
    """Warm fluid and a dye that go round through four slabs, warmed from below."""
    sides = ALONG_X | {"bottom": {"temperature": 330.0}, "top": {"heat_flux": 5.0}}
    tables = fluid_scene([8, 6], sides) | {"heat": FLUID_HEAT | {"expansion": 3e-3}, "scalars": [DYE]}
    tables["fluid"]["velocity"] = [1.0, 0.0]
    draw = np.random.default_rng(0)

    def marked(scalars):
        return scalars._replace(fields=tuple(f + draw.random(f.shape) for f in scalars.fields))

    state, whole, _ = stepped(jaxdem.load_scene(tables), 4, 8, marked)
    for expected, found in zip(state.scalars.fields, whole.scalars.fields, strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    passed = np.asarray(state.scalars.supplied.sides)
    assert np.all(passed[0, 2:] != 0.0)
    np.testing.assert_allclose(whole.scalars.supplied.sides, passed, rtol=0, atol=1e-11 * np.abs(passed).max())
    assert float(np.abs(state.fluid.face_velocity[1]).max()) > 1e-4, "warm fluid rises"


def tables_of_all():
    """Grains that change slabs, leave and come in, exchange heat with a stream, with each other and with a wall."""
    sides = {
        "left": {"kind": "inlet", "velocity": 0.2, "temperature": 320.0, "scalars": {"dye": 1.0}},
        "right": {"kind": "outlet", "particles": "remove"},
        "bottom": {"temperature": 400.0},
    }
    tables = coupled_scene(2, sides) | {"scalars": [DYE]}
    tables["contact"] |= {"speed": 4.0}
    tables["heat"] = FLUID_HEAT | {
        "particle_heat_capacity": 100.0, "particle_temperature": 350.0, "particle_conductivity": 1e6,
        "true_young_modulus": 1e9, "expansion": 3e-3, "friction": True,
    }  # fmt: skip
    draw = np.random.default_rng(5)
    tables["particles"] |= {
        "position": places([0.4, 0.16], count=50),
        "velocity": ([0.8, -0.3] + draw.normal(size=(50, 2))).tolist(),
        "inlet": [{"start": [0.02, 0.17], "stop": [0.38, 0.2], "rate": 1000.0, "velocity": [0.5, -1.0],
                   "temperature": 280.0, "total": 18}],
    }  # fmt: skip
    gate = {"name": "gate", "kind": "plane", "axis": "x", "at": 0.22, "interval": 0.01}
    return tables | {"probes": [gate], "time": {"end": 0.04, "output_interval": 0.02}}


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """The whole run on one device; on two, stopped in the middle and resumed on two, and on one."""
    out = tmp_path_factory.mktemp("heat")
    tables = tables_of_all()
    half = tables | {"time": {"end": 0.02, "output_interval": 0.02}}
    one = jaxdem.simulate(jaxdem.load_scene(tables), out / "one")
    jaxdem.simulate(jaxdem.load_scene(half), out / "two", devices=2)
    shutil.copytree(out / "two", out / "back")
    two = jaxdem.simulate(jaxdem.load_scene(tables), out / "two", devices=2, resume=True)
    back = jaxdem.simulate(jaxdem.load_scene(tables), out / "back", resume=True)
    return one, two, back


@COMBINATION
@pytest.mark.parametrize("number", [1, 2])
def test_everything_at_once_is_that_of_one_device(runs, number):
    """Temperatures of grains and fluid, the dye, and whence all heat came; the tolerance is that of the pressure."""
    one, other = runs[0], runs[number]
    assert other.summary["devices"]["migrations"] > 0 if number == 1 else "devices" not in other.summary
    expected, found = one.particles(-1), other.particles(-1)
    there = expected["active"] == 1
    np.testing.assert_array_equal(found["active"], expected["active"])
    assert one.history["removed"][-1] > 0 and there.sum() + one.history["removed"][-1] > 50
    for name in ("temperature", "position", "velocity"):
        assert apart(expected[name][there], found[name][there]) < 1e-10, name
    assert np.ptp(expected["temperature"][there]) > 20.0
    for name in ("temperature", "dye"):
        assert apart(one.fluid(-1)[name], other.fluid(-1)[name]) < 1e-10, name
    told, same = one.summary["heat"], other.summary["heat"]
    scale = abs(told["start"])
    for name in ("start", "fluid", "grains", "from_walls_to_grains", "brought_by_grains", "from_friction"):
        assert abs(same[name] - told[name]) < 1e-11 * scale, name
        assert told[name] != 0.0
    for sides, others in (
        (told["through_sides"], same["through_sides"]),
        (one.summary["scalars"]["dye"]["through_sides"], other.summary["scalars"]["dye"]["through_sides"]),
    ):
        largest = max(map(abs, sides.values()))
        assert all(abs(others[side] - value) < 1e-10 * largest for side, value in sides.items())
    assert abs(same["missing"]) < 1e-10 * scale


@COMBINATION
def test_a_run_begins_from_one_in_slabs(runs):
    """Temperatures and dye of a run on one device that begins from another one."""
    states = []
    for run in runs[:2]:
        tables = tables_of_all() | {"start": {"from": str(run.path)}, "time": {"end": 0.06, "output_interval": 0.02}}
        state = build_case(jaxdem.load_scene(tables)).unsettled_state()[0]
        there = np.asarray(state.particles.active)
        states.append((np.asarray(state.scalars.grains)[there], *state.scalars.fields))
    for expected, found in zip(*states, strict=True):
        assert apart(expected, found) < 1e-10
    assert np.ptp(states[0][0]) > 20.0


@COMBINATION
def test_a_profiled_run_in_slabs_is_the_same(runs, tmp_path):
    """Fluid, scalars, particles and probes by programs of their own, each over both devices."""
    tables = tables_of_all() | {"time": {"end": 0.02, "output_interval": 0.02}}
    profiled = jaxdem.simulate(jaxdem.load_scene(tables), tmp_path / "run", devices=2, profile=True)
    for name in ("temperature", "position", "velocity"):
        there = profiled.particles(-1)["active"] == 1
        assert apart(runs[0].particles(1)[name][there], profiled.particles(-1)[name][there]) < 1e-10, name
    assert apart(runs[0].fluid(1)["dye"], profiled.fluid(-1)["dye"]) < 1e-10
    for column, values in profiled.probes["gate"].items():
        np.testing.assert_allclose(values, runs[0].probes["gate"][column][: len(values)], rtol=1e-9, err_msg=column)
    stages = profiled.summary["stages_s"]
    assert stages["fluid"] > 0.0 and stages["contact"] > 0.0
