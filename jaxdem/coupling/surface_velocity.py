"""The velocity of surfaces that the fluid sees, on the faces of its mesh; arrays of NumPy or JAX."""

from __future__ import annotations

from collections.abc import Sequence

from jax import Array

from jaxdem.coupling.open_parts import mean_of_corners, places_in_box
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.grid import FaceField, Grid, along, divergence, own_layers
from jaxdem.fluid.mesh import beyond
from jaxdem.numerics.host import namespace
from jaxdem.numerics.placement import Placement
from jaxdem.numerics.vectors import Vector
from jaxdem.solids.clipping import positive_part


def with_velocity(
    grid: Grid, cut: CutCells, distances: Sequence[Array], placements: Sequence[Placement | None]
) -> CutCells:
    """The open parts with the velocity of the surfaces, each at the foot of the perpendicular from a face's middle.

    Args:
        grid: the grid.
        cut: the open parts.
        distances: of every surface, at the corners [m].
        placements: of every surface; None for one at rest.
    """
    velocity = []
    for axis, label in enumerate(cut.nearest_to_faces):
        own = namespace(label).zeros_like(cut.open_faces[axis])
        for k, placed in enumerate(placements):
            if placed is not None:
                on_surface = placed.velocity_at(feet(grid, distances[k], axis))[axis]
                own = namespace(label).where(label == k, on_surface, own)
        velocity.append(own)
    return cut._replace(velocity=tuple(velocity), spin=_spin(distances[0], placements))


def _spin(like: Array, placements: Sequence[Placement | None]) -> Array | None:
    """(S, A) angular velocity of every surface; None where none turns [rad/s]."""
    turning = [None if placed is None else placed.angular_velocity for placed in placements]
    found = [w for w in turning if w is not None]
    if not found:
        return None
    xp = namespace(like)
    return xp.stack([xp.zeros_like(found[0]) if w is None else w for w in turning])


def feet(grid: Grid, distance: Array, axis: int) -> Vector:
    """The points of a surface that are nearest to the middles of the faces of an axis, by the slope of its distance;
    the middles themselves where that is not near one, as in the middle of a gap.

    Args:
        grid: the grid.
        distance: at the corners [m].
        axis: of the faces.
    """
    xp, slopes = namespace(distance), slopes_at_faces(grid, distance, axis)
    apart = mean_of_corners(distance, tuple(a for a in range(grid.dimension) if a != axis))
    squared = sum(s * s for s in slopes)
    usable = (squared > 0.5) & (squared < 2.0)
    way = xp.where(usable, apart / xp.where(usable, squared, 1.0), 0.0)
    points = places_in_box(grid, axis, distance.dtype)
    return tuple(x - way * s for x, s in zip(points, slopes, strict=True))


def slopes_at_faces(grid: Grid, distance: Array, axis: int) -> Vector:
    """Slopes of a distance at the middles of the faces of an axis, from its values at the corners [-]."""
    xp, slopes = namespace(distance), []
    for k in range(grid.dimension):
        others = tuple(a for a in range(grid.dimension) if a not in (axis, k))
        near = mean_of_corners(distance, others)
        if k != axis:
            slopes.append((along(near, k, 1, None) - along(near, k, None, -1)) / grid.spacing[k])
            continue
        steps = (along(near, k, 1, None) - along(near, k, None, -1)) / grid.spacing[k]
        ends = beyond(grid, k, steps, (-1,), (0,), own_layers(steps, k))
        wide = xp.concatenate((ends[0], steps, ends[1]), k)
        slopes.append(0.5 * (along(wide, k, None, -1) + along(wide, k, 1, None)))
    return tuple(slopes)


def swept(
    grid: Grid, cut: CutCells, still: FaceField, bodies: Sequence[tuple[Array, Sequence[int], Placement]], all_of: Array
) -> Array:
    """Rate at which surfaces that change their place open the cells, over the volume of a whole cell [1/s].

    Solid passes through the part of a face that a body closes, with the body's velocity in the middle of that part:
    what it brings into a cell goes out through the open faces. Summed over a body within the box it is zero to
    rounding, and a uniform stream that moves with a body obeys continuity exactly.

    Args:
        grid: the grid.
        cut: the open parts between all surfaces.
        still: open fractions of the faces between the surfaces that keep their place.
        bodies: of each body that changes its place the distance at the corners, together with all before it and the
            still ones; the numbers of its surfaces; and its placement.
        all_of: distance from all surfaces at the corners [m].
    """
    xp, flux = namespace(all_of), []
    for axis, (open_part, label) in enumerate(zip(cut.open_faces, cut.nearest_to_faces, strict=True)):
        others = tuple(a for a in range(grid.dimension) if a != axis)
        before, total = still[axis], xp.zeros_like(open_part)
        for distance, numbers, placed in bodies:
            now = positive_part(distance, others).fraction
            speed = placed.velocity_at(_middles_of_closed(grid, distance, now, axis))[axis]
            rest = sum((label == k for k in numbers), start=label < 0)
            # Of a face that is open by so little that it is closed, the rest is closed by the nearest surface.
            closed = xp.where(rest, positive_part(all_of, others).fraction - open_part, 0.0)
            total = total + (before - now + closed) * speed
            before = now
        flux.append(total)
    return xp.where(cut.open_cells > 0.0, divergence(grid, tuple(flux)), 0.0)


def _middles_of_closed(grid: Grid, distance: Array, open_part: Array, axis: int) -> Vector:
    """The middles of the closed parts of the faces of an axis, as if a straight line cut them off."""
    xp, slopes = namespace(distance), list(slopes_at_faces(grid, distance, axis))
    slopes[axis] = xp.zeros_like(slopes[axis])
    size = sum(abs(s) for s in slopes)
    share = xp.where(size > 0.0, 0.5 * open_part / xp.where(size > 0.0, size, 1.0), 0.0)
    points = places_in_box(grid, axis, distance.dtype)
    return tuple(x - share * h * s for x, h, s in zip(points, grid.spacing, slopes, strict=True))
