"""What the surfaces within the mesh of the fluid are to the scalars that it carries. Host, numpy."""

from __future__ import annotations

import dataclasses
import math

import jax
import numpy as np

from jaxdem.coupling.open_parts import corner_points, on_corners
from jaxdem.errors import required
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.cut_scalar import ScalarWalls
from jaxdem.fluid.grid import Grid, along
from jaxdem.fluid.scalar_transport import SideKind
from jaxdem.numerics.host import on_device
from jaxdem.scalars.moving_cells import LEAST, exchange_and_area
from jaxdem.scalars.scalars import TEMPERATURE
from jaxdem.scene import Scene
from jaxdem.scene.walls import Wall
from jaxdem.setup.fluid_walls import FluidWalls
from jaxdem.state import Parameters

LENT, LENT_AMONG_GRAINS = 0.5, 0.15
"""Largest part of its capacity that a cell lends to small ones [-]. Among grains a third of a cell may be all of its
fluid."""


@dataclasses.dataclass(frozen=True)
class SurfacesOfScalars:
    """Surfaces within the mesh, as scalars know them.

    Attributes:
        walls: table of the wall that each surface belongs to.
        lent, exchange, area: see `ScalarWalls`, in float64.
        smallest: capacity of a cell over what its open faces pass in explicit steps, the least of all [-].
    """

    walls: tuple[Wall, ...]
    lent: np.ndarray
    exchange: np.ndarray
    area: np.ndarray
    smallest: float

    def kinds(self, name: str) -> tuple[SideKind, ...]:
        """What passes each surface of a field."""
        return tuple(_kind(wall, name) for wall in self.walls)

    def put_into(self, parameters: Parameters, names: list[str]) -> Parameters:
        """The parameters with these surfaces, for fields of these names."""
        scalars, dtype = required(parameters.scalars, "scalars"), np.dtype(parameters.gravity.dtype)

        def numbers(key: str) -> np.ndarray:
            given = [[getattr(wall, key) or 0.0 for wall in self.walls] for _ in names]
            return np.where([[name == TEMPERATURE] for name in names], given, 0.0)

        arrays = (self.lent, self.exchange, self.area, numbers("temperature"), numbers("heat_flux"))
        walls = ScalarWalls(*(on_device(array, dtype) for array in arrays))
        return parameters._replace(scalars=scalars._replace(walls=walls))


def surfaces_of_scalars(scene: Scene, grid: Grid, seen: FluidWalls) -> SurfacesOfScalars | None:
    """The surfaces of a scene with scalars in the fluid; None where there are none.

    Args:
        scene: the scene.
        grid: mesh of the fluid.
        seen: what the fluid sees of the walls.
    """
    if seen.cut is None or (scene.heat is None and not scene.scalars):
        return None
    nearest = on_corners(grid, seen.distance(corner_points(grid)))  # type: ignore[arg-type]
    most = LENT if scene.particles is None else LENT_AMONG_GRAINS
    walls = tuple(scene.walls[number] for number in seen.walls)
    lent, exchange, area, smallest = scalar_geometry(grid, seen.cut, np.asarray(nearest), most)
    if seen.moving is not None and seen.moving.change_place:
        smallest = min(smallest, LEAST)
    return SurfacesOfScalars(walls, lent, exchange, area, smallest)


def scalar_geometry(
    grid: Grid, cut: CutCells, distance: np.ndarray, most: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """`lent`, `exchange`, `area` and `smallest` of `SurfacesOfScalars`.

    Args:
        grid: the grid.
        cut: the open parts.
        distance: from the nearest surface at the corners (n + 1, m + 1, ...) [m].
        most: part of its capacity that a cell lends.
    """
    cut = jax.tree.map(np.asarray, cut)
    exchange, area = map(np.asarray, exchange_and_area(grid, cut, distance))  # type: ignore[arg-type]
    lent, smallest = lent_capacity(grid, cut.open_faces, np.asarray(cut.open_cells), most)  # type: ignore[arg-type]
    return lent, exchange, area, smallest


def lent_capacity(
    grid: Grid, faces: tuple[np.ndarray, ...], open_cells: np.ndarray, most: float
) -> tuple[np.ndarray, float]:
    """What larger cells lend to small ones [-], and the least of capacity over need.

    A cell needs as much as its open faces pass of what those of a whole one do. What it lacks it borrows of the largest
    of its neighbours that an open face leads to.

    Args:
        grid: the grid.
        faces: open fractions.
        open_cells: of the cells.
        most: part of its own that a cell lends.
    """
    places = np.arange(open_cells.size).reshape(open_cells.shape)
    need, largest, lender = np.zeros_like(open_cells), np.full(open_cells.shape, -1.0), places.copy()
    per_face = [1.0 / h**2 for h in grid.spacing]
    for axis, a in enumerate(faces):
        for shift, own in ((1, along(a, axis, None, -1)), (-1, along(a, axis, 1, None))):  # type: ignore[arg-type]
            need += 0.5 * per_face[axis] / sum(per_face) * np.asarray(own)
            is_open = np.asarray(own) > 0.0
            if not grid.periodic[axis]:
                end = 0 if shift == 1 else -1
                is_open[(slice(None),) * axis + (end,)] = False
            beside = np.where(is_open, np.roll(open_cells, shift, axis), -1.0)
            better = beside > largest
            largest = np.where(better, beside, largest)
            lender = np.where(better, np.roll(places, shift, axis), lender)
    short = np.where((open_cells > 0.0) & (largest > open_cells), np.maximum(need - open_cells, 0.0), 0.0)
    asked = np.bincount(lender.ravel(), short.ravel(), open_cells.size).reshape(open_cells.shape)
    share = np.minimum(1.0, most * open_cells / np.where(asked > 0.0, asked, 1.0))
    borrowed = short * share.ravel()[lender]
    given = np.bincount(lender.ravel(), borrowed.ravel(), open_cells.size).reshape(open_cells.shape)
    lent = borrowed - given
    there = (open_cells > 0.0) & (need > 0.0)
    least = np.min((open_cells + lent)[there] / need[there], initial=math.inf)
    return lent, float(least)


def _kind(wall: Wall, name: str) -> SideKind:
    if name != TEMPERATURE:
        return "closed"
    if wall.temperature is not None:
        return "value"
    return "flux" if wall.heat_flux is not None else "closed"
