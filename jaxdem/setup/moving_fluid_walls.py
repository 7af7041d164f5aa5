"""Walls in the fluid that change their place: what does not change of its mesh, and whether the fluid can make way.
Host, numpy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxdem.coupling.open_parts import corner_points, on_corners, open_faces_of_cells
from jaxdem.coupling.walls_in_fluid import WallsInFluid
from jaxdem.errors import InputError
from jaxdem.fluid.boundary import Boundary
from jaxdem.fluid.fluid_state import StillDistances
from jaxdem.fluid.grid import Grid
from jaxdem.scene import Scene
from jaxdem.setup.cut_cells import without_a_way_out
from jaxdem.setup.fluid_surfaces import SeenSurface, host_numbers
from jaxdem.solids.clipping import positive_part
from jaxdem.solids.motion_tables import number

LOOKS = 9
"""Times of a run at which it is looked at whether the fluid can make way for walls."""

LARGEST_LEFT = 0.02
"""Net volume that walls sweep over that which they sweep either way, above which a space must have a way out [-]."""


def still_distances(grid: Grid, surfaces: Sequence[SeenSurface]) -> StillDistances:
    """What does not change of a mesh between these surfaces, arrays of NumPy in float64."""
    corners = corner_points(grid)
    kept: list[Any] = []
    distances: list[Any] = []
    for surface in surfaces:
        if surface.moving is not None and surface.moving.shape is not None:
            distances.append(np.zeros(()) if surface.sampled is None else surface.sampled)
            continue
        distances.append(surface.distance(corners))
        kept.append(on_corners(grid, distances[-1]))
    open_faces: Any = None
    if len(kept) < len(surfaces):
        shape = corners.shape[:-1]
        nearest: Any = np.min(kept, axis=0) if kept else np.ones(shape)
        open_faces = tuple(
            np.asarray(positive_part(nearest, tuple(a for a in range(grid.dimension) if a != axis)).fraction)
            for axis in range(grid.dimension)
        )
    sticks: Any = np.asarray([surface.no_slip for surface in surfaces])
    return StillDistances(tuple(distances), sticks, open_faces)


def open_cells_at(moving: WallsInFluid, still: StillDistances, numbers: Sequence[Any], time: float) -> np.ndarray:
    """Open part of every cell at a time [s]."""
    places = moving.places(still, numbers, (number(time), None))
    return np.asarray(moving.cut(still, places).open_cells)


def check_way_out(
    scene: Scene, moving: WallsInFluid, still: StillDistances, boundary: Boundary, times: tuple[float, float]
) -> None:
    """Refuses walls that squeeze fluid which cannot leave, as far as can be seen at some times of the run.

    Args:
        scene: the scene.
        moving: the walls that move.
        still: what does not change.
        boundary: sides of the box.
        times: at which the run begins, and its coupling interval [s].

    Raises:
        InputError: naming the wall and the time.
    """
    begin, interval = times
    key = f"walls.{moving.change_place[0].wall}.motion"
    numbers, duration = host_numbers(scene), number(interval)
    for time in np.linspace(begin, max(begin, scene.time.end - interval), LOOKS):
        cut, found = moving.cut_and_swept(still, numbers, (number(time), None), duration)
        swept, cells = np.asarray(found), np.asarray(cut.open_cells)
        if not np.any(cells):
            limit = f"leaves no cell of the fluid open at {time:.4g} s"
            raise InputError(key, "...", limit, "shorten the way of the wall, or end the run before")
        cut_off = without_a_way_out(moving.grid, boundary, cut.open_faces, cells)
        fluid = np.asarray(open_faces_of_cells(moving.grid, cut.open_faces)) > 0.0
        either_way = np.sum(np.abs(swept))
        spaces = [("the fluid there", cut_off & fluid)]
        if not boundary.has_outlet:
            spaces.append(("the fluid in the box", ~cut_off & fluid))
        for words, space in spaces:
            if scene.particles is not None and words == "the fluid there" and space.any():
                limit = f"cuts {space.sum()} cells off from the rest of the fluid at {time:.4g} s, with grains"
                raise InputError(key, "...", limit, "leave a gap of two cells, or another way")
            if abs(np.sum(swept[space])) > LARGEST_LEFT * max(either_way, 1e-300):
                limit = f"squeezes {words} at {time:.4g} s, which has no way out ({space.sum()} cells)"
                raise InputError(key, "...", limit, 'make a side of kind "outlet" there, or move a whole body')
