"""Grains on meshes: like analytic walls, over edges and corners, in corners and pipes, in float32, and on resume."""

from __future__ import annotations

import numpy as np
import pytest

from tests.cases.surfaces import flight, grains_scene, plane_mesh, saved

HEIGHT = 0.3
PLANE = {"kind": "plane", "point": [0.0, 0.0, HEIGHT], "normal": [0.0, 0.0, 1.0]}


def on_mesh(path, **given):
    return {"kind": "mesh", "file": str(path), "translate": [0.0, 0.0, HEIGHT], **given}


def twelve():
    """Grains in all directions over the plane: some that fall, some that slide, roll and spin."""
    angle = 2.0 * np.pi * np.arange(12) / 12 + 0.1
    place = np.array([0.5, 0.5]) + 0.2 * np.stack([np.cos(angle), np.sin(angle)], 1)
    height = np.where(np.arange(12) % 2, HEIGHT + 0.02, HEIGHT + 0.03)
    away = np.stack([np.cos(2.1 * angle), np.sin(2.1 * angle), -0.5 * (np.arange(12) % 2 == 0)], 1)
    spin = 10.0 * np.stack([np.sin(angle), np.cos(3 * angle), np.sin(5 * angle)], 1)
    return np.column_stack([place, height]), 0.5 * away, spin


@pytest.fixture(scope="module")
def planes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("planes")
    return {
        cells: saved(plane_mesh(squares, warp=warp), folder / f"{cells}.ply")
        for cells, squares, warp in ((2, 1, 0.0), (200, 10, 0.3), (20000, 100, 0.3))
    }


@pytest.mark.parametrize(("precision", "within"), [("float64", 1e-12), ("float32", 1e-6)])
def test_a_plane_of_triangles_is_a_plane(planes, precision, within):
    """Impact, sliding and rolling over edges and corners in all directions."""
    grains = twelve()
    expected = flight(grains_scene([PLANE], *grains, precision=precision), 16)
    assert np.ptp(expected.position[:, :, 0], axis=0).max() > 0.06  # over many of the triangles
    for path in planes.values():
        found = flight(grains_scene([on_mesh(path)], *grains, precision=precision), 16)
        assert np.abs(found.position - expected.position).max() < within * 0.04
        assert np.abs(found.spin - expected.spin).max() < 50 * within * np.abs(expected.spin).max()


def test_a_plane_of_triangles_that_moves_is_a_plane_that_moves(planes):
    """It swings, turns and shifts, one on top of the other; in periodic directions too."""
    motion = [
        {"kind": "oscillation", "direction": [0.0, 0.0, 1.0], "amplitude": 0.004, "frequency": 9.0},
        {"kind": "rotation", "axis": [0.0, 1.0, 0.0], "center": [0.5, 0.0, HEIGHT], "rate": 0.4},
        {"kind": "translation", "velocity": [0.3, 0.1, 0.02]},
    ]
    grains = twelve()
    expected = flight(grains_scene([PLANE | {"motion": motion}], *grains), 16)
    found = flight(grains_scene([on_mesh(planes[200], motion=motion)], *grains), 16)
    assert np.abs(found.position - expected.position).max() < 1e-12
    still = flight(grains_scene([on_mesh(planes[200])], *grains), 16)
    assert np.abs(still.position - expected.position).max() > 1e-3
