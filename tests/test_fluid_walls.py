"""Walls that the fluid sees, from scenes: what is refused, rest, momentum with grains, probes and summary."""

import copy

import h5py
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from rich.console import Console

from jaxdem import InputError, build, initial_state, load_scene, simulate
from jaxdem.check.check import check_scene
from jaxdem.cli.check_table import render
from jaxdem.coupling.deposition import Kernel
from jaxdem.coupling.open_cells import open_weights
from jaxdem.coupling.void_fraction import solid_fraction
from jaxdem.fluid.grid import Grid, face_average, face_control_volume, face_total
from jaxdem.setup.builder import build_case
from jaxdem.setup.cut_cells import FluidSurface, cut_cells_of
from jaxdem.setup.even_deposition import even_factors
from jaxdem.setup.fluid_surfaces import wall_speed_in_fluid
from tests.cases.tiers import COMBINATION, tiered

TILTED = (
    {"kind": "plane", "point": [0.05, 0.03], "normal": [-0.2, 1.0], "fluid": "no_slip"},
    {"kind": "plane", "point": [0.35, 0.1], "normal": [-1.0, -0.3], "fluid": "free_slip"},
    {"kind": "cylinder", "center": [0.2, 0.2], "radius": 0.19, "fluid": "no_slip"},
)


def tables(*walls, grains=True, **changes):
    found = {
        "precision": "float64",
        "domain": {"size": [0.4, 0.4], "depth": 0.02, "gravity": [3.0, -9.0]},
        "fluid": {"cells": [12, 12], "density": 1000.0, "viscosity": 1e-4},
        "walls": [copy.deepcopy(wall) for wall in walls],
        "time": {"end": 0.04, "output_interval": 0.02},
    }
    if grains:
        found["particles"] = {
            "radius": 0.008, "density": 1000.0, "position": [[0.15, 0.2], [0.25, 0.22], [0.2, 0.12], [0.2, 0.3]],
        }  # fmt: skip
        found["contact"] = {"young_modulus": 1e7}
    for key, value in changes.items():
        found[key] = found.get(key, {}) | value if isinstance(value, dict) else value
    return found


def refusal(given, act=lambda given: build(load_scene(given))):
    with pytest.raises(InputError) as caught:
        act(given)
    assert caught.value.remedy
    return str(caught.value)


CYLINDER = {"kind": "cylinder", "center": [0.2, 0.2], "radius": 0.06, "inside": False, "fluid": "no_slip"}
STREAM = {"boundary": {"left": {"kind": "inlet", "velocity": [0.1, 0.0]}, "right": {"kind": "outlet"}}}


def test_what_does_not_work_is_refused_by_name():
    wall = TILTED[2]
    assert "walls.0.begin" in refusal(tables(wall | {"begin": 0.1}))
    moving = {"motion": [{"kind": "translation", "velocity": [0.0, 0.1]}]}
    assert "no way out" in refusal(tables(TILTED[0] | moving, grains=False))
    assert "fluid.bed_mixing" in refusal(tables(wall, fluid={"bed_mixing": {"von_karman": 0.4}}))
    assert "coupling.deconvolution" in refusal(tables(wall, coupling={"deconvolution": 0.1}))
    assert "coupling.drag_inputs_coarsened" in refusal(tables(wall, coupling={"drag_inputs_coarsened": 2}))
    no_fluid = tables(wall)
    del no_fluid["fluid"]
    assert "walls.0.fluid" in refusal(no_fluid)
    nothing_left = {"kind": "plane", "point": [0.0, 1.0], "normal": [0.0, 1.0], "fluid": "no_slip"}
    assert "no cell" in refusal(tables(nothing_left, grains=False))
    before_the_inlet = {"kind": "plane", "point": [0.1, 0.0], "normal": [1.0, 0.0], "fluid": "no_slip"}
    assert "boundary.left.kind" in refusal(tables(before_the_inlet, grains=False, **STREAM))
    sides = {"probes": [{"name": "floor", "kind": "wall", "side": "bottom", "interval": 0.02}]}
    assert "probes" in refusal(tables(wall, **sides))
    assert "need [particles]" in refusal(tables({k: v for k, v in CYLINDER.items() if k != "fluid"}, grains=False))


def test_turning_cylinders_and_sliding_planes_are_allowed():
    turning = CYLINDER | {"motion": [{"kind": "rotation", "rate": 2.0}]}
    sliding = {"kind": "plane", "point": [0.0, 0.03], "normal": [0.0, 1.0], "fluid": "no_slip"}
    sliding["motion"] = [{"kind": "translation", "velocity": [0.3, 0.0]}]
    _, parameters = build(load_scene(tables(turning, sliding, grains=False)))
    cut = parameters.fluid.cut
    assert float(cut.spin[0, 0]) == 2.0
    assert float(jnp.abs(cut.velocity[0]).max()) == pytest.approx(0.3)
    near = np.asarray(cut.nearest_to_faces[1]) == 0
    assert float(np.abs(np.asarray(cut.velocity[1]))[near].max()) == pytest.approx(2.0 * 0.06, rel=0.02)


def test_the_speed_of_a_wall_is_that_of_its_own_points():
    """A tube about its axis that turns and slides: sqrt(0.3^2 + 0.4^2) m/s. A body of lines that turns: its rate times
    its largest distance from the centre, not the 0.8 m/s of the farthest corner of the box."""
    tube = {"kind": "cylinder", "center": [0.2, 0.2, 0.2], "axis": [1.0, 0.0, 0.0], "radius": 0.2, "fluid": "no_slip"}
    tube["motion"] = [{"kind": "rotation", "rate": 2.0}, {"kind": "translation", "velocity": [0.3, 0.0, 0.0]}]
    given = tables(tube, grains=False) | {"domain": {"size": [0.4, 0.4, 0.4]}}
    given["fluid"]["cells"] = [8, 8, 8]
    assert wall_speed_in_fluid(load_scene(given)) == pytest.approx(0.5)
    corners, middle = [[0.15, 0.2], [0.2, 0.15], [0.25, 0.2], [0.2, 0.25]], [0.2, 0.17]
    body = {"kind": "mesh", "points": corners, "closed": True, "fluid": "no_slip"}
    body["motion"] = [{"kind": "rotation", "rate": 2.5, "center": middle}]
    assert wall_speed_in_fluid(load_scene(tables(body, grains=False))) == pytest.approx(2.5 * 0.08)
    body["motion"] += [{"kind": "translation", "velocity": [-0.1, 0.0]}]  # the way of its top as it begins to turn
    assert wall_speed_in_fluid(load_scene(tables(body, grains=False))) == pytest.approx(2.5 * 0.08 + 0.1)


def momentum(simulation, parameters, fluid):
    grid, cut = simulation.fluid.solver.grid, parameters.fluid.cut
    g = face_average(grid, fluid.void_fraction)
    volumes = (1000.0 * face_control_volume(grid, axis) for axis in range(2))
    parts = zip(cut.inertia, volumes, g, fluid.face_velocity, cut.open_faces, strict=True)
    return np.asarray(face_total(grid, tuple(m * v * h * u * (a > 0.0) for m, v, h, u, a in parts)))


OTHERS = {"fluid": {"smagorinsky": 0.3}, "coupling": {"void_fraction": "diffusion", "kernel_width": {"cells": 2.0}}}


@pytest.mark.parametrize("models", tiered([{}, OTHERS], first=[{}]), ids=["plain", "eddies and diffusion"])
def test_water_and_grains_in_a_tilted_box_rest_and_the_third_law_holds(models):
    """Between planes and a cylinder, round a body of lines."""
    corners = [[0.24, 0.29], [0.3, 0.29], [0.27, 0.34]]
    body = {"kind": "mesh", "points": corners, "closed": True, "fluid": "no_slip"}
    scene = load_scene(tables(*TILTED, body, **models))
    simulation, parameters = build(scene)
    state, neighbors = initial_state(scene, simulation, parameters)
    step = jax.jit(simulation.step)
    for _ in range(3):
        state, neighbors, told = step(parameters, state, neighbors)
    assert max(float(jnp.abs(u).max()) for u in state.fluid.face_velocity) < 1e-15
    assert float(jnp.abs(state.particles.velocity).max()) < 1e-14
    assert float(told.exchange.volume) < 1e-13
    # Heavier grains sink: what the fluid gains is what grains and walls do not get.
    heavy = parameters._replace(bodies=parameters.bodies._replace(density=jnp.asarray(2500.0)))
    for _ in range(4):
        before = momentum(simulation, heavy, state.fluid)
        state, neighbors, told = step(heavy, state, neighbors)
        gained = (momentum(simulation, heavy, state.fluid) - before) / simulation.interval
        on_walls = np.asarray(told.fluid.surface_load)[:, :, 0]
        given = np.asarray(told.forces.total).sum(axis=0)
        assert np.abs(gained + on_walls.sum(axis=0) + given).max() < 1e-10 * np.abs(on_walls).sum()
        assert float(told.fluid.divergence) < 1e-11
    assert np.abs(gained).max() > 1e-6 * np.abs(on_walls).sum()


def settled(lifted, corrected=True):
    """Velocity of a grain after some intervals, over the floor of a box or over a plane on a grid line."""
    floor = 0.008 if lifted else 0.0
    plane = {"kind": "plane", "point": [0.0, 0.0, floor], "normal": [0.0, 0.0, 1.0], "fluid": "no_slip"}
    scene = load_scene(
        {
            "precision": "float64",
            "domain": {"size": [0.032, 0.032, 0.032 + floor], "gravity": [0.0, 0.0, -9.81]},
            "fluid": {"cells": [8, 8, 10 if lifted else 8], "density": 1000.0, "viscosity": 1e-4, "time_step": 1e-3},
            "walls": [plane] if lifted else [],
            "particles": {"radius": 1e-3, "density": 2000.0, "position": [[0.0171, 0.0153, 0.0163 + floor]]},
            "contact": {"young_modulus": 1e7},
            "coupling": {"kernel_width": {"diameters": 3.0, "cells": 1.0}, "self_disturbance": corrected},
            "time": {"end": 0.1, "output_interval": 0.1},
        }
    )
    simulation, parameters = build(scene)
    state, neighbors = initial_state(scene, simulation, parameters)
    step = jax.jit(simulation.step)
    for _ in range(8):
        state, neighbors, _ = step(parameters, state, neighbors)
    return np.asarray(state.particles.velocity)[0]


@COMBINATION
def test_the_wake_of_a_grain_is_corrected_over_a_plane_as_over_the_floor():
    """A plane on a grid line is a no-slip side: out of reach of the wall the corrected grain falls as fast.

    The friction on a plane is implicit in time and that on a side is not.
    """
    over_plane, over_floor = settled(True), settled(False)
    assert over_plane == pytest.approx(over_floor, rel=1e-5, abs=1e-7)
    plain = settled(True, corrected=False)  # negative control: without the correction it falls faster
    assert plain[2] / over_plane[2] > 1.01


def test_forces_in_probes_and_summary(tmp_path):
    probes = [{"name": "drag", "kind": "wall", "wall": 0, "interval": 0.01, "average": True}]
    given = tables(CYLINDER, grains=False, probes=probes, domain={"gravity": [0.0, 0.0]}, **STREAM)
    whole = simulate(load_scene(given), out=tmp_path / "whole")
    rows = h5py.File(whole.path / "probes.h5")["drag"][:]
    assert rows["fluid_force_x"][-1] > 0.0
    mean = whole.summary["walls_in_fluid"][0]["fluid_force_mean"]
    assert mean[0] == pytest.approx(rows["fluid_force_x"].mean(), rel=1e-12)
    case = build_case(load_scene(given))
    solid = np.asarray(case.fluid_walls.cut.open_cells) == 0.0
    assert solid.any()
    frame = whole.fluid(-1)
    assert not np.asarray(frame["pressure"])[solid].any()


def text_of_check(given):
    report, console = check_scene(load_scene(given)), Console(width=200)
    with console.capture() as captured:
        console.print(render(report))
    return report, captured.get()


def test_check_tells_the_cells_that_walls_cut_off():
    """A cylinder wider than the box leaves its four corners; the grain's box keeps the largest one alone."""
    wide = CYLINDER | {"center": [0.195, 0.198], "radius": 0.22}
    corners = np.asarray(build_case(load_scene(tables(wide, grains=False))).fluid_walls.cut.open_cells) > 0.0
    sizes = [part.sum() for half in np.split(corners, 2) for part in np.split(half, 2, axis=1)]
    assert min(sizes) > 0 and corners[:, 5:7].sum() == corners[5:7].sum() == 0  # nothing joins them
    grain = {"particles": {"position": [[0.38, 0.38]]}}
    report, text = text_of_check(tables(wide, **grain))
    assert report.closed_pockets == sum(sizes) - max(sizes)
    assert f"{report.closed_pockets} cells that walls cut off" in text
    # Negative control: inside of a cylinder there is no fluid, and so no pocket.
    report, text = text_of_check(tables(CYLINDER, **grain))
    assert report.closed_pockets == 0 and "cut off" not in text


@COMBINATION
def test_a_resumed_run_is_the_whole_run_bit_for_bit(tmp_path):
    """Grains and the force on a cylinder that swings in a stream, in single precision, stopped at half time."""
    probes = [{"name": "drag", "kind": "wall", "wall": 0, "interval": 0.01}]
    swings = {"motion": [{"kind": "oscillation", "direction": [0.0, 1.0], "amplitude": 0.01, "frequency": 5.0}]}
    given = tables(CYLINDER | swings, precision="float32", probes=probes, output={"checkpoint_interval": 0.0}, **STREAM)
    given["particles"]["position"] = [[0.1, 0.2], [0.12, 0.26], [0.3, 0.22], [0.2, 0.1]]
    whole = simulate(load_scene(given), tmp_path / "whole")
    simulate(load_scene(given, {"time.end": 0.02}), tmp_path / "half")
    resumed = simulate(load_scene(given), tmp_path / "half", resume=True)
    assert np.abs(whole.fluid(-1)["velocity"]).max() > 0.01
    for kind in ("particles", "fluid"):
        ours, theirs = (getattr(run, kind)(-1) for run in (whole, resumed))
        assert ours.keys() == theirs.keys()
        assert all(np.asarray(ours[name]).tobytes() == np.asarray(theirs[name]).tobytes() for name in ours)
    assert (whole.path / "history.csv").read_bytes() == (resumed.path / "history.csv").read_bytes()
    rows = [h5py.File(run.path / "probes.h5")["drag"][:] for run in (whole, resumed)]
    assert len(rows[0]) == 4 and rows[0].tobytes() == rows[1].tobytes()


@COMBINATION
def test_float32_and_three_dimensions():
    tube = {
        "kind": "cylinder",
        "center": [0.2, 0.2, 0.2],
        "radius": 0.15,
        "axis": [0.0, 0.3, 1.0],
        "fluid": "no_slip",
    }
    given = {
        "domain": {"size": [0.4, 0.4, 0.4], "gravity": [0.0, 0.0, 0.0]},
        "fluid": {"cells": [8, 8, 8], "density": 1000.0, "viscosity": 1e-3, "time_step": 0.01},
        "walls": [tube],
        "boundary": {"bottom": {"kind": "inlet", "velocity": [0.0, 0.0, 0.05]}, "top": {"kind": "outlet"}},
        "time": {"end": 0.02, "output_interval": 0.02},
    }
    scene = load_scene(given)
    simulation, parameters = build(scene)
    state, _ = initial_state(scene, simulation, parameters)
    state, _, told = jax.jit(simulation.step)(parameters, state, None)
    assert bool(told.fluid.converged) and bool(told.fluid.finite)
    assert float(told.fluid.divergence) < 1e-5
    assert state.fluid.pressure.dtype == jnp.float32


def test_an_even_cloud_beside_a_wall_gives_an_even_solid_fraction():
    grid = Grid((10, 10), (1.0, 1.0), 1.0, (False, False))
    normal = np.array([-0.6, 0.8])
    wall = FluidSurface(lambda x: (x - 0.4) @ normal)
    cut, _ = cut_cells_of(grid, [wall])
    kernel, radius = Kernel((0.15, 0.15)), 0.05
    even = even_factors(grid, kernel, cut.open_cells, wall.distance, radius)
    k = (np.arange(400) + 0.5) / 400
    points = np.stack(np.meshgrid(k, k, indexing="ij"), axis=-1).reshape(-1, 2)
    points = points[wall.distance(points) > 0.0]
    spread = {}
    for name, factors in (("even", cut.open_cells * even), ("open parts alone", cut.open_cells)):
        weights = open_weights(kernel.weights(grid, points, radius), cut._replace(deposit_weights=factors))
        solids = solid_fraction(grid, weights, np.asarray(0.3 / 400**2), cut)
        assert np.sum(solids * cut.open_cells) / 100 == pytest.approx(0.3 * len(points) / 400**2, rel=1e-12)
        # The factors are found with 16 points a cell: in a cell that a wall cuts one more or less may count as open.
        spread[name] = np.abs(solids[cut.open_cells > 0.5] / 0.3 - 1.0).max()
    assert spread["even"] < 1.0 / 16.0
    assert spread["open parts alone"] > 0.1  # negative control
