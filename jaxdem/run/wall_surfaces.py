"""The meshes of a run, written for ParaView and for pictures when it begins."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from jaxdem.io.wall_file import WALLS, WallSurfaces, write_walls
from jaxdem.setup.builder import Case
from jaxdem.solids.motion_tables import placement_of

MOST_NUMBERS = 30_000_000
"""Coordinates of all times; a file of more has the walls at the start alone."""


def keep_walls(case: Case, folder: Path) -> None:
    """Writes `walls.vtkhdf` into a run directory that has none, of a scene with meshes.

    Meshes with a given motion are there at every output time. Those that a force moves stand where they begin.
    """
    meshes = () if case.particles is None else case.particles.meshes
    if not meshes or (folder / WALLS).exists():
        return
    tables = case.scene.tables()["walls"]
    numbers = [int(mesh.key.rpartition(".")[2]) for mesh in meshes]
    first = np.cumsum([0, *(len(mesh.mesh.points) for mesh in meshes)])
    surfaces = WallSurfaces(
        np.concatenate([mesh.mesh.points for mesh in meshes]),
        np.concatenate([mesh.mesh.cells + start for mesh, start in zip(meshes, first, strict=False)]),
        np.repeat(numbers, [len(mesh.mesh.cells) for mesh in meshes]),
    )
    times = [float(case.begin)]
    if any(tables[number].get("motion") for number in numbers):
        output = case.simulation.interval * case.simulation.steps.intervals_per_output
        times = [times[0] + output * k for k in range(case.simulation.steps.outputs + 1)]
    if len(times) * surfaces.points.size > MOST_NUMBERS:
        times = times[:1]
    places = []
    for time in times:
        moved = []
        for number, mesh in zip(numbers, meshes, strict=True):
            placed = placement_of(tables[number], time)
            points = mesh.mesh.points
            if placed is not None:
                turn = np.eye(points.shape[1]) if placed.rotation is None else np.asarray(placed.rotation)
                points = points @ turn.T + np.asarray(placed.shift)
            moved.append(points)
        places.append(np.concatenate(moved))
    write_walls(folder, surfaces, times, places)
