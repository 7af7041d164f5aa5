"""Grains on meshes: against the analytic walls that they approximate."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import numpy as np

from tests.cases.registry import Figure, below, case, relative
from tests.cases.surfaces import flight, grains_scene, pipe_mesh, plane_mesh, saved

HEIGHT = 0.3
RADIUS = 0.02


def _grains() -> dict:
    """Twelve grains that fall, slide, roll and spin over a plane in all directions."""
    number = np.arange(12)
    angle = 2.0 * np.pi * number / 12 + 0.1
    position = np.column_stack(
        [0.5 + 0.2 * np.cos(angle), 0.5 + 0.2 * np.sin(angle), HEIGHT + np.where(number % 2, RADIUS, 1.5 * RADIUS)]
    )
    velocity = np.column_stack([0.5 * np.cos(2.1 * angle), 0.5 * np.sin(2.1 * angle), -0.25 * (number % 2 == 0)])
    spin = 10.0 * np.column_stack([np.sin(angle), np.cos(3 * angle), np.sin(5 * angle)])
    return {"position": position, "velocity": velocity, "spin": spin}


@case("plane of triangles against a plane", "contact", "the analytic plane", fast={"squares": (1, 10)}, tested=False)
def plane_of_triangles(squares: tuple[int, ...] = (1, 10, 100)) -> list[Figure]:
    """Impact, sliding and rolling over edges and corners in any direction, for 0.16 s: the largest distance from the
    trajectories on the plane, over the diameter [1e-12 in float64, 1e-6 in float32]."""
    wall = {"kind": "plane", "point": [0.0, 0.0, HEIGHT], "normal": [0.0, 0.0, 1.0]}
    figures = []
    with tempfile.TemporaryDirectory() as folder:
        for precision, gate in (("float64", 1e-12), ("float32", 1e-6)):
            expected = flight(grains_scene([wall], **_grains(), precision=precision), 16).position
            for number in squares:
                path = saved(plane_mesh(number, warp=0.3 * (number > 1)), Path(folder) / f"{number}.ply")
                mesh = {"kind": "mesh", "file": path, "translate": [0.0, 0.0, HEIGHT]}
                found = flight(grains_scene([mesh], **_grains(), precision=precision), 16).position
                apart = np.abs(found - expected).max() / (2.0 * RADIUS)
                figures.append(below(f"{precision}, {2 * number**2} triangles, distance/d", apart, gate))
    return figures


@case("pipe of flat sides against a cylinder", "contact", "R (1 - cos(pi/n))", fast={"sides": (12,)}, tested=False)
def pipe_of_flat_sides(sides: tuple[int, ...] = (12, 48, 192)) -> list[Figure]:
    """Height of a grain at rest over that in the cylinder, over R (1 - cos(pi/n)), R = 20 r [1]."""
    radius, figures = 20.0 * RADIUS, []
    with tempfile.TemporaryDirectory() as folder:
        for number in sides:
            path = saved(pipe_mesh(number, radius, 1.0), Path(folder) / "pipe.ply")
            keys = {"translate": [0.5, 0.0, 0.5], "touch": "front", "smooth_angle": 30.0}
            position = [[0.5, y, 0.5 - radius * math.cos(math.pi / number) + 1.05 * RADIUS] for y in (0.4, 0.6)]
            given = {"position": position, "contact": {"restitution": 0.1, "young_modulus": 1e8}}
            found = flight(grains_scene([{"kind": "mesh", "file": path, **keys}], **given), 20)
            above = found.position[-1, 0, 2] - (0.5 - radius + RADIUS)
            bound = radius * (1.0 - math.cos(math.pi / number))
            figures.append(below(f"{number} sides, height over that in the cylinder/bound", abs(above) / bound, 1.0))
    return figures


@case("concave edge of two lines against a wedge", "contact", "statics", tested=False)
def concave_edge() -> list[Figure]:
    """A grain at rest in a right angle of two lines: force from both sides over its weight [1e-3]; distance from the
    trajectory in the wedge over the diameter [1e-12]."""
    mesh = {"kind": "mesh", "points": [[0.1, 0.9], [0.5, 0.5], [0.9, 0.9]]}
    wedge = {"kind": "wedge", "apex": [0.5, 0.5], "directions": [[-1.0, 1.0], [1.0, 1.0]]}
    given = {
        "position": [[0.5, 0.5 + RADIUS * 2**0.5], [0.52, 0.56]],
        "domain": {"size": [1.0, 1.0]},
        "contact": {"restitution": 0.1, "friction": 0.3},
    }
    found, expected = (flight(grains_scene([wall], **given), 40) for wall in (mesh, wedge))
    weight = 2500.0 * 4.0 / 3.0 * math.pi * RADIUS**3 * 9.81
    apart = np.abs(found.position - expected.position).max() / (2.0 * RADIUS)
    return [
        relative("force at rest", weight, float(found.force[-1, 0, 1]), 1e-3, "N"),
        below("distance from the trajectory in the wedge/d", apart, 1e-12),
    ]
