"""Where the particles of an inlet come in, for inlets that are no box. Host, numpy."""

from __future__ import annotations

import numpy as np

from jaxdem.errors import InputError
from jaxdem.particles import regions
from jaxdem.particles.inlet_regions import Cubes, InletRegion, Prism, Round, Tube, cubes_in
from jaxdem.scene.domain import Box
from jaxdem.scene.regions import Region
from jaxdem.setup.regions import region_space, require_in_box

SAMPLES = 20_000
"""Points of a polygon by which the room in it is estimated."""

ROOMIER = "enlarge the region, take a box (start and stop), or use smaller particles"
LEAST_ROOM = 0.02
"""Part of the rectangle round a polygon in which a centre must be able to lie: of 16 places that are tried at once for
a particle, one is free then in 28 % of the intervals."""

CUBES = 20_000
"""About as many cubes the inside of a mesh is made of."""

THINNEST = 10.0
"""Volume of the box around a mesh over its own from which on the cubes are larger than that."""


def inlet_space(key: str, region: Region, box: Box, largest: float = 0.0) -> regions.Region:
    """The part of space of an inlet.

    Args:
        key: of the inlet in the scene, for the messages.
        region: of the scene.
        box: of the scene; the inlet has ends along periodic axes too.
        largest: see `inlet_region`.

    Raises:
        InputError: the region has no meaning in this box, or reaches out of it.
    """
    closed = Box(box.size, (False,) * len(box.size))
    space = region_space(f"{key}.region", region, closed, largest)
    require_in_box(f"{key}.region", space, closed)
    return space


def inlet_region(key: str, region: Region, box: Box, largest: float) -> InletRegion:
    """From where places are drawn.

    Args:
        key, region, box: see `inlet_space`.
        largest: radius of the largest particle that comes [m].

    Raises:
        InputError: see `inlet_space`; or it has no room for such a particle.
    """
    space = inlet_space(key, region, box, 2.0 * largest)
    if region.shape == "mesh":
        return _cubes(key, region, space, largest)
    if region.shape == "polygon":
        low, high = (np.asarray(corner) for corner in space.bounds)
        points = np.random.default_rng(0).uniform(
            low + largest, np.maximum(high - largest, low + largest), (SAMPLES, len(low))
        )
        room = float(space.inside(points, largest).mean())
    else:
        radius, length = region.radius or 0.0, region.length or 2.0 * largest
        room = float(radius >= largest and length >= 2.0 * largest)
    if room < LEAST_ROOM:
        limit = f"has no room for a particle of radius {largest:.4g} m"
        if room > 0.0:
            limit = f"has room for a particle of radius {largest:.4g} m in {100 * room:.2g} % of the rectangle round it"
        raise InputError(f"{key}.region", region.shape, limit, ROOMIER)
    if region.shape == "sphere":
        return Round(region.center or (), region.radius or 0.0)
    if region.shape == "cylinder":
        axis = np.asarray(region.axis) / np.linalg.norm(region.axis or ())
        return Tube(region.base or (), tuple(axis.tolist()), region.radius or 0.0, region.length or 0.0)
    corners = tuple((float(x), float(z)) for x, z in region.vertices or ())
    ends = () if len(box.size) == 2 else (space.bounds[0][1], space.bounds[1][1])
    return Prism(corners, ends)


def _cubes(key: str, region: Region, space: regions.Region, largest: float) -> Cubes:
    """The inside of a mesh, less a layer beside its surface that is about one cube thicker than a radius.

    Raises:
        InputError: it has no room for a particle.
    """
    low, high = (np.asarray(corner) for corner in space.bounds)
    edge = (space.volume / CUBES) ** (1.0 / 3.0)
    # No finer than the particles need it; a mesh that fills little of the box around it has larger cubes.
    edge = max(edge, 0.1 * largest, (float(np.prod(high - low)) / (THINNEST * CUBES)) ** (1.0 / 3.0))
    for part in (1.0, 0.5):
        found = cubes_in(space.inside, (low, high), part * edge, largest)
        if found is not None:
            return found
    limit = f"has no room for a particle of radius {largest:.4g} m"
    raise InputError(f"{key}.region", region.shape, limit, ROOMIER)
