"""The sides of the box as walls."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array
from jax.typing import DTypeLike

from jaxdem.numerics.compensated import Low
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector


@static
class BoxSide:
    """A flat side of the box; static.

    Attributes:
        axis: the axis it is normal to.
        coordinate: where it stands on that axis [m].
        inward: +1 for the lower side, -1 for the upper.
    """

    axis: int
    coordinate: float
    inward: int


def box_sides(
    box: tuple[float, ...], periodic: tuple[bool, ...], without: tuple[tuple[int, int], ...] = ()
) -> tuple[BoxSide, ...]:
    """The walls of a box, lower and upper side of every axis that is not periodic.

    Args:
        box: side lengths [m].
        periodic: whether each axis is periodic.
        without: (axis, inward) of sides that are no wall.
    """
    return tuple(
        BoxSide(axis, coordinate, inward)
        for axis, length in enumerate(box)
        if not periodic[axis]
        for coordinate, inward in ((0.0, 1), (length, -1))
        if (axis, inward) not in without
    )


def wall_overlap(side: BoxSide, position: Vector, low: tuple[Low, ...], radius: Array) -> Array:
    """(N,) depth by which the particles reach into the wall, negative for a gap [m].

    radius - gap, in an order in which both differences of leading parts are exact near the wall, so that
    only the trailing part rounds.
    """
    high = position[side.axis]
    gap = high - side.coordinate if side.inward > 0 else side.coordinate - high
    overlap = radius - gap
    trailing = low[side.axis]
    return overlap if trailing is None else overlap - side.inward * trailing


def wall_normals(sides: tuple[BoxSide, ...], dtype: DTypeLike, dimension: int) -> Vector:
    """Unit vectors from the walls into the box, D arrays (S, 1)."""
    return tuple(
        jnp.asarray([[float(side.inward) if axis == side.axis else 0.0] for side in sides], dtype)
        for axis in range(dimension)
    )
