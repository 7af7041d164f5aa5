"""The scenes with meshes beside that of the silo: what their files are, and where their grains begin."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import jaxdem
from jaxdem.setup.builder import build_case
from tests.cases.moving_walls import path

SCENES = Path(__file__).parents[1] / "scenes"


def case_of(name, **changes):
    return build_case(jaxdem.load_scene(SCENES / f"{name}.toml", changes))


@pytest.mark.parametrize(
    ("name", "changes", "triangles", "closed"),
    [
        ("dosta_silo", {"particles.pack.count": 20}, 288, False),
        ("dosta_impact", {"particles.pack.count": 20}, 1280, True),
        ("drum_with_lifters", {"particles.count": 20}, 144, False),
        ("slope", {"particles.pack.count": 20}, 2800, False),
    ],
)
def test_the_meshes_are_sound_and_the_grains_before_them(name, changes, triangles, closed):
    """Grains before they fall; a mesh with holes, turned triangles or in a wrong place would be refused."""
    case = case_of(name, **changes)
    (mesh,) = case.particles.meshes
    assert len(mesh.mesh.cells) == triangles and mesh.defects.is_closed == closed
    assert mesh.defects.pieces == 1 and mesh.defects.flipped == 0
    case.first_state()


def test_the_slope_faces_up_and_the_drum_inwards():
    """With touch = "front" grains touch what they should: of the drum its shell and the tops of its lifters."""
    (slope,) = case_of("slope", **{"particles.pack.count": 5}).particles.meshes
    assert (slope.mesh.area_vectors[:, 2] > 0.0).all()
    (drum,) = case_of("drum_with_lifters", **{"particles.count": 5}).particles.meshes
    middles, normal = drum.mesh.corners.mean(axis=1), drum.mesh.area_vectors
    inwards = (np.array([0.11, 0.025, 0.11]) - middles) * [1.0, 0.0, 1.0]
    radius = np.linalg.norm(inwards, axis=1)
    facing = np.einsum("fd,fd->f", inwards, normal) / (radius * np.linalg.norm(normal, axis=1))
    shell_or_top = (radius > 0.098) | (radius < 0.0885)
    assert shell_or_top.sum() > 100 and (facing[shell_or_top] > 0.9).all()


def test_the_ball_falls_freely_before_it_meets_the_layer():
    """Its displacement, in the frame of its first velocity, is g t^2/2."""
    scene = jaxdem.load_scene(
        SCENES / "dosta_impact.toml",
        {"particles.pack.count": 2, "time.end": 0.003, "precision": "float64"},
    )
    tables = scene.tables()
    tables["walls"][0]["translate"] = [0.0225, 0.0225, 0.09]
    found = path(tables)
    fall = 0.5 * 9.81 * found.time**2
    np.testing.assert_allclose(found.pistons.displacement[:, 0], fall, rtol=1e-6, atol=1e-12)
