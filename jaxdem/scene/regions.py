"""A region of the box in a scene: box, cylinder, polygon or sphere."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from jaxdem.scene.base import Direction, Finite, Positive, Rows, Section, Vector, wrong

NEEDED: dict[str, tuple[str, ...]] = {
    "box": ("start", "stop"),
    "cylinder": ("base", "axis", "radius", "length"),
    "polygon": ("vertices",),
    "sphere": ("center", "radius"),
}
"""Keys that each shape must have; a polygon may have from and to."""


class Region(Section):
    """A part of the box.

    Attributes:
        shape: "box", "cylinder" (3-D only), "polygon" in the plane of the first and the vertical axis, or "sphere" (in
            2-D a disc).
        start: lower corner of a box [m].
        stop: upper corner of a box [m].
        base: middle of the first end of a cylinder [m].
        axis: direction from the first to the second end of a cylinder; any length.
        center: of a sphere [m].
        radius: of a cylinder or a sphere [m].
        length: of a cylinder, from end to end [m].
        vertices: corners (x, vertical) of a polygon in their order, three at least [m].
        from_: in 3-D: where a polygon begins along the second axis (key `from`). Default: 0 [m].
        to: in 3-D: where it ends. Default: the end of the box [m].
    """

    shape: Literal["box", "cylinder", "polygon", "sphere"]
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

    @model_validator(mode="after")
    def _keys_of_its_shape(self) -> Region:
        needed = NEEDED[self.shape]
        optional = ("from_", "to") if self.shape == "polygon" else ()
        for name, field in type(self).model_fields.items():
            value = getattr(self, name)
            if name == "shape" or (value is None) == (name not in needed) or name in optional:
                continue
            limit = f"a region of shape {self.shape} needs {', '.join(needed)}"
            remedy = "add this key" if value is None else "remove this key"
            raise wrong(field.alias or name, value, limit, remedy)
        for low, high in zip(self.start or (), self.stop or (), strict=True):
            if not low < high:
                raise wrong("stop", self.stop, f"must be above start = {self.start}", "exchange start and stop")
        if self.vertices is not None and (len(self.vertices) < 3 or any(len(corner) != 2 for corner in self.vertices)):
            limit = "needs at least three corners (x, vertical)"
            raise wrong("vertices", self.vertices, limit, "add corners to the polygon")
        return self
