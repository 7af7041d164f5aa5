"""A scene that begins from the state of another run: the same bits with unchanged keys, and what may be changed."""

from __future__ import annotations

import copy
import json
import os
import shutil
import signal
from pathlib import Path

import jax
import numpy as np
import pytest
from typer.testing import CliRunner

from jaxdem import InputError, initial_state, load_run, load_scene, simulate
from jaxdem.check.check import check_scene
from jaxdem.cli.main import app
from jaxdem.fluid.grid import divergence, face_average
from jaxdem.io import read_checkpoint
from jaxdem.particles.packing import deepest_overlap
from jaxdem.run.time_loop import Interrupted
from jaxdem.setup.builder import build_case
from jaxdem.setup.start_point import of_deposit
from tests.cases.tiers import COMBINATION, tiered

RADIUS, HALF, END = 0.01, 0.06, 0.12
SCENE = {
    "domain": {"size": [0.2, 0.2], "depth": 0.04},
    "particles": {
        "radius": RADIUS,
        "density": 2650.0,
        "pack": {"kind": "lattice", "start": [0.0, 0.0], "stop": [0.15, 0.075], "spacing": 1.02, "jitter": 0.01},
        "inlet": [{"start": [0.02, 0.17], "stop": [0.18, 0.2], "rate": 90.0, "velocity": [0.0, -0.5]}],
    },
    "contact": {"young_modulus": 5e5, "restitution": 0.6, "friction": 0.4, "skin": 0.06, "speed": 1.0},
    "fluid": {"cells": [4, 4], "time_step": 0.01},
    "boundary": {
        "left": {"kind": "inlet", "velocity": 0.2, "from": 0.0, "to": 0.1, "ramp_time": 0.1},
        "right": {"kind": "outlet", "particles": "remove"},
    },
    "coupling": {"drag": "koch_hill", "virtual_mass": 0.5},
    "time": {"end": END, "output_interval": 0.02},
    "output": {"checkpoint_interval": 0.0},
}
"""With all that a state has: contacts, a list rebuilt, a ramp in time, an inlet whose rows grow with `time.end`."""


@pytest.fixture(scope="module", autouse=True)
def in_single_precision():
    with jax.enable_x64(False):
        yield


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """One run to the end."""
    return simulate(load_scene(SCENE), tmp_path_factory.mktemp("whole") / "run")


@pytest.fixture(scope="module")
def half(tmp_path_factory):
    """The first half of it as a run of its own."""
    return simulate(load_scene(SCENE, {"time.end": HALF}), tmp_path_factory.mktemp("half") / "half")


def later(run, changes=None, without=()):
    """The scene that begins from a run."""
    tables = copy.deepcopy(SCENE) | {"start": {"from": str(run.path)}}
    for name in without:
        del tables[name]
    return load_scene(tables, changes)


@pytest.fixture(scope="module")
def second(half, tmp_path_factory):
    """The second half."""
    return simulate(later(half), tmp_path_factory.mktemp("second") / "run")


def first_state(scene):
    case = build_case(scene)
    return case, case.initial_state()


def assert_same_frame(ours, i, theirs, j, but=()):
    for kind in ("particles", "fluid"):
        one, other = getattr(ours, kind)(i), getattr(theirs, kind)(j)
        assert one.keys() == other.keys()
        for name in one.keys() - set(but):
            assert one[name].tobytes() == other[name].tobytes(), f"{kind} frames {i} and {j}: {name}"


def test_unchanged_keys_give_the_same_bits_as_one_run(whole, half, second):
    """Frames, history and the last checkpoint; the first frame alone has no drag yet, as in every run."""
    assert whole.summary["valid"] and second.summary["valid"]
    assert whole.summary["counts"]["neighbor_builds"] > half.summary["counts"]["neighbor_builds"] > 2
    assert whole.summary["counts"]["inserted"] > half.summary["counts"]["inserted"] > 0
    np.testing.assert_array_equal(second.times, whole.times[3:])
    forces = ("drag_force", "virtual_mass_force")
    for k in range(4):
        assert_same_frame(whole, 3 + k, second, k, but=forces if k == 0 else ())
    ours, theirs = ((run.path / "history.csv").read_text().splitlines()[-3:] for run in (whole, second))
    assert ours == theirs
    ours, theirs = (read_checkpoint(run.path / "checkpoint.h5")[0] for run in (whole, second))
    assert ours.keys() == theirs.keys()
    for name in ours:
        if not name.startswith("extra/"):
            assert ours[name].tobytes() == theirs[name].tobytes(), name


def test_where_it_began_is_told(half, second, tmp_path):
    start = second.summary["start"]
    assert start["from"] == str(half.path) and start["time"] == HALF and len(start["sha256"]) == 64
    assert (start["removed"], start["added"]) == (0, 0)
    assert second.scene["start"]["from"] == str(half.path)
    path = tmp_path / "scene.toml"
    path.write_text(later(half).to_toml())
    checked = CliRunner().invoke(app, ["check", str(path)])
    assert checked.exit_code == 0
    assert "begins from" in checked.output and "0.06 s" in checked.output


def test_a_resumed_run_needs_only_its_own_folder(half, second, tmp_path):
    """The run that it began from has been deleted; the command line finds what it needs beside the checkpoint."""
    moved, out = tmp_path / "half", tmp_path / "run"
    shutil.copytree(half.path, moved)
    path = tmp_path / "scene.toml"
    tables = later(half).tables() | {"start": {"from": str(moved)}}
    scene = load_scene(tables)
    path.write_text(scene.to_toml())

    def stop(time, end):
        if time >= 0.08:
            os.kill(os.getpid(), signal.SIGTERM)

    with pytest.raises(Interrupted):
        simulate(scene, out, progress=stop)
    shutil.rmtree(moved)
    done = CliRunner().invoke(app, ["run", str(path), "--out", str(out), "--resume", "--quiet"])
    assert done.exit_code == 0, done.output
    for k in range(4):
        assert_same_frame(second, k, load_run(out), k)
    with pytest.raises(InputError, match=r"start\.from.*no run directory"):
        load_scene(tables)


def test_dry_after_wet_and_wet_after_dry(half, tmp_path):
    """Without the fluid positions, spins and springs go on; with a fluid on a dry run it starts at rest."""
    scene = load_scene(
        {k: v for k, v in copy.deepcopy(SCENE).items() if k not in ("fluid", "coupling", "boundary")}
        | {"start": {"from": str(half.path)}}
    )
    case, (state, neighbors) = first_state(scene)
    arrays = read_checkpoint(half.path / "checkpoint.h5")[0]
    many = len(arrays["state.particles.position"])
    assert state.fluid is None and state.particles.fluid_force is None and case.simulation.coupling is None
    for name in ("position", "position_low", "velocity", "angular_velocity", "contact_force"):
        ours = np.asarray(getattr(state.particles, name))[:many]
        assert ours.tobytes() == arrays[f"state.particles.{name}"].tobytes(), name
    spring = np.asarray(state.particles.contact_spring[0])
    assert np.abs(spring).max() > 0.0
    np.testing.assert_array_equal(np.sort(spring[spring != 0.0]), _stored_springs(arrays))
    # What a wall remembers goes on at the walls that there were; the right side was none.
    assert np.abs(np.asarray(state.particles.wall_spring[0])).max() > 0.0
    run = simulate(scene.model_copy(update={"time": scene.time.model_copy(update={"end": 0.08})}), tmp_path / "dry")
    case, (state, _) = first_state(load_scene(copy.deepcopy(SCENE) | {"start": {"from": str(run.path)}}))
    assert float(state.fluid.face_velocity[0].max()) == 0.0 and int(state.step) > 0
    solids = (1.0 - np.asarray(state.fluid.void_fraction, float)).sum() * 0.05**2 * 0.04
    present = np.count_nonzero(np.asarray(state.particles.active))
    assert solids == pytest.approx(present * 4.0 / 3.0 * np.pi * RADIUS**3, rel=1e-5)


def _stored_springs(arrays):
    spring = arrays["state.particles.contact_spring[0]"]
    return np.sort(spring[spring != 0.0])


def test_time_goes_on_where_the_interval_changes(half):
    """t = t0 + (steps since then) times the new interval; with the old one it is the plain product."""
    same, (state, _) = first_state(later(half))
    assert same.simulation.clock is None
    for interval in (0.005, 0.02):
        case, (state, _) = first_state(later(half, {"coupling.interval": interval, "fluid.time_step": interval}))
        assert case.simulation.clock is not None
        later_state = state._replace(step=state.step + 2)
        assert float(case.simulation.time(case.parameters, later_state)) == pytest.approx(HALF + 2 * interval, rel=1e-6)
        due = np.asarray(case.simulation.population.inlets[0].due)
        # Those due while it runs are as many as before, each in the first interval that ends after its time.
        times = HALF + (due - int(state.step)) * interval
        whole = 0.01 * np.asarray(same.simulation.population.inlets[0].due)
        coming = whole > HALF + 1e-9
        np.testing.assert_allclose(times[coming], np.ceil(whole[coming] / interval - 1e-6) * interval, atol=0.0101)


def test_particles_are_removed_added_and_moved_apart(half):
    box = {"shape": "box", "start": [0.0, 0.0], "stop": [0.2, 0.03]}
    before = read_checkpoint(half.path / "checkpoint.h5")[0]
    position, active = before["state.particles.position"], before["state.particles.active"]
    low = active & (position[:, 1] <= 0.03)
    case, (state, _) = first_state(later(half, {"start.remove": [box]}))
    many = len(active)
    assert 0 < low.sum() < active.sum()
    np.testing.assert_array_equal(np.asarray(state.particles.active)[:many], active & ~low)
    assert case.start_figures["removed"] == low.sum()
    # The void fraction knows of it.
    there = first_state(later(half))[1][0]
    assert float(state.fluid.void_fraction.mean()) > float(there.fluid.void_fraction.mean())

    place = [[0.19, 0.15], [0.16, 0.15]]
    add = {"radius": 0.008, "density": 1000.0, "position": place, "velocity": [[0.1, 0.0], [0.0, 0.0]]}
    case, (state, _) = first_state(later(half, {"start.add": add}))
    np.testing.assert_allclose(np.asarray(state.particles.position)[many : many + 2], place, rtol=1e-6)
    np.testing.assert_allclose(np.asarray(state.particles.velocity)[many], [0.1, 0.0], rtol=1e-6)
    np.testing.assert_allclose(case.bodies.radius[[0, many, -1]], [RADIUS, 0.008, RADIUS])
    assert np.asarray(state.particles.active)[many : many + 2].all()
    assert case.simulation.population.inlets[0].rows is not None, "its rows stand before and after those added"
    there = position[np.flatnonzero(active)[0]].tolist()
    with pytest.raises(InputError, match=r"start\.add = .*overlap by"):
        first_state(later(half, {"start.add": add | {"position": [there, place[1]]}}))

    case, (state, _) = first_state(later(half, {"start.relax": True}))
    there = np.asarray(state.particles.active)
    moved = np.asarray(state.particles.position, float)[there]
    assert deepest_overlap(moved, np.full(len(moved), RADIUS), (0.2, 0.2), (False, False))[0] < 1e-6
    assert 0.0 < case.start_figures["largest_move"] < 0.1 * RADIUS
    assert float(np.abs(state.particles.contact_spring[0]).max()) == 0.0

    # A wall that stands now, through the middle of the lowest grains; one that has vanished moves nothing.
    height = float(np.sort(moved[:, 1])[2])
    wall = {"kind": "plane", "point": [0.0, height], "normal": [0.0, 1.0]}
    case, (state, _) = first_state(later(half, {"start.relax": True, "walls": [wall]}))
    above = np.asarray(state.particles.position, float)[there]
    assert above[:, 1].min() >= height + RADIUS * (1.0 - 1e-5)
    assert deepest_overlap(above, np.full(len(above), RADIUS), (0.2, 0.2), (False, False))[0] < 1e-6
    assert case.start_figures["largest_move"] >= 0.9 * RADIUS
    gone, (state, _) = first_state(later(half, {"start.relax": True, "walls": [wall | {"end": 0.5 * HALF}]}))
    np.testing.assert_array_equal(np.asarray(state.particles.position, float)[there], moved)


def test_a_frame_in_place_of_the_checkpoint(half):
    """Positions and velocities are the frame's; faces are means of cells, made to satisfy the sides and continuity."""
    case, (state, _) = first_state(later(half, {"start.time": 0.04}))
    frame = half.particles(2)
    many = len(frame["position"])
    np.testing.assert_array_equal(np.asarray(state.particles.velocity)[:many], frame["velocity"][:, :2])
    assert int(state.step) == 4 and case.begin == case.start.time and float(case.begin) == 0.04
    rows = read_checkpoint(half.path / "checkpoint.h5")[0]["inlet/0/rows"]
    assert int(state.particles.inserted[0]) == np.count_nonzero(frame["active"][rows]) > 0
    grid, fluid = case.simulation.fluid.solver.grid, state.fluid
    gaps = face_average(grid, fluid.void_fraction)
    flux = tuple(g * u for g, u in zip(gaps, fluid.face_velocity, strict=True))
    rate = np.abs(np.asarray(divergence(grid, flux))).max()
    assert rate < 1e-4 * float(np.abs(flux[0]).max()) / grid.spacing[0]
    inflow = 0.2 * 0.04 / 0.1 * 0.1  # ramped, over half of the side
    assert float(np.asarray(flux[0])[0].sum()) * grid.spacing[1] == pytest.approx(inflow, rel=1e-5)
    with pytest.raises(InputError, match=r"no frame at this time.*nearest is at 0\.04 s"):
        first_state(later(half, {"start.time": 0.035}))


def test_cells_are_filled_anew_where_kernels_differ():
    """Of several sizes kernels of the largest grain and of each one's own fill the cells differently."""
    tables = [load_scene(SCENE, {"coupling.kernel_diameter": kind}).tables() for kind in ("largest", "own")]
    of_largest, of_own = map(of_deposit, tables)
    assert of_largest != of_own
    del tables[0]["coupling"]["kernel_diameter"]  # as versions before this key wrote it
    assert of_deposit(tables[0]) == of_largest


@pytest.mark.parametrize("cells", tiered([[2, 2], [8, 8]], first=[[2, 2]]))
def test_another_mesh_keeps_the_flux(half, cells):
    """The flux through every line across the box is kept, on a coarser mesh and on a finer one."""
    case, (state, _) = first_state(later(half, {"fluid.cells": cells, "coupling.kernel_width": 2.0}))
    grid, fluid = case.simulation.fluid.solver.grid, state.fluid
    gaps = face_average(grid, fluid.void_fraction)
    flux = np.asarray(gaps[0] * fluid.face_velocity[0]).sum(axis=1) * grid.spacing[1]
    inflow = 0.2 * 0.06 / 0.1 * 0.1
    np.testing.assert_allclose(flux, inflow, rtol=2e-5)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"domain.size": [0.2, 0.2, 0.2]}, r"domain\.size.*number of axes"),
        ({"domain.size": [0.3, 0.2]}, r"domain\.size.*start\.fluid"),
        ({"time.end": 0.06}, r"time\.end.*time goes on from there"),
        ({"time.end": 0.13}, r"time\.output_interval.*start at 0\.06 s"),
        ({"particles.radius": 0.011}, r"particles\.radius.*start\.add"),
        ({"start.from": "/nowhere"}, r"start\.from.*no run directory"),
        ({"materials": [{"name": "glass"}]}, r"materials = '1 table': the particles of the run .* have no material"),
        ({"start.remov": []}, r"start\.remov.*Did you mean 'remove'"),
        ({"contact.maximum_overlap": 1e-3, "contact.speed": 0.001}, r"start\.from.*overlap.*start\.relax"),
    ],
)
def test_what_cannot_be_is_named(half, changes, message):
    with pytest.raises(InputError, match=message):
        first_state(later(half, changes))


ADDED = {"radius": 0.008, "density": 1000.0}
HIGH = ADDED | {"position": [[0.19, 0.15]]}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"start.add": ADDED | {"position": [[0.1, 0.198]]}}, r"start\.add = 'particle .*the bottom or top wall"),
        (
            {"start.add": HIGH, "walls": [{"kind": "plane", "point": [0.19, 0.0], "normal": [-1.0, 0.0]}]},
            r"start\.add = 'particle .* at \(0\.19, 0\.15\) m': it reaches 50 % .*walls\.0 \(plane\)",
        ),
        (
            {"start.add": HIGH, "walls": [{"kind": "mesh", "points": [[0.18, 0.15], [0.2, 0.15]]}]},
            r"start\.add = 'particle .*walls\.0 \(mesh\).*add the particles elsewhere",
        ),
        (
            {"walls": [{"kind": "plane", "point": [0.0, 0.04], "normal": [0.0, 1.0]}]},
            r"start\.from = 'particle .*walls\.0 \(plane\).*start\.remove",
        ),
        (
            {"start.add": ADDED | {"pack": {"kind": "lattice", "start": [0.1, 0.1], "stop": [0.13, 0.13]}, "count": 9}},
            r"start\.add\.count = 9.*lower start\.add\.pack\.spacing",
        ),
        ({"start.add": ADDED | {"file": "nothing.csv"}}, r"start\.add\.file = .*no such file"),
    ],
)
def test_added_particles_are_named_as_such(half, changes, message):
    with pytest.raises(InputError, match=f"(?i){message}"):
        first_state(later(half, changes))


@COMBINATION
def test_a_larger_box_with_a_new_fluid_and_another_law(half):
    """All of it changes at once: box, mesh, contact law, rolling springs, sides, no inlet."""
    changes = {
        "domain.size": [0.3, 0.3],
        "fluid.cells": [6, 5],
        "start.fluid": "new",
        "contact.law": "linear_spring_dashpot",
        "contact.normal_stiffness": 2e3,
        "contact.rolling_friction": 0.1,
        "contact.rolling_model": "epsd",
        "particles.inlet": [],
        "boundary.right": {"kind": "outlet"},
    }
    case, (state, neighbors) = first_state(later(half, changes))
    arrays = read_checkpoint(half.path / "checkpoint.h5")[0]
    assert len(state.particles.contact_spring) == 2
    spring = np.asarray(state.particles.contact_spring[0])
    np.testing.assert_array_equal(np.sort(spring[spring != 0.0]), _stored_springs(arrays))
    assert float(np.abs(state.particles.contact_spring[1]).max()) == 0.0
    assert case.simulation.population is not None, "rows of particles that are still to come stay empty"
    assert case.simulation.population.never == len(arrays["inlet/0/rows"]) - int(arrays["state.particles.inserted"][0])


def test_initial_state_of_python_and_a_scene_without_particles_written(half):
    """`[particles]` need not be repeated."""
    scene = later(half, without=("particles",))
    assert scene.particles.radius == RADIUS and scene.particles.inlet == ()
    case = build_case(scene)
    state, neighbors = initial_state(scene, case.simulation, case.parameters)
    assert state.particles.position.shape == half.particles(-1)["position"][:, :2].shape
    assert check_scene(scene).start["from"] == str(half.path)
    json.dumps(case.start_figures)
    assert Path(scene.start.from_).is_absolute()


@COMBINATION
def test_a_merge_with_an_inlet(half):
    """Those that have come in are merged; the inlet goes on with parcels, and those that wait never come."""
    before = read_checkpoint(half.path / "checkpoint.h5")[0]
    there = np.count_nonzero(before["state.particles.active"])
    with pytest.raises(InputError, match=r"particles\.inlet\.0\.stop.*no particle of radius 0\.02"):
        later(half, {"particles.coarse_grain": 2.0})
    inlet = [SCENE["particles"]["inlet"][0] | {"start": [0.02, 0.15]}]
    scene = later(half, {"particles.coarse_grain": 2.0, "particles.inlet": inlet, "coupling.virtual_mass": 0.0})
    case, (state, _) = first_state(scene)
    told, active = case.start_figures["merged"], np.asarray(state.particles.active)
    assert told["particles"] == there and told["parcels"] == there // 4 == np.count_nonzero(active)
    waiting = len(before["inlet/0/rows"]) - int(before["state.particles.inserted"][0])
    assert told.get("never_inserted", 0) == waiting
    # As many parcels as grains come in a time; each is due after the start.
    assert len(active) - there // 4 == pytest.approx(90.0 * (END - HALF), abs=1.0)
    assert (np.asarray(case.simulation.population.inlets[0].due) > int(state.step)).all()
    solids = (1.0 - np.asarray(state.fluid.void_fraction, float)).sum() * 0.05**2 * 0.04
    assert solids == pytest.approx(there // 4 * 4 * 4.0 / 3.0 * np.pi * RADIUS**3, rel=1e-5)
