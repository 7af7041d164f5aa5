"""A region of the box in a scene: box, cylinder, polygon, sphere, or the inside of a mesh."""

from __future__ import annotations

import hashlib
from typing import Literal

from pydantic import Field, model_validator

from jaxdem.files.reading import TABLE_BYTES, read_bytes
from jaxdem.scene.base import Direction, Finite, Name, Positive, Rows, Section, Vector, wrong

NEEDED: dict[str, tuple[str, ...]] = {
    "box": ("start", "stop"),
    "cylinder": ("base", "axis", "radius", "length"),
    "polygon": ("vertices",),
    "sphere": ("center", "radius"),
    "mesh": ("file",),
}
"""Keys that each shape must have."""

OPTIONAL: dict[str, tuple[str, ...]] = {
    "polygon": ("from_", "to"),
    "mesh": ("scale", "rotate", "translate", "start", "stop"),
}
"""Keys that it may have."""


class Region(Section):
    """A part of the box.

    Attributes:
        shape: "box", "cylinder" (3-D only), "polygon" in the plane of the first and the vertical axis, "sphere" (in 2-D
            a disc), or "mesh" (3-D only), the inside of a closed surface of triangles.
        start: lower corner of a box; of a mesh: it is cut to the box from here ... [m].
        stop: upper corner of a box; ... to here [m].
        base: middle of the first end of a cylinder [m].
        axis: direction from the first to the second end of a cylinder; any length.
        center: of a sphere [m].
        radius: of a cylinder or a sphere [m].
        length: of a cylinder, from end to end [m].
        vertices: corners (x, vertical) of a polygon in their order, three at least [m].
        from_: in 3-D: where a polygon begins along the second axis (key `from`). Default: 0 [m].
        to: in 3-D: where it ends. Default: the end of the box [m].
        file: triangles of a mesh (.stl, .obj, .ply), relative to the scene. They must enclose a volume.
        scale: factor by which their coordinates are multiplied: 0.001 for millimetres. Default: 1 [-].
        rotate: angles about the x, y and z axis, by which the scaled mesh is turned about the origin in this order.
            Default: none [degrees].
        translate: is added to the turned coordinates. Default: zero [m].
    """

    shape: Literal["box", "cylinder", "polygon", "sphere", "mesh"]
    start: Vector | None = None
    stop: Vector | None = None
    base: Vector | None = None
    axis: Direction | None = None
    center: Vector | None = None
    radius: Positive | None = None
    length: Positive | None = None
    vertices: Rows | None = None
    from_: Finite | None = Field(default=None, alias="from")
    to: Finite | None = None
    file: Name | None = None
    scale: Positive | None = None
    rotate: Vector | None = None
    translate: Vector | None = None

    @model_validator(mode="after")
    def _keys_of_its_shape(self) -> Region:
        needed, optional = NEEDED[self.shape], OPTIONAL.get(self.shape, ())
        for name, field in type(self).model_fields.items():
            value = getattr(self, name)
            if name == "shape" or (value is None) == (name not in needed) or name in optional:
                continue
            limit = f"a region of shape {self.shape} needs {', '.join(needed)}"
            remedy = "add this key" if value is None else "remove this key"
            raise wrong(field.alias or name, value, limit, remedy)
        for low, high in zip(self.start or (), self.stop or (), strict=False):
            if not low < high:
                raise wrong("stop", self.stop, f"must be above start = {self.start}", "exchange start and stop")
        if self.vertices is not None and (len(self.vertices) < 3 or any(len(corner) != 2 for corner in self.vertices)):
            limit = "needs at least three corners (x, vertical)"
            raise wrong("vertices", self.vertices, limit, "add corners to the polygon")
        return self

    @property
    def digest(self) -> str:
        """A fingerprint of the file of a mesh; empty without one that can be read."""
        try:
            return "" if self.file is None else hashlib.sha256(read_bytes(self.file, TABLE_BYTES)).hexdigest()
        except (OSError, ValueError):
            return ""  # what is wrong with it is said where it is read for the region
