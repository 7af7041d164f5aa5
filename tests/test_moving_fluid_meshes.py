"""Meshes that move in the fluid: against the walls with a formula that they stand for, and what they sweep."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

from jaxdem import load_scene
from jaxdem.coupling.body_grid import BodyGrid
from jaxdem.setup import fluid_meshes
from jaxdem.setup.builder import build_case
from jaxdem.setup.cut_cells import FluidSurface, cut_cells_of
from jaxdem.setup.fluid import fluid_setup
from jaxdem.setup.fluid_surfaces import surfaces_in_fluid
from jaxdem.solids.grid_distance import grid_distance
from tests.cases.tiers import COMBINATION
from tests.test_fluid_meshes import circle
from tests.test_fluid_walls import CYLINDER, refusal, tables
from tests.test_moving_fluid_walls import BOX, STREAM, march

ANGLE = [[0.05, 0.04], [0.15, 0.04], [0.15, 0.09], [0.1, 0.09], [0.1, 0.15], [0.05, 0.15]]
"""A body with a corner that looks inwards, two cells and more thick."""


def body(points, **motion):
    return {"kind": "mesh", "points": points, "closed": True, "fluid": "no_slip", "motion": [motion]}


def test_a_mesh_that_moves_with_a_stream_leaves_it_as_it_is():
    box = BOX | {"fluid": BOX["fluid"] | {"velocity": [0.3, 0.0]}}
    wall = body(ANGLE, kind="translation", velocity=[0.3, 0.0])
    simulation, parameters, found = march(tables(wall, grains=False, boundary=STREAM, **box), 25)
    for state, told in found:
        along, across = (np.asarray(u) for u in state.fluid.face_velocity)
        assert np.abs(along - 0.3).max() < 1e-14 and np.abs(across).max() < 1e-14
        assert np.abs(np.asarray(told.fluid.surface_load)).max() < 1e-12
    moved, fluid = jax.jit(simulation.with_moved_walls)(parameters, found[9][0].fluid, found[9][0].step)
    cut = jax.tree.map(np.asarray, moved.fluid.cut)
    solid = float(np.sum(1.0 - np.asarray(cut.open_cells))) * 0.02**2
    # 0.1 x 0.05 and 0.05 x 0.06; each of five edges is rounded within a cell, by less than a quarter of its area.
    assert 0.008 - 5 * 0.25 * 0.02**2 < solid < 0.008
    along, across = (a * np.asarray(u) for a, u in zip(cut.open_faces, fluid.face_velocity, strict=True))
    flux = (np.diff(along, axis=0) + np.diff(across, axis=1)) / 0.02
    assert np.abs(flux + cut.swept).max() < 1e-12
    # Negative control: without what it sweeps the stream would not obey continuity.
    assert np.abs(flux).max() > 1.0


@COMBINATION
def test_a_round_mesh_that_goes_round_is_the_cylinder():
    turning = {"kind": "rotation", "rate": 4.0, "center": [0.22, 0.19]}
    scenes = [
        tables(CYLINDER | {"motion": [turning]}, grains=False),
        tables(body(circle(64, radius=0.06).tolist(), **turning), grains=False),
    ]
    found = []
    for given in scenes:
        given["fluid"]["cells"] = [16, 16]
        case = build_case(load_scene(given))
        moving = case.simulation.walls_in_fluid

        @jax.jit
        def cut_at(parameters, start, moving=moving):
            cut, swept = moving.cut_and_swept(
                parameters.fluid.still, parameters.wall_motion, ((start, None), jnp.asarray(0.01)), start + 0.005
            )
            return cut.open_cells, swept, cut.spin

        found.append([cut_at(case.parameters, jnp.asarray(time)) for time in (0.0, 0.3, 1.1)])
    # The polygon is off the circle by R/12 (2 pi/n)^2, and what is linear between corners half a cell apart by
    # h^2/(32 R): over a cell 0.4 % and 1.3 %.
    found = jax.tree.map(np.asarray, found)
    for (open_cells, swept, spin), (of_mesh, swept_by_mesh, spin_of_mesh) in zip(*found, strict=True):
        assert np.abs(of_mesh - open_cells).max() < 0.03
        assert np.abs(swept_by_mesh - swept).max() < 0.05 * np.abs(swept).max()
        # Where faces that are open by less than a hundredth are closed, something is left of a body that turns.
        assert max(abs(swept.sum()), abs(swept_by_mesh.sum())) < 0.01 * np.abs(swept).sum()
        assert float(spin[0, 0]) == float(spin_of_mesh[0, 0]) == 4.0
    first, last = (np.asarray(found[1][k][0]) for k in (0, 2))
    assert np.abs(last - first).max() > 0.9  # it has moved


@COMBINATION
def test_a_ball_of_triangles_is_a_sphere_on_its_way(tmp_path):
    ball = trimesh.creation.icosphere(3, 0.09)
    ball.apply_translation([0.2, 0.15, 0.2])
    ball.export(tmp_path / "ball.stl")
    wall = {"kind": "mesh", "file": str(tmp_path / "ball.stl"), "fluid": "no_slip"}
    wall["motion"] = [
        {"kind": "rotation", "rate": 3.0, "axis": [1.0, 1.0, 0.0], "center": [0.2, 0.15, 0.2]},
        {"kind": "translation", "velocity": [0.0, 0.5, 0.1]},
    ]
    given = tables(wall, grains=False) | {"domain": {"size": [0.4, 0.4, 0.4], "gravity": [0.0, 0.0, 0.0]}}
    given["fluid"]["cells"] = [12, 12, 12]
    scene = load_scene(given)
    case, radius = build_case(scene), (3.0 * ball.volume / (4.0 * np.pi)) ** (1.0 / 3.0)
    for time in (0.0, 0.11, 0.2):
        middle = np.array([0.2, 0.15 + 0.5 * time, 0.2 + 0.1 * time])
        exact, _ = cut_cells_of(case.simulation.fluid.solver.grid, [sphere(middle, radius)])
        found = case.fluid_walls.open_cells(scene, time)
        # The triangles are within 0.6 % of the radius of the sphere, 1.6 % of a cell.
        assert np.abs(found - exact.open_cells).max() < 0.05
        # Linear between corners h/2 apart the distance is too large by up to 2/R (h/2)^2/8, 0.9 % of R.
        assert 0.0 < 1.0 - np.sum(1.0 - found) / np.sum(1.0 - exact.open_cells) < 3 * 0.009


def sphere(middle, radius):
    return FluidSurface(lambda x: np.linalg.norm(x - middle, axis=-1) - radius)


def test_a_distance_that_is_linear_is_exact_and_beyond_the_mesh_it_is_continued():
    grid = BodyGrid((-0.1, 0.2), (0.05, 0.1))
    corners = np.meshgrid(-0.1 + 0.05 * np.arange(5), 0.2 + 0.1 * np.arange(4), indexing="ij")
    values = 0.3 + 2.0 * corners[0] - corners[1]
    x, y = np.random.default_rng(0).uniform([-0.1, 0.2], [0.1, 0.5], (50, 2)).T
    assert grid.distance(values, (x, y)) == pytest.approx(0.3 + 2.0 * x - y, abs=1e-14)
    assert grid.distance(values, (np.array([5.0]), np.array([0.25])))[0] == pytest.approx(0.3 + 0.2 - 0.25)


def test_a_map_of_heights_does_not_move(tmp_path):
    np.save(tmp_path / "bed.npy", 0.1 + 0.05 * np.sin(np.arange(21)))
    wall = {"kind": "mesh", "file": str(tmp_path / "bed.npy"), "spacing": 0.02, "fluid": "no_slip"}
    wall["motion"] = [{"kind": "translation", "velocity": [0.0, 0.1]}]
    assert "walls.0.motion" in refusal(tables(wall, grains=False))


def test_the_distance_of_a_mesh_that_moves_is_made_once_and_checked_like_another(monkeypatch):
    made = []

    def counted(*arguments):
        made.append(arguments)
        return grid_distance(*arguments)

    monkeypatch.setattr(fluid_meshes, "grid_distance", counted)
    motion = {"kind": "translation", "velocity": [0.3, 0.0]}
    scene = load_scene(tables(body(ANGLE, **motion), grains=False))
    surfaces_in_fluid(scene, fluid_setup(scene).grid, 0.0, 0.01)
    assert len(made) == 1
    flat = [[0.05, 0.2], [0.35, 0.2], [0.35, 0.201], [0.05, 0.201]]
    assert "thinner than the cells" in refusal(tables(body(flat, **motion), grains=False))
    assert "closed = true" in refusal(tables(body(ANGLE, **motion) | {"closed": False}, grains=False))
