"""Where walls that a force holds, and that the fluid does not see, meet other walls. Host, numpy.

Walls do not push each other, so a run stops there. A wall that a piston reaches through where the scene has it guides
it: it may slide along, until all of that wall is behind it. Those that the fluid sees are in
`coupling.pistons_in_fluid`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from jaxdem.errors import required
from jaxdem.particles.piston_travel import PistonTravel
from jaxdem.particles.surfaces import Plane
from jaxdem.particles.walls import BoxSide
from jaxdem.scene import Scene
from jaxdem.scene.fluid_walls import keeps_place
from jaxdem.scene.walls import Wall
from jaxdem.setup.meshes import WallMesh
from jaxdem.setup.walls import surfaces_of
from jaxdem.solids.motion_tables import unit
from jaxdem.solids.touched_planes import Planes, planes_at_once

TOUCHING = 1e-6
"""Distance over the size of the box within which walls touch [-]."""


class Obstacle(NamedTuple):
    """What a piston may meet: balls of one radius round points.

    Attributes:
        name: in words.
        points: (P, D) [m].
        radius: [m].
    """

    name: str
    points: np.ndarray
    radius: float = 0.0


class Face(NamedTuple):
    """A plane that is a piston, or that one meets.

    Attributes:
        name: in words.
        normal: (D,) unit vector towards the grains.
        offset: of n . x = offset [m].
    """

    name: str
    normal: np.ndarray
    offset: float


class End(NamedTuple):
    """An end of the way of pistons: see `PistonTravel`.

    Attributes:
        wall: number of the piston's wall.
        name: of what it meets.
        rates: by number of the wall of each piston that takes part.
        most: [m].
    """

    wall: int
    name: str
    rates: dict[int, float]
    most: float


def piston_travel(scene: Scene, sides: Sequence[BoxSide], meshes: Sequence[WallMesh]) -> PistonTravel | None:
    """The ends of the ways of the pistons that the fluid does not see; None where there is none.

    Of a plane or wedge: sides of the box, planes, in 2-D circles from outside, and meshes, all at rest and always
    there; the place where no room is left before it; and another plane that faces it and that a force holds. Of a mesh,
    and in 2-D of a circle from outside: sides and planes. What moves by `motion`, has `begin` or `end`, cylinders in
    3-D, and meshes with each other are not looked at.

    Args:
        scene: the scene.
        sides: of the box that are walls.
        meshes: its walls that are meshes.
    """
    held = [k for k, wall in enumerate(scene.walls) if wall.piston is not None]
    pistons = [k for k in held if not scene.walls[k].seen_by_fluid and _stays(scene.walls[k])]
    if not pistons:
        return None
    room, placed = _room(scene, sides), {int(mesh.key.split(".")[1]): mesh for mesh in meshes}
    bodies = list(_bodies_at_rest(scene, placed))
    tolerance = TOUCHING * math.hypot(*scene.domain.size)
    ends: list[End] = []
    for k in pistons:
        way = np.asarray(unit(required(scene.walls[k].piston, "piston").direction))
        own = _own_faces(k, scene.walls[k])
        for face in own:
            ends += _ends_of_face(k, face, way, room, bodies, tolerance)
        body = None if own else _body(k, scene.walls[k], placed)
        if body is not None:
            stops = [face for face, is_wall in zip(room.faces, room.walls, strict=True) if is_wall]
            ends += _ends_of_body(k, body, way, stops, tolerance)
    ends += _facing(scene, pistons, tolerance)
    if not ends:
        return None
    rates = tuple(tuple(end.rates.get(k, 0.0) for k in held) for end in ends)
    most, names = tuple(end.most for end in ends), tuple((end.wall, end.name) for end in ends)
    return PistonTravel(rates, most, tuple(held), names)


def _stays(wall: Wall) -> bool:
    """Whether it is always there and no motion moves it from its place."""
    return wall.begin is None and wall.end is None and (not wall.motion or keeps_place(wall))


def _own_faces(number: int, wall: Wall) -> list[Face]:
    found = []
    for plane in surfaces_of(wall):
        if isinstance(plane, Plane):
            normal = np.asarray(unit(plane.normal))
            found.append(Face(f"walls.{number}", normal, float(normal @ np.asarray(plane.point))))
    return found


class Room(NamedTuple):
    """What planes at rest and the sides of the box leave.

    Attributes:
        faces: n of them, the sides first.
        walls: (n,) bool, what stops a wall: not periodic sides, and not those through which grains leave.
        open: (n,) bool, the latter.
        corners: (C, D) of the room [m].
        faces_at: (C, n) bool, on which faces each is.
    """

    faces: list[Face]
    walls: np.ndarray
    open: np.ndarray
    corners: np.ndarray
    faces_at: np.ndarray

    def obstacles(self) -> Iterator[Obstacle]:
        """The faces that are walls, as far as they bound the room."""
        for k in np.flatnonzero(self.walls & self.faces_at.any(axis=0)):
            yield Obstacle(self.faces[k].name, self.corners[self.faces_at[:, k]])


def _room(scene: Scene, sides: Sequence[BoxSide]) -> Room:
    size, dimension = np.asarray(scene.domain.size), scene.dimension
    closed = {(side.axis, side.inward < 0) for side in sides}
    faces, walls, opened = [], [], []
    for axis in range(dimension):
        for upper, sign in ((False, 1.0), (True, -1.0)):
            name = f"the {scene.sides[2 * axis + upper]} side of the box"
            faces.append(Face(name, sign * np.eye(dimension)[axis], -upper * float(size[axis])))
            walls.append((axis, upper) in closed)
            opened.append(not walls[-1] and not scene.periodic[axis])
    for k, wall in enumerate(scene.walls):
        if wall.piston is None and _stays(wall):
            faces += _own_faces(k, wall)
    rest = len(faces) - len(walls)
    normals, offsets = np.stack([face.normal for face in faces]), np.array([face.offset for face in faces])
    flat = np.zeros(len(faces))
    planes = Planes(normals, offsets, flat, flat, np.ones(len(offsets), bool), TOUCHING * math.hypot(*size))
    touched = planes_at_once(planes)
    corners = [np.linalg.lstsq(normals[on], offsets[on], rcond=None)[0] for on in touched]
    return Room(faces, np.array(walls + rest * [True]), np.array(opened + rest * [False]), np.stack(corners), touched)


def _bodies_at_rest(scene: Scene, meshes: dict[int, WallMesh]) -> Iterator[Obstacle]:
    """Circles and cylinders with grains outside, and meshes, as far as they are in the box."""
    size = np.asarray(scene.domain.size)
    for k, wall in enumerate(scene.walls):
        if wall.piston is not None or not _stays(wall):
            continue
        body = _body(k, wall, meshes)
        if body is None:
            continue
        inside = ((body.points >= -body.radius) & (body.points <= size + body.radius)).all(axis=1)
        if inside.any():
            yield body._replace(points=body.points[inside])


def _body(number: int, wall: Wall, meshes: dict[int, WallMesh]) -> Obstacle | None:
    """A mesh, or a circle with grains outside; None of other walls."""
    if wall.kind == "mesh":
        mesh = meshes[number].mesh
        return Obstacle(f"walls.{number}", mesh.points[np.unique(mesh.cells)])
    if wall.kind == "cylinder" and wall.inside is False and wall.axis is None:
        return Obstacle(f"walls.{number}", np.asarray(wall.center)[None], required(wall.radius, "radius"))
    return None


def _ends_of_face(
    number: int, face: Face, way: np.ndarray, room: Room, bodies: Sequence[Obstacle], tolerance: float
) -> Iterator[End]:
    """Of a plane: what is ahead of it as a whole; a body that it reaches through is passed when all of it is behind,
    and the room between planes that it reaches through ends at its last corner."""
    rate = float(face.normal @ way)
    if rate < TOUCHING:
        return
    blocked = False
    for obstacle, is_plane in [*((one, True) for one in room.obstacles()), *((one, False) for one in bodies)]:
        ahead = obstacle.points @ face.normal - face.offset
        nearest, last = float(ahead.min()) - obstacle.radius, float(ahead.max()) + obstacle.radius
        if nearest > tolerance or (last > tolerance and not is_plane):
            blocked = blocked or is_plane
            yield End(number, obstacle.name, {number: rate}, nearest if nearest > tolerance else last)
    far = room.corners @ face.normal - face.offset
    on = room.faces_at[int(np.argmax(far))]
    if not blocked and far.max() > tolerance and not (on & room.open).any():
        names = dict.fromkeys(room.faces[k].name for k in np.flatnonzero(on & room.walls))
        yield End(number, " and ".join(names), {number: rate}, float(far.max()))


def _ends_of_body(
    number: int, body: Obstacle, way: np.ndarray, faces: Sequence[Face], tolerance: float
) -> Iterator[End]:
    """Of a mesh or circle: the planes and sides ahead of it."""
    for face in faces:
        rate = -float(face.normal @ way)
        gap = body.points @ face.normal - face.offset
        nearest, last = float(gap.min()) - body.radius, float(gap.max()) + body.radius
        if rate > TOUCHING and last > tolerance:
            yield End(number, face.name, {number: rate}, nearest if nearest > tolerance else last)


def _facing(scene: Scene, pistons: Sequence[int], tolerance: float) -> Iterator[End]:
    """Of two planes that face each other and that forces hold."""
    ways = {k: np.asarray(unit(required(scene.walls[k].piston, "piston").direction)) for k in pistons}
    for position, k in enumerate(pistons):
        for other in pistons[position + 1 :]:
            for one in _own_faces(k, scene.walls[k]):
                for two in _own_faces(other, scene.walls[other]):
                    gap = -two.offset - one.offset
                    if float(one.normal @ two.normal) < TOUCHING - 1.0 and gap > tolerance:
                        rates = {k: float(one.normal @ ways[k]), other: float(two.normal @ ways[other])}
                        yield End(k, two.name, rates, gap)
