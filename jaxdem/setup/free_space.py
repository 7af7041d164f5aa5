"""Where the particles of a scene may lie: the box, less what is behind its walls. Host, numpy."""

from __future__ import annotations

import math

from jaxdem.numerics.tables import Window
from jaxdem.particles.regions import Region, box
from jaxdem.particles.walled import WalledRegion
from jaxdem.scene import Scene
from jaxdem.setup.walls import surfaces_of


def free_space(scene: Scene, time: float) -> Region:
    """The box, before the walls of the scene that are there at a time [s]."""
    whole = box((0.0,) * len(scene.domain.size), scene.domain.size, scene.periodic)
    there = [wall for wall in scene.walls if Window(wall.begin or 0.0, wall.end or math.inf).holds(time)]
    surfaces = tuple(surface for wall in there for surface in surfaces_of(wall))
    return WalledRegion(whole.parts, whole.bounds, surfaces=surfaces) if surfaces else whole
