"""The tables `[[walls]]` of a scene: walls beside the sides of the box."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from jaxdem.errors import InputError
from jaxdem.scene.base import Direction, NonNegative, Positive, Section, Tables, Vector, WallMaterialName, wrong
from jaxdem.scene.domain import Box
from jaxdem.scene.wall_motion import Piston, WallMotion, check_motion

STRAIGHT = 1e-6
"""Two directions whose angle differs by less from 0 or a half turn are taken for one line [rad]."""

NEEDED = {
    "plane": {"point": "a point of the plane", "normal": "its normal, towards the particles"},
    "cylinder": {"center": "a point on its axis", "radius": "its radius"},
    "wedge": {
        "apex": "a point of the edge where its two planes meet",
        "directions": "two directions, one in each plane, away from the edge",
    },
}
"""Keys that each kind of wall must have, and what they are."""

OF_ALL = ("name", "material", "begin", "end", "motion", "piston")
OPTIONAL = {"plane": OF_ALL, "cylinder": ("axis", "inside", *OF_ALL), "wedge": OF_ALL}
"""Keys that it may have."""


class Wall(Section):
    """A wall. It has the constants of the walls of the box, or its own material. It is at rest without `motion` and
    `piston`.

    Attributes:
        name: by which a probe finds it, different for each. Default: it has its number alone.
        kind: "plane", "cylinder" (of infinite length; in 2-D a circle) or "wedge" (two planes with the particles
            between them).
        point: a point of the plane [m].
        normal: normal of the plane, pointing to the particles; any length.
        center: a point on the axis of the cylinder [m].
        radius: radius of the cylinder [m].
        axis: direction of the cylinder, any length; 3-D only.
        inside: whether the particles are inside the cylinder. Default: true.
        apex: a point of the edge where the two planes of a wedge meet [m].
        directions: two directions, one in each plane of the wedge, at right angles to the edge and away from it; any
            length.
        material: name of one of `[[materials]]`. Default: `contact.wall_material`.
        begin: time from which the wall is there; before it grains pass. It comes with the coupling interval that begins
            nearest to this time, and must not overlap a grain then by more than `contact.maximum_overlap`. Default:
            from the start [s].
        end: time at which the wall vanishes, to the nearest coupling interval: a gate that is opened. Default: never
            [s].
        motion: list of tables, how the wall moves; see `[[walls.motion]]`.
        piston: the wall is held by a force; see `[walls.piston]`.
    """

    name: Annotated[str, Field(strict=True, min_length=1, max_length=100)] | None = None
    kind: Literal["plane", "cylinder", "wedge"]
    point: Vector | None = None
    normal: Direction | None = None
    center: Vector | None = None
    radius: Positive | None = None
    axis: Direction | None = None
    inside: Annotated[bool, Field(strict=True)] | None = None
    apex: Vector | None = None
    directions: tuple[Direction, ...] | None = None
    material: WallMaterialName | None = None
    begin: NonNegative | None = None
    end: Positive | None = None
    motion: Tables[WallMotion] | None = None
    piston: Piston | None = None

    @model_validator(mode="after")
    def _keys_of_its_kind(self) -> Wall:
        needed, optional = NEEDED[self.kind], OPTIONAL[self.kind]
        for name in type(self).model_fields:
            value = getattr(self, name)
            if value is None and name in needed:
                raise wrong(name, None, f"is needed by kind = {self.kind}: {needed[name]}", "add this key")
            if value is not None and name not in ("kind", *needed, *optional):
                limit = f"the keys of a wall of kind {self.kind} are {', '.join((*needed, *optional))}"
                raise wrong(name, value, limit, "remove this key")
        if self.kind == "cylinder" and self.inside is None:
            return self.model_copy(update={"inside": True})
        return self

    @model_validator(mode="after")
    def _begins_before_it_ends(self) -> Wall:
        if self.end is not None and self.end <= (self.begin or 0.0):
            raise wrong("end", self.end, f"must be after begin = {self.begin or 0.0} s", "raise end, or lower begin")
        return self

    @property
    def moves(self) -> bool:
        """Whether it is not at rest."""
        return bool(self.motion) or self.piston is not None

    @model_validator(mode="after")
    def _piston_is_always_there(self) -> Wall:
        if self.piston is not None and (self.begin is not None or self.end is not None):
            key = "begin" if self.begin is not None else "end"
            limit = "a piston is there all the time"
            raise wrong(key, getattr(self, key), limit, "remove this key, or use stages with other walls")
        return self

    @model_validator(mode="after")
    def _angle_of_a_wedge(self) -> Wall:
        if self.directions is None:
            return self
        if len(self.directions) != 2:
            raise wrong("directions", self.directions, "a wedge has two planes", "give two directions: [[...], [...]]")
        a, b = self.directions
        cosine = sum(x * y for x, y in zip(a, b, strict=True)) / (math.hypot(*a) * math.hypot(*b))
        if 1.0 - abs(cosine) < 0.5 * STRAIGHT**2:
            limit = "the planes must enclose an angle between 0 and 180 degrees"
            raise wrong("directions", self.directions, limit, "change one of the directions, or use a plane")
        return self


def check_walls(walls: tuple[Wall, ...], box: Box) -> None:
    """Refuses walls that do not fit the box.

    Raises:
        InputError: a cylinder without an axis in 3-D or with one in 2-D, a wall that changes along a periodic axis, or
            a name that two have.
    """
    solid = len(box.size) == 3
    for k, wall in enumerate(walls):
        key = f"walls.{k}"
        if wall.name is not None and wall.name in [other.name for other in walls[:k]]:
            raise InputError(f"{key}.name", wall.name, "is the name of another wall too", "give each its own name")
        if wall.kind == "plane":
            box.check_same_along_periodic_axes(f"{key}.normal", wall.normal or ())
        elif wall.kind == "wedge":
            for direction in wall.directions or ():
                box.check_same_along_periodic_axes(f"{key}.directions", direction)
        else:
            if (wall.axis is None) == solid:
                words = "is needed in 3-D" if solid else "is for 3-D scenes only"
                remedy = "give a direction in 3-D, and remove this key in 2-D"
                raise InputError(f"{key}.axis", wall.axis, words, remedy)
            axis = wall.axis or (0.0,) * len(box.size)
            across = [float(component == 0.0 or math.hypot(*axis) != abs(component)) for component in axis]
            box.check_same_along_periodic_axes(f"{key}.center", across)
        for n, motion in enumerate(wall.motion or ()):
            check_motion(f"{key}.motion.{n}", motion, box, wall.center)
