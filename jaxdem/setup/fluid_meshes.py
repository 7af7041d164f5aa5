"""Meshes that the fluid sees: their signed distance on its mesh; of one that moves on a mesh of its own, which moves
with it. Host, numpy."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy.ndimage import map_coordinates, minimum_filter

from jaxdem.coupling.body_grid import BodyGrid
from jaxdem.errors import InputError
from jaxdem.fluid.grid import Grid
from jaxdem.scene import Scene
from jaxdem.scene.walls import Wall
from jaxdem.setup.mesh_sources import sound_mesh
from jaxdem.setup.meshes import sampled
from jaxdem.solids.defects import Defects
from jaxdem.solids.grid_distance import grid_distance
from jaxdem.solids.mesh_files import HEIGHTS
from jaxdem.solids.surface_mesh import SurfaceMesh

BAND = 2.5
"""Width of the band in which the distance is exact, over the diagonal of a cell: faces at the surface know that of the
next ones [-]."""

FINER = 2
"""Spacing of the fluid's mesh over that of the mesh of a body that moves: what is linear between its corners then adds
a quarter to the error of surfaces that are flat within a cell."""

MOST_UNSEEN = 0.05
"""Part of a mesh that may be so thin that the fluid's mesh has no corner behind it [-]."""


@dataclasses.dataclass(frozen=True)
class SampledDistance:
    """A signed distance known at the corners of the cells, linear between them.

    Attributes:
        values: (n + 1, m + 1, ...) positive in the fluid [m].
        spacing: of the corners [m].
    """

    values: np.ndarray
    spacing: tuple[float, ...]

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """At points (..., D) [m]."""
        place = np.moveaxis(points / np.asarray(self.spacing), -1, 0)
        found: np.ndarray = map_coordinates(self.values, place, order=1, mode="nearest")
        return found


def mesh_distance(key: str, wall: Wall, scene: Scene, grid: Grid) -> SampledDistance:
    """The distance of a mesh of the scene from the corners of the fluid's mesh.

    Args:
        key: of its table, such as walls.0.
        wall: the table.
        scene: the scene.
        grid: mesh of the fluid.

    Raises:
        InputError: the mesh is open or broken, or thinner than the cells.
    """
    mesh = _checked(key, wall, scene)
    reach = BAND * math.hypot(*grid.spacing)
    around = _with_images(mesh, grid, reach)
    found = grid_distance(around, grid.spacing, tuple(n + 1 for n in grid.cells), reach)
    if _is_map(wall) and found.uncovered:
        limit = f"does not cover the box: {found.uncovered} lines of cells are beside the map"
        raise InputError(_source(key, wall), wall.file, limit, "give a larger map, or correct scale and translate")
    values = -found.distance if wall.inside else found.distance
    _check_thickness(_source(key, wall), wall, mesh, grid, values)
    return SampledDistance(values, grid.spacing)


def distance_of_body(key: str, wall: Wall, scene: Scene, grid: Grid) -> tuple[BodyGrid, np.ndarray]:
    """The distance of a mesh that moves, on a mesh of its own round it, positive in the fluid [m].

    Args:
        key: of its table, such as walls.0.
        wall: the table.
        scene: the scene.
        grid: mesh of the fluid.

    Raises:
        InputError: the mesh is open or broken, or thinner than the cells, where it is given.
    """
    reach = BAND * math.hypot(*grid.spacing)
    mesh = _checked(key, wall, scene)
    around = _with_images(mesh, grid, reach)
    lower, upper = around.bounds
    spacing = tuple(h / FINER for h in grid.spacing)
    origin = lower - reach
    corners = tuple(np.ceil((upper - lower + 2.0 * reach) / np.asarray(spacing)).astype(int) + 1)
    moved = around.placed(1.0, np.eye(around.dimension), -origin)
    found = grid_distance(moved, spacing, corners, reach).distance
    body, values = BodyGrid(tuple(origin.tolist()), spacing), -found if wall.inside else found
    lines = [h * np.arange(n + 1) for h, n in zip(grid.spacing, grid.cells, strict=True)]
    seen = np.asarray(body.distance(values, tuple(np.meshgrid(*lines, indexing="ij"))))  # type: ignore[arg-type]
    _check_thickness(_source(key, wall), wall, mesh, grid, seen)
    return body, values


def _with_images(mesh: SurfaceMesh, grid: Grid, reach: float) -> SurfaceMesh:
    """The mesh with its images across periodic sides that are within reach of the box; along the last axis, along which
    it is found what is solid, with whole ones."""
    last = grid.dimension - 1
    across, up = (tuple(p and (a == last) == is_up for a, p in enumerate(grid.periodic)) for is_up in (False, True))
    return mesh.repeated(grid.size, across, reach).repeated(grid.size, up, math.inf)


def _checked(key: str, wall: Wall, scene: Scene) -> SurfaceMesh:
    """The mesh of a wall, which has an inside or is a map of heights."""
    mesh, defects = sound_mesh(key, wall, scene, 0.0)
    if _is_map(wall):
        _check_heights(key, wall)
    else:
        _check_closed(_source(key, wall), wall, mesh, defects)
    return mesh


def _is_map(wall: Wall) -> bool:
    """Whether a mesh is a map of heights."""
    return wall.file is not None and wall.file.lower().endswith(HEIGHTS)


def _source(key: str, wall: Wall) -> str:
    """The key that a mesh is given by."""
    return f"{key}.file" if wall.points is None else f"{key}.points"


def _check_heights(key: str, wall: Wall) -> None:
    if wall.motion:
        limit = "a map of heights that the fluid sees is at rest: it has no other side"
        remedy = 'give a closed mesh, leave this key out, or set fluid = "none"'
        raise InputError(f"{key}.motion", f"{len(wall.motion)} motions", limit, remedy)
    if wall.inside:
        limit = "the fluid is above a map of heights"
        raise InputError(f"{key}.inside", True, limit, "remove this key")
    if any(angle != 0.0 for angle in wall.rotate or ()):
        limit = "a map of heights that the fluid sees stands upright, with the solid below"
        raise InputError(f"{key}.rotate", wall.rotate, limit, "remove this key, or give a closed mesh")


def _check_closed(key: str, wall: Wall, mesh: SurfaceMesh, defects: Defects) -> None:
    """Refuses what has no inside."""
    one, many = ("edge", "edges") if mesh.dimension == 3 else ("end", "ends")
    cells = "triangles" if mesh.dimension == 3 else "lines"
    counts = (
        (defects.open_edges, f"of one of its {cells} alone, at holes and rims"),
        (defects.crowded_edges, f"of more than two {cells}"),
        (defects.flipped, f"{cells} turned over against their neighbours"),
    )
    found = [f"{n} {words if 'turned' in words else f'{one if n == 1 else many} {words}'}" for n, words in counts if n]
    if found:
        limit = f"is no closed surface for the fluid: it has {', and '.join(found)}, of {len(mesh.cells)} {cells}"
        remedy = "close the file, or set repair = true for triangles that are turned over"
        if wall.points is not None:
            remedy = "set closed = true"
        raise InputError(key, wall.file, limit, f'{remedy}; or set fluid = "none"')
    volume = np.einsum("fd,fd->", mesh.area_vectors, mesh.corners.mean(axis=1) - mesh.points.mean(axis=0))
    if wall.touch == "front" and (volume < 0.0) != bool(wall.inside):
        limit = "the fronts of the mesh look away from the fluid, and grains touch its front"
        remedy = f"set inside = {str(not wall.inside).lower()}"
        raise InputError(key.rsplit(".", 1)[0] + ".inside", wall.inside, limit, remedy)


def _check_thickness(key: str, wall: Wall, mesh: SurfaceMesh, grid: Grid, distance: np.ndarray) -> None:
    """Refuses a mesh of which much is so thin that no corner of the cells around it is in the solid."""
    points, _ = sampled(mesh)
    points = points[: len(points) // 2]  # those that are even over its size
    cell = np.floor(points / np.asarray(grid.spacing)).astype(int)
    within = ((cell >= 0) & (cell < np.asarray(grid.cells))).all(axis=1)
    if not within.any():
        return
    lowest = minimum_filter(distance, size=4, origin=-1, mode="nearest")
    unseen = lowest[tuple(cell[within].T)] > -1e-6 * min(grid.spacing)
    if unseen.mean() > MOST_UNSEEN:
        limit = f"{100.0 * unseen.mean():.3g} % of it is thinner than the cells of the fluid, which would flow through"
        remedy = 'raise fluid.cells, make it thicker, or set fluid = "none"'
        raise InputError(key, wall.file, limit, remedy)
