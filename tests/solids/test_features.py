"""What a sphere can touch of a surface: connectivity, convex and concave edges, corners, defects, bins, files."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from jaxdem.setup.mesh_tables import tables_of_features
from jaxdem.solids.bins import hashed, levels_of
from jaxdem.solids.defects import defects_of, mended
from jaxdem.solids.features import features_of
from jaxdem.solids.inside import inside
from jaxdem.solids.mesh_files import drawing, polyline, surface_of_heights, triangles_of
from jaxdem.solids.surface_mesh import SurfaceMesh
from tests.cases.surfaces import pipe_mesh, plane_mesh, saved

SMOOTH = np.radians(1.0)


def surface(mesh):
    return SurfaceMesh(np.asarray(mesh.vertices, float), np.asarray(mesh.faces)).welded()


def test_a_cube_has_faces_edges_and_corners_that_stick_out():
    found = features_of(surface(trimesh.creation.box()), True, SMOOTH)
    assert (len(found.faces.patch), len(found.edges.patch), len(found.corners.patch)) == (12, 12, 8)
    assert len(np.unique(found.faces.patch)) == 6  # two triangles a side are one patch
    outside = features_of(surface(trimesh.creation.box()), False, SMOOTH)
    assert (len(outside.edges.patch), len(outside.corners.patch)) == (12, 8)
    within = features_of(surface(trimesh.creation.box()).flipped(), False, SMOOTH)
    assert (len(within.edges.patch), len(within.corners.patch)) == (0, 0)  # from inside all edges are concave


def test_a_flat_plane_has_edges_and_corners_at_its_rim_only():
    found = features_of(surface(plane_mesh(7, warp=0.3)), True, SMOOTH)
    assert len(np.unique(found.faces.patch)) == 1
    assert len(found.edges.patch) == 28
    assert len(found.corners.patch) == 4


def distance_by_features(found, points):
    """Distance from the nearest of the features in whose region each point lies."""
    best = np.full(len(points), np.inf)
    for kind in found:
        if not len(kind.patch):
            continue
        apart = points[:, None] - kind.anchor[None]
        if hasattr(kind, "normal"):
            across = np.einsum("pfd,fkd->pfk", apart, kind.inward) - kind.offset
            far = np.abs(np.einsum("pfd,fd->pf", apart, kind.normal))
            within = (across >= -1e-9).all(axis=2)
        else:
            along = (
                np.einsum("pfd,fd->pf", apart, kind.along)[..., None] * kind.along if hasattr(kind, "along") else 0.0
            )
            apart, far = apart - along, np.linalg.norm(apart - along, axis=2)
            within = (np.einsum("pfd,fkd->pfk", apart, kind.beyond) <= 1e-9).all(axis=2)
            if hasattr(kind, "along"):
                place = np.einsum("pfd,fd->pf", points[:, None] - kind.anchor[None], kind.along)
                within &= (place >= -1e-9) & (place <= kind.length + 1e-9)
        best = np.minimum(best, np.where(within, far, np.inf).min(axis=1))
    return best


@pytest.mark.parametrize("shape", ["cube", "ball", "pyramid", "torus", "slivers"])
def test_the_regions_of_the_features_leave_no_gap(shape):
    """From everywhere the nearest point of the surface is the one of a feature in whose region the point lies."""
    mesh = {
        "cube": lambda: trimesh.creation.box(),
        "ball": lambda: trimesh.creation.icosphere(subdivisions=1),
        "pyramid": lambda: trimesh.creation.cone(0.5, 1.0, sections=7),
        "torus": lambda: trimesh.creation.torus(1.0, 0.4, major_sections=9, minor_sections=7),
        "slivers": lambda: plane_mesh(3, warp=0.49).apply_transform(np.diag([1.0, 1e-4, 1.0, 1.0])),
    }[shape]()
    own = surface(mesh)
    points = np.random.default_rng(1).uniform(-1.5, 1.5, (300, 3))
    near, far, _ = trimesh.proximity.closest_point_naive(mesh, points)
    assert distance_by_features(features_of(own, True, SMOOTH), points) == pytest.approx(far, abs=1e-9)
    del near


def test_bins_find_all_that_is_in_reach():
    """Every part within the reach of a point is in the bin that the point is in, whatever its size."""
    rng = np.random.default_rng(2)
    lower = rng.uniform(-1.0, 1.0, (400, 3))
    upper = lower + rng.exponential(0.05, (400, 3)) * rng.choice([1.0, 40.0], (400, 1), p=[0.95, 0.05])
    levels = levels_of(lower, upper, 0.05, 0.05)
    assert len(levels) > 2
    for point in rng.uniform(-1.2, 1.2, (200, 3)):
        gap = np.maximum(np.maximum(lower - point, point - upper), 0.0)
        near = set(np.flatnonzero(np.linalg.norm(gap, axis=1) < 0.05).tolist())
        found = set()
        for level in levels:
            bin_ = tuple(np.array([np.floor(x / level.width)], np.int32) for x in point)
            place = int(hashed(bin_, len(level.start) - 1)[0])
            found |= set(level.entry[level.start[place] : level.start[place + 1]].tolist())
        assert near <= found
    assert sum(len(level.entry) for level in levels) < 400 * 150  # by parts, not by the volume that they span


def looked_at(levels, point):
    """Numbers of the parts in the bins that a point is in; what the hash puts there too is left out."""
    found = []
    for level in levels:
        bin_ = tuple(np.array([np.floor(x / level.width)], np.int32) for x in point)
        place = int(hashed(bin_, len(level.start) - 1)[0])
        found += level.entry[level.start[place] : level.start[place + 1]].tolist()
    return found


def test_slivers_are_found_from_near_them_alone():
    """Of a tube askew of 72 pairs of triangles, 80 times as long as wide, a grain at the surface looks at a few, and
    each that it reaches is among them, once. In bins as wide as they are long it is 154."""
    own = surface(pipe_mesh(72, 0.1, 0.7).apply_transform(trimesh.transformations.euler_matrix(0.5, 0.7, 0.2)))
    features, reach = features_of(own, True, SMOOTH), 0.005
    levels = tables_of_features(features, True, 0.8 * reach, 0.2 * reach)
    rng, seen = np.random.default_rng(3), []
    corners = own.corners
    for cell in rng.integers(0, len(corners), 60):
        point = rng.dirichlet(np.ones(3)) @ corners[cell] + 0.3 * reach * rng.uniform(-1.0, 1.0, 3)
        foot = trimesh.triangles.closest_point(corners, np.tile(point, (len(corners), 1)))
        near = np.flatnonzero(np.linalg.norm(foot - point, axis=1) < 0.8 * reach)
        found = looked_at(levels.faces.bins, point)
        assert set(near.tolist()) <= set(found) and len(set(found)) == len(found)
        seen.append(len(found) + len(looked_at(levels.edges.bins, point)))
    assert len(corners) == 144 and np.mean(seen) < 30.0


def broken():
    """A cube with a triangle turned over, one twice, one without size and one missing."""
    mesh = trimesh.creation.box()
    faces = np.array(mesh.faces)
    faces[3] = faces[3][::-1]
    faces = np.concatenate([faces[:-1], faces[:1], [[0, 0, 1]]])
    return SurfaceMesh(np.asarray(mesh.vertices, float), faces)


def test_defects_are_counted_and_mended():
    found = defects_of(broken())
    assert (found.degenerate, found.duplicate, found.flipped, found.open_edges, found.pieces) == (1, 1, 1, 3, 1)
    after = defects_of(mended(broken()))
    assert (after.degenerate, after.duplicate, after.flipped, after.open_edges) == (0, 0, 0, 3)
    turned = mended(surface(trimesh.creation.box()).flipped())  # a closed surface looks outwards
    assert np.einsum("fd,fd->f", turned.area_vectors, turned.corners.mean(axis=1)).sum() > 0.0


def test_inside_of_a_closed_surface():
    points = np.random.default_rng(5).uniform(-0.7, 0.7, (500, 3))
    assert np.array_equal(inside(surface(trimesh.creation.box()), points), (np.abs(points) < 0.5).all(axis=1))
    ring = polyline([[np.cos(a), np.sin(a)] for a in np.arange(60) * np.pi / 30], closed=True)
    flat = 2.0 * points[:, :2]
    radius = np.linalg.norm(flat, axis=1)
    sure = np.abs(radius - 1.0) > 0.01
    assert np.array_equal(inside(ring, flat)[sure], radius[sure] < 1.0)


@pytest.mark.parametrize("kind", ["stl", "stl_ascii", "obj", "ply"])
def test_files_of_triangles(tmp_path, kind):
    mesh = pipe_mesh(8, 0.25, 1.0)
    path = tmp_path / f"pipe.{kind[:3]}"
    data = mesh.export(file_type=kind)
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    found = triangles_of(str(path)).welded()
    assert (len(found.cells), len(found.points)) == (16, 16)
    assert found.area == pytest.approx(mesh.area, rel=1e-6)
    again = triangles_of(saved(mesh, tmp_path / "again.ply"))
    np.testing.assert_array_equal(again.points[again.cells], mesh.vertices[mesh.faces], "float64 to the last bit")


@pytest.mark.parametrize("content", [b"", b"garbage", b"v 0 0 0\nf 1 2 3\n", b"solid\nendsolid\n"])
@pytest.mark.parametrize("kind", ["stl", "obj", "ply"])
def test_files_that_are_none_are_refused(tmp_path, kind, content):
    path = tmp_path / f"bad.{kind}"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"holds no|is no|not finite"):
        triangles_of(str(path))


def test_heights_and_drawings(tmp_path):
    heights = np.array([[0.0, 1.0, 2.0], [0.5, 1.5, 2.5]])
    np.save(tmp_path / "h.npy", heights)
    np.savetxt(tmp_path / "h.txt", heights)
    (tmp_path / "h.asc").write_text(
        "ncols 2\nnrows 3\nxllcenter 0\nyllcenter 0\ncellsize 2\nNODATA_value -9\n2 2.5\n1 1.5\n0 0.5\n"
    )
    for name, spacing in (("h.npy", (2.0, 2.0)), ("h.txt", (2.0, 2.0)), ("h.asc", None)):
        found = surface_of_heights(str(tmp_path / name), spacing)
        assert len(found.cells) == 4
        assert np.all(found.area_vectors[:, 2] > 0.0)  # the front is above
        assert found.points[found.points[:, 0] == 2.0][:, 1:].tolist() == [[0.0, 0.5], [2.0, 1.5], [4.0, 2.5]]
    with pytest.raises(ValueError, match="spacing"):
        surface_of_heights(str(tmp_path / "h.npy"), None)
    (tmp_path / "d.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg"><path d="M0,0 h2 v-1 L1 -1 z m5 5 q1 0 1 1"/>'
        '<rect x="0" y="0" width="2" height="1"/></svg>'
    )
    found = drawing(str(tmp_path / "d.svg"))
    assert len(found.cells) == 4 + 16 + 4
    assert found.bounds[1].tolist() == [6.0, 1.0]  # y is upwards
    (tmp_path / "a.svg").write_text('<svg><path d="M0,0 A1 1 0 0 0 1 1"/></svg>')
    with pytest.raises(ValueError, match="'A'"):
        drawing(str(tmp_path / "a.svg"))
