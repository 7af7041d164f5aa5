"""From surfaces and regions to the parts of them that are inlets and outlets, see `fluid.openings`; arrays of NumPy or
JAX."""

from __future__ import annotations

from collections.abc import Sequence

from jax import Array

from jaxdem.coupling.open_parts import mean_of_corners, places_in_box
from jaxdem.coupling.surface_velocity import slopes_at_faces
from jaxdem.fluid.cut_cells import CutCells, OpeningParts
from jaxdem.fluid.grid import Grid, along
from jaxdem.numerics.blocks import total
from jaxdem.numerics.host import least_of, namespace
from jaxdem.numerics.placement import Placement
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.regions import Ball, Interval, Region
from jaxdem.solids.clipping import positive_part


@static
class OpeningPlace:
    """Where an opening is; static.

    Attributes:
        wall: number of its wall in the scene.
        surfaces: numbers of the wall's surfaces among those that the fluid sees.
        region: that it is the part of the surfaces in, made of intervals and balls, in the frame of the wall; None for
            the whole of them.
    """

    wall: int
    surfaces: tuple[int, ...]
    region: Region | None = None


def opening_parts(
    grid: Grid, cut: CutCells, distances: Sequence[Array], place: OpeningPlace, placed: Placement | None
) -> OpeningParts:
    """What an opening is to the mesh.

    A cell, or a face, that the region covers in part has that part of the opening: the surface in it is taken to lie in
    the region as its volume does.

    Args:
        grid: the grid.
        cut: the open parts.
        distances: of every surface, at the corners [m].
        place: of the opening.
        placed: its wall; None for one at rest.
    """
    xp, axes = namespace(distances[0]), tuple(range(grid.dimension))
    depth = None if place.region is None else _depth(grid, place.region, placed, distances[0])
    areas = [
        (grid.cell_volume / grid.spacing[axis]) * (along(a, axis, 1, None) - along(a, axis, None, -1))
        for axis, a in enumerate(cut.open_faces)
    ]
    squared = sum(a * a for a in areas)
    own = sum((cut.nearest_to_cells == k for k in place.surfaces), start=cut.nearest_to_cells < 0)
    cuts = own & (squared > 0.0)
    share = 1.0 if depth is None else positive_part(depth, axes).fraction
    area = xp.where(cuts, share * xp.sqrt(xp.where(cuts, squared, 1.0)), 0.0)
    velocity, normals = [], []
    for axis, label in enumerate(cut.nearest_to_faces):
        others = tuple(a for a in axes if a != axis)
        near = [mean_of_corners(distances[k], others) for k in place.surfaces]
        first, normal = near[0], _normal(grid, distances[place.surfaces[0]], axis)
        for k, apart in zip(place.surfaces[1:], near[1:], strict=True):
            normal = xp.where(apart < first, _normal(grid, distances[k], axis), normal)
            first = xp.minimum(apart, first)
        covered = 1.0 if depth is None else positive_part(depth, others).fraction
        here = sum((label == k for k in place.surfaces), start=label < 0)
        velocity.append(xp.where(here, covered * normal, 0.0))
        normals.append(normal)
    return OpeningParts(
        area / grid.cell_volume, tuple(velocity), tuple(normals), total(grid.blocks, xp.sum(area))
    )  # fmt: skip


def _normal(grid: Grid, distance: Array, axis: int) -> Array:
    """Component along an axis of the unit normal of a surface, at the middles of the faces of that axis [-]."""
    xp, slopes = namespace(distance), slopes_at_faces(grid, distance, axis)
    squared = sum(s * s for s in slopes)
    return xp.where(squared > 0.0, slopes[axis] / xp.sqrt(xp.where(squared > 0.0, squared, 1.0)), 0.0)


def _depth(grid: Grid, region: Region, placed: Placement | None, like: Array) -> Array:
    """How deep the corners lie in a region; negative outside, by an upper bound of the distance from it [m]."""
    xp = namespace(like)
    points = tuple(map(xp.asarray, places_in_box(grid, None, like.dtype)))
    if placed is not None:
        own, low = placed.to_body(points, (None,) * len(points))
        points = tuple(x if y is None else x + y for x, y in zip(own, low, strict=True))
    if region.frame is not None:
        from_origin = [x - o for x, o in zip(points, region.origin, strict=True)]
        points = tuple(sum(e * x for e, x in zip(row, from_origin, strict=True)) for row in region.frame)
    return least_of([_depth_in(shape, tuple(points[a] for a in axes)) for axes, shape in region.parts])


def _depth_in(shape: object, points: Vector) -> Array:
    """The same of a shape."""
    xp = namespace(points[0])
    if isinstance(shape, Interval):
        if shape.wraps:
            return xp.full_like(points[0], shape.size)
        return least_of((points[0] - shape.low, shape.high - points[0]))
    assert isinstance(shape, Ball)
    squared = sum((x - c) ** 2 for x, c in zip(points, shape.center, strict=True))
    away = squared > 0.0
    return shape.radius - xp.where(away, xp.sqrt(xp.where(away, squared, 1.0)), 0.0)
