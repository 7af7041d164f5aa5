"""Walls in the fluid that change their place, come or vanish: what does not change of its mesh, and whether the fluid
can make way. Host, numpy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from jaxdem.coupling.open_parts import corner_points, on_corners, open_faces_of_cells
from jaxdem.coupling.walls_in_fluid import WallsInFluid
from jaxdem.errors import InputError
from jaxdem.fluid.boundary import Boundary
from jaxdem.fluid.cut_cells import CutCells
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
        if surface.moving is None or not surface.moving.cuts_anew:
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


def open_cells_at(
    moving: WallsInFluid, still: StillDistances, numbers: Sequence[Any], time: float, middle: float
) -> np.ndarray:
    """Open part of every cell at a time, with the walls of the interval with this middle [s]."""
    places = moving.places(still, numbers, (number(time), None), number(middle))
    return np.asarray(moving.cut(still, places).open_cells)


def check_bodies_that_come(scene: Scene, moving: WallsInFluid, boundary: Boundary) -> None:
    """Refuses bodies in whose place fluid or grains would be lost unseen.

    Raises:
        InputError: a wall comes in a box without an outlet, or a mesh that grains may be within.
    """
    for gate in moving.gates:
        wall, key = scene.walls[gate.wall], f"walls.{gate.wall}.begin"
        if gate.window.begin <= 0.0:
            continue
        if not boundary.has_outlet:
            limit = "the fluid in its place would be lost, of a box that nothing leaves"
            remedy = 'make a side of kind "outlet", or move the wall there from beside the box by walls.motion'
            raise InputError(key, wall.begin, limit, remedy)
        if wall.kind == "mesh" and scene.particles is not None:
            limit = "a mesh that the fluid sees must not come among particles: those within it would not be found"
            remedy = "take planes or a cylinder, or move the mesh there by walls.motion"
            raise InputError(key, wall.begin, limit, remedy)


class Look(NamedTuple):
    """A look at the mesh at a time of the run.

    Attributes:
        time: [s].
        cut: the open parts.
        swept: rate at which walls open the cells, over the volume of a whole one [1/s].
    """

    time: float
    cut: CutCells
    swept: np.ndarray


def looks(scene: Scene, moving: WallsInFluid, still: StillDistances, times: tuple[float, float]) -> Iterator[Look]:
    """The mesh at some times of the run, and with every set of walls that are there.

    Args:
        scene: the scene.
        moving: the walls that move.
        still: what does not change.
        times: at which the run begins, and its coupling interval [s].
    """
    begin, interval = times
    duration = number(interval)
    last = max(begin, scene.time.end - interval)
    changes = {change for gate in moving.gates for change in (gate.window.begin, gate.window.end)}
    for time in sorted({*np.linspace(begin, last, LOOKS).tolist(), *(t for t in changes if begin < t <= last)}):
        span, middle = ((number(time), None), duration), number(time) + 0.5 * duration
        cut, swept = moving.cut_and_swept(still, host_numbers(scene, time), span, middle)
        yield Look(time, cut, np.asarray(swept))


def check_way_out(scene: Scene, moving: WallsInFluid, boundary: Boundary, look: Look, has_outlet: bool) -> None:
    """Refuses walls that squeeze fluid which cannot leave, as far as can be seen at a time of the run.

    Args:
        scene: the scene.
        moving: the walls that move.
        boundary: sides of the box.
        look: at this time.
        has_outlet: whether there is one, on a side or a wall.

    Raises:
        InputError: naming the wall and the time.
    """
    time, cut, swept = look
    wall, cells = moving.change_place[0], np.asarray(cut.open_cells)
    given = scene.walls[wall.wall]
    key = f"walls.{wall.wall}.{'motion' if given.motion else 'piston' if given.piston else 'fluid'}"
    if not np.any(cells):
        limit = f"leaves no cell of the fluid open at {time:.4g} s"
        raise InputError(key, "...", limit, "shorten the way of the wall, or end the run before")
    cut_off = without_a_way_out(moving.grid, boundary, cut.open_faces, cells)
    fluid = np.asarray(open_faces_of_cells(moving.grid, cut.open_faces)) > 0.0
    for name, side in zip(scene.sides, boundary.sides, strict=True):
        place = (*(slice(None),) * side.axis, slice(-1, None) if side.upper else slice(0, 1))
        if side.kind == "inlet" and boundary.has_outlet and np.any((cut_off & fluid)[place]):
            limit = f"shuts the inlet {name} off from the outlets at {time:.4g} s"
            raise InputError(key, "...", limit, "leave a gap of two cells, or another way")
    spaces = [("the fluid there", cut_off & fluid)]
    if not has_outlet:
        spaces.append(("the fluid in the box", ~cut_off & fluid))
    for words, space in spaces:
        if scene.particles is not None and words == "the fluid there" and space.any():
            limit = f"cuts {space.sum()} cells off from the rest of the fluid at {time:.4g} s, with grains"
            raise InputError(key, "...", limit, "leave a gap of two cells, or another way")
        # What pistons sweep is not known before the run; that at 1 m/s shows whether there is a way out.
        for one in (swept, *(np.asarray(unit) for unit in cut.unit_swept or ())):
            if abs(np.sum(one[space])) > LARGEST_LEFT * max(np.sum(np.abs(one)), 1e-300):
                limit = f"squeezes {words} at {time:.4g} s, which has no way out ({space.sum()} cells)"
                raise InputError(key, "...", limit, 'make a side of kind "outlet" there, or move a whole body')
