"""Wear of the meshes of a scene: its laws, and what has been taken at the start. Host."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jaxdem.numerics.host import on_device
from jaxdem.particles.wear import Archard, Finnie, WearLaw, WornMesh
from jaxdem.scene.walls import Wall
from jaxdem.setup.meshes import WallMesh


def wear_law(wall: Wall) -> WearLaw | None:
    """The law of a wall; None without wear."""
    wear = wall.wear
    if wear is None:
        return None
    if wear.model == "archard":
        return Archard(wear.coefficient, wear.hardness or 1.0)
    return Finnie(wear.coefficient, wear.flow_stress or 1.0, wear.force_ratio or 1.0, wear.depth_ratio or 1.0)


def not_worn(meshes: Sequence[WallMesh], dtype: np.dtype[np.floating]) -> tuple[WornMesh | None, ...]:
    """What has been taken from every mesh at the start; () where none wears."""
    if not any(mesh.wall.wear for mesh in meshes):
        return ()

    def new(mesh: WallMesh) -> WornMesh:
        zero = on_device(np.zeros(len(mesh.mesh.cells)), dtype)
        return WornMesh(zero, None if dtype == np.float64 else zero)

    return tuple(new(mesh) if mesh.wall.wear else None for mesh in meshes)
