"""The tables `[boundary.<side>]` of a scene: what the sides of the box are to the fluid."""

from __future__ import annotations

import itertools
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, field_validator

from jaxdem.errors import InputError
from jaxdem.scene.base import Finite, NonNegative, Section, check_entries, refuse_unknown

KIND_ALIASES = {
    "wall": "no_slip",
    "noslip": "no_slip",
    "slip": "free_slip",
    "freeslip": "free_slip",
    "velocity_inlet": "inlet",
    "pressure_outlet": "outlet",
}

Abscissae = Annotated[tuple[NonNegative, ...], Field(min_length=2)]


class BoundarySide(Section):
    """One side of the box, or a patch of it. The rest of a side with a patch is a no-slip wall.

    Attributes:
        kind: boundary condition of the fluid. "periodic" holds for both sides of an axis; it is enough to give it for one.
        velocity: of an inlet: superficial velocity, as the inward speed or as one number per axis. Components along the side are
            interstitial velocities, at any void fraction. Of a moving_wall: velocity of the wall, one number per axis [m/s].
        from_: corner of the patch in the other axes: one number in 2-D, two in 3-D (key `from`) [m].
        to: opposite corner of the patch [m].
        ramp_time: time in which the velocity rises from zero. Default: 0.05 s for an inlet without `times`, otherwise 0 [s].
        times: increasing times, for an inlet whose velocity changes in time. Needs `velocities`, excludes `velocity` [s].
        velocities: velocities at these times, each in the form of `velocity`. Linear between the times, constant before the first
            and after the last [m/s].
        profile: velocity profile of an inlet: "uniform", "parabolic" or "table" (`positions`, `values`). "parabolic" has mean 1 and is zero
            at the ends of the patch, along every axis of the side except those on which the inlet spans the whole side between
            periodic or free-slip sides.
        positions: for profile = "table": increasing positions along the (last) axis of the side, over the whole patch [m].
        values: for profile = "table": multiples of the velocity at these positions, linear between them [-].
        particles: "screen": the side is a wall for particles. "remove": particles whose centre crosses the side are removed.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)

    kind: Literal["no_slip", "free_slip", "moving_wall", "inlet", "outlet", "periodic"] = "no_slip"
    velocity: Finite | tuple[Finite, ...] | None = None
    from_: tuple[Finite, ...] | None = Field(default=None, alias="from")
    to: tuple[Finite, ...] | None = None
    ramp_time: NonNegative | None = None
    times: Abscissae | None = None
    velocities: tuple[Finite | tuple[Finite, ...], ...] | None = None
    profile: Literal["uniform", "parabolic", "table"] | None = None
    positions: Abscissae | None = None
    values: tuple[Finite, ...] | None = None
    particles: Literal["screen", "remove"] = "screen"

    @field_validator("kind", mode="before")
    @classmethod
    def _known_kind(cls, value: Any) -> Any:
        if not isinstance(value, str):
            return value
        name = value.strip().lower().replace("-", "_").replace(" ", "_")
        return KIND_ALIASES.get(name, name)

    @field_validator("from_", "to", mode="before")
    @classmethod
    def _corner(cls, value: Any) -> Any:
        return (value,) if isinstance(value, int | float) and not isinstance(value, bool) else value


def completed_boundary(scene: Any) -> dict[str, BoundarySide]:
    """All sides by name, with their defaults and vectors written in, checked.

    Raises:
        InputError: an unknown side, a key that is missing, means nothing there or does not fit another.
    """
    for name in scene.boundary:
        if name not in scene.sides:
            refuse_unknown(f"boundary.{name}", name, scene.sides)
    scene = scene.model_copy(update={"boundary": _paired(scene)})
    return {name: _completed_side(scene, name) for name in scene.sides}


def check_inlets(scene: Any) -> None:
    """Refuses inlets of a scene without fluid."""
    for name, side in scene.boundary.items():
        if scene.fluid is None and side.kind == "inlet":
            raise InputError(
                f"boundary.{name}.kind",
                "inlet",
                "is an inlet of fluid, and the scene has no fluid",
                'add [fluid], or set kind = "no_slip"',
            )


def _paired(scene: Any) -> dict[str, BoundarySide]:
    """The sides as given, both of an axis periodic where one is; refuses two that contradict each other."""
    sides = dict(scene.boundary)
    for axis in range(scene.dimension):
        pair = scene.sides[2 * axis : 2 * axis + 2]
        given = [sides.get(name, BoundarySide()) for name in pair]
        if [side.kind for side in given].count("periodic") != 1:
            continue
        name, other = pair if given[0].kind == "periodic" else pair[::-1]
        opposite = sides.get(other, BoundarySide())
        if "kind" in opposite.model_fields_set:
            raise InputError(
                f"boundary.{other}.kind",
                opposite.kind,
                f'boundary.{name}.kind = "periodic" holds for both sides of the axis',
                f"remove boundary.{other}, or give boundary.{name} another kind",
            )
        sides[other] = opposite.model_copy(update={"kind": "periodic"})
    return sides


def _completed_side(scene: Any, name: str) -> BoundarySide:
    side = scene.boundary.get(name, BoundarySide())
    number = scene.sides.index(name)
    axis, upper = number // 2, number % 2
    key = f"boundary.{name}"
    if (side.from_ is None) != (side.to is None):
        given = "from" if side.to is None else "to"
        raise InputError(
            f"{key}.{given}", side.from_ or side.to, "a patch needs both from and to", "give both or neither"
        )
    lengths = [length for a, length in enumerate(scene.domain.size) if a != axis]
    for label, corner in (("from", side.from_), ("to", side.to)):
        if corner is not None:
            check_entries(f"{key}.{label}", corner, len(lengths))
            for value, length in zip(corner, lengths, strict=True):
                if not 0.0 <= value <= length:
                    raise InputError(
                        f"{key}.{label}",
                        value,
                        f"must lie in 0 ... {length} m",
                        "move the patch into the side",
                    )
    if side.from_ is not None and side.to is not None:
        if any(a >= b for a, b in zip(side.from_, side.to, strict=True)):
            raise InputError(f"{key}.from", side.from_, f"must be below to = {side.to}", "exchange from and to")
        if side.kind == "periodic":
            raise InputError(f"{key}.from", side.from_, "a periodic side has no patch", "remove from and to")
    if side.kind == "moving_wall" and side.from_ is not None and scene.particles is not None:
        raise InputError(
            f"{key}.from", side.from_, "a moving patch would drag the fluid but not the particles", "let the whole side move: remove from and to"
        )  # fmt: skip
    _check_side_velocity(key, side)
    update: dict[str, Any] = {"ramp_time": side.ramp_time}
    if side.velocity is not None:
        update["velocity"] = _vector(scene, f"{key}.velocity", side.kind, side.velocity, axis, upper)
    if side.velocities is not None:
        update["velocities"] = tuple(
            _vector(scene, f"{key}.velocities", side.kind, velocity, axis, upper) for velocity in side.velocities
        )
    if side.ramp_time is None:
        update["ramp_time"] = 0.05 if side.kind == "inlet" and side.times is None else 0.0
    if side.kind == "inlet":
        update["profile"] = side.profile or "uniform"
        _check_profile(scene, name, side)
    return side.model_copy(update=update)


def _check_side_velocity(key: str, side: BoundarySide) -> None:
    """One velocity, or one for each of the times; for sides that have any."""
    for name in ("velocity", "times", "velocities", "profile", "positions", "values"):
        kinds = ("inlet", "moving_wall") if name == "velocity" else ("inlet",)
        if getattr(side, name) is not None and side.kind not in kinds:
            raise InputError(
                f"{key}.{name}",
                getattr(side, name),
                f"is not used with kind = {side.kind}",
                "remove this key",
            )
    _check_table(key, "times", side.times, "velocities", side.velocities)
    if side.kind in ("inlet", "moving_wall") and side.velocity is None and side.times is None:
        raise InputError(f"{key}.velocity", None, f"is needed by kind = {side.kind}", "set a velocity [m/s]")
    if side.velocity is not None and side.times is not None:
        raise InputError(
            f"{key}.velocity",
            side.velocity,
            "cannot be combined with times, which use velocities",
            "remove velocity, or times and velocities",
        )


def _check_table(key: str, name: str, arguments: Any, other: str, values: Any) -> None:
    """Arguments that increase, and as many values."""
    if (arguments is None) != (values is None):
        given, lacking = (name, other) if values is None else (other, name)
        raise InputError(
            f"{key}.{given}", arguments or values, f"needs {lacking} as well", f"add the key {key}.{lacking}"
        )
    if arguments is None:
        return
    if len(arguments) != len(values):
        raise InputError(
            f"{key}.{other}",
            values,
            f"needs {len(arguments)} entries, as many as {name}",
            "give lists of the same length",
        )
    for a, b in itertools.pairwise(arguments):
        if b <= a:
            raise InputError(f"{key}.{name}", arguments, f"must increase, but {b} follows {a}", "sort the entries")


def _check_profile(scene: Any, name: str, side: BoundarySide) -> None:
    key = f"boundary.{name}"
    _check_table(key, "positions", side.positions, "values", side.values)
    if (side.profile == "table") != (side.positions is not None):
        raise InputError(
            f"{key}.profile",
            side.profile or "uniform",
            "positions and values are needed by profile = table, and are not used with another profile",
            'set profile = "table" and give positions and values, or remove all three',
        )
    if side.profile == "parabolic" and not any(parabolic_axes(scene, name, side)):
        raise InputError(
            f"{key}.profile",
            side.profile,
            "the inlet spans the whole side between periodic or free-slip sides, where the velocity is not zero at the ends",
            'set profile = "uniform", or give a patch (from, to) or walls',
        )
    if side.positions is not None:
        axis = [a for a in range(scene.dimension) if a != scene.sides.index(name) // 2][-1]
        start = 0.0 if side.from_ is None else side.from_[-1]
        stop = scene.domain.size[axis] if side.to is None else side.to[-1]
        if side.positions[0] > start or side.positions[-1] < stop:
            raise InputError(
                f"{key}.positions",
                side.positions,
                f"must cover the whole inlet, {start} ... {stop} m",
                "add the ends of the inlet",
            )


def parabolic_axes(scene: Any, name: str, side: BoundarySide) -> tuple[bool, ...]:
    """Whether a parabolic inlet's velocity falls to zero at its ends, for each axis of the side.

    It does but where the inlet reaches over the whole side between two that do not hold the fluid.
    """
    result = []
    others = [axis for axis in range(scene.dimension) if axis != scene.sides.index(name) // 2]
    for position, axis in enumerate(others):
        kinds = {scene.boundary.get(end, BoundarySide()).kind for end in scene.sides[2 * axis : 2 * axis + 2]}
        whole = side.from_ is None or side.to is None
        if side.from_ is not None and side.to is not None:
            whole = (side.from_[position], side.to[position]) == (0.0, scene.domain.size[axis])
        result.append(not (whole and kinds <= {"periodic", "free_slip"}))
    return tuple(result)


def _vector(
    scene: Any, key: str, kind: str, velocity: float | tuple[float, ...], axis: int, upper: int
) -> tuple[float, ...]:
    """Velocity of a side as a vector; a single number is the inward speed of an inlet."""
    if isinstance(velocity, float):
        if kind != "inlet":
            check_entries(key, (velocity,), scene.dimension)
        inward = -velocity if upper else velocity
        return tuple(inward if a == axis else 0.0 for a in range(scene.dimension))
    check_entries(key, velocity, scene.dimension)
    if kind == "moving_wall" and velocity[axis] != 0.0:
        raise InputError(key, velocity, "a moving wall can only move in its own plane", "set the normal component to 0")
    return velocity
