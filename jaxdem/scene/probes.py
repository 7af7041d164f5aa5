"""The tables `[[probes]]` of a scene: what is measured while it runs."""

from __future__ import annotations

import re
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from jaxdem.scene.base import Corner, Finite, NonNegative, Positive, Section, Vector, wrong
from jaxdem.scene.walls import Direction

FILE_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}")
"""Names of probes: each is the name of a file."""

KEYS = {
    "plane": ("axis", "at", "normal", "point", "from", "to"),
    "profile": ("axis", "cells", "edges", "from", "to", "regions"),
    "point": ("points",),
    "wall": ("side", "wall", "about"),
    "contacts": (),
}
"""Keys of each kind beside those that all have."""

COMMON = ("name", "kind", "interval", "begin", "average", "window", "sample_interval")
"""Keys of all kinds."""

CLOSED = ("no_slip", "free_slip", "moving_wall")
"""Kinds of sides that are wholly a wall to the fluid."""

MEANS = ("plane", "wall")
"""Kinds whose rows are means over time unless the scene says otherwise."""


def is_file_name(value: str) -> bool:
    """Whether a probe may have this name."""
    return FILE_NAME.fullmatch(value) is not None and not value.startswith(".")


def _file_name(value: str) -> str:
    if not is_file_name(value):
        limit = "is the name of a file: up to 100 letters, digits, '_', '-' and '.', the first a letter, digit or '_'"
        raise wrong("", value, limit, "choose another name")
    return value


class Probe(Section):
    """A quantity that is measured while the scene runs and written to `probes/NAME.csv` and `probes.h5`.

    Attributes:
        name: name of the probe and of its file, different for each.
        kind: "plane": flow of particles and fluid through a plane. "profile": means over slices or boxes. "point": the
            fluid at points. "wall": force and torque of particles and fluid on a side of the box or a wall.
            "contacts": all contacts at the times of the rows, a line each.
        axis: "x", "y" or "z". Of a plane: the axis that it is normal to; flows along the axis are positive. Of a
            profile: the axis along which slices follow each other.
        at: of a plane with an axis: its coordinate [m].
        normal: of a plane without an axis: its normal, any length, along which flows are positive. The flow of
            particles alone is measured.
        point: of a plane with a normal: a point of it [m].
        cells: of a profile with an axis: number of slices of equal thickness.
        edges: of a profile with an axis, in place of `cells`: coordinates between which the slices lie, increasing [m].
        from_: of a plane with an axis: corner of a rectangle of it, in the other axes. Of a profile with an axis:
            corner of the part of the box that is sliced, one number per axis (key `from`). Default: the whole plane,
            the whole box [m].
        to: opposite corner [m].
        regions: of a profile without an axis: boxes, each as a list of two opposite corners, lower and upper [m].
        points: of kind "point": points, each as a list of one number per axis [m].
        side: of kind "wall": a side of the box, such as "bottom". The force of the fluid is measured where the whole
            side is a wall or a free-slip side.
        wall: of kind "wall", in place of `side`: name of one of `[[walls]]`, or number of its table, from 0.
        about: of kind "wall": point of the torque, one number per axis. Default: the middle of the
            side; `point`, `center` or `apex` of the wall [m].
        interval: time between two rows; a multiple of the coupling interval. Default: `time.output_interval` [s].
        begin: start; nothing before it is measured, and the first row is at begin + interval [s].
        average: whether a row is the mean over the time since the row before, and not the state at its time. Flows
            through a plane are always such means. Default: false, of kind "wall" true: false is then the mean over
            the last coupling interval.
        window: last part of this time over which is averaged. Default: all of it [s].
        sample_interval: time between the measurements that are averaged; a multiple of the coupling interval, and the
            window a multiple of it. Not of a plane. Default: the coupling interval [s].
    """

    name: Annotated[str, Field(strict=True), AfterValidator(_file_name)]
    kind: Literal["plane", "profile", "point", "wall", "contacts"]
    axis: Literal["x", "y", "z"] | None = None
    at: Finite | None = None
    normal: Direction | None = None
    point: Vector | None = None
    from_: Corner | None = Field(default=None, alias="from")
    to: Corner | None = None
    cells: Annotated[int, Field(ge=1, le=100_000, strict=True)] | None = None
    edges: Annotated[tuple[Finite, ...], Field(min_length=2)] | None = None
    regions: Annotated[tuple[tuple[Vector, Vector], ...], Field(min_length=1)] | None = None
    points: Annotated[tuple[Vector, ...], Field(min_length=1)] | None = None
    side: Literal["left", "right", "front", "back", "bottom", "top"] | None = None
    wall: Annotated[int, Field(ge=0, strict=True)] | Annotated[str, Field(strict=True)] | None = None
    about: Vector | None = None
    interval: Positive | None = None
    begin: NonNegative = 0.0
    average: Annotated[bool, Field(strict=True)] | None = None
    window: Positive | None = None
    sample_interval: Positive | None = None

    @model_validator(mode="after")
    def _keys_of_its_kind(self) -> Probe:
        for field, info in type(self).model_fields.items():
            name = info.alias or field
            if getattr(self, field) is not None and name not in (*COMMON, *KEYS[self.kind]):
                limit = f"the keys of a probe of kind {self.kind} are {', '.join((*COMMON, *KEYS[self.kind]))}"
                raise wrong(name, getattr(self, field), limit, "remove this key")
        if (self.from_ is None) != (self.to is None):
            raise wrong("from", self.from_ or self.to, "needs both from and to", "give both or neither")
        if self.kind == "plane" and self.sample_interval is not None:
            limit = "a plane looks at every coupling interval, so that it misses nobody"
            raise wrong("sample_interval", self.sample_interval, limit, "remove this key")
        for name in ("average", "window", "sample_interval"):
            if self.kind == "contacts" and getattr(self, name):
                raise wrong(name, getattr(self, name), "contacts are those at a time", "remove this key")
        averages = self.average is not False if self.kind in MEANS else self.average
        for name in ("window", "sample_interval"):
            if getattr(self, name) is not None and not averages:
                raise wrong(name, getattr(self, name), "is for averages", "set average = true, or remove this key")
        return self

    @model_validator(mode="after")
    def _place_of_a_plane(self) -> Probe:
        if self.kind != "plane":
            return self
        if self.average is False:
            raise wrong("average", False, "flows through a plane are means over time", "remove this key")
        given = self.axis is not None, self.at is not None, self.normal is not None, self.point is not None
        if given not in ((True, True, False, False), (False, False, True, True)):
            raise wrong(
                "axis", self.axis, "a plane needs either axis and at, or normal and point", "give one of the two"
            )
        if self.normal is not None and self.from_ is not None:
            raise wrong("from", self.from_, "a rectangle is for a plane with an axis", "remove from and to")
        return self

    @model_validator(mode="after")
    def _place_of_a_profile(self) -> Probe:
        if self.kind == "point" and self.points is None:
            raise wrong("points", None, "is needed by kind = point: where the fluid is measured", "add this key")
        if self.kind != "profile":
            return self
        if (self.axis is None) == (self.regions is None):
            limit = "a profile needs either an axis, with cells or edges, or regions"
            raise wrong("axis", self.axis, limit, "give one of the two")
        if (self.axis is None) != ((self.cells is None) and (self.edges is None)) or (self.cells and self.edges):
            raise wrong(
                "cells", self.cells, "a profile along an axis needs either cells or edges", "give one of the two"
            )
        if self.regions is not None and self.from_ is not None:
            raise wrong("from", self.from_, "is for slices along an axis", "remove from and to")
        return self
