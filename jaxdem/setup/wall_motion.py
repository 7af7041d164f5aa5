"""How the walls of a scene move: static motions, their numbers, and the refusal of walls that are too fast. Host."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from jax import Array

from jaxdem.errors import InputError, required
from jaxdem.numerics.placement import Placement
from jaxdem.particles.moving_walls import Numbers, Piston, PistonNumbers, SurfaceMotion
from jaxdem.scene import Scene
from jaxdem.scene.fluid_walls import keeps_place
from jaxdem.scene.walls import Wall
from jaxdem.setup.as_arrays import Values
from jaxdem.setup.mesh_sources import placed_mesh
from jaxdem.setup.mesh_tables import hull_of
from jaxdem.setup.particles import ParticleSetup
from jaxdem.setup.walls import surfaces_of
from jaxdem.solids.motion import RigidMotion, Table
from jaxdem.solids.motion_tables import motion_of, number, numbers_of, placement_of, unit

SAMPLES = 800
"""Times at which the speed of a wall is looked at; at phases spread by the golden ratio, so that no frequency of a
motion is missed."""

LARGEST_DISPLACEMENT = 0.1
"""Distance that a wall moves in a contact step, over the radius of the smallest particle, above which it is refused
[-]. A grain that a wall meets at this speed overlaps it by more in one step than a contact should in all."""


def tables_of(wall: Wall) -> dict[str, Any]:
    """A wall as the scene file has it."""
    return wall.model_dump(exclude_none=True)


def rigid_motion(wall: Wall) -> RigidMotion | None:
    """The given motion of a wall; None where there is none."""
    return motion_of(tables_of(wall))


def motion_numbers(wall: Wall, number: Callable[[Values], Array]) -> tuple[dict[str, Array], ...]:
    """The numbers of its parts, each made by `number`."""
    return tuple({name: number(value) for name, value in part.items()} for part in numbers_of(tables_of(wall)))


def all_motion_numbers(scene: Scene, number: Callable[[Values], Array]) -> tuple[Numbers, ...]:
    """Numbers of the motion of every wall; () where none moves."""
    if not any(wall.moves for wall in scene.walls):
        return ()
    return tuple(motion_numbers(wall, number) for wall in scene.walls)


def piston_numbers(scene: Scene, number: Callable[[Values], Array]) -> tuple[PistonNumbers, ...]:
    """The numbers of the pistons of a scene."""
    pistons = [wall.piston for wall in scene.walls if wall.piston is not None]
    return tuple(PistonNumbers(number(one.force), number(one.mass), number(one.damping)) for one in pistons)


def surface_motions(
    scene: Scene, functions: int, sides: int
) -> tuple[tuple[SurfaceMotion | None, ...], tuple[Piston, ...]]:
    """How each surface, and then each mesh, moves, () where all are at rest; and the pistons.

    Args:
        scene: the scene.
        functions: number of walls given as functions, which are at rest.
        sides: number of walls that are sides of the box.
    """
    found: list[SurfaceMotion | None] = []
    pistons: list[Piston] = []
    numbered = list(enumerate(scene.walls))
    analytic = sum(len(surfaces_of(wall)) for wall in scene.walls) + functions
    for index, wall in sorted(numbered, key=lambda one: one[1].kind == "mesh"):
        is_mesh = wall.kind == "mesh"
        count, motion = 1 if is_mesh else len(surfaces_of(wall)), rigid_motion(wall)
        if is_mesh and len(found) < analytic:
            found += [None] * functions
        entry = None if motion is None else SurfaceMotion(motion, index)
        if wall.piston is not None:
            direction = unit(wall.piston.direction)
            entry = SurfaceMotion(motion, index, len(pistons), direction)
            own = tuple(sides + len(found) + k for k in range(count))
            pistons.append(Piston(direction, own, wall.piston.force_times))
        found += [entry] * count
    if len(found) < analytic:
        found += [None] * functions
    return (tuple(found) if any(found) else ()), tuple(pistons)


def placements_at(scene: Scene, time: float) -> tuple[Placement | None, ...]:
    """Where the walls of a scene have moved at a time by their given motions, in float64; None for those at rest."""
    return tuple(placement_of(tables_of(wall), time) if wall.motion else None for wall in scene.walls)


def wall_speed(scene: Scene, number: int) -> float:
    """The largest speed of a given motion in the box during the run, of one of the walls of a scene [m/s].

    That of the points that enclose a mesh, or of the outline of a cylinder that keeps its place; of other walls, which
    may reach through the box, at its corners.
    """
    wall = scene.walls[number]
    if not wall.motion:
        return 0.0
    points = _outermost(f"walls.{number}", wall, scene.dimension)
    return _speed(wall, scene.domain.size, scene.time.end, points)


def _outermost(key: str, wall: Wall, dimension: int) -> tuple[tuple[float, ...], ...]:
    """Points of a wall that turns, without its motion, of which one is the fastest of it; () where it has no end or
    all of it has one speed."""
    if not any(motion.turns for motion in wall.motion or ()):
        return ()
    if wall.kind == "mesh":
        return tuple(map(tuple, hull_of(placed_mesh(key, wall, dimension)).tolist()))
    if wall.kind == "cylinder" and keeps_place(wall):  # it turns about its axis
        axis = np.asarray(unit(wall.axis)) if wall.axis is not None else np.zeros(dimension)
        across = np.eye(dimension)[np.argmin(np.abs(axis))]
        across = across - axis * (axis @ across)
        radius = required(wall.radius, "radius") / np.linalg.norm(across)
        return (tuple((np.asarray(wall.center) + radius * across).tolist()),)
    return ()


@functools.lru_cache(maxsize=64)
def _speed(wall: Wall, box: tuple[float, ...], end: float, points: tuple[tuple[float, ...], ...]) -> float:
    """The largest speed at the corners of the box, or that of these points of the wall (D numbers each), if less."""
    motion, numbers = (
        required(rigid_motion(wall), "motion"),
        [{k: number(v) for k, v in part.items()} for part in numbers_of(tables_of(wall))],
    )
    golden = (math.sqrt(5.0) - 1.0) / 2.0
    times = [0.0, end, *(end * np.modf(golden * np.arange(1.0, SAMPLES))[0])]
    for part in motion.parts:
        changes = [part.active.begin, part.active.end]
        if isinstance(part.course, Table):
            changes += [part.active.begin + time for time in part.course.times]
        times += [time * (1.0 + 1e-12) for time in changes if time < end]
    corners = np.asarray(np.meshgrid(*[(0.0, length) for length in box])).reshape(len(box), -1)
    own = np.asarray(points)
    in_box, of_points = 0.0, 0.0
    for time in times:
        placed = motion.at(numbers, (number(time), None))  # type: ignore[arg-type]
        in_box = max(in_box, _fastest(placed, corners))
        if points:
            turned = own if placed.rotation is None else own @ np.asarray(placed.rotation).T
            of_points = max(of_points, _fastest(placed, (turned + np.asarray(placed.shift)).T))
    return min(in_box, of_points) if points else in_box


def _fastest(placed: Placement, position: np.ndarray) -> float:
    """The largest speed of a body at positions (D, P) [m/s]."""
    velocity = placed.velocity_at(tuple(position))  # type: ignore[arg-type]
    return float(np.sqrt(np.max(sum(np.square(component) for component in velocity))))


def fastest_wall(scene: Scene) -> float:
    """The largest speed of a wall of the scene in the box [m/s]; of pistons only their given motion."""
    return max((wall_speed(scene, number) for number in range(len(scene.walls))), default=0.0)


def check_displacement(scene: Scene, contact_step: float, radius: float) -> None:
    """Refuses walls that would jump into grains within a contact step.

    Args:
        scene: the scene.
        contact_step: [s].
        radius: of the smallest particle [m].

    Raises:
        InputError: naming the motion and the step that works.
    """
    for k in range(len(scene.walls)):
        speed = wall_speed(scene, k)
        if speed * contact_step > LARGEST_DISPLACEMENT * radius:
            longest = LARGEST_DISPLACEMENT * radius / speed
            raise InputError(
                f"walls.{k}.motion",
                f"{speed:.3g} m/s",
                f"the wall moves {speed * contact_step / radius:.3g} radii of the smallest particle in a contact step "
                f"of {contact_step:.3g} s and would jump into grains, the limit is {LARGEST_DISPLACEMENT:g}",
                f"set contact.time_step = {0.99 * longest:.3g} or less, or slow the wall down",
            )


def check_pistons(particles: ParticleSetup, contact_step: float, stable: float) -> None:
    """Refuses pistons that are so light that they swing on the grains faster than the contact step resolves.

    N grains of stiffness k that touch a piston of mass M swing at sqrt(N k/M). A contact step is stable for a grain of
    mass m with two neighbours up to 2/sqrt(2 k/m), which bounds k; N is the section of the box over the square round a
    grain, and at most the number of grains. The swing is kept a factor 2 below the limit, for dashpots. Of several
    materials that of the largest N m counts, by the smallest grain of each: k may be of any of them.

    Args:
        particles: of the scene.
        contact_step: [s].
        stable: longest stable contact step of the grains [s].

    Raises:
        InputError: naming the mass that works.
    """
    scene, bodies = particles.scene, particles.bodies
    if not any(wall.piston for wall in scene.walls):
        return
    columns = np.broadcast_arrays(bodies.radius, bodies.density, bodies.material)
    rows = [columns[2] == material for material in np.unique(bodies.material)]
    smallest = [tuple(float(np.min(x[row])) for x in columns[:2]) for row in rows]
    for k, wall in enumerate(scene.walls):
        if wall.piston is None:
            continue
        direction, size = np.abs(unit(wall.piston.direction)), np.asarray(scene.domain.size)
        sections = np.prod(size) / size
        section, most = float(direction @ sections), particles.total
        counts = [min(max(1.0, section / (2.0 * radius) ** (len(size) - 1)), most) for radius, _ in smallest]
        masses = [4.0 / 3.0 * math.pi * radius**3 * density for radius, density in smallest]
        count, mass = max(zip(counts, masses, strict=True), key=math.prod)
        least = 2.0 * count * mass * (contact_step / stable) ** 2
        if wall.piston.mass < least:
            raise InputError(
                f"walls.{k}.piston.mass",
                wall.piston.mass,
                f"is too light for the contact step of {contact_step:.3g} s: with {count:.3g} grains on it the wall "
                f"would swing faster than this resolves, and needs {least:.3g} kg",
                f"set mass = {1.01 * least:.3g} or more, or lower contact.time_step",
            )
