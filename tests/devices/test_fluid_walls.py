"""Walls that the fluid sees on several devices, against one device."""

import shutil

import jax
import numpy as np
import pytest

import jaxdem
from jaxdem import InputError, devices
from jaxdem.coupling.pistons_in_fluid import PistonInFluid, gaps_of
from jaxdem.coupling.walls_in_fluid import WallsInFluid
from jaxdem.failures import Failure, failures
from jaxdem.fluid.grid import Grid
from jaxdem.fluid.slabs import cells_in_slabs
from jaxdem.numerics.blocks import Blocks
from jaxdem.setup.builder import build_case
from tests.cases.fluid_slabs import SLABS, compared, fluid_scene, run_on_slabs
from tests.cases.pistons_in_fluid import STEP, before_column, march
from tests.cases.slabs_beside_walls import CYLINDER, JET, SCENES
from tests.cases.tiers import COMBINATION


@pytest.mark.parametrize(
    ("name", "number", "axis"),
    [
        pytest.param("jet", 2, 0, marks=COMBINATION),
        pytest.param("stream", 3, 1, marks=COMBINATION),
        pytest.param("jet, 3-D", 2, 2, marks=COMBINATION),
        ("moving", 2, 0),
        pytest.param("openings", 2, 0, marks=COMBINATION),
        pytest.param("grains", 2, 0, marks=COMBINATION),
        pytest.param("piston, diffusion", 2, 1, marks=COMBINATION),
    ],
)
def test_flow_and_loads_are_those_of_one_device(name, number, axis, monkeypatch):
    """After five intervals: fields within 1e-11, the same iterations of the pressure, and forces and torques on the
    walls; of grains beside them places, velocities and forces, and temperatures of both. Volume and momentum balance,
    and nothing is gathered.

    A slab has no more of the open parts than its cells, and the faces on its borders. A mesh that moves is cut once an
    interval, for fluid and temperatures.
    """
    scene = jaxdem.load_scene(SCENES[name])
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    divided = devices.divided(
        simulation, number, None if state.particles is None else state.particles.position, axis=axis
    )
    own = divided.with_parts(parameters)
    for part, whole in zip(jax.tree.leaves(own.fluid.cut), jax.tree.leaves(parameters.fluid.cut), strict=True):
        assert {shard.data.shape for shard in part.addressable_shards} == {(1, *part.shape[1:])}
        if whole.ndim == len(simulation.box):
            assert part.shape[1 + axis] - 2 <= whole.shape[axis] // number
    for back, whole in zip(jax.tree.leaves(divided.of_whole(own)), jax.tree.leaves(parameters), strict=True):
        np.testing.assert_array_equal(back, whole)
    slabs, lists = devices.distributed(divided, own, state, neighbors)
    cuts, over = [], WallsInFluid.over
    monkeypatch.setattr(WallsInFluid, "over", lambda *given: cuts.append(name) or over(*given))
    one, many = jax.jit(simulation.step), jax.jit(divided.step).lower(own, slabs, lists).compile()
    assert "all-gather" not in many.as_text() and len(cuts) == (simulation.walls_in_fluid is not None)
    for _ in range(5):
        state, neighbors, report = one(parameters, state, neighbors)
        slabs, lists, figures = many(own, slabs, lists)
        assert figures.fluid.converged and figures.fluid.iterations == report.fluid.iterations
        load = np.asarray(report.fluid.surface_load)
        np.testing.assert_allclose(figures.fluid.surface_load, load, rtol=0, atol=1e-11 * np.abs(load).max())
    assert np.max(compared(divided.slabs, slabs.fluid, state.fluid)) < 1e-11
    assert np.abs(load[0, 0, 0]) > 0.0 and np.asarray(state.fluid.face_velocity[0]).std() > 0.0
    if state.particles is None:
        return
    if state.scalars is not None:
        scalars, wanted = (of.scalars for of in (devices.gathered(divided, slabs, lists)[0], state))
        for found, expected in zip(jax.tree.leaves(scalars), jax.tree.leaves(wanted), strict=True):
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())
        assert np.ptp(wanted.fields[0]) > 0.01 and wanted.supplied.sides[0, -1] > 0.0
    assert figures.exchange.momentum < 1e-13 and figures.exchange.volume < 1e-13
    whole, _ = devices.gathered(divided, slabs, lists)
    for field in ("position", "velocity", "fluid_force"):
        found, expected = (np.asarray(getattr(of.particles, field)) for of in (whole, state))
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * np.abs(expected).max(), err_msg=field)
    if state.particles.pistons is not None:
        expected = np.asarray(state.particles.pistons.velocity)
        np.testing.assert_allclose(whole.particles.pistons.velocity, expected, rtol=1e-11)
        assert np.all(expected > 0.0)
        np.testing.assert_allclose(figures.fluid.response.gap, report.fluid.response.gap, rtol=1e-11)
        # Beyond the plate, and a fiftieth of a cell before the end of the floor that it slides along.
        pistons = state.particles.pistons._replace(displacement=np.asarray([0.279]), velocity=np.zeros(1))
        met = state._replace(particles=state.particles._replace(pistons=pistons))
        report = one(parameters, met, neighbors)[2]
        figures = many(own, *devices.distributed(divided, own, met, neighbors))[2]
        for structure, told in ((simulation, report), (divided, figures)):
            _, plate, end = np.asarray(told.fluid.response.gap)[0]
            assert plate < -0.02 and end == pytest.approx(0.001 + 0.01 * 0.4 / 12)
            assert Failure.PISTON_MEETS in Failure(int(failures(structure, told)))


def test_parameters_of_one_device_are_refused():
    scene = jaxdem.load_scene(SCENES["jet"])
    divided, own = jaxdem.build(scene, devices=2)
    _, parameters = jaxdem.build(scene)
    state, _ = jaxdem.initial_state(scene, divided, own)
    with pytest.raises(InputError, match=r"Take those of jaxdem.build\(scene, devices=...\)"):
        divided.step(parameters, state, None)


def test_a_piston_faces_a_body_at_a_border_as_on_one_device():
    """Beyond the border between two slabs both distances change, by 1 and -0.9 of the way, so that the two face each
    other from the next corner on. At the border the changes on both sides count: of those above it alone it would be
    the border, where the gap is 0.3 m."""
    grid = Grid((8, 6), (0.8, 0.6), 1.0, (False, False))
    along = np.maximum(np.arange(9) * 0.1 - 0.4, 0.0)
    distances = [np.tile(one[:, None], (1, 7)) for one in (along, 0.3 - 0.9 * along)]
    piston, blocks = PistonInFluid(0, 0, (0,), (1.0, 0.0), along=((1, 1),)), Blocks(2, 0, False)
    whole = jax.jit(lambda *given: gaps_of(grid, [piston], given))(*distances)
    assert float(whole[0, 1]) == pytest.approx(0.3 + 0.1 * 0.1 + 0.01 * 0.1)
    own = grid.in_blocks(blocks)
    slabs = [cells_in_slabs(blocks, one, 1) for one in distances]
    found, _ = run_on_slabs(2, lambda *given: gaps_of(own, [piston], given), [SLABS, SLABS], slabs)
    np.testing.assert_allclose(found[0], whole, rtol=1e-14)


@COMBINATION
def test_a_run_beside_warm_walls_goes_on_as_on_one_device(tmp_path):
    """Forces, torque and heat of a warm cylinder in a cold stream: on one device; on two, stopped and resumed on two,
    and on one. The tolerance is that of the pressure."""
    wall = CYLINDER | {"name": "rod", "temperature": 350.0}
    probe = {"name": "rod", "kind": "wall", "wall": "rod", "about": [0.0, 0.0], "interval": 0.02}
    sides = JET | {"left": JET["left"] | {"temperature": 290.0}}
    heat = {"fluid_heat_capacity": 1000.0, "fluid_conductivity": 0.5, "fluid_temperature": 300.0}
    tables = fluid_scene([8, 6], sides) | {"walls": [wall], "probes": [probe], "heat": heat}
    half, whole = (tables | {"time": {"end": end, "output_interval": 0.04}} for end in (0.04, 0.08))
    one = jaxdem.simulate(jaxdem.load_scene(whole), tmp_path / "one")
    jaxdem.simulate(jaxdem.load_scene(half), tmp_path / "two", devices=2)
    shutil.copytree(tmp_path / "two", tmp_path / "back")
    expected, supplied = one.fluid(-1), one.summary["heat"]["from_walls_to_fluid"]["rod"]
    assert abs(supplied) > 0.0 and np.ptp(expected["temperature"]) > 1.0
    for name, number in (("two", 2), ("back", None)):
        found = jaxdem.simulate(jaxdem.load_scene(whole), tmp_path / name, devices=number, resume=True)
        for field in ("velocity", "pressure", "temperature"):
            size = np.abs(expected[field]).max()
            np.testing.assert_allclose(found.fluid(-1)[field], expected[field], rtol=0, atol=1e-10 * size)
        loads, wanted = found.probes["rod"], one.probes["rod"]
        for column in ("fluid_force_x", "fluid_force_z", "fluid_torque"):
            assert np.abs(wanted[column]).min() > 0.0
            np.testing.assert_allclose(loads[column], wanted[column], rtol=0, atol=1e-10 * np.abs(wanted[column]).max())
        assert abs(found.summary["heat"]["from_walls_to_fluid"]["rod"] - supplied) < 1e-10 * abs(supplied)
    # A run that begins from one in slabs: what its solver begins with is that of the whole box.
    further = whole | {"time": {"end": 0.12, "output_interval": 0.04}}
    starts = [further | {"start": {"from": str(tmp_path / name)}} for name in ("one", "two")]
    first, second = (build_case(jaxdem.load_scene(start)).unsettled_state()[0].fluid for start in starts)
    assert np.abs(first.pressure_change).max() > 0.0
    size = np.abs(first.pressure).max()
    np.testing.assert_allclose(second.pressure_change, first.pressure_change, rtol=0, atol=1e-10 * size)


@COMBINATION
def test_a_profiled_run_in_slabs_moves_a_piston_as_on_one_device(tmp_path):
    """What the fluid does to it has a program of its own there."""
    given = before_column(0.01) | {"time": {"end": 3 * STEP, "output_interval": STEP}}
    found = jaxdem.simulate(jaxdem.load_scene(given), tmp_path / "run", devices=2, profile=True)
    ways = march(given, 3)[0][:, 0]
    np.testing.assert_allclose(found.history["wall_0_displacement"][1:], ways, rtol=1e-9)
