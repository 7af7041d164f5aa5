"""Meshes for cases and tests: planes, boxes, pipes and steps of triangles; and scenes with grains on them."""

from __future__ import annotations

import numpy as np
import trimesh


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
    cells = np.concatenate([np.stack([k, nxt + sides, nxt], 1), np.stack([k, k + sides, nxt + sides], 1)])
    return trimesh.Trimesh(points, cells, process=False)


def saved(mesh: trimesh.Trimesh, path) -> str:
    """The file of a mesh; PLY holds coordinates in float64."""
    path = str(path)
    data = mesh.export(file_type="ply", encoding="ascii") if path.endswith(".ply") else mesh.export(
        file_type=path.rpartition(".")[2]
    )  # fmt: skip
    with open(path, "wb") as file:
        file.write(data if isinstance(data, bytes) else data.encode())
    return path
