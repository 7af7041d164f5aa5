"""Meshes that the fluid sees: against the analytic walls that they stand for, at rest, and what is refused."""

import numpy as np
import pytest
import trimesh

from jaxdem import InputError, load_scene
from jaxdem.fluid.boundary import Boundary, Side
from jaxdem.fluid.grid import Grid
from jaxdem.setup.builder import build_case
from jaxdem.setup.cut_cells import FluidSurface, cut_cells_of
from jaxdem.solids.grid_distance import grid_distance
from jaxdem.solids.mesh_files import polyline
from jaxdem.solids.surface_mesh import SurfaceMesh
from tests.test_fluid_walls import refusal, tables


def circle(count, centre=(0.2, 0.2), radius=0.1):
    """Corners of a polygon with the area of a circle, counter-clockwise."""
    angle = 2.0 * np.pi * (np.arange(count) + 0.37) / count
    same_area = radius * np.sqrt(2.0 * np.pi / (count * np.sin(2.0 * np.pi / count)))
    return np.stack([centre[0] + same_area * np.cos(angle), centre[1] + same_area * np.sin(angle)], axis=-1)


def block(lower, upper):
    """A block of twelve triangles, fronts outside."""
    found = trimesh.creation.box(bounds=[lower, upper])
    return SurfaceMesh(np.asarray(found.vertices), np.asarray(found.faces))


def test_the_distance_of_a_sphere_and_of_bodies_that_overlap():
    ball = trimesh.creation.icosphere(3, 0.3)
    ball.apply_translation([0.5, 0.45, 0.55])
    mesh = SurfaceMesh(np.asarray(ball.vertices), np.asarray(ball.faces))
    found = grid_distance(mesh, (0.1,) * 3, (11,) * 3, 0.25).distance
    points = np.stack(np.meshgrid(*[np.arange(11) * 0.1] * 3, indexing="ij"), axis=-1)
    exact = np.linalg.norm(points - [0.5, 0.45, 0.55], axis=-1) - 0.3
    near = np.abs(exact) < 0.24
    # The triangles are within R (1 - cos) of the sphere, with the angle from their middle to their corner.
    depth = 0.3 - np.linalg.norm(mesh.corners.mean(axis=1) - [0.5, 0.45, 0.55], axis=-1).min()
    assert np.abs(found - exact)[near].max() < depth
    assert (found[exact > 0.26] == 0.25).all() and (found[exact < -0.24] <= -0.24).all()
    one, other = block((0.22,) * 3, (0.62,) * 3), block((0.42,) * 3, (0.83,) * 3)
    both = SurfaceMesh(np.concatenate([one.points, other.points]), np.concatenate([one.cells, other.cells + 8]))
    solid = grid_distance(both, (0.1,) * 3, (11,) * 3, 0.2).distance < 0.0
    inside = [((points > lower) & (points < upper)).all(axis=-1) for lower, upper in ((0.22, 0.62), (0.42, 0.83))]
    assert (solid == (inside[0] | inside[1])).all()


@pytest.mark.parametrize("count", [64, 256])
def test_open_fractions_of_a_polygon_converge_to_those_of_a_circle(count):
    grid = Grid((16, 16), (0.4, 0.4), 1.0, (False, False))
    round_one = FluidSurface(lambda x: np.hypot(x[..., 0] - 0.2, x[..., 1] - 0.2) - 0.1)
    exact, _ = cut_cells_of(grid, [round_one])
    found = grid_distance(polyline(circle(count), True), grid.spacing, (17, 17), 0.1).distance
    cut, _ = cut_cells_of(grid, [FluidSurface(lambda x: found)])
    error = max(np.abs(a - b).max() for a, b in zip(cut.open_faces, exact.open_faces, strict=True))
    # A polygon is off its circle by R/12 (2 pi/n)^2 to either side: over the cell, 0.6 % with 64 corners.
    assert error < 2.0 * 0.1 * (2.0 * np.pi / count) ** 2 / 12.0 / 0.025 * 2.0


def test_a_pipe_of_triangles_is_the_cylinder():
    grid = Grid((10, 10, 4), (0.4, 0.4, 0.16), 1.0, (False, False, True))
    tube = trimesh.creation.cylinder(0.15, 1.0, sections=256)
    tube.apply_translation([0.203, 0.196, 0.08])
    mesh = SurfaceMesh(np.asarray(tube.vertices), np.asarray(tube.faces))
    found = -grid_distance(mesh, grid.spacing, (11, 11, 5), 0.18).distance
    cut, _ = cut_cells_of(grid, [FluidSurface(lambda x: found)])
    exact, _ = cut_cells_of(grid, [FluidSurface(lambda x: 0.15 - np.hypot(x[..., 0] - 0.203, x[..., 1] - 0.196))])
    for a, b in zip(cut.open_faces, exact.open_faces, strict=True):
        assert np.abs(a - b).max() < 0.15 * (np.pi / 256) ** 2 / 0.04


BOX = np.array([[0.06, 0.02], [0.38, 0.09], [0.33, 0.36], [0.03, 0.28]])
"""A tilted quadrangle, counter-clockwise."""


def planes():
    """The same as planes that face its middle."""
    for start, end in zip(BOX, np.roll(BOX, -1, axis=0), strict=True):
        along = end - start
        yield {"kind": "plane", "point": start.tolist(), "normal": [-along[1], along[0]], "fluid": "no_slip"}


MESH = {"kind": "mesh", "points": BOX.tolist(), "closed": True, "fluid": "no_slip", "inside": True}


def test_a_tilted_box_of_lines_is_that_of_tilted_planes():
    of_lines = build_case(load_scene(tables(MESH, grains=False))).fluid_walls.cut
    of_planes = build_case(load_scene(tables(*planes(), grains=False))).fluid_walls.cut
    # In the solid beyond a corner the distance is that of the corner and not of the planes: there alone it differs.
    corners = np.floor(BOX / (0.4 / 12)).astype(int)
    away = np.ones((12, 12), bool)
    for i, j in corners:
        away[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2] = False
    assert away.sum() > 100
    assert np.abs(of_lines.open_cells - of_planes.open_cells)[away].max() < 1e-12
    assert np.abs(of_lines.open_cells - of_planes.open_cells).max() < 0.2
    assert of_lines.open_cells[away].min() == 0.0


def test_meshes_that_have_no_inside_are_refused_with_counts():
    text = refusal(tables(MESH | {"closed": False}, grains=False))
    assert "2 ends of one of its lines alone" in text and "closed = true" in text
    thin = [[0.05, 0.2], [0.35, 0.2], [0.35, 0.205], [0.05, 0.205]]
    assert "thinner than the cells" in refusal(tables(MESH | {"points": thin, "inside": False}, grains=False))
    assert "inside" in refusal(tables(MESH | {"fluid": "none"}))
    # The fronts of a closed line that goes counter-clockwise look outside.
    assert "walls.0.inside" in refusal(tables(MESH | {"touch": "front"}, grains=False))


def test_terrain_from_heights_has_the_fluid_above(tmp_path):
    heights = 0.1 + 0.05 * np.sin(np.arange(21))
    np.save(tmp_path / "bed.npy", heights)
    wall = {"kind": "mesh", "file": str(tmp_path / "bed.npy"), "spacing": 0.02, "fluid": "no_slip"}
    cut = build_case(load_scene(tables(wall, grains=False))).fluid_walls.cut
    below = np.trapezoid(np.interp(np.linspace(0.0, 0.4, 4001), np.arange(21) * 0.02, heights), dx=1e-4)
    # Cells of 0.033 m see waves of 0.126 m.
    assert np.sum(1.0 - cut.open_cells) * (0.4 / 12) ** 2 == pytest.approx(below, rel=0.02)
    short = wall | {"translate": [0.1, 0.0]}
    assert "does not cover the box" in refusal(tables(short, grains=False))
    with pytest.raises(InputError, match="upright"):
        build_case(load_scene(tables(wall | {"rotate": 5.0}, grains=False)))


def test_cells_that_a_mesh_encloses_are_left_out_beside_grains():
    outer, inner = polyline(circle(64, radius=0.15), True), polyline(circle(64, radius=0.08)[::-1], True)
    ring = SurfaceMesh(np.concatenate([outer.points, inner.points]), np.concatenate([outer.cells, inner.cells + 64]))
    grid = Grid((16, 16), (0.4, 0.4), 1.0, (False, False))
    found = grid_distance(ring, grid.spacing, (17, 17), 0.1).distance
    assert found[8, 8] > 0.0 and found[8, 3] < 0.0
    sides = Boundary(tuple(Side(n // 2, bool(n % 2), "no_slip") for n in range(4)))
    cut, pockets = cut_cells_of(grid, [FluidSurface(lambda x: found)], sides, coupled=True)
    assert 20 < pockets < 60 and cut.open_cells[8, 8] == 0.0 and cut.open_cells[0, 0] == 1.0
