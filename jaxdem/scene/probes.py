"""The tables `[[probes]]` of a scene: what is measured while it runs."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from jaxdem.errors import InputError
from jaxdem.scene.base import Corner, Finite, NonNegative, Positive, Section, Vector, nearest, wrong
from jaxdem.scene.domain import Box
from jaxdem.scene.walls import Direction

AXIS_NAMES = {2: "xz", 3: "xyz"}
"""By dimension the names of the axes; the last is up."""

FILE_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}")
"""Names of probes: each is the name of a file."""

KEYS = {
    "plane": ("axis", "at", "normal", "point", "from", "to"),
    "profile": ("axis", "cells", "edges", "from", "to", "regions"),
    "point": ("points",),
}
"""Keys of each kind beside those that all have."""

COMMON = ("name", "kind", "interval", "begin", "average", "window", "sample_interval")
"""Keys of all kinds."""


def _file_name(value: str) -> str:
    if not FILE_NAME.fullmatch(value) or value.startswith("."):
        limit = "is the name of a file: up to 100 letters, digits, '_', '-' and '.', the first a letter, digit or '_'"
        raise wrong("", value, limit, "choose another name")
    return value


class Probe(Section):
    """A quantity that is measured while the scene runs and written to `probes/NAME.csv` and `probes.h5`.

    Attributes:
        name: name of the probe and of its file, different for each.
        kind: "plane": flow of particles and fluid through a plane. "profile": means over slices or boxes. "point": the
            fluid at points.
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
        interval: time between two rows; a multiple of the coupling interval. Default: `time.output_interval` [s].
        begin: start; nothing before it is measured, and the first row is at begin + interval [s].
        average: whether a row is the mean over the time since the row before, and not the state at its time. Flows
            through a plane are always such means. Default: false.
        window: last part of this time over which is averaged. Default: all of it [s].
        sample_interval: time between the measurements that are averaged. Default: the coupling interval, of which it is
            a multiple [s].
    """

    name: Annotated[str, Field(strict=True), AfterValidator(_file_name)]
    kind: Literal["plane", "profile", "point"]
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
        averages = self.average is not False if self.kind == "plane" else self.average
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


@dataclass(frozen=True)
class ProbePlace:
    """What probes are checked against.

    Attributes:
        box: of the scene.
        end: of the run [s].
        output_interval: of the run [s].
        with_particles, with_fluid: what the scene has.
    """

    box: Box
    end: float
    output_interval: float
    with_particles: bool
    with_fluid: bool

    @property
    def axes(self) -> str:
        """Names of the axes."""
        return AXIS_NAMES[len(self.box.size)]


def completed_probes(probes: tuple[Probe, ...], place: ProbePlace) -> tuple[Probe, ...]:
    """The probes with their interval and average written in, checked.

    Raises:
        InputError: two have one name, or one does not fit the box or the time.
    """
    result, names = [], set[str]()
    for k, probe in enumerate(probes):
        key = f"probes.{k}"
        # Some file systems do not tell capital letters from small ones.
        if probe.name.lower() in names:
            raise InputError(f"{key}.name", probe.name, "is the name of another probe", "give each its own name")
        names.add(probe.name.lower())
        PLACES[probe.kind](key, probe, place)
        result.append(_timed(key, probe, place))
    return tuple(result)


def _timed(key: str, probe: Probe, place: ProbePlace) -> Probe:
    """The probe with its interval, checked against the end of the run."""
    interval = place.output_interval if probe.interval is None else probe.interval
    if probe.begin + interval > place.end * (1.0 + 1e-9):
        name = "begin" if probe.interval is None else "interval"
        limit = f"the first row would be at begin + interval = {probe.begin + interval:g} s, after the end of the run"
        raise InputError(f"{key}.{name}", getattr(probe, name), f"{limit}, time.end = {place.end:g} s", "lower it")
    for name in ("window", "sample_interval"):
        value = getattr(probe, name)
        if value is not None and value > interval * (1.0 + 1e-9):
            raise InputError(f"{key}.{name}", value, f"is more than the interval of {interval:g} s", "lower it")
    average = probe.kind == "plane" if probe.average is None else probe.average
    return probe.model_copy(update={"interval": interval, "average": average})


def _axis(key: str, probe: Probe, place: ProbePlace) -> int:
    name = probe.axis or ""
    if name not in place.axes:
        raise InputError(f"{key}.axis", name, "the box has no such axis", nearest(name, place.axes))
    return place.axes.index(name)


def _check_plane(key: str, probe: Probe, place: ProbePlace) -> None:
    if probe.normal is not None:
        if not place.with_particles:
            raise InputError(f"{key}.normal", probe.normal, "needs particles", "give axis and at")
        place.box.check_same_along_periodic_axes(f"{key}.normal", probe.normal)
        _check_inside(f"{key}.point", probe.point or (), place.box.size)
        return
    axis = _axis(key, probe, place)
    length = place.box.size[axis]
    if probe.at is None or not 0.0 <= probe.at <= length:
        raise InputError(f"{key}.at", probe.at, f"the plane must lie in the box, between 0 and {length:g} m", "move it")
    if probe.from_ is not None and probe.to is not None:
        others = [side for k, side in enumerate(place.box.size) if k != axis]
        check_corners(key, probe.from_, probe.to, others)


def _check_profile(key: str, probe: Probe, place: ProbePlace) -> None:
    size = place.box.size
    for k, (lower, upper) in enumerate(probe.regions or ()):
        check_corners(f"{key}.regions.{k}", lower, upper, list(size))
    if probe.axis is None:
        return
    axis = _axis(key, probe, place)
    if probe.from_ is not None and probe.to is not None:
        check_corners(key, probe.from_, probe.to, list(size))
    edges = probe.edges or ()
    if any(b <= a for a, b in itertools.pairwise(edges)):
        raise InputError(f"{key}.edges", edges, "must increase", "sort them")
    if edges:
        low = 0.0 if probe.from_ is None else probe.from_[axis]
        high = size[axis] if probe.to is None else probe.to[axis]
        if edges[0] < low or edges[-1] > high:
            limit = f"must lie between {low:g} and {high:g} m"
            raise InputError(f"{key}.edges", edges, limit, "move them")


def _check_point(key: str, probe: Probe, place: ProbePlace) -> None:
    if not place.with_fluid:
        raise InputError(f"{key}.kind", probe.kind, "measures the fluid, and the scene has none", "remove the probe")
    for k, point in enumerate(probe.points or ()):
        _check_inside(f"{key}.points.{k}", point, place.box.size)


def check_corners(key: str, lower: tuple[float, ...], upper: tuple[float, ...], lengths: list[float]) -> None:
    """Refuses two corners that enclose nothing, or lie outside.

    Raises:
        InputError: they do.
    """
    for name, corner in (("from", lower), ("to", upper)):
        if len(corner) != len(lengths):
            limit = f"needs {len(lengths)} numbers, got {len(corner)}"
            raise InputError(f"{key}.{name}", corner, limit, "give one for each of these axes")
        _check_inside(f"{key}.{name}", corner, lengths)
    if not all(low < high for low, high in zip(lower, upper, strict=True)):
        raise InputError(f"{key}.to", upper, f"must be above from = {lower} in every axis", "exchange them")


def _check_inside(key: str, point: tuple[float, ...], lengths: tuple[float, ...] | list[float]) -> None:
    if not all(0.0 <= x <= length for x, length in zip(point, lengths, strict=True)):
        raise InputError(key, point, f"must lie in the box, which ends at {tuple(lengths)} m", "move it")


PLACES: dict[str, Callable[[str, Probe, ProbePlace], None]] = {
    "plane": _check_plane,
    "profile": _check_profile,
    "point": _check_point,
}
"""Check of each kind: key, probe, place."""
