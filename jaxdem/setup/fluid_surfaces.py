"""The surfaces that the fluid sees: from the walls of a scene to distances and motions. Host, numpy."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jax import Array

from jaxdem.coupling.open_parts import corner_points
from jaxdem.coupling.pistons_in_fluid import TOUCHING, PistonInFluid, gaps_of
from jaxdem.coupling.walls_in_fluid import FAR, MovingSurface, signed_distance
from jaxdem.errors import InputError, required
from jaxdem.fluid.grid import Grid
from jaxdem.numerics.placement import Placement
from jaxdem.numerics.tables import Window
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.surfaces import Cylinder, Plane
from jaxdem.scene import Scene
from jaxdem.scene.fluid_walls import keeps_place, seen_by_fluid
from jaxdem.scene.walls import Wall
from jaxdem.setup.fluid_meshes import distance_of_body, mesh_distance
from jaxdem.setup.wall_motion import motion_numbers, rigid_motion, tables_of, wall_speed
from jaxdem.setup.wall_times import check_presence
from jaxdem.setup.walls import surfaces_of
from jaxdem.solids.clipping import positive_part
from jaxdem.solids.motion import Drift, RigidMotion, Translation
from jaxdem.solids.motion_tables import number, placement_of, unit

SAME = 1e-9
"""Change of the distance of a surface over a cell, over its size, up to which it is the same [-]."""


@dataclasses.dataclass(frozen=True)
class SeenSurface:
    """A surface of a wall that the fluid sees.

    Attributes:
        number: among the surfaces that the fluid sees.
        wall: number of its wall in the scene.
        no_slip: whether the fluid sticks to it; else it slips freely.
        distance: points (..., D) [m] -> (...) [m] where it is when the run begins, positive in the fluid.
        placed: how it moves then; None for one at rest.
        moving: how it moves, as it is compiled; None for one at rest.
        sampled: distance of a mesh that moves, at the corners of its own mesh; None for others [m].
        far: of one that is not there when the run begins, the distance that stands for it; else None [m].
    """

    number: int
    wall: int
    no_slip: bool
    distance: Callable[[np.ndarray], np.ndarray]
    placed: Placement | None = None
    moving: MovingSurface | None = None
    sampled: np.ndarray | None = None
    far: float | None = None

    def distance_at_start(self, points: np.ndarray) -> np.ndarray:
        """Its distance when the run begins at points (..., D); far where it is not there yet [m]."""
        return self.distance(points) if self.far is None else np.full(points.shape[:-1], self.far)


def surfaces_in_fluid(scene: Scene, grid: Grid, begin: float, interval: float) -> tuple[SeenSurface, ...]:
    """The surfaces that the fluid sees, in the order of the walls.

    Args:
        scene: the scene.
        grid: mesh of the fluid.
        begin: time at which the run begins [s].
        interval: coupling interval [s].

    Raises:
        InputError: a mesh has no inside, or is thinner than the cells, or a wall is there for less than an interval.
    """
    found: list[SeenSurface] = []
    for number_of_wall, wall in seen_by_fluid(scene.walls):
        sticks = wall.fluid == "no_slip"
        motion, stays = motion_in_fluid(wall), keeps_place(wall)
        placed = None if motion is None else placement_of(tables_of(wall), begin)
        if wall.kind == "mesh":
            mesh = _mesh_in_fluid((number_of_wall, len(found)), wall, scene, grid, placed)
            found.append(_in_its_time(mesh, wall, grid, (begin, interval)))
            continue
        for shape in surfaces_of(wall):
            if not isinstance(shape, Plane | Cylinder):
                limit = "the fluid sees planes, cylinders, wedges and meshes"
                raise InputError(f"walls.{number_of_wall}.fluid", "...", limit, 'set fluid = "none" for this wall')
            moving = None
            if motion is not None:
                moving = MovingSurface(len(found), number_of_wall, motion, None if stays else shape)
            distance = _placed_distance(functools.partial(signed_distance, shape), None if stays else placed)
            seen = SeenSurface(len(found), number_of_wall, sticks, distance, placed, moving)
            found.append(_in_its_time(seen, wall, grid, (begin, interval)))
    return tuple(found)


def motion_in_fluid(wall: Wall) -> RigidMotion | None:
    """The motion of a wall, with that of a piston within an interval; None at rest."""
    given = rigid_motion(wall)
    if wall.piston is None:
        return given
    drift = Translation(unit(wall.piston.direction), Drift())
    return RigidMotion((*(() if given is None else given.parts), drift))


def pistons_in_fluid(scene: Scene, grid: Grid, surfaces: Sequence[SeenSurface]) -> tuple[PistonInFluid, ...]:
    """The pistons among the surfaces that the fluid sees.

    Raises:
        InputError: a piston overlaps another wall that is there from the start, and faces it.
    """
    pistons, found = [k for k, wall in enumerate(scene.walls) if wall.piston is not None], []
    if any(scene.walls[k].seen_by_fluid for k in pistons):
        distances: list[Any] = [surface.distance(corner_points(grid)) for surface in surfaces]
    for own in (k for k in pistons if scene.walls[k].seen_by_fluid):
        wall, rows = scene.walls[own], tuple(s.number for s in surfaces if s.wall == own)
        displaced = 0.0
        if wall.kind in ("mesh", "cylinder") and not wall.inside:
            distance: Any = distances[rows[0]]
            solid = 1.0 - np.asarray(positive_part(distance, tuple(range(grid.dimension))).fraction)
            displaced = float(np.sum(solid)) * grid.cell_volume
        direction = unit(required(wall.piston, "piston").direction)
        piston = PistonInFluid(pistons.index(own), own, rows, direction, displaced)
        found.append(_with_others(piston, grid, surfaces, distances))
    return tuple(found)


def _with_others(
    piston: PistonInFluid, grid: Grid, surfaces: Sequence[SeenSurface], distances: Sequence[Any]
) -> PistonInFluid:
    """A piston with what it must not meet, from the distances at the corners where the scene has the walls; see
    `pistons_in_fluid`."""
    others = [surface for surface in surfaces if surface.wall != piston.wall]
    numbers = tuple((s.number, s.wall) for s in others)
    as_apart, as_along = dataclasses.replace(piston, apart=numbers), dataclasses.replace(piston, along=numbers)
    gaps, ahead = (np.asarray(gaps_of(grid, [one], distances))[0] for one in (as_apart, as_along))
    along = []
    for other in others:
        if other.far is not None:
            if _is_same_along(piston, grid, other, distances[other.number]):
                along.append((other.number, other.wall))
        elif gaps[other.number] <= TOUCHING * min(grid.spacing):
            if ahead[other.number] < 0.0:
                limit = f"overlaps walls.{other.wall}, which is ahead of it at the start, and the fluid sees both"
                remedy = "move them apart; they may touch, and it may slide along the wall as in a guide"
                raise InputError(f"walls.{piston.wall}.piston", "...", limit, remedy)
            along.append((other.number, other.wall))
    return dataclasses.replace(piston, apart=tuple(k for k in numbers if k not in along), along=tuple(along))


def _is_same_along(piston: PistonInFluid, grid: Grid, other: SeenSurface, distance: np.ndarray) -> bool:
    """Whether a surface is at rest and the same all along the way of a piston, from its distance at the corners [m]."""
    if other.moving is not None and other.moving.motion is not None:
        return False
    further = other.distance(corner_points(grid) + min(grid.spacing) * np.asarray(piston.direction))
    return bool(np.abs(further - distance).max() < SAME * min(grid.spacing))


def _in_its_time(seen: SeenSurface, wall: Wall, grid: Grid, times: tuple[float, float]) -> SeenSurface:
    """A surface with the time in which its wall is there; `times` are the start of the run and its interval [s]."""
    window, (begin, interval) = Window(wall.begin or 0.0, wall.end or math.inf), times
    if window.is_always:
        return seen
    check_presence(f"walls.{seen.wall}", window, interval)
    moving = seen.moving or MovingSurface(seen.number, seen.wall, None)
    moving = dataclasses.replace(moving, window=window)
    there = moving.is_there(number(begin + 0.5 * interval))
    return dataclasses.replace(seen, moving=moving, far=None if there else FAR * math.hypot(*grid.size))


def _mesh_in_fluid(
    numbers: tuple[int, int], wall: Wall, scene: Scene, grid: Grid, placed: Placement | None
) -> SeenSurface:
    """A mesh that the fluid sees, by its numbers among the walls and the surfaces; `placed` where one that moves is."""
    number_of_wall, own = numbers
    key, sticks, motion = f"walls.{number_of_wall}", wall.fluid == "no_slip", motion_in_fluid(wall)
    if motion is None:
        return SeenSurface(own, number_of_wall, sticks, mesh_distance(key, wall, scene, grid))
    corners, values = distance_of_body(key, wall, scene, grid)
    moving = MovingSurface(own, number_of_wall, motion, corners)
    distance = _placed_distance(functools.partial(corners.distance, values), placed)  # type: ignore[arg-type]
    return SeenSurface(own, number_of_wall, sticks, distance, placed, moving, values)


def host_numbers(scene: Scene, time: float, displacements: Sequence[float] | None = None) -> tuple[Any, ...]:
    """Numbers of the motion of every wall of the scene at a time, in float64.

    Args:
        scene: the scene.
        time: [s].
        displacements: of its pistons; None where the scene has them [m].
    """
    numbers: list[Any] = [motion_numbers(wall, np.asarray) for wall in scene.walls]  # type: ignore[arg-type]
    pistons = [k for k, wall in enumerate(scene.walls) if wall.piston is not None]
    for k, way in zip(pistons, displacements or [0.0] * len(pistons), strict=True):
        own = {"displacement": (number(way), None), "velocity": number(0.0), "since": (number(time), None)}
        numbers[k] = (*numbers[k], own)
    return tuple(numbers)


def wall_speed_in_fluid(scene: Scene) -> float:
    """The largest speed of a given motion in the box, of the walls that the fluid sees [m/s]."""
    return max((wall_speed(scene, number) for number, _ in seen_by_fluid(scene.walls)), default=0.0)


def _placed_distance(
    of_body: Callable[[Vector], Array], placed: Placement | None
) -> Callable[[np.ndarray], np.ndarray]:
    """Signed distance of a surface where it is, at points (..., D), in float64.

    Args:
        of_body: distance in the frame of the body at points, D arrays [m].
        placed: the body; None for one that is where it was given.
    """

    def distance(points: np.ndarray) -> np.ndarray:
        own = tuple(np.moveaxis(points, -1, 0))
        if placed is not None:
            own, _ = placed.to_body(own, (None,) * len(own))  # type: ignore[assignment,arg-type]
        return of_body(own)  # type: ignore[return-value,arg-type]

    return distance
