"""The tables `[[walls]]` of a scene: walls beside the sides of the box."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, model_validator

from jaxdem.errors import InputError
from jaxdem.scene.base import (
    Direction,
    Finite,
    Name,
    NonNegative,
    Positive,
    Rows,
    Section,
    Tables,
    Vector,
    WallMaterialName,
    one_number,
    wrong,
)
from jaxdem.scene.domain import Box
from jaxdem.scene.openings import Opening
from jaxdem.scene.wall_motion import Piston, WallMotion, check_motion
from jaxdem.scene.wear import Wear

STRAIGHT = 1e-6
"""Two directions whose angle differs by less from 0 or a half turn are taken for one line [rad]."""

NEEDED = {
    "plane": {"point": "a point of the plane", "normal": "its normal, towards the particles"},
    "cylinder": {"center": "a point on its axis", "radius": "its radius"},
    "wedge": {
        "apex": "a point of the edge where its two planes meet",
        "directions": "two directions, one in each plane, away from the edge",
    },
    "mesh": {},
}
"""Keys that each kind of wall must have, and what they are."""

OF_ALL = ("name", "material", "begin", "end", "motion", "piston", "fluid", "opening", "temperature", "heat_flux")
OF_MESH = (
    "file", "points", "scale", "rotate", "translate", "spacing", "closed", "touch", "smooth_angle", "repair",
)  # fmt: skip
OPTIONAL = {
    "plane": OF_ALL,
    "cylinder": ("axis", "inside", *OF_ALL),
    "wedge": OF_ALL,
    "mesh": (*OF_MESH, "wear", "inside", *OF_ALL),
}
"""Keys that it may have."""


MESH_DEFAULTS: dict[str, object] = {
    "scale": 1.0, "closed": False, "touch": "both", "smooth_angle": 1.0, "repair": False,
}  # fmt: skip
"""Keys of a mesh that are written out."""


class Wall(Section):
    """A wall. It has the constants of the walls of the box, or its own material. It is at rest without `motion` and
    `piston`.

    Attributes:
        name: by which a probe finds it, different for each. Default: it has its number alone.
        kind: "plane", "cylinder" (of infinite length; in 2-D a circle), "wedge" (two planes with the particles
            between them) or "mesh" (triangles from a file; in 2-D straight lines).
        point: a point of the plane [m].
        normal: normal of the plane, pointing to the particles; any length.
        center: a point on the axis of the cylinder [m].
        radius: radius of the cylinder [m].
        axis: direction of the cylinder, any length; 3-D only.
        inside: whether the particles are inside the cylinder. Default: true. Of a closed mesh that the fluid sees,
            whether the fluid is inside of it. Default: false.
        apex: a point of the edge where the two planes of a wedge meet [m].
        directions: two directions, one in each plane of the wedge, at right angles to the edge and away from it; any
            length.
        file: of a mesh: its triangles (.stl, .obj, .ply), or a map of heights (.npy; .txt or .csv with a row of heights
            along y for each x; .asc, the text grid of ESRI). In 2-D a drawing (.svg) or heights along x. Relative to
            the scene.
        points: of a mesh in 2-D, in place of `file`: corners of a line in their order, two at least [m].
        scale: factor by which the coordinates of the file or the points are multiplied: 0.001 for millimetres. Default:
            1 [-].
        rotate: angles about the x, y and z axis, by which the scaled mesh is turned about the origin in this order; in
            2-D one angle, from the first axis to the vertical one. Default: none [degrees].
        translate: is added to the turned coordinates. Default: zero [m].
        spacing: of a map of heights: distance of its columns and rows before scaling; in 2-D one number [m].
        closed: of a mesh: true refuses one with holes, and joins the last of `points` to the first. Default: false.
        touch: sides from which grains touch a mesh: "both", or its "front" alone, and what is behind it is solid. The
            front of a triangle is where its corners appear counter-clockwise, outside of a solid in most files; that of
            a line in 2-D is to the right of its way; that of heights is above. Default: "both".
        smooth_angle: up to which neighbouring triangles bend to count as one smooth surface, with one contact at a
            time. Default: 1 [degrees].
        repair: whether a broken mesh is mended: triangles without size or that are there twice are left out, and those
            that are turned over are turned back. Default: false, and it is refused.
        material: name of one of `[[materials]]`. Default: `contact.wall_material`.
        begin: time from which the wall is there; before it grains pass. It comes with the coupling interval that begins
            nearest to this time, and must not overlap a grain then by more than `contact.maximum_overlap`. Not for a
            mesh with `touch = "front"`. Default: from the start [s].
        end: time at which the wall vanishes, to the nearest coupling interval: a gate that is opened. Default: never
            [s].
        motion: list of tables, how the wall moves; see `[[walls.motion]]`.
        piston: the wall is held by a force; see `[walls.piston]`.
        wear: how grains wear a mesh; see `[walls.wear]`. Default: not at all.
        fluid: what the wall is to the fluid: "none" (it flows through), "no_slip" (it sticks to the wall) or
            "free_slip". A mesh that the fluid sees is closed, or a map of heights with the fluid above. Default:
            "none".
        opening: list of tables, inlets and outlets on a wall that the fluid sees; see `[[walls.opening]]`.
        temperature: temperature of the wall, for grains that touch it and for the fluid that sees it. Default: no heat
            passes it [K].
        heat_flux: heat flux from a wall into the fluid that sees it, in place of a temperature [W/m2].
    """

    name: Annotated[str, Field(strict=True, min_length=1, max_length=100)] | None = None
    kind: Literal["plane", "cylinder", "wedge", "mesh"]
    point: Vector | None = None
    normal: Direction | None = None
    center: Vector | None = None
    radius: Positive | None = None
    axis: Direction | None = None
    inside: Annotated[bool, Field(strict=True)] | None = None
    apex: Vector | None = None
    directions: tuple[Direction, ...] | None = None
    file: Name | None = None
    points: Annotated[Rows, Field(min_length=2)] | None = None
    scale: Positive | None = None
    rotate: Annotated[tuple[Finite, ...], BeforeValidator(one_number)] | None = None
    translate: Vector | None = None
    spacing: Annotated[tuple[Positive, ...], BeforeValidator(one_number)] | None = None
    closed: Annotated[bool, Field(strict=True)] | None = None
    touch: Literal["both", "front"] | None = None
    smooth_angle: Annotated[float, Field(ge=0.0, le=30.0, strict=True)] | None = None
    repair: Annotated[bool, Field(strict=True)] | None = None
    material: WallMaterialName | None = None
    begin: NonNegative | None = None
    end: Positive | None = None
    motion: Tables[WallMotion] | None = None
    piston: Piston | None = None
    wear: Wear | None = None
    fluid: Literal["none", "no_slip", "free_slip"] | None = None
    opening: Tables[Opening] | None = None
    temperature: Finite | None = None
    heat_flux: Finite | None = None

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
        if self.kind == "mesh":
            if self.inside is not None and not self.seen_by_fluid:
                limit = "says on which side of a mesh the fluid is, and the fluid does not see this one"
                raise wrong("inside", self.inside, limit, 'remove this key, or set fluid = "no_slip"')
            update = {name: value for name, value in MESH_DEFAULTS.items() if getattr(self, name) is None}
            return self.model_copy(update=update)
        return self

    @model_validator(mode="after")
    def _mesh_from_a_file_or_points(self) -> Wall:
        if self.kind == "mesh" and (self.file is None) == (self.points is None):
            limit = "a mesh has either a file or, in 2-D, points"
            raise wrong("file", self.file, limit, "add the key file" if self.file is None else "remove one of the keys")
        return self

    @model_validator(mode="after")
    def _begins_before_it_ends(self) -> Wall:
        if self.end is not None and self.end <= (self.begin or 0.0):
            raise wrong("end", self.end, f"must be after begin = {self.begin or 0.0} s", "raise end, or lower begin")
        return self

    @property
    def seen_by_fluid(self) -> bool:
        """Whether the fluid does not flow through it."""
        return self.fluid in ("no_slip", "free_slip")

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
        if wall.kind == "mesh":
            _check_mesh(key, wall, box)
        elif wall.kind == "plane":
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


def _check_mesh(key: str, wall: Wall, box: Box) -> None:
    """Refuses keys of a mesh that do not fit the box.

    Raises:
        InputError: points in 3-D or of another number of coordinates, another number of angles or spacings, or a motion
            along a periodic axis.
    """
    solid = len(box.size) == 3
    ways = [(f"motion.{n}", motion.velocity or motion.direction) for n, motion in enumerate(wall.motion or ())]
    ways += [] if wall.piston is None else [("piston", wall.piston.direction)]
    for name, way in ways:
        if any(wraps and component for wraps, component in zip(box.periodic, way or (), strict=False)):
            limit = "moves along a periodic axis, out of its images there"
            raise InputError(f"{key}.{name}", way, limit, "move it across the periodic axes, or make the sides walls")
    if wall.points is not None and (solid or any(len(point) != 2 for point in wall.points)):
        remedy = "give a file in 3-D, and points [x, z] in 2-D"
        raise InputError(f"{key}.points", wall.points[0], "are for 2-D scenes and have two coordinates", remedy)
    if wall.rotate is not None and len(wall.rotate) != (3 if solid else 1):
        limit = "has three angles in 3-D and one in 2-D"
        raise InputError(f"{key}.rotate", wall.rotate, limit, "give angles about x, y and z, in 2-D one number")
    if wall.spacing is not None and len(wall.spacing) != (2 if solid else 1):
        limit = "has two numbers in 3-D and one in 2-D"
        raise InputError(f"{key}.spacing", wall.spacing, limit, "give the distances along x and y, in 2-D along x")
