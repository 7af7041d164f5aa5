"""The meshes of a run, written for ParaView and for pictures when it begins, and again where a force has moved them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from jaxdem.io.load import load_run
from jaxdem.io.wall_file import WALLS, WallSurfaces, write_walls
from jaxdem.setup.builder import Case
from jaxdem.solids.motion_tables import placement_of

MOST_NUMBERS = 30_000_000
"""Coordinates of all times; a file of more has the walls at the start alone."""


def keep_walls(case: Case, folder: Path) -> None:
    """Writes `walls.vtkhdf` into a run directory that has none, of a scene with meshes.

    Meshes with a given motion are there at every output time. Those that a force moves stand where they begin until
    `place_pistons`.
    """
    numbers = _numbers(case)
    if not numbers or (folder / WALLS).exists():
        return
    times = [float(case.begin)]
    if any(case.scene.walls[number].motion for number in numbers):
        output = case.simulation.interval * case.simulation.steps.intervals_per_output
        times = [times[0] + output * k for k in range(case.simulation.steps.outputs + 1)]
    _write(case, folder, times, {})


def place_pistons(case: Case, folder: Path) -> None:
    """Writes the file of a complete run anew, with meshes that a force moves where they were at every output time."""
    moved = [number for number in _numbers(case) if case.scene.walls[number].piston is not None]
    if not moved:
        return
    history = load_run(folder).history
    columns = {number: history[f"wall_{number}_displacement"] for number in moved}
    _write(case, folder, history["time"].tolist(), columns)


def _numbers(case: Case) -> list[int]:
    """Of the tables in `[[walls]]` that are meshes."""
    meshes = () if case.particles is None else case.particles.meshes
    return [int(mesh.key.rpartition(".")[2]) for mesh in meshes]


def _write(case: Case, folder: Path, times: list[float], moved: Mapping[int, np.ndarray]) -> None:
    """The file.

    Args:
        case: of the run.
        folder: run directory.
        times: at which the meshes are placed [s].
        moved: displacement of each piston at these times, by number of its wall [m].
    """
    meshes, numbers = () if case.particles is None else case.particles.meshes, _numbers(case)
    tables = case.scene.tables()["walls"]
    first = np.cumsum([0, *(len(mesh.mesh.points) for mesh in meshes)])
    surfaces = WallSurfaces(
        np.concatenate([mesh.mesh.points for mesh in meshes]),
        np.concatenate([mesh.mesh.cells + start for mesh, start in zip(meshes, first, strict=False)]),
        np.repeat(numbers, [len(mesh.mesh.cells) for mesh in meshes]),
    )
    if len(times) * surfaces.points.size > MOST_NUMBERS:
        times = times[:1]
    places = []
    for k, time in enumerate(times):
        now = []
        for number, mesh in zip(numbers, meshes, strict=True):
            placed = placement_of(tables[number], time, float(moved[number][k]) if number in moved else 0.0)
            points = mesh.mesh.points
            if placed is not None:
                turn = np.eye(points.shape[1]) if placed.rotation is None else np.asarray(placed.rotation)
                points = points @ turn.T + np.asarray(placed.shift)
            now.append(points)
        places.append(np.concatenate(now))
    write_walls(folder, surfaces, times, places)
