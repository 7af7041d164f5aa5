"""From a region of a scene to the part of space that it is. Host, numpy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jaxdem.errors import InputError
from jaxdem.particles import regions
from jaxdem.scene.domain import Box
from jaxdem.scene.regions import Region
from jaxdem.setup.mesh_regions import inside_of_mesh

WHOLE = 1e-9
"""Of a side of the box, by which a region that spans it may differ from it."""


def region_space(key: str, region: Region, box: Box, depth: float = 0.0) -> regions.Region:
    """The part of space that a region of a scene is.

    One that spans a periodic axis from end to end goes round the box there and has no boundary: a box, a polygon in
    3-D along y, and a cylinder along an axis of the box can.

    Args:
        key: of the region in the scene, for the messages.
        region: of the scene.
        box: of the scene.
        depth: up to which distances within the inside of a mesh must be exact: the radius of the largest particle, or
            the diagonal of a cell [m].

    Raises:
        InputError: it has no meaning in this box, lies outside of it, edges of a polygon cross, or a mesh encloses
            nothing.
    """
    solid = {"cylinder": 'use a disc (shape = "sphere") or a box', "mesh": 'use shape = "polygon"'}
    if region.shape in solid and len(box.size) == 2:
        raise InputError(f"{key}.shape", region.shape, "is for 3-D scenes only", solid[region.shape])
    if region.file is not None:
        space = inside_of_mesh(key, region, region.file, box, depth)
    else:
        space = _polygon(key, region, box) if region.vertices is not None else _other(region, box)
    low, high = (np.asarray(corner) for corner in space.bounds)
    if (high <= 0.0).any() or (low >= np.asarray(box.size)).any():
        limit = f"lies wholly outside of the box, 0 ... {box.size} m"
        raise InputError(key, region.shape, limit, "move it into the box; all lengths are in m")
    return space


def require_in_box(key: str, space: regions.Region, box: Box) -> None:
    """Refuses a region of which a part lies outside of the box.

    Raises:
        InputError: naming where it reaches.
    """
    size, (low, high) = np.asarray(box.size), (np.asarray(corner) for corner in space.bounds)
    if (low < -WHOLE * size).any() or (high > (1.0 + WHOLE) * size).any():
        limit = f"reaches from {_point(low)} to {_point(high)} m and must lie in the box, 0 ... {_point(size)} m"
        raise InputError(key, None, limit, "move it into the box, or make it smaller")


def refuse_crossing(key: str, vertices: Sequence[Sequence[float]]) -> None:
    """Refuses a polygon with two edges that cross or touch: it has no inside that one could name.

    Raises:
        InputError: naming the two edges.
    """
    crossing = regions.crossing_edges(vertices)
    if crossing is not None:
        a, b = (f"that from {vertices[k]} to {vertices[(k + 1) % len(vertices)]}" for k in crossing)
        remedy = "give the corners in their order along the boundary"
        raise InputError(key, vertices, f"two edges meet, {a} and {b}", remedy)


def _polygon(key: str, region: Region, box: Box) -> regions.Region:
    vertices = region.vertices or ()
    refuse_crossing(f"{key}.vertices", vertices)
    size = np.ptp(np.asarray(vertices), axis=0)
    if regions.polygon(vertices, None).volume <= WHOLE * float(size @ size):
        raise InputError(f"{key}.vertices", vertices, "the corners lie on one line", "give corners around an area")
    if len(box.size) == 2:
        for name, value in (("from", region.from_), ("to", region.to)):
            if value is not None:
                raise InputError(f"{key}.{name}", value, "is for 3-D scenes only", "remove this key")
        return regions.polygon(vertices, None)
    first, last = region.from_ or 0.0, box.size[1] if region.to is None else region.to
    if not first < last:
        raise InputError(f"{key}.to", last, f"must be above from = {first} m", "exchange from and to")
    return regions.polygon(vertices, (first, last), _goes_round(box, 1, first, last))


def _other(region: Region, box: Box) -> regions.Region:
    if region.start is not None and region.stop is not None:
        return box_space(region.start, region.stop, box)
    if region.center is not None:
        return regions.ball(region.center, region.radius or 0.0)
    base, axis, length = region.base or (), region.axis or (), region.length or 0.0
    turned = [k for k, part in enumerate(axis) if part != 0.0]
    first = base[turned[0]] - (length if axis[turned[0]] < 0.0 else 0.0)
    wraps = len(turned) == 1 and _goes_round(box, turned[0], first, first + length)
    return regions.cylinder(base, axis, region.radius or 0.0, length, wraps)


def box_space(start: Sequence[float], stop: Sequence[float], box: Box) -> regions.Region:
    """The box start ... stop [m]; it goes round along periodic axes that it spans."""
    ends = zip(start, stop, strict=True)
    return regions.box(start, stop, [_goes_round(box, k, *sides) for k, sides in enumerate(ends)])


def _goes_round(box: Box, axis: int, first: float, last: float) -> bool:
    """Whether first ... last [m] is the whole of a periodic axis."""
    return box.periodic[axis] and last - first >= box.size[axis] * (1.0 - WHOLE)


def _point(row: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.5g}" for value in row) + ")"
