"""Meshes for cases and tests: planes, boxes, pipes and steps of triangles; and scenes with grains on them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import trimesh

import jaxdem
from jaxdem.setup.builder import build_case
from tests.cases.steps import compiled_step


def plane_mesh(squares: int, lower=-0.5, upper=1.5, height=0.0, warp=0.0) -> trimesh.Trimesh:
    """A horizontal plane of 2 squares^2 triangles; `warp` moves the inner corners within it, over their distance."""
    axis = np.linspace(lower, upper, squares + 1)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    inner = np.zeros(x.shape, bool)
    inner[1:-1, 1:-1] = True
    rng = np.random.default_rng(3)
    step = warp * (upper - lower) / squares
    x, y = (values + step * np.where(inner, rng.uniform(-1, 1, x.shape), 0.0) for values in (x, y))
    points = np.stack([x.ravel(), y.ravel(), np.full(x.size, height)], axis=1)
    number = np.arange(x.size).reshape(x.shape)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    cells = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return trimesh.Trimesh(points, cells, process=False)


def pipe_mesh(sides: int, radius: float, length: float) -> trimesh.Trimesh:
    """An n-gon round the axis y with its corners at the radius, open at both ends, with the front inside; a side lies
    at the bottom."""
    angle = 2.0 * np.pi * (np.arange(sides) + 0.5) / sides - 0.5 * np.pi
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = np.concatenate([np.stack([ring[:, 0], np.full(sides, y), ring[:, 1]], axis=1) for y in (0.0, length)])
    k = np.arange(sides)
    nxt = (k + 1) % sides
    cells = np.concatenate([np.stack([k, nxt, nxt + sides], 1), np.stack([k, nxt + sides, k + sides], 1)])
    return trimesh.Trimesh(points, cells, process=False)


def turned(profile: np.ndarray, sides: int) -> trimesh.Trimesh:
    """The surface of a profile (K, 2) of radius and height that turns about the z axis.

    Args:
        profile: corners, one after the other [m].
        sides: of the polygons that stand for circles; their sides have the radius in the middle.
    """
    angle = 2.0 * np.pi * np.arange(sides) / sides
    radius, height = profile[:, 0] / np.cos(np.pi / sides), profile[:, 1]
    x, y = (np.outer(radius, f(angle)) for f in (np.cos, np.sin))
    points = np.stack([x, y, np.broadcast_to(height[:, None], x.shape)], axis=-1).reshape(-1, 3)
    number = np.arange(len(points)).reshape(x.shape)
    a, b = number[:-1], np.roll(number[:-1], -1, axis=1)
    c, d = np.roll(number[1:], -1, axis=1), number[1:]
    cells = np.concatenate([np.stack(corners, -1).reshape(-1, 3) for corners in ((a, b, c), (a, c, d))])
    return trimesh.Trimesh(points, cells)


def orifice_plate(orifice: float, radius: float, sides: int = 48) -> trimesh.Trimesh:
    """A flat ring at z = 0 about a round orifice of this radius [m]."""
    return turned(np.array([[orifice, 0.0], [radius, 0.0]]), sides)


def saved(mesh: trimesh.Trimesh, path) -> str:
    """The file of a mesh; PLY holds coordinates in float64, which trimesh reads but does not write."""
    path = str(path)
    data = _ply(mesh) if path.endswith(".ply") else mesh.export(file_type=path.rpartition(".")[2])
    with open(path, "wb") as file:
        file.write(data if isinstance(data, bytes) else data.encode())
    return path


def _ply(mesh: trimesh.Trimesh) -> str:
    """Text of a PLY file; 17 digits give every float64 back."""
    header = [
        "ply", "format ascii 1.0",
        f"element vertex {len(mesh.vertices)}", *(f"property double {axis}" for axis in "xyz"),
        f"element face {len(mesh.faces)}", "property list uchar int vertex_indices", "end_header",
    ]  # fmt: skip
    points = [" ".join(f"{x:.17g}" for x in point) for point in mesh.vertices]
    return "\n".join([*header, *points, *(f"3 {a} {b} {c}" for a, b, c in mesh.faces)]) + "\n"


def grains_scene(walls, position, velocity=None, spin=None, precision="float64", **given) -> dict:
    """Tables of a scene with grains that are far from each other."""
    tables = {
        "seed": 1, "precision": precision,
        "domain": {"size": [1.0, 1.0, 1.0]},
        "particles": {"position": np.asarray(position, float).tolist(), "radius": 0.02, "density": 2500.0},
        "contact": {"young_modulus": 1e7, "poisson_ratio": 0.3, "restitution": 0.5, "friction": 0.4},
        "time": {"end": 0.01, "output_interval": 0.01},
        "walls": walls,
    }  # fmt: skip
    for name, rows in (("velocity", velocity), ("angular_velocity", spin)):
        if rows is not None:
            tables["particles"][name] = np.asarray(rows, float).tolist()
    for table, keys in given.items():
        tables[table] = {**tables.get(table, {}), **keys} if isinstance(keys, dict) else keys
    return tables


class Flight(NamedTuple):
    """Frames (T, N, ...) of a scene: positions in float64, velocities, spins, mean contact forces."""

    position: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    force: np.ndarray


def flight(tables: dict, intervals: int) -> Flight:
    """The grains of a scene after each of so many coupling intervals; more room for lists where it is needed."""
    scene = jaxdem.load_scene(tables)
    case = build_case(scene)
    state, neighbors = case.initial_state()
    step, frames = compiled_step(case.simulation), []
    while len(frames) < intervals:
        after, listed, report = step(case.parameters, state, neighbors)
        if bool(report.particles.overflow):
            state, neighbors = case.simulation.with_room(state, neighbors, neighbors.room.enlarged())
            continue
        state, neighbors, own = after, listed, after.particles
        low = 0.0 if own.position_low is None else np.asarray(own.position_low, float)
        position = np.asarray(own.position, float) + low
        frames.append((position, *(np.asarray(x) for x in (own.velocity, own.angular_velocity, own.contact_force))))
    return Flight(*(np.stack(column) for column in zip(*frames, strict=True)))
