"""The walls of a scene that the fluid sees, and the mesh that they leave open."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from jaxdem.coupling.deposition import Deposition
from jaxdem.errors import InputError
from jaxdem.fluid.boundary import Boundary, coverage, open_fraction
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.grid import Grid
from jaxdem.numerics.host import on_device
from jaxdem.particles.surfaces import Cylinder, Plane
from jaxdem.scene import Scene
from jaxdem.scene.fluid_walls import seen_by_fluid
from jaxdem.scene.wall_motion import WallMotion
from jaxdem.scene.walls import Wall
from jaxdem.setup.cut_cells import FluidSurface, cut_cells_of
from jaxdem.setup.even_deposition import even_factors
from jaxdem.setup.extensions import Extensions
from jaxdem.setup.walls import surfaces_of
from jaxdem.state import Parameters

Points = np.ndarray


@dataclasses.dataclass(frozen=True)
class FluidWalls:
    """What the fluid sees of the walls of a scene.

    Attributes:
        cut: the open parts of its mesh, arrays of NumPy in float64; None where it sees none.
        walls: number in the scene of the wall that each surface belongs to.
        surfaces: that the fluid sees.
        closed_pockets: number of cells that surfaces enclose, without a way out: the fluid there is left out.
    """

    cut: CutCells | None = None
    walls: tuple[int, ...] = ()
    surfaces: tuple[FluidSurface, ...] = ()
    closed_pockets: int = 0

    def with_particles(self, grid: Grid, deposition: Deposition, diameter: float) -> FluidWalls:
        """The same with the weights of the cells for particles up to this diameter [m]."""
        if self.cut is None:
            return self
        open_cells = np.asarray(self.cut.open_cells)
        even = even_factors(grid, deposition, open_cells, self.distance, 0.5 * diameter)
        cut = self.cut._replace(deposit_weights=open_cells * even)  # type: ignore[arg-type]
        return dataclasses.replace(self, cut=cut)

    def distance(self, points: Points) -> np.ndarray:
        """From the nearest surface at points (..., D), positive in the fluid [m]."""
        found: np.ndarray = np.min([surface.distance(points) for surface in self.surfaces], axis=0)
        return found

    def put_into(self, parameters: Parameters) -> Parameters:
        """The parameters with the open parts of the mesh."""
        if self.cut is None or parameters.fluid is None:
            return parameters
        dtype = parameters.gravity.dtype

        def placed(array: np.ndarray) -> object:
            return on_device(array, dtype if array.dtype.kind == "f" else array.dtype)

        whole = {
            name: tuple(placed(part) for part in value) if isinstance(value, tuple) else placed(value)
            for name, value in self.cut._asdict().items()
            if value is not None
        }
        return parameters._replace(fluid=parameters.fluid._replace(cut=CutCells(**whole)))  # type: ignore[arg-type]


def fluid_walls(scene: Scene, grid: Grid, boundary: Boundary, extensions: Extensions) -> FluidWalls:
    """The walls that the fluid sees, as they cut its mesh.

    Args:
        scene: the scene.
        grid: its mesh.
        boundary: its sides.
        extensions: parts of the user.

    Raises:
        InputError: no fluid is left, an inlet or outlet is closed, or a part of the user's does not know of walls.
    """
    seen = seen_by_fluid(scene.walls)
    if not seen:
        return FluidWalls()
    if extensions.get("subgrid") is not None:
        limit = "does not work beside a wall that the fluid sees"
        raise InputError("subgrid", "...", limit, 'leave it out, or set fluid = "none" for all walls')
    surfaces, owners = [], []
    for number, wall in seen:
        for surface in surfaces_of(wall):
            surfaces.append(FluidSurface(_distance(number, surface), wall.fluid == "no_slip", *_moving(wall)))
            owners.append(number)
    cut, pockets = cut_cells_of(grid, surfaces, boundary, scene.particles is not None)
    key = f"walls.{seen[0][0]}.fluid"
    if not np.any(cut.open_cells):
        limit = "the walls that the fluid sees leave no cell of the mesh open"
        remedy = "check the side that the walls face, and the size of the cells (fluid.cells)"
        raise InputError(key, seen[0][1].fluid, limit, remedy)
    _check_openings(scene, grid, boundary, cut)
    return FluidWalls(cut, tuple(owners), tuple(surfaces), pockets)


def wall_speed_in_fluid(scene: Scene) -> float:
    """A speed that no wall exceeds that the fluid sees: the sum over its motions of |v| and |rate| r, r the radius of a
    cylinder or the diagonal of the box [m/s]."""
    fastest = 0.0
    for _, wall in seen_by_fluid(scene.walls):
        reach = (wall.radius if wall.kind == "cylinder" else None) or math.hypot(*scene.domain.size)
        speeds = (math.hypot(*(m.velocity or ())) + abs(m.rate or 0.0) * reach for m in wall.motion or ())
        fastest = max(fastest, sum(speeds))
    return fastest


def _distance(number: int, surface: object) -> Callable[[Points], np.ndarray]:
    """Signed distance of a surface at points (..., D), in float64."""
    if isinstance(surface, Plane):
        normal = np.asarray(surface.normal) / math.hypot(*surface.normal)
        return lambda x: (x - np.asarray(surface.point)) @ normal
    if isinstance(surface, Cylinder):
        return lambda x: _of_cylinder(surface, x)
    limit = "the fluid sees planes, cylinders and wedges"
    raise InputError(f"walls.{number}.fluid", "...", limit, 'set fluid = "none" for this wall')


def _of_cylinder(surface: Cylinder, points: Points) -> np.ndarray:
    across = points - np.asarray(surface.center)
    if surface.axis is not None:
        axis = np.asarray(surface.axis) / math.hypot(*surface.axis)
        across = across - (across @ axis)[..., None] * axis
    gap: np.ndarray = surface.radius - np.linalg.norm(across, axis=-1)
    return gap if surface.inside else -gap


def _moving(wall: Wall) -> tuple[Callable[[Points], np.ndarray] | None, tuple[float, ...] | None]:
    """Velocity at points, and angular velocity, of a wall that moves along itself; None of one at rest."""
    if not wall.motion:
        return None, None
    motions = wall.motion
    size = 3 if len(wall.point or wall.center or wall.apex or ()) == 3 else 1
    spin = np.zeros(size)
    for motion in motions:
        spin = spin + _spin(wall, motion, size)

    def velocity(points: Points) -> np.ndarray:
        total = np.zeros(points.shape)
        for motion in motions:
            if motion.velocity is not None:
                total = total + np.asarray(motion.velocity)
                continue
            arm = points - np.asarray(motion.center or wall.center or wall.point or ())
            turning = _spin(wall, motion, size)
            if size == 1:
                total = total + turning[0] * np.stack([-arm[..., 1], arm[..., 0]], axis=-1)
            else:
                total = total + np.cross(turning, arm)
        return total

    return velocity, tuple(spin.tolist())


def _spin(wall: Wall, motion: WallMotion, size: int) -> np.ndarray:
    if motion.velocity is not None:
        return np.zeros(size)
    axis = motion.axis or wall.axis
    unit = np.ones(1) if size == 1 or axis is None else np.asarray(axis) / math.hypot(*axis)
    return unit * (motion.rate or 0.0)


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
