"""Inlets and outlets on walls that the fluid sees: from the scene to the mesh, and what is refused. Host, numpy."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxdem.coupling.open_parts import corner_points, open_faces_of_cells
from jaxdem.coupling.openings import OpeningPlace, opening_parts
from jaxdem.errors import InputError, required
from jaxdem.fluid.boundary import Boundary, coverage
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.grid import Grid
from jaxdem.fluid.interval import SUBSTEPS
from jaxdem.fluid.openings import Opening
from jaxdem.scene import Scene
from jaxdem.scene.fluid_walls import seen_by_fluid
from jaxdem.scene.openings import Opening as OpeningTable
from jaxdem.setup.boundaries import BALANCED, imbalance, inflow_of_sides
from jaxdem.setup.cut_cells import spaces_of
from jaxdem.setup.fluid_surfaces import SeenSurface
from jaxdem.setup.moving_fluid_walls import LARGEST_LEFT, Look
from jaxdem.setup.regions import region_space

SHARED = 1e-6
"""Part of a cell's surface that two openings may both have: rounding [-]."""


@dataclasses.dataclass(frozen=True)
class WallOpening:
    """An opening of a scene.

    Attributes:
        key: of its table in the scene.
        table: of the scene.
        place: where it is.
        area: that it has on the mesh at the start; 0 before it is known [m2].
    """

    key: str
    table: OpeningTable
    place: OpeningPlace
    area: float = 0.0

    @property
    def key_of_amount(self) -> str:
        """Key of what comes in through an inlet."""
        return f"{self.key}.{self.table.given}"

    @property
    def compiled(self) -> Opening:
        """What is compiled of it."""
        given = "velocity" if self.table.by_velocity else "flow"
        return Opening("nothing" if self.is_outlet else given, self.table.ramped_over, self.table.times)  # type: ignore[arg-type]

    @property
    def is_outlet(self) -> bool:
        """Whether it takes what is left over."""
        return self.table.kind == "outlet"

    def flow(self, time: float) -> float:
        """What comes in at a time, by the area at the start; 0 of an outlet [m3/s]."""
        table, amounts = self.table, self.table.amounts
        now = amounts[0] if table.times is None else float(np.interp(time, table.times, amounts))
        ramp = min(time / table.ramped_over, 1.0) if table.ramped_over else 1.0
        return ramp * now * (self.area if table.by_velocity else 1.0)

    @property
    def largest_speed(self) -> float:
        """By the area at the start [m/s]."""
        return max(map(abs, self.table.amounts)) / (1.0 if self.table.by_velocity else self.area)


def wall_openings(scene: Scene, surfaces: Sequence[SeenSurface]) -> tuple[WallOpening, ...]:
    """The openings of the walls that the fluid sees, in the order of the scene.

    Raises:
        InputError: a region lies outside of the box.
    """
    found = []
    for number, wall in seen_by_fluid(scene.walls):
        for k, table in enumerate(wall.opening or ()):
            key = f"walls.{number}.opening.{k}"
            region = None if table.region is None else region_space(f"{key}.region", table.region, scene.box)
            own = tuple(surface.number for surface in surfaces if surface.wall == number)
            found.append(WallOpening(key, table, OpeningPlace(number, own, region)))
    return tuple(found)


def with_openings(
    grid: Grid, cut: CutCells, surfaces: Sequence[SeenSurface], openings: Sequence[WallOpening]
) -> tuple[CutCells, tuple[WallOpening, ...]]:
    """The open parts with the openings where the run begins, and these with their areas.

    Raises:
        InputError: an opening has no surface in its region, or two have the same.
    """
    if not openings:
        return cut, ()
    corners: Any = corner_points(grid)
    distances: list[Any] = [surface.distance_at_start(corners) for surface in surfaces]
    placed = {surface.wall: surface.placed for surface in surfaces}
    parts = tuple(opening_parts(grid, cut, distances, one.place, placed[one.place.wall]) for one in openings)
    found = tuple(
        dataclasses.replace(one, area=float(part.area)) for one, part in zip(openings, parts, strict=True)
    )  # fmt: skip
    for one in found:
        if one.area <= 0.0:
            limit = "has no part of the wall's surface on this mesh"
            remedy = "move it to the surface; it must reach a cell beyond it to both sides"
            raise InputError(f"{one.key}.region", _shape(one), limit, remedy)
    _check_apart(grid, cut, found, [np.asarray(part.supply) for part in parts])
    return cut._replace(openings=parts), found


def _check_apart(grid: Grid, cut: CutCells, openings: Sequence[WallOpening], supplies: Sequence[np.ndarray]) -> None:
    """Refuses two openings on the same part of a surface."""
    sides: Any = [
        (np.diff(np.asarray(a), axis=axis) / grid.spacing[axis]) ** 2 for axis, a in enumerate(cut.open_faces)
    ]  # fmt: skip
    whole = np.sqrt(sum(sides))
    for (first, a), (second, b) in itertools.combinations(zip(openings, supplies, strict=True), 2):
        if np.any(a + b > (1.0 + SHARED) * whole):
            limit = f"is partly the same as that of {first.key}"
            raise InputError(f"{second.key}.region", _shape(second), limit, "move the regions apart")


def check_balance(
    scene: Scene, grid: Grid, boundary: Boundary, cut: CutCells, openings: Sequence[WallOpening], changes: bool
) -> None:
    """Refuses openings by which the volume of the fluid cannot be kept; `changes` where a wall changes its place.

    Raises:
        InputError: an outlet of the box and one of a wall; an opening in a space without a way out; more comes in than
            goes out.
    """
    if not openings:
        return
    outlets = [one for one in openings if one.is_outlet]
    if boundary.has_outlet and outlets:
        limit = "takes what is left over, and so does a side of the box that is an outlet"
        raise InputError(f"{outlets[0].key}.kind", "outlet", limit, "make it an inlet with a negative flow")
    _check_spaces(scene, grid, boundary, cut, openings)
    carries = scene.heat is not None or bool(scene.scalars)
    if boundary.has_outlet or (outlets and not carries):
        return
    by_velocity = [one for one in openings if one.table.by_velocity]
    if changes and by_velocity and not outlets:
        limit = "is over an area of the mesh that changes as walls move, and the box has no outlet"
        raise InputError(by_velocity[0].key_of_amount, "...", limit, "give flow, or make another opening an outlet")
    bends = (time for one in openings for time in (one.table.ramped_over, *(one.table.times or ())))
    for time, net, gross in inflow_of_sides(scene, grid, boundary, bends):
        flows = [one.flow(time) for one in openings]
        net, gross = net + sum(flows), gross + sum(map(abs, flows))
        if outlets and net < -BALANCED * gross:
            limit = f"lets {-net:.4g} m3/s in at t = {time:g} s, and nothing says what that brings"
            raise InputError(f"{outlets[0].key}.kind", "outlet", limit, "make it an inlet, or take off less elsewhere")
        if not outlets and abs(net) > BALANCED * gross:
            raise imbalance(
                openings[0].key_of_amount, net, time, 'make an opening or a side an outlet (kind = "outlet")'
            )


def check_at(scene: Scene, grid: Grid, boundary: Boundary, look: Look, openings: Sequence[WallOpening]) -> None:
    """Refuses walls that cover an opening, or shut it off, at a time of the run, and pistons that openings do not hold.

    Raises:
        InputError: naming the opening and the time, or the piston.
    """
    for one, part in zip(openings, look.cut.openings or (), strict=True):
        if float(part.area) <= 0.0:
            limit = f"is covered by a wall at {look.time:.4g} s"
            raise InputError(f"{one.key}.region", _shape(one), limit, "move the opening, or change the way of the wall")
    if openings:
        _check_spaces(scene, grid, boundary, look.cut, openings)
        if not boundary.has_outlet:
            _check_pistons(scene, look.cut, openings[0].key)


def _check_pistons(scene: Scene, cut: CutCells, opening: str) -> None:
    """Refuses pistons whose load depends on the level of the pressure, where no side of the box sets it: those that
    sweep more than they leave behind."""
    pistons = [k for k, wall in enumerate(scene.walls) if wall.piston is not None and wall.seen_by_fluid]
    for k, unit in zip(pistons, cut.unit_swept or (), strict=True):
        if abs(float(np.sum(unit))) > LARGEST_LEFT * float(np.sum(np.abs(unit))):
            limit = f"is held by the pressure, the level of which neither {opening} nor a side of the box sets"
            remedy = 'make a side of kind "outlet", and the outlet on the wall an inlet with a negative flow'
            raise InputError(f"walls.{k}.piston", "...", limit, remedy)


def _check_spaces(scene: Scene, grid: Grid, boundary: Boundary, cut: CutCells, openings: Sequence[WallOpening]) -> None:
    """Refuses an opening in a space that the fluid cannot leave, and in a box without an outlet openings and inlets in
    several spaces."""
    space, ways_out = spaces_of(grid, boundary, cut.open_faces)
    fluid = np.asarray(open_faces_of_cells(grid, cut.open_faces)) > 0.0
    parts, common = required(cut.openings, "openings"), None
    if not boundary.has_outlet:
        common = {
            int(k)
            for side in boundary.sides
            if side.kind == "inlet"
            for k in np.unique(_at_side(space, side)[_at_side(fluid, side) & _covered(grid, side, space)])
        }
    for one, part in zip(openings, parts, strict=True):
        own = set(np.unique(space[(np.asarray(part.supply) > 0.0) & fluid]).tolist())
        if common is None:
            lost = own - ways_out
        else:
            common |= own
            lost = common if len(common) > 1 else set()
        if lost:
            limit = "is in a space that walls shut off from the outlets and the other openings"
            raise InputError(f"{one.key}.kind", one.table.kind, limit, "move the opening, or make a way for the fluid")


def _at_side(cells: np.ndarray, side: Any) -> np.ndarray:
    return cells[(*(slice(None),) * side.axis, slice(-1, None) if side.upper else slice(0, 1))]


def _covered(grid: Grid, side: Any, cells: np.ndarray) -> np.ndarray:
    return np.broadcast_to(coverage(grid, side) > 0.0, _at_side(cells, side).shape)


def check_speed(grid: Grid, openings: Sequence[WallOpening], interval: float, courant: float) -> None:
    """Refuses an interval in which the fluid of an opening passes more cells than its steps may.

    Raises:
        InputError: naming the opening, and the interval that works.
    """
    for one in openings:
        passed = one.largest_speed * interval / max(grid.spacing)
        most = SUBSTEPS[-1] * courant
        if passed > most:
            limit = (
                f"{one.largest_speed:.4g} m/s crosses {passed:.3g} cells in an interval of {interval:.4g} s; "
                f"{SUBSTEPS[-1]} fluid steps with a Courant number of {courant} allow {most:.3g}"
            )
            remedy = f"set coupling.interval or fluid.time_step to {interval * most / passed:.3g} or less"
            raise InputError(one.key_of_amount, "...", limit, remedy)


def _shape(one: WallOpening) -> str:
    return "the whole wall" if one.table.region is None else one.table.region.shape
