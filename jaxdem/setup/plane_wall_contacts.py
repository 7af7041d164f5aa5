"""Walls of a scene that a grain touches at once and that are not at right angles, for the contact step. Host, numpy.

Sides of the box, planes and wedges with each other and with meshes. Those of a mesh alone are in
`solids.simultaneous_contacts`, those of cylinders and functions in `curved_wall_contacts`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from jaxdem.numerics.placement import Placement
from jaxdem.particles.surfaces import Plane
from jaxdem.scene import Scene
from jaxdem.scene.fluid_walls import keeps_place
from jaxdem.scene.walls import Wall
from jaxdem.setup.meshes import WallMesh
from jaxdem.setup.wall_motion import placements_at, wall_speed
from jaxdem.setup.walls import surfaces_of
from jaxdem.solids.motion_tables import unit
from jaxdem.solids.simultaneous_contacts import (
    SAME,
    SimultaneousContacts,
    joined_sets,
    simultaneous_contacts_among,
    worst_of,
)
from jaxdem.solids.touched_planes import Planes, planes_at_once, planes_beside

TOUCHING = 1e-6
"""Gap over the radius of a grain up to which walls touch it [-]."""

TIMES = 32
"""Times at which walls that move are looked at, at phases spread by the golden ratio."""

AHEAD = 0.5
"""A piston has planes ahead and behind whose normals are within 60 degrees of its way [-]."""

PARALLEL = 1e-6
"""Difference of unit vectors below which they are one [-]."""


class PlaneWalls(NamedTuple):
    """Plane walls of a scene at a time, n of them: sides of the box first.

    Attributes:
        normal: (n, D) towards the grains.
        offset: (n,) of n . x = offset [m].
        slack: (n,) how far from there each may be, as it moves [m].
        side: (n,) bool, sides of the box.
        wall: (n,) bool, what grains touch: no periodic sides, nor those that remove grains.
        way: (n, D) unit vector along which a force moves it; zero of others [-].
        lasting: (n,) bool, what is always there, so that no grain comes behind it.
    """

    normal: np.ndarray
    offset: np.ndarray
    slack: np.ndarray
    side: np.ndarray
    wall: np.ndarray
    way: np.ndarray
    lasting: np.ndarray

    @property
    def joined(self) -> np.ndarray:
        """(n, n) bool, pairs that count together.

        They are not at right angles. Sides that face each other are counted elsewhere. Where one of two parallel planes
        moves, nothing says that it comes so near; what a piston has ahead it meets at the end of its way.
        """
        cosine = np.abs(self.normal @ self.normal.T)
        still, side = self.slack == 0.0, self.side
        facing = (still[:, None] & still) & ~(side[:, None] & side)
        ahead = np.abs(self.way @ self.normal.T) > AHEAD
        found = (cosine > SAME) & ((cosine < 1.0 - SAME) | facing) & self.wall[:, None] & self.wall
        np.fill_diagonal(found, False)
        return found & ~ahead & ~ahead.T

    def where_they_are(self) -> PlaneWalls:
        """The same at rest."""
        return self._replace(slack=np.zeros_like(self.slack), way=np.zeros_like(self.way))

    def around(self, radius: float, depth: float) -> Planes:
        """For a grain of this radius that overlaps a wall by up to `depth` [m]."""
        low = np.where(self.wall, radius - depth, 0.0) - self.slack
        high = np.where(self.wall, radius + self.slack, -math.inf)
        return Planes(self.normal, self.offset, low, high, self.lasting, TOUCHING * radius)


def times_of(scene: Scene) -> tuple[list[float], float]:
    """Times at which walls that move are looked at, and the longest way off one of them [s]."""
    if all(not wall.motion or keeps_place(wall) for wall in scene.walls):
        return [0.0], 0.0
    golden = (math.sqrt(5.0) - 1.0) / 2.0
    times = [0.0, *(scene.time.end * (golden * k % 1.0) for k in range(1, TIMES)), scene.time.end]
    return times, 0.5 * float(np.max(np.diff(np.sort(times))))


def plane_walls(scene: Scene, placements: Sequence[Placement | None], between: float) -> PlaneWalls:
    """The planes at a time.

    Args:
        scene: the scene.
        placements: of its walls then.
        between: longest way to this time [s].
    """
    size = np.asarray(scene.domain.size)
    dimension = len(size)
    normal = np.concatenate([np.eye(dimension), -np.eye(dimension)])
    offset = np.concatenate([np.zeros(dimension), -size])
    removes = np.reshape([scene.boundary[name].particles == "remove" for name in scene.sides], (-1, 2))
    wall = (~np.asarray(scene.periodic)[:, None] & ~removes).T.reshape(-1)
    slack, ways = np.zeros(2 * dimension), np.zeros((2 * dimension, dimension))
    lasting = np.ones(2 * dimension, bool)
    for number, (table, placed) in enumerate(zip(scene.walls, placements, strict=True)):
        for surface in surfaces_of(table):
            if not isinstance(surface, Plane):
                continue
            way, point = np.asarray(surface.normal), np.asarray(surface.point)
            way = way / np.linalg.norm(way)
            if placed is not None:
                turn = np.eye(dimension) if placed.rotation is None else np.asarray(placed.rotation)
                way, point = turn @ way, turn @ point + np.asarray(placed.shift)
            far = _slack(scene, table, number, between)
            normal, offset = np.vstack([normal, way]), np.append(offset, way @ point)
            slack, wall, ways = np.append(slack, far), np.append(wall, True), np.vstack([ways, _way(table, dimension)])
            lasting = np.append(lasting, is_lasting(table))
    side = np.arange(len(wall)) < 2 * dimension
    return PlaneWalls(normal, offset, slack, side, wall, ways, lasting)


def is_lasting(wall: Wall) -> bool:
    """Whether a wall is there all the time."""
    return wall.begin is None and wall.end is None


def _way(wall: Wall, dimension: int) -> np.ndarray:
    """(D,) along which a force moves a wall; zero of others."""
    return np.zeros(dimension) if wall.piston is None else np.asarray(unit(wall.piston.direction))


def _slack(scene: Scene, wall: Wall, number: int, between: float) -> float:
    """How far a wall may be from where it is looked at [m]; anywhere, if a force holds it."""
    if wall.piston is not None:
        return math.hypot(*scene.domain.size)
    return 0.0 if not wall.motion or keeps_place(wall) else wall_speed(scene, number) * between


def contacts_with_planes(
    scene: Scene, meshes: Sequence[WallMesh], radius: float, depth: float
) -> tuple[SimultaneousContacts, ...]:
    """The worst walls of the scene that a grain touches at once, of those that are not at right angles.

    Of planes that move all places count at which they are between two of the times that are looked at, and of pistons
    those where they are at the start and all on their way; of meshes that move the places at these times. Walls with
    `begin` or `end` count as all others do, and hide nothing that is behind them.

    Args:
        scene: the scene.
        meshes: its walls that are meshes.
        radius: of the grain [m].
        depth: largest overlap [m].
    """
    times, between = times_of(scene)
    found: list[SimultaneousContacts] = []
    looked_at: set[bytes] = set()
    for time in times:
        placements = placements_at(scene, time)
        walls = plane_walls(scene, placements, between)
        start = [walls.where_they_are()] if time == 0.0 else []
        for view in (walls, *start):
            found += _of_planes(view, view.around(radius, depth))
        for mesh in meshes:
            placed, own = placements[int(mesh.key.split(".")[1])], walls
            if mesh.wall.piston is not None:
                along = np.abs(walls.normal @ _way(mesh.wall, scene.dimension))
                far = math.hypot(*scene.domain.size) * along
                own = walls._replace(slack=walls.slack + far, wall=walls.wall & (along < AHEAD))
            for view in (own, *start):
                arrays = (*view, *(() if placed is None else (placed.rotation, placed.shift)))
                known = b"".join(np.asarray(array, float).tobytes() for array in arrays if array is not None)
                if (mine := mesh.key.encode() + known) not in looked_at:  # what stands still is looked at once
                    looked_at.add(mine)
                    found += _beside_mesh(view, mesh, placed, radius, depth)
    return worst_of(found)


def _of_planes(walls: PlaneWalls, planes: Planes) -> Iterator[SimultaneousContacts]:
    """Of planes with each other."""
    joined = walls.joined
    if not joined.any():
        return
    reached = {tuple(part) for touched in planes_at_once(planes) for part in joined_sets(touched, joined)}
    for part in reached:
        found = simultaneous_contacts_among(walls.normal[list(part)])
        if found is not None:
            yield found


def _beside_mesh(
    walls: PlaneWalls, mesh: WallMesh, placed: Placement | None, radius: float, depth: float
) -> Iterator[SimultaneousContacts]:
    """Of planes with what a grain touches of a mesh: its faces, and the edges and corners at which several meet."""
    planes = walls.around(radius, depth)
    turn = np.eye(mesh.mesh.dimension) if placed is None or placed.rotation is None else np.asarray(placed.rotation)
    shift = np.zeros(len(turn)) if placed is None else np.asarray(placed.shift)
    hull = planes.distances(mesh.hull @ turn.T + shift)
    if (hull.min(axis=0) > planes.high + radius + planes.tolerance).all():
        return
    for piece in mesh.pieces:
        corners, way = piece.corners @ turn.T + shift, piece.centre @ turn.T
        total = turn @ piece.faces.total @ turn.T
        beside = _oblique(walls, total)
        for front in (1.0, -1.0) if mesh.both else (1.0,):
            centres = corners + front * radius * way[:, None]
            near = planes.distances(centres).min(axis=1) <= planes.high + planes.tolerance
            some = np.flatnonzero((near & beside).any(axis=1))
            number, touched = planes_beside(planes, centres[some])
            some = some[number]
            yield from _with_pieces(walls, piece.faces.number[some], total[some], beside[some], touched)


def _oblique(walls: PlaneWalls, total: np.ndarray) -> np.ndarray:
    """(Q, n) bool, planes that are not at right angles to pieces with sums (Q, D, D) of n n^T; see `PlaneWalls.joined`
    for those that are parallel."""
    felt = total @ walls.normal.T
    facing = np.linalg.norm(felt - walls.normal.T, axis=1) < PARALLEL
    found: np.ndarray = (np.linalg.norm(felt, axis=1) > SAME) & ~(facing & (walls.slack > 0.0)) & walls.wall
    return found


def _with_pieces(
    walls: PlaneWalls, number: np.ndarray, total: np.ndarray, beside: np.ndarray, touched: np.ndarray
) -> Iterator[SimultaneousContacts]:
    """Of pieces with such sums over (Q,) faces, beside planes (Q, n) that are touched with them."""
    for row in np.unique(touched, axis=0):
        here = (touched == row).all(axis=1)
        count, tensor = number[here].copy(), total[here].copy()
        for part in joined_sets(row, walls.joined):
            with_it = beside[here][:, part].any(axis=1)
            own = walls.normal[part]
            tensor += np.where(with_it[:, None, None], own.T @ own, 0.0)
            count += np.where(with_it, len(part), 0)
        more = count > number[here]
        if not more.any():
            continue
        values = np.linalg.eigvalsh(tensor[more])
        rank = (values > PARALLEL).sum(axis=1)
        rows = zip(count[more].tolist(), values[:, -1].tolist(), rank.tolist(), strict=True)
        yield from (SimultaneousContacts(*one) for one in set(rows) if one[1] > 1.0 + SAME)
