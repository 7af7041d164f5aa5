"""What contacts with meshes have kept in the run before. Host, numpy."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from jaxdem.numerics.host import on_device
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.mesh_contact import MeshMemory
from jaxdem.particles.mesh_list import MeshList
from jaxdem.particles.wear import WornMesh
from jaxdem.scene import Scene
from jaxdem.setup.meshes import WallMesh
from jaxdem.setup.start_point import StartPoint, mesh_texts

WORN = "state.particles.mesh_wear"
"""Prefix of the wear of meshes in a checkpoint."""


def kept_of_meshes(
    start: StartPoint,
    scene: Scene,
    meshes: Sequence[WallMesh],
    lists: Sequence[MeshList],
    blank: Sequence[MeshMemory],
    rows: int,
    springs_of: Callable[[str], list[np.ndarray]],
) -> tuple[MeshMemory, ...]:
    """What the contacts with each mesh keep: those with a mesh that was there already go on.

    Args:
        start: where the run before has got to.
        scene: that begins.
        meshes: its walls that are meshes.
        lists: of them.
        blank: of contacts that have just begun, for these lists.
        rows: number of particles of the run before, which have the first rows here.
        springs_of: from the name of an array of the particles to the stored components that contacts here keep too.
    """
    here = mesh_texts(scene, meshes)
    found = []
    for text, listed, own in zip(here, lists, blank, strict=True):
        if text in start.meshes:
            number = start.meshes.index(text)
            own = _moved(start.arrays, number, listed, own, rows, springs_of(f"mesh_memory[{number}].spring"))
        found.append(own)
    return tuple(found)


def wear_of_meshes(
    start: StartPoint, scene: Scene, meshes: Sequence[WallMesh], blank: Sequence[WornMesh | None]
) -> tuple[WornMesh | None, ...]:
    """What has been taken from each mesh: that of one that was there already goes on, in the precision of `blank`."""
    here = mesh_texts(scene, meshes)
    found = list(blank)
    for number, own in enumerate(blank):
        if own is not None and here[number] in start.meshes:
            name = f"{WORN}[{start.meshes.index(here[number])}]"
            dtype = own.volume.dtype
            stored = start.arrays.get(f"{name}.volume", np.zeros(own.volume.shape)).astype(float)
            stored = stored + start.arrays.get(f"{name}.volume_low", 0.0)
            leading = stored.astype(dtype)
            low = None if own.volume_low is None else on_device(stored - leading, dtype)
            found[number] = WornMesh(on_device(leading, dtype), low)
    return tuple(found)


def unworn_meshes(start: StartPoint, scene: Scene, meshes: Sequence[WallMesh]) -> list[str]:
    """Keys of the walls whose wear begins at zero, of a run before with walls that wear."""
    if not any(name.startswith(WORN) for name in start.arrays):
        return []
    here = zip(meshes, mesh_texts(scene, meshes), strict=True)
    return [mesh.key for mesh, text in here if mesh.wall.wear is not None and text not in start.meshes]


def _moved(
    arrays: Mapping[str, np.ndarray],
    number: int,
    new: MeshList,
    blank: MeshMemory,
    rows: int,
    springs: Sequence[np.ndarray],
) -> MeshMemory:
    """What the contacts with mesh `number` of a checkpoint go on with, moved to the rows of another list by the grains'
    identity; of stored `springs`, and those that were not there stay at rest."""
    if f"neighbors.meshes[{number}].row" not in arrays:
        return blank
    old, now = arrays[f"neighbors.meshes[{number}].row"], np.asarray(new.row)
    place = np.full(max(int(now.max(initial=0)), rows) + 1, -1)
    known = np.flatnonzero(old < rows)
    place[old[known]] = known
    wanted = place[now]

    def carried(parts: Vector, before: Sequence[np.ndarray]) -> Vector:
        found = []
        for part, stored in itertools.zip_longest(parts, before):
            values = np.array(part)
            if stored is not None:
                contacts = min(len(values), len(stored))
                values[:contacts] = np.where(wanted >= 0, stored[:contacts, np.maximum(wanted, 0)], 0.0)
            found.append(on_device(values, values.dtype))
        return tuple(found)

    def stored(name: str, parts: Vector) -> list[np.ndarray]:
        names = [f"state.particles.mesh_memory[{number}].{name}[{k}]" for k in range(len(parts))]
        return [arrays[name] for name in names if name in arrays]

    before = stored("normal", blank.normal), springs, stored("overlap", blank.overlap)
    return MeshMemory(*(carried(parts, own) for parts, own in zip(blank, before, strict=True)))
