"""What the surfaces within the mesh of the fluid are to the scalars that it carries. Host, numpy."""

from __future__ import annotations

import dataclasses

import jax
import numpy as np

from jaxdem.coupling.open_parts import corner_points, on_corners
from jaxdem.errors import required
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.cut_scalar import ScalarWalls
from jaxdem.fluid.grid import Grid
from jaxdem.fluid.scalar_transport import SideKind
from jaxdem.numerics.host import on_device
from jaxdem.scalars.moving_cells import LEAST, exchange_and_area
from jaxdem.scalars.scalars import TEMPERATURE
from jaxdem.scene import Scene
from jaxdem.scene.openings import Opening
from jaxdem.scene.walls import Wall
from jaxdem.setup.fluid_walls import FluidWalls
from jaxdem.setup.lent_capacity import lent_capacity
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
        openings: of the walls.
    """

    walls: tuple[Wall, ...]
    lent: np.ndarray
    exchange: np.ndarray
    area: np.ndarray
    smallest: float
    openings: tuple[Opening, ...] = ()

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
        brought = tuple(
            on_device(np.array([_brought(one, name) for name in names]), dtype) if one.brings else None
            for one in self.openings
        )
        lent, exchange, area, value, flux = (on_device(array, dtype) for array in arrays)
        walls = ScalarWalls(lent, exchange, area, value, flux, brought or None)
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
    openings = tuple(one.table for one in seen.openings)
    return SurfacesOfScalars(walls, lent, exchange, area, smallest, openings)


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


def _brought(opening: Opening, name: str) -> float:
    """Of a field in what comes in through an opening."""
    return required(opening.temperature if name == TEMPERATURE else (opening.scalars or {}).get(name), name)


def _kind(wall: Wall, name: str) -> SideKind:
    if name != TEMPERATURE:
        return "closed"
    if wall.temperature is not None:
        return "value"
    return "flux" if wall.heat_flux is not None else "closed"
