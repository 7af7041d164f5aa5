"""The tables `[boundary.<side>]` of a scene: what the sides of the box are to the fluid."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, model_validator

from jaxdem.errors import InputError
from jaxdem.scene.base import Abscissae, Corner, Finite, NonNegative, Section, check_table, wrong
from jaxdem.scene.domain import Box
from jaxdem.scene.unread import ReadWith

KIND_ALIASES = {
    "wall": "no_slip",
    "noslip": "no_slip",
    "slip": "free_slip",
    "freeslip": "free_slip",
    "velocity_inlet": "inlet",
    "pressure_outlet": "outlet",
}


def _known_kind(value: object) -> object:
    if not isinstance(value, str):
        return value
    name = value.strip().lower().replace("-", "_").replace(" ", "_")
    return KIND_ALIASES.get(name, name)


Kind = Annotated[
    Literal["no_slip", "free_slip", "moving_wall", "inlet", "outlet", "periodic"], BeforeValidator(_known_kind)
]
Velocity = Finite | tuple[Finite, ...]


class BoundarySide(Section):
    """One side of the box, or a patch of it. The rest of a side with a patch is a no-slip wall.

    Attributes:
        kind: boundary condition of the fluid. "periodic" holds for both sides of an axis; it is enough to give it for
            one.
        velocity: of an inlet: superficial velocity, as the inward speed or as one number per axis. Components along the
            side are interstitial velocities, at any void fraction. Of a moving_wall: velocity of the wall, one number
            per axis [m/s].
        from_: corner of the patch in the other axes: one number in 2-D, two in 3-D (key `from`) [m].
        to: opposite corner of the patch [m].
        ramp_time: time in which the velocity rises from zero. Default: 0.05 s for an inlet without `times`,
            otherwise 0 [s].
        times: increasing times, for an inlet or a moving wall whose velocity changes in time. Needs `velocities`,
            excludes `velocity` [s].
        velocities: velocities at these times, each in the form of `velocity`. Linear between the times, constant before
            the first and after the last [m/s].
        profile: velocity profile of an inlet: "uniform", "parabolic" or "table" (`positions`, `values`). "parabolic"
            has mean 1 and is zero at the ends of the patch, along every axis of the side except those on which the
            inlet spans the whole side between periodic or free-slip sides.
        positions: for profile = "table": increasing positions along the (last) axis of the side, over the whole patch
            [m].
        values: for profile = "table": multiples of the velocity at these positions, linear between them [-].
        particles: "screen": the side is a wall for particles. "remove": particles whose centre crosses the side are
            removed.
        temperature: temperature of the side: of the fluid that comes in, and of a wall, for the fluid and for particles
            that touch it. Default: no heat passes a wall, and needed by an inlet [K].
        heat_flux: heat flux into the fluid through a wall, in place of a temperature [W/m2].
        level: with `[surface]`, height along the last axis below which there is liquid beyond an inlet or outlet. An
            outlet then holds this level: the pressure beyond it is that of both fluids at rest. Default: 0 for an
            outlet, the second fluid alone; needed by an inlet [m].
        scalars: values of `[[scalars]]` by name: of the fluid that comes in, and at a wall. Default: nothing passes a
            wall, and needed by an inlet.
    """

    kind: Kind = "no_slip"
    velocity: Velocity | None = None
    from_: Corner | None = Field(default=None, alias="from")
    to: Corner | None = None
    ramp_time: Annotated[NonNegative | None, ReadWith(".kind = inlet", ".kind = moving_wall")] = None
    times: Abscissae | None = None
    velocities: tuple[Velocity, ...] | None = None
    profile: Literal["uniform", "parabolic", "table"] | None = None
    positions: Abscissae | None = None
    values: tuple[Finite, ...] | None = None
    particles: Literal["screen", "remove"] = "screen"
    temperature: Finite | None = None
    heat_flux: Finite | None = None
    level: Finite | None = None
    scalars: dict[str, Finite] | None = None

    @model_validator(mode="after")
    def _patch(self) -> BoundarySide:
        if (self.from_ is None) != (self.to is None):
            name = "from" if self.to is None else "to"
            raise wrong(name, self.from_ or self.to, "a patch needs both from and to", "give both or neither")
        if self.from_ is not None and self.kind == "periodic":
            raise wrong("from", self.from_, "a periodic side has no patch", "remove from and to")
        return self

    @model_validator(mode="after")
    def _one_velocity(self) -> BoundarySide:
        """One velocity, or one for each of the times; for sides that have any."""
        for name in ("velocity", "times", "velocities", "profile", "positions", "values"):
            kinds = ("inlet", "moving_wall") if name in ("velocity", "times", "velocities") else ("inlet",)
            if getattr(self, name) is not None and self.kind not in kinds:
                raise wrong(name, getattr(self, name), f"is not used with kind = {self.kind}", "remove this key")
        check_table("times", self.times, "velocities", self.velocities)
        if self.kind in ("inlet", "moving_wall") and self.velocity is None and self.times is None:
            raise wrong("velocity", None, f"is needed by kind = {self.kind}", "set a velocity [m/s]")
        if self.velocity is not None and self.times is not None:
            remedy = "remove velocity, or times and velocities"
            raise wrong("velocity", self.velocity, "cannot be combined with times, which use velocities", remedy)
        check_table("positions", self.positions, "values", self.values)
        if (self.profile == "table") != (self.positions is not None):
            limit = "positions and values are needed by profile = table, and are not used with another profile"
            remedy = 'set profile = "table" and give positions and values, or remove all three'
            raise wrong("profile", self.profile or "uniform", limit, remedy)
        return self


def completed_boundary(
    boundary: Mapping[str, BoundarySide], size: tuple[float, ...], with_particles: bool
) -> tuple[dict[str, BoundarySide], Box]:
    """All sides by name, with their defaults and vectors written in, checked; and the box that they make.

    Args:
        boundary: as given.
        size: of the box [m].
        with_particles: whether there are any; they would not feel a moving patch.

    Raises:
        InputError: a key does not fit the box or another side.
    """
    names = Box(size, ()).sides
    sides = {name: boundary.get(name, BoundarySide()) for name in names}
    for pair in zip(names[::2], names[1::2], strict=True):
        sides |= _paired({name: sides[name] for name in pair})
    box = Box(size, tuple(sides[name].kind == "periodic" for name in names[::2]))
    for name, side in sides.items():
        _check_patch(name, side, box)
        if side.kind == "moving_wall" and side.from_ is not None and with_particles:
            limit = "a moving patch would drag the fluid but not the particles"
            raise InputError(f"boundary.{name}.from", side.from_, limit, "let the whole side move: remove from and to")
    return {name: _completed_side(sides, box, name) for name in names}, box


def _paired(pair: dict[str, BoundarySide]) -> dict[str, BoundarySide]:
    """The two sides of an axis, both periodic where one is; refuses two that contradict each other."""
    kinds = [side.kind for side in pair.values()]
    if kinds.count("periodic") != 1:
        return pair
    name, other = pair if kinds[0] == "periodic" else reversed(pair)
    if "kind" in pair[other].model_fields_set:
        limit = f'boundary.{name}.kind = "periodic" holds for both sides of the axis'
        remedy = f"remove boundary.{other}, or give boundary.{name} another kind"
        raise InputError(f"boundary.{other}.kind", pair[other].kind, limit, remedy)
    return pair | {other: pair[other].model_copy(update={"kind": "periodic"})}


def _check_patch(name: str, side: BoundarySide, box: Box) -> None:
    lengths = [box.size[axis] for axis in box.along(name)]
    if side.from_ is None or side.to is None:
        return
    for label, corner in (("from", side.from_), ("to", side.to)):
        key = f"boundary.{name}.{label}"
        check_entries(key, corner, len(lengths))
        for value, length in zip(corner, lengths, strict=True):
            if not 0.0 <= value <= length:
                raise InputError(key, value, f"must lie in 0 ... {length} m", "move the patch into the side")
    if any(a >= b for a, b in zip(side.from_, side.to, strict=True)):
        limit = f"must be below to = {side.to}"
        raise InputError(f"boundary.{name}.from", side.from_, limit, "exchange from and to")


def _completed_side(sides: Mapping[str, BoundarySide], box: Box, name: str) -> BoundarySide:
    side, key = sides[name], f"boundary.{name}"
    update: dict[str, object] = {}
    if side.velocity is not None:
        update["velocity"] = _vector(f"{key}.velocity", side.kind, side.velocity, box, name)
    if side.velocities is not None:
        update["velocities"] = tuple(_vector(f"{key}.velocities", side.kind, v, box, name) for v in side.velocities)
    if side.ramp_time is None:
        update["ramp_time"] = 0.05 if side.kind == "inlet" and side.times is None else 0.0
    if side.kind == "inlet":
        update["profile"] = side.profile or "uniform"
        _check_profile(sides, box, name)
    return side.model_copy(update=update)


def _check_profile(sides: Mapping[str, BoundarySide], box: Box, name: str) -> None:
    side = sides[name]
    if side.profile == "parabolic" and not any(parabolic_axes(sides, box, name)):
        limit = (
            "the inlet spans the whole side between periodic or free-slip sides, "
            "where the velocity is not zero at the ends"
        )
        remedy = 'set profile = "uniform", or give a patch (from, to) or walls'
        raise InputError(f"boundary.{name}.profile", side.profile, limit, remedy)
    if side.positions is not None:
        start = 0.0 if side.from_ is None else side.from_[-1]
        stop = box.size[box.along(name)[-1]] if side.to is None else side.to[-1]
        if side.positions[0] > start or side.positions[-1] < stop:
            limit = f"must cover the whole inlet, {start} ... {stop} m"
            raise InputError(f"boundary.{name}.positions", side.positions, limit, "add the ends of the inlet")


def parabolic_axes(sides: Mapping[str, BoundarySide], box: Box, name: str) -> tuple[bool, ...]:
    """Whether a parabolic inlet's velocity falls to zero at its ends, for each axis of the side.

    It does but where the inlet reaches over the whole side between two that do not hold the fluid.
    """
    result, side = [], sides[name]
    for position, axis in enumerate(box.along(name)):
        kinds = {sides[end].kind for end in box.sides[2 * axis : 2 * axis + 2]}
        whole = side.from_ is None or side.to is None
        if side.from_ is not None and side.to is not None:
            whole = (side.from_[position], side.to[position]) == (0.0, box.size[axis])
        result.append(not (whole and kinds <= {"periodic", "free_slip"}))
    return tuple(result)


def _vector(key: str, kind: str, velocity: Velocity, box: Box, name: str) -> tuple[float, ...]:
    """Velocity of a side as a vector; a single number is the inward speed of an inlet."""
    if isinstance(velocity, float) and kind == "inlet":
        return box.inward(name, velocity)
    vector = velocity if isinstance(velocity, tuple) else (velocity,)
    check_entries(key, vector, len(box.size))
    if kind == "moving_wall" and vector[box.normal_of(name)[0]] != 0.0:
        raise InputError(key, vector, "a moving wall can only move in its own plane", "set the normal component to 0")
    return vector


def check_entries(key: str, value: tuple[float, ...], count: int) -> None:
    """Refuses a list that has not `count` numbers."""
    if len(value) != count:
        raise InputError(key, value, f"needs {count} number(s), got {len(value)}", f"give {count} number(s)")
