"""Where the particles of a scene may lie: the box, less what is behind its walls. Host, numpy."""

from __future__ import annotations

import math

import numpy as np

from jaxdem.numerics.placement import Placement
from jaxdem.numerics.tables import Window
from jaxdem.particles.regions import Region, box
from jaxdem.particles.surfaces import MovedSurface, Surface
from jaxdem.particles.walled import WalledRegion
from jaxdem.scene import Scene
from jaxdem.setup.wall_motion import placements_at
from jaxdem.setup.walls import surfaces_of


def free_space(scene: Scene, time: float) -> Region:
    """The box, before the walls of the scene that are there at a time [s]."""
    whole = box((0.0,) * len(scene.domain.size), scene.domain.size, scene.periodic)
    there = [
        (wall, placed)
        for wall, placed in zip(scene.walls, placements_at(scene, time), strict=True)
        if Window(wall.begin or 0.0, wall.end or math.inf).holds(time)
    ]
    surfaces = tuple(_moved(surface, placed) for wall, placed in there for surface in surfaces_of(wall))
    return WalledRegion(whole.parts, whole.bounds, surfaces=surfaces) if surfaces else whole


def _moved(surface: Surface, placed: Placement | None) -> Surface:
    """The surface where its motion has it, itself where that is its own place."""
    if placed is None:
        return surface
    turn, shift = np.eye(placed.dimension) if placed.rotation is None else np.asarray(placed.rotation), placed.shift
    if not np.any(shift) and np.array_equal(turn, np.eye(placed.dimension)):
        return surface
    return MovedSurface(surface, tuple(map(tuple, turn.tolist())), tuple(np.asarray(shift).tolist()))
