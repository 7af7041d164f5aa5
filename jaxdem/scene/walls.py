"""The tables `[[walls]]` of a scene: walls beside the sides of the box."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import Field

from jaxdem.errors import InputError
from jaxdem.scene.base import Finite, Positive, Rows, Section

STRAIGHT = 1e-6
"""Two directions whose angle differs by less from 0 or a half turn are taken for one line [rad]."""

NEEDED = {"plane": ("point", "normal"), "cylinder": ("center", "radius"), "wedge": ("apex", "directions")}
"""Keys that each kind of wall must have."""

OPTIONAL = {"plane": ("material",), "cylinder": ("axis", "inside", "material"), "wedge": ("material",)}
"""Keys that it may have."""


class Wall(Section):
    """A wall that does not move. It has the constants of the walls of the box, or its own material.

    Attributes:
        kind: "plane", "cylinder" (of infinite length; in 2-D a circle) or "wedge" (two planes with the particles between them).
        point: a point of the plane [m].
        normal: normal of the plane, pointing to the particles; any length.
        center: a point on the axis of the cylinder [m].
        radius: radius of the cylinder [m].
        axis: direction of the cylinder, any length; 3-D only.
        inside: whether the particles are inside the cylinder. Default: true.
        apex: a point of the edge where the two planes of a wedge meet [m].
        directions: two directions, one in each plane of the wedge, at right angles to the edge and away from it; any length.
        material: name of one of `[[materials]]`. Default: `contact.wall_material`.
    """

    kind: Literal["plane", "cylinder", "wedge"]
    point: tuple[Finite, ...] | None = None
    normal: tuple[Finite, ...] | None = None
    center: tuple[Finite, ...] | None = None
    radius: Positive | None = None
    axis: tuple[Finite, ...] | None = None
    inside: Annotated[bool, Field(strict=True)] | None = None
    apex: tuple[Finite, ...] | None = None
    directions: Rows | None = None
    material: str | None = None


def completed_walls(walls: tuple[Wall, ...], dimension: int, periodic: tuple[bool, ...]) -> tuple[Wall, ...]:
    """The walls with their defaults written in, checked.

    Raises:
        InputError: a key is missing, too many or wrong.
    """
    return tuple(_completed(f"walls.{k}", wall, dimension, periodic) for k, wall in enumerate(walls))


def _completed(key: str, wall: Wall, dimension: int, periodic: tuple[bool, ...]) -> Wall:
    _check_keys(key, wall)
    for name in ("point", "center", "apex"):
        _check_vector(f"{key}.{name}", getattr(wall, name), dimension)
    for name in ("normal", "axis"):
        _check_direction(f"{key}.{name}", getattr(wall, name), dimension)
    if wall.kind == "plane":
        _check_periodic(f"{key}.normal", wall.normal or (), periodic)
        return wall
    if wall.kind == "cylinder":
        if (wall.axis is None) == (dimension == 3):
            words = "is needed in 3-D" if dimension == 3 else "is for 3-D scenes only"
            raise InputError(f"{key}.axis", wall.axis, words, "give a direction in 3-D, and remove this key in 2-D")
        across = [0.0 if wall.axis and math.hypot(*wall.axis) == abs(wall.axis[k]) else 1.0 for k in range(dimension)]
        _check_periodic(f"{key}.center", tuple(across), periodic)
        return wall.model_copy(update={"inside": wall.inside is not False})
    _check_wedge(f"{key}.directions", wall.directions or (), dimension)
    for direction in wall.directions or ():
        _check_periodic(f"{key}.directions", direction, periodic)
    return wall


def _check_keys(key: str, wall: Wall) -> None:
    needed, known = NEEDED[wall.kind], NEEDED[wall.kind] + OPTIONAL[wall.kind]
    for name in type(wall).model_fields:
        given = getattr(wall, name) is not None
        if name != "kind" and (given and name not in known or not given and name in needed):
            raise InputError(
                f"{key}.{name}",
                getattr(wall, name),
                f"the keys of a wall of kind {wall.kind} are {', '.join(known)}",
                "remove this key" if given else "add this key",
            )


def _check_vector(key: str, value: tuple[float, ...] | None, dimension: int) -> None:
    if value is not None and len(value) != dimension:
        raise InputError(key, value, f"needs {dimension} numbers, got {len(value)}", f"give {dimension} numbers")


def _check_direction(key: str, value: tuple[float, ...] | None, dimension: int) -> None:
    _check_vector(key, value, dimension)
    if value is not None and math.hypot(*value) == 0.0:
        raise InputError(key, value, "a direction must not be zero", "give a vector that is not zero")


def _check_wedge(key: str, directions: tuple[Any, ...], dimension: int) -> None:
    if len(directions) != 2:
        raise InputError(key, directions, "a wedge has two planes", "give two directions")
    for direction in directions:
        _check_direction(key, direction, dimension)
    a, b = directions
    cosine = sum(x * y for x, y in zip(a, b, strict=True)) / (math.hypot(*a) * math.hypot(*b))
    if 1.0 - abs(cosine) < 0.5 * STRAIGHT**2:
        raise InputError(
            key,
            directions,
            "the planes must enclose an angle between 0 and 180 degrees",
            "change one of the directions, or use a plane",
        )


def _check_periodic(key: str, across: tuple[float, ...], periodic: tuple[bool, ...]) -> None:
    """A wall must be the same along a periodic axis: a particle that has gone round meets it again."""
    for axis, (part, wraps) in enumerate(zip(across, periodic, strict=True)):
        if wraps and part != 0.0:
            raise InputError(
                key,
                f"along axis {axis}",
                "the wall must be the same all along a periodic axis",
                "turn the wall, or do not make that axis periodic",
            )
