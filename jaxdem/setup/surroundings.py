"""The search for the neighbours that a learned closure asks for, and which scenes it is not for."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from jaxdem.closures.base import DragClosure
from jaxdem.closures.neighbor_range import DENSEST
from jaxdem.closures.neighbors import NeighborClosure
from jaxdem.coupling.surroundings import Surroundings
from jaxdem.errors import InputError
from jaxdem.particles.cells import CellGrid
from jaxdem.particles.wide_search import Region
from jaxdem.scene import Scene
from jaxdem.setup.particles import ParticleSetup

EXTRA_ROOM = 1.15
"""Room for neighbours and in a cell, over their numbers at the solid fraction from which on the mean law acts alone."""
DISCS = 1000
"""Into which half of the regions of a closure is cut to know their volume."""
LARGEST_RATIO = 1.1
"""Largest over smallest diameter up to which spheres count as equal."""


def surroundings_of(scene: Scene, particles: ParticleSetup, closure: DragClosure) -> Surroundings | None:
    """The search of a scene with a closure of neighbours; None with any other drag law.

    Raises:
        InputError: a scene that is not 3-D, particles that are parcels or of several sizes, a correction that there is
            no rule for, a periodic side shorter than twice the reach, or `closure.hold` with another law.
    """
    if not isinstance(closure, NeighborClosure):
        if scene.closure.hold != 1:
            limit = "is for closures of neighbours, and the drag law is none"
            raise InputError("closure.hold", scene.closure.hold, limit, "set it to 1, or give such a closure")
        return None
    file, diameter = scene.closure.file, particles.bodies.largest_diameter
    _refuse_others(scene, particles)
    reach = closure.reach * diameter
    for axis, wraps in enumerate(scene.periodic):
        if wraps and scene.domain.size[axis] < 2.0 * reach:
            raise InputError(
                "domain.size",
                scene.domain.size,
                f"a periodic side must be at least {2.0 * reach:.4g} m, twice the reach of the closure of neighbours "
                f"({closure.reach:g} diameters)",
                f"enlarge the box, make that side a wall, or leave out closure.file ({file})",
            )
    count = particles.total
    grid = CellGrid(scene.domain.size, scene.periodic, reach, count)
    widths = (length / cells for length, cells in zip(scene.domain.size, grid.shape, strict=True))
    crowd = EXTRA_ROOM * DENSEST * _volume(closure.regions) / (math.pi / 6.0)
    in_cell = EXTRA_ROOM * DENSEST * math.prod(widths) / (math.pi / 6.0 * diameter**3)
    slots, cell_slots = (max(1, min(count, math.ceil(number) + 2)) for number in (crowd, in_cell))
    regions = tuple(Region(along * diameter, across * diameter) for along, across in closure.regions)
    return Surroundings(scene.domain.size, scene.periodic, regions, diameter, slots, cell_slots, scene.closure.hold)


def _volume(regions: Sequence[tuple[float, float]]) -> float:
    """Volume of ellipsoids about one axis, half lengths along it and across it, where they overlap once; by discs."""
    width = max(along for along, _ in regions) / DISCS
    x = (np.arange(DISCS) + 0.5) * width
    squared = [across**2 * (1.0 - (x / along) ** 2) for along, across in regions]
    return float(2.0 * math.pi * width * np.maximum(np.max(squared, axis=0), 0.0).sum())


def _refuse_others(scene: Scene, particles: ParticleSetup) -> None:
    """Raises InputError for what the data of the closure do not have."""
    bodies, coupling = particles.bodies, scene.coupling
    remedy = "leave out closure.file, or use another closure"
    if scene.dimension != 3:
        limit = "is a closure of neighbours: it is of spheres in 3-D, and the scene is 2-D"
        raise InputError("closure.file", scene.closure.file, limit, "give domain.size three lengths, or " + remedy)
    if particles.table.coarse_grain != 1.0:
        limit = "is of grains: a parcel has the neighbours of none of its grains"
        raise InputError("particles.coarse_grain", particles.table.coarse_grain, limit, "set it to 1, or " + remedy)
    if particles.shapes is not None:
        limit = "is a closure of neighbours: it is of spheres"
        raise InputError("closure.file", scene.closure.file, limit, "remove particles.shape, or " + remedy)
    ratio = bodies.largest_diameter / (2.0 * bodies.smallest_radius)
    if ratio > LARGEST_RATIO:
        limit = f"the closure of neighbours is of equal spheres; the largest here is {ratio:.3g} times the smallest, "
        limit += f"and up to {LARGEST_RATIO:g} is taken as equal"
        raise InputError("particles.radius", None, limit, "use one size, or " + remedy)
    if coupling is not None and coupling.self_disturbance:
        limit = "corrects the slip that a law of the mean slip sees; for a closure of neighbours there is no rule"
        raise InputError("coupling.self_disturbance", True, limit, "set it to false, or " + remedy)
