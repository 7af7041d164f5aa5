"""What `jaxdem check` says of the walls that are meshes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from jaxdem.setup.builder import Case
from jaxdem.setup.mesh_sources import from_to, outside, reached
from jaxdem.setup.meshes import WallMesh
from jaxdem.setup.started_meshes import unworn_meshes


def mesh_rows(case: Case) -> tuple[tuple[str, str], ...]:
    """Key and text of each mesh of a scene."""
    return tuple((mesh.key, _text(mesh)) for mesh in _meshes(case))


def _meshes(case: Case) -> tuple[WallMesh, ...]:
    return () if case.particles is None else case.particles.meshes


def mesh_cautions(case: Case) -> Iterator[str]:
    """A sentence on each mesh whose wear does not go on, and on each that moves and is outside of the box all the time;
    where a piston goes is not known."""
    scene = case.scene
    if case.start is not None:
        for key in unworn_meshes(case.start, scene, _meshes(case)):
            yield (
                f"{key}.wear begins at zero: the run {case.start.source} has walls that wear, and none with the "
                "triangles of this one in its place."
            )
    size = np.asarray(scene.domain.size)
    for mesh in _meshes(case):
        bounds = reached(mesh.wall, mesh.mesh, scene.time.end)
        if mesh.moves and mesh.wall.piston is None and outside(*bounds, size):
            box = " x ".join(f"{length:.4g}" for length in size)
            yield (
                f"{mesh.key}: this mesh moves {from_to(*bounds)} until time.end = {scene.time.end:g} s, outside of the "
                f"box of {box} m all the time. Correct translate, scale or motion, if grains should touch it."
            )


def _text(mesh: WallMesh) -> str:
    lower, upper = mesh.mesh.bounds
    size = " x ".join(f"{length:.4g}" for length in upper - lower)
    flat = mesh.mesh.dimension == 2
    cells, found = ("lines" if flat else "triangles"), mesh.defects
    rims = "closed" if found.is_closed else f"open, {found.open_edges} {'ends' if flat else 'edges at holes and rims'}"
    features = mesh.features
    edges = "" if flat else f"{len(features.edges.patch)} edges and "
    text = f"{len(mesh.mesh.cells)} {cells}, {size} m, {rims}"
    text += f", {found.pieces} pieces" if found.pieces != 1 else ""
    if found.crowded_edges:
        text += f", {found.crowded_edges} {'points' if flat else 'edges'} where more than two {cells} meet"
    sides = "from both sides" if mesh.both else "from the front"
    return f"{text}; touched {sides}; {edges}{len(features.corners.patch)} corners stick out"
