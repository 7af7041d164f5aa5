"""Curved walls that a grain touches together with another wall: cylinders, and functions of the user. Host, numpy.

Where it does is found by Newton's method from points all over the box. See `plane_wall_contacts` for plane walls.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from jaxdem.numerics.placement import Placement
from jaxdem.particles.surfaces import Cylinder
from jaxdem.scene import Scene
from jaxdem.scene.fluid_walls import keeps_place
from jaxdem.setup.plane_wall_contacts import PARALLEL, PlaneWalls, is_lasting, plane_walls, times_of
from jaxdem.setup.wall_functions import WallFunctions
from jaxdem.setup.wall_motion import placements_at
from jaxdem.setup.walls import surfaces_of
from jaxdem.solids.simultaneous_contacts import SimultaneousContacts, worst_of

POINTS = 64
"""Places in the box from which two walls are approached."""

STEPS = 30
"""Of Newton's method. Near walls that touch each other it halves the distance in each."""

ROUNDING = 1e-6
"""Distance over the size of the box within which a point is on a wall: also functions in float32 have it [-]."""

ACROSS = 1e-5
"""Cosine below which two walls are at right angles [-]."""

Distances = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Points (P, D) [m] -> distances of n walls (P, n) [m], and their slopes (P, n, D)."""


def contacts_with_curved_walls(
    scene: Scene, functions: WallFunctions, radius: float, depth: float
) -> tuple[SimultaneousContacts, ...]:
    """The worst of curved walls with each other, with sides of the box and with planes, of those that a grain touches
    at once and that are not at right angles.

    Cylinders that move are looked at at some times, and where the scene has them if a force holds them.

    Args:
        scene: the scene.
        functions: walls of the user.
        radius: of the grain [m].
        depth: largest overlap [m].
    """
    cylinders = [wall for wall in scene.walls if wall.kind == "cylinder"]
    if not cylinders and functions.distances is None:
        return ()
    times, between = times_of(scene)
    found: list[SimultaneousContacts] = []
    for time in times:
        placements = placements_at(scene, time)
        planes = plane_walls(scene, placements, between)
        curved = [
            _of_cylinder(surface, None if keeps_place(wall) else placed)
            for wall, placed in zip(scene.walls, placements, strict=True)
            for surface in surfaces_of(wall)
            if isinstance(surface, Cylinder)
        ]
        lasting = [*(is_lasting(wall) for wall in cylinders), *functions.lasting]
        if functions.distances is not None:
            curved.append(functions.distances)
        found += _found(scene, planes, curved, lasting, radius, depth)
    return worst_of(found)


def _of_cylinder(cylinder: Cylinder, placed: Placement | None) -> Distances:
    """Distance and slope of a cylinder, of a circle in 2-D."""
    center, sign = np.asarray(cylinder.center), -1.0 if cylinder.inside else 1.0
    turn = np.eye(len(center))
    across = turn if cylinder.axis is None else turn - np.outer(*[_unit(np.asarray(cylinder.axis))] * 2)
    if placed is not None:
        turn = turn if placed.rotation is None else np.asarray(placed.rotation)
        center, across = turn @ center + np.asarray(placed.shift), turn @ across @ turn.T

    def distances(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        arm = (x - center) @ across
        far = np.linalg.norm(arm, axis=1)
        slope = arm / np.where(far > 0.0, far, 1.0)[:, None]
        return sign * (far - cylinder.radius)[:, None], sign * slope[:, None]

    return distances


def _unit(vector: np.ndarray) -> np.ndarray:
    found: np.ndarray = vector / np.linalg.norm(vector)
    return found


def _found(
    scene: Scene,
    planes: PlaneWalls,
    curved: Sequence[Distances],
    lasting: Sequence[bool],
    radius: float,
    depth: float,
) -> Iterator[SimultaneousContacts]:
    """At one time; `lasting` are the curved walls that are always there."""
    size = np.asarray(scene.domain.size)
    tolerance = ROUNDING * float(size.max())

    def distances(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of all walls: planes first."""
        columns = [
            (x @ planes.normal.T - planes.offset, np.broadcast_to(planes.normal, (len(x), *planes.normal.shape)))
        ]
        columns += [of(x) for of in curved]
        return tuple(np.concatenate(parts, axis=1) for parts in zip(*columns, strict=True))  # type: ignore[return-value]

    start = np.random.default_rng(0).random((POINTS, len(size))) * size
    count, first = distances(start[:1])[0].shape[1], len(planes.offset)
    walls = np.append(planes.wall, np.ones(count - first, bool))
    slack = np.append(planes.slack, np.zeros(count - first))
    bounds = np.concatenate([planes.lasting, np.array(lasting, bool)])
    low = np.where(walls, radius - depth, 0.0) - slack - tolerance
    high = np.where(walls, radius, -np.inf) + slack + tolerance
    pairs = [pair for pair in itertools.combinations(np.flatnonzero(walls).tolist(), 2) if pair[1] >= first]
    tried = list(itertools.product(pairs, *[(radius - depth, radius)] * 2))
    if not tried:
        return
    pair = np.repeat([one for one, _, _ in tried], POINTS, axis=0)
    x = _approached(
        distances, pair, np.repeat([far for _, *far in tried], POINTS, axis=0), np.tile(start, (len(tried), 1))
    )
    distance, normal = distances(x)
    steep = np.linalg.norm(normal, axis=2)
    normal = normal / np.where(steep > 0.0, steep, 1.0)[:, :, None]
    front = distance >= low
    touched = front & (distance <= high)
    there = (front | ~bounds).all(axis=1) & np.take_along_axis(touched, pair, axis=1).all(axis=1)
    for one in pairs:
        own = there & (pair == one).all(axis=1)
        if own.any():
            yield from _at_points(normal[own], touched[own], one, slack > 0.0)


def _approached(distances: Distances, pair: np.ndarray, wanted: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Points (P, D) with two distances (P, 2) from two walls (P, 2), or not: where these are too far apart, there are
    none."""
    for _ in range(STEPS):
        distance, slope = distances(x)
        off = np.take_along_axis(distance, pair, axis=1) - wanted
        off = np.where(np.isfinite(off), off, 0.0)  # where a function is no number, there is no way to its wall
        rows = np.take_along_axis(slope, pair[:, :, None], axis=1)
        a, b, c = ((rows[:, i] * rows[:, j]).sum(axis=1) for i, j in ((0, 0), (0, 1), (1, 1)))
        a, c = a + PARALLEL**2, c + PARALLEL**2
        determinant = a * c - b * b
        one, other = (c * off[:, 0] - b * off[:, 1]) / determinant, (a * off[:, 1] - b * off[:, 0]) / determinant
        x = x - rows[:, 0] * one[:, None] - rows[:, 1] * other[:, None]
    return x


def _at_points(
    normal: np.ndarray, touched: np.ndarray, pair: tuple[int, int], moves: np.ndarray
) -> Iterator[SimultaneousContacts]:
    """At points with unit normals (P, n, D) of the walls that are touched there (P, n); with a pair of them goes what
    is not at right angles to one of the two."""
    cosine = np.abs(normal @ normal[:, pair].transpose(0, 2, 1))
    with_pair = (cosine > ACROSS).any(axis=2) & touched
    with_pair[:, pair] = True
    facing = cosine[:, pair[0], 1]
    joined = (facing > ACROSS) & ~((facing > 1.0 - PARALLEL) & moves[list(pair)].any())
    normal, with_pair = normal[joined], with_pair[joined]
    felt = np.where(with_pair[:, :, None], normal, 0.0)
    values = np.linalg.eigvalsh(felt.transpose(0, 2, 1) @ felt)
    for number in np.unique(with_pair.sum(axis=1)):
        own = values[with_pair.sum(axis=1) == number]
        yield SimultaneousContacts(int(number), float(own[:, -1].max()), int((own > PARALLEL).sum(axis=1).min()))
