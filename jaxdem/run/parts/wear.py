"""Wear of the meshes of a run: a column of history.csv, the summary, and the triangles for ParaView. Host side."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from jaxdem.io.wall_file import add_cell_data
from jaxdem.run.instant import Instant
from jaxdem.run.parts.part import Part
from jaxdem.run.totals import Means, Totals
from jaxdem.setup.builder import Case
from jaxdem.state import State


class Wear(Part):
    """Volume that is worn off the meshes."""

    def columns(self, case: Case, instant: Instant, means: Means) -> dict[str, float]:
        """Volume taken from every mesh that wears [m3]."""
        return {f"wall_{number}_wear": float(own.sum()) for number, own in worn_volumes(case, instant.state).items()}

    def summary(self, case: Case, instant: Instant, totals: Totals) -> dict[str, Any]:
        """Volume of wear of every mesh, and where it is deepest."""
        found = []
        for number, volume in worn_volumes(case, instant.state).items():
            depth = _depth(case, number, volume) if case.scene.dimension == 3 else None  # lines have no area
            worst = int(np.argmax(volume if depth is None else depth))
            deepest = None if depth is None else float(depth[worst])
            name = case.scene.walls[number].name
            found.append({"wall": number, "name": name, "volume": float(volume.sum()), "depth": deepest, "cell": worst})
        return {"wear": found} if found else {}


def worn_volumes(case: Case, state: State) -> dict[int, np.ndarray]:
    """(F,) volume taken from every triangle, by the number of the wall's table [m3]; {} where no mesh wears."""
    meshes = () if case.particles is None else case.particles.meshes
    worn = () if state.particles is None else state.particles.mesh_wear
    found = {}
    for mesh, own in zip(meshes, worn, strict=False):
        if own is not None:
            low = 0.0 if own.volume_low is None else np.asarray(own.volume_low, float)
            found[int(mesh.key.rpartition(".")[2])] = np.asarray(own.volume, float) + low
    return found


def keep_wear(case: Case, state: State, folder: Path) -> None:
    """Puts the wear of every triangle at the end of a run into its `walls.vtkhdf`."""
    worn = worn_volumes(case, state)
    if not worn or case.particles is None:
        return
    volumes, depths = [], []
    solid = case.scene.dimension == 3
    for mesh in case.particles.meshes:
        number, blank = int(mesh.key.rpartition(".")[2]), np.zeros(len(mesh.mesh.cells))
        own = worn.get(number, blank)
        volumes.append(own)
        if solid:
            depths.append(_depth(case, number, own))
    arrays = {"wear_volume": (np.concatenate(volumes), "m3")}
    if solid:
        arrays["wear_depth"] = (np.concatenate(depths), "m")
    add_cell_data(folder, arrays)


def _depth(case: Case, number: int, volume: np.ndarray) -> np.ndarray:
    """(F,) mean depth of the wear of every triangle [m]."""
    meshes = () if case.particles is None else case.particles.meshes
    own = next(mesh for mesh in meshes if mesh.key == f"walls.{number}")
    found: np.ndarray = volume / np.linalg.norm(own.mesh.area_vectors, axis=1)
    return found
