"""The walls of a scene that the fluid sees, and the mesh that they leave open."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import jax
import numpy as np

from jaxdem.coupling.deposition import Deposition
from jaxdem.coupling.walls_in_fluid import WallsInFluid
from jaxdem.errors import InputError
from jaxdem.fluid.boundary import Boundary, coverage, open_fraction
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.fluid_state import FluidProperties, FluidState, StillDistances
from jaxdem.fluid.grid import Grid
from jaxdem.numerics.host import on_device
from jaxdem.scene import Scene
from jaxdem.scene.fluid_walls import seen_by_fluid
from jaxdem.setup.cut_cells import FluidSurface, cut_cells_of
from jaxdem.setup.cut_liquid import with_layers
from jaxdem.setup.even_deposition import even_factors
from jaxdem.setup.extensions import Extensions
from jaxdem.setup.fluid import courant_limit
from jaxdem.setup.fluid_surfaces import SeenSurface, host_numbers, pistons_in_fluid, surfaces_in_fluid
from jaxdem.setup.moving_fluid_walls import (
    check_bodies_that_come,
    check_way_out,
    looks,
    open_cells_at,
    still_distances,
)
from jaxdem.setup.openings import WallOpening, check_at, check_balance, check_speed, wall_openings, with_openings
from jaxdem.state import Parameters


@dataclasses.dataclass(frozen=True)
class FluidWalls:
    """What the fluid sees of the walls of a scene.

    Attributes:
        cut: the open parts of its mesh at the start, arrays of NumPy in float64; None where it sees none.
        walls: number in the scene of the wall that each surface belongs to.
        surfaces: that the fluid sees.
        closed_pockets: number of cells that surfaces enclose, without a way out: the fluid there is left out.
        moving: the walls that move, as they are compiled; None where none does.
        still: what does not change of a mesh whose surfaces move, arrays of NumPy; None where none does.
        times: at which the run begins, and its coupling interval [s].
        openings: inlets and outlets on the surfaces.
    """

    cut: CutCells | None = None
    walls: tuple[int, ...] = ()
    surfaces: tuple[SeenSurface, ...] = ()
    closed_pockets: int = 0
    moving: WallsInFluid | None = None
    still: StillDistances | None = None
    times: tuple[float, float] = (0.0, 0.0)
    openings: tuple[WallOpening, ...] = ()

    def with_particles(self, grid: Grid, deposition: Deposition, diameter: float) -> FluidWalls:
        """The same with the weights of the cells for particles up to this diameter [m]."""
        if self.cut is None:
            return self
        open_cells = np.asarray(self.cut.open_cells)
        if self.moving is not None and self.moving.change_place:
            cut = self.cut._replace(deposit_weights=self.cut.open_cells)
            return dataclasses.replace(self, cut=cut)
        even = even_factors(grid, deposition, open_cells, self.distance, 0.5 * diameter)
        cut = self.cut._replace(deposit_weights=open_cells * even)  # type: ignore[arg-type]
        return dataclasses.replace(self, cut=cut)

    def distance(self, points: np.ndarray) -> np.ndarray:
        """From the nearest surface where it is at the start, at points (..., D), positive in the fluid [m]."""
        found: np.ndarray = np.min([surface.distance_at_start(points) for surface in self.surfaces], axis=0)
        return found

    def open_cells(self, scene: Scene, time: float, displacements: Sequence[float] | None = None) -> np.ndarray | None:
        """Open part of every cell at a time, at the end of an interval [s], with these displacements of the pistons
        [m]; None without walls in the fluid."""
        if self.cut is None or self.moving is None or self.still is None or not self.moving.change_place:
            return None if self.cut is None else np.asarray(self.cut.open_cells)
        begin, interval = self.times
        middle = max(time - 0.5 * interval, begin + 0.5 * interval)
        numbers = host_numbers(scene, time, displacements)
        return open_cells_at(self.moving, self.still, numbers, time, middle)

    def put_into(self, parameters: Parameters) -> Parameters:
        """The parameters with the open parts of the mesh."""
        if self.cut is None or parameters.fluid is None:
            return parameters
        dtype = parameters.gravity.dtype
        cut, still = jax.tree.map(
            lambda array: on_device(array, dtype if array.dtype.kind == "f" else array.dtype), (self.cut, self.still)
        )
        return parameters._replace(fluid=parameters.fluid._replace(cut=cut, still=still))


def fluid_walls(
    scene: Scene, grid: Grid, boundary: Boundary, extensions: Extensions, begin: float, interval: float
) -> FluidWalls:
    """The walls that the fluid sees, as they cut its mesh.

    Args:
        scene: the scene.
        grid: its mesh.
        boundary: its sides.
        extensions: parts of the user.
        begin: time at which the run begins [s].
        interval: coupling interval [s].

    Raises:
        InputError: no fluid is left, an inlet or outlet is closed, a wall that moves squeezes fluid that cannot
            leave, or a part of the user's does not know of walls.
    """
    seen = seen_by_fluid(scene.walls)
    if not seen:
        return FluidWalls()
    if extensions.get("subgrid") is not None:
        limit = "does not work beside a wall that the fluid sees"
        raise InputError("subgrid", "...", limit, 'leave it out, or set fluid = "none" for all walls')
    surfaces = surfaces_in_fluid(scene, grid, begin, interval)
    own = [FluidSurface(s.distance_at_start, s.no_slip, s.placed) for s in surfaces]
    # A second free surface in a space of its own would need a level of its pressure of its own.
    two_fluids = scene.surface is not None
    cut, pockets = cut_cells_of(grid, own, boundary, scene.particles is not None or two_fluids)
    if two_fluids:
        cut = with_layers(grid, cut, [s.distance_at_start for s in surfaces])
    key = f"walls.{seen[0][0]}.fluid"
    if not np.any(cut.open_cells):
        limit = "the walls that the fluid sees leave no cell of the mesh open"
        remedy = "check the side that the walls face, and the size of the cells (fluid.cells)"
        raise InputError(key, seen[0][1].fluid, limit, remedy)
    _check_openings(scene, grid, boundary, cut)
    cut, openings = with_openings(grid, cut, surfaces, wall_openings(scene, surfaces))
    moving = still = None
    found = tuple(s.moving for s in surfaces if s.moving is not None)
    if found:
        places = tuple(one.place for one in openings)
        moving = WallsInFluid(grid, found, pistons_in_fluid(scene, grid, surfaces), places)
        if moving.pistons and scene.start is not None:
            limit = "does not work with a piston that the fluid sees: the mesh is cut where the scene has it"
            raise InputError("start", "...", limit, 'set fluid = "none" for the piston, or begin without [start]')
        still = still_distances(grid, surfaces)
        if moving.change_place:
            check_bodies_that_come(scene, moving, boundary)
            has_outlet = boundary.has_outlet or any(one.is_outlet for one in openings)
            for look in looks(scene, moving, still, (begin, interval)):
                check_way_out(scene, moving, boundary, look, has_outlet)
                check_at(scene, grid, boundary, look, openings)
                if moving.gates:
                    _check_openings(scene, grid, boundary, look.cut)
    changes = moving is not None and bool(moving.change_place)
    check_balance(scene, grid, boundary, cut, openings, changes)
    check_speed(grid, openings, interval, courant_limit(scene))
    walls = tuple(s.wall for s in surfaces)
    return FluidWalls(cut, walls, surfaces, pockets, moving, still, (begin, interval), openings)


def with_start_of_solver(fluid: FluidState, properties: FluidProperties) -> FluidState:
    """The fluid with what the solver of the pressure between surfaces begins with; the same without surfaces."""
    if properties.cut is None or properties.second is not None:
        return fluid
    pressure = fluid.pressure
    return fluid._replace(pressure_change=on_device(np.zeros(pressure.shape), pressure.dtype))


def _check_openings(scene: Scene, grid: Grid, boundary: Boundary, cut: CutCells) -> None:
    """Refuses inlets and outlets that the walls close, and inlets cut by a wall in a box without an outlet."""
    for name, side in zip(scene.sides, boundary.sides, strict=True):
        end = slice(-1, None) if side.upper else slice(0, 1)
        place = (*(slice(None),) * side.axis, end)
        open_part = np.asarray(cut.open_faces[side.axis])[place]
        outlet, inlet = side.condition.sets_pressure, side.kind == "inlet"
        if not (outlet or inlet):
            continue
        own = open_fraction(grid, side) if outlet else coverage(grid, side)
        own = np.broadcast_to(own, open_part.shape)
        if not np.any((own > 0.0) & (open_part > 0.0)):
            limit = "walls that the fluid sees close all of it"
            raise InputError(f"boundary.{name}.kind", side.kind, limit, "move the wall or the patch of the side")
        if inlet and not boundary.has_outlet and np.any((own > 0.0) & (open_part < 1.0)):
            limit = "a wall that the fluid sees covers a part of it, so that what comes in is less than the scene says"
            remedy = "make a side an outlet, or give the inlet a patch beside the wall"
            raise InputError(f"boundary.{name}.kind", side.kind, limit, remedy)
