"""Where the particles of an inlet come in, for inlets that are no box. Host, numpy."""

from __future__ import annotations

import numpy as np

from jaxdem.errors import InputError
from jaxdem.particles import regions
from jaxdem.particles.inlet_regions import InletRegion, Prism, Round, Tube
from jaxdem.scene.domain import Box
from jaxdem.scene.regions import Region
from jaxdem.setup.regions import region_space, require_in_box

SAMPLES = 20_000
"""Points of a polygon by which the room in it is estimated."""

LEAST_ROOM = 0.02
"""Part of the rectangle round a polygon in which a centre must be able to lie: of 16 places that are tried at once for
a particle, one is free then in 28 % of the intervals."""


def inlet_space(key: str, region: Region, box: Box) -> regions.Region:
    """The part of space of an inlet.

    Args:
        key: of the inlet in the scene, for the messages.
        region: of the scene.
        box: of the scene; the inlet has ends along periodic axes too.

    Raises:
        InputError: the region has no meaning in this box, or reaches out of it.
    """
    closed = Box(box.size, (False,) * len(box.size))
    space = region_space(f"{key}.region", region, closed)
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
    space = inlet_space(key, region, box)
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
        raise InputError(f"{key}.region", region.shape, limit, "enlarge the region, or use a box (start and stop)")
    if region.shape == "sphere":
        return Round(region.center or (), region.radius or 0.0)
    if region.shape == "cylinder":
        axis = np.asarray(region.axis) / np.linalg.norm(region.axis or ())
        return Tube(region.base or (), tuple(axis.tolist()), region.radius or 0.0, region.length or 0.0)
    corners = tuple((float(x), float(z)) for x, z in region.vertices or ())
    ends = () if len(box.size) == 2 else (space.bounds[0][1], space.bounds[1][1])
    return Prism(corners, ends)
