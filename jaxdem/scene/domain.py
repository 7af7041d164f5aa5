"""The tables `[domain]`, `[time]` and `[output]`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from pydantic import Field, ValidationInfo, model_validator

from jaxdem.errors import InputError
from jaxdem.scene.base import (
    Abscissae,
    NonNegative,
    Positive,
    Section,
    VectorOverTime,
    at_all_times,
    check_over_time,
    wrong,
)

SIDES = {2: ("left", "right", "bottom", "top"), 3: ("left", "right", "front", "back", "bottom", "top")}
"""Sides in the order axis by axis, lower before upper; the last axis is up."""

MOST_OUTPUTS = 1_000_000
"""Frames that a run may write; more is a slip of the output interval's unit."""


@dataclass(frozen=True)
class Box:
    """The box: side lengths [m], and whether each axis is periodic."""

    size: tuple[float, ...]
    periodic: tuple[bool, ...]

    @property
    def sides(self) -> tuple[str, ...]:
        """Names of the sides, axis by axis."""
        return SIDES[len(self.size)]

    def normal_of(self, side: str) -> tuple[int, bool]:
        """Axis that a side is normal to, and whether it is the upper one of the two."""
        axis, upper = divmod(self.sides.index(side), 2)
        return axis, bool(upper)

    def along(self, side: str) -> list[int]:
        """Axes along a side."""
        return [axis for axis in range(len(self.size)) if axis != self.normal_of(side)[0]]

    def inward(self, side: str, speed: float) -> tuple[float, ...]:
        """Velocity into the box at a side."""
        normal, upper = self.normal_of(side)
        return tuple((-speed if upper else speed) if axis == normal else 0.0 for axis in range(len(self.size)))

    def check_same_along_periodic_axes(self, key: str, across: Sequence[float]) -> None:
        """Refuses a wall that changes along a periodic axis: a particle that has gone round meets it again."""
        for axis, (part, wraps) in enumerate(zip(across, self.periodic, strict=True)):
            if wraps and part != 0.0:
                limit = "the wall must be the same all along a periodic axis"
                remedy = "turn the wall, or do not make that axis periodic"
                raise InputError(key, f"along axis {axis}", limit, remedy)


class Domain(Section):
    """The box.

    Attributes:
        size: side lengths, two or three numbers; the last axis points up [m].
        depth: extent in the third direction, in 2-D only. Default: one (largest) diameter, or 1 m without particles
            [m].
        gravity: acceleration, one number per axis; with `gravity_times` one such list for each time. Default: 9.81
            downwards. Along a periodic axis it drives a fluid, and must be given then [m/s2].
        gravity_times: increasing times for `gravity`. Linear between them, constant before the first and after the last
            [s].
    """

    size: tuple[Positive, ...] = Field(min_length=2, max_length=3)
    depth: Positive | None = None
    gravity: VectorOverTime | None = None
    gravity_times: Abscissae | None = None

    @property
    def gravities(self) -> tuple[tuple[float, ...], ...]:
        """Gravity at all its times: one vector where it does not change; none where it is not given."""
        return at_all_times(self.gravity)  # type: ignore[return-value]

    @property
    def strongest_gravity(self) -> tuple[float, ...]:
        """That of the time at which it is largest [m/s2]."""
        return max(self.gravities, key=lambda row: math.hypot(*row), default=(0.0,) * len(self.size))

    @property
    def gravity_along(self) -> tuple[float, ...]:
        """The largest size of each component at any time [m/s2]."""
        return tuple(max(map(abs, column)) for column in zip(*self.gravities, strict=True))

    @property
    def oblique_gravity(self) -> bool:
        """Whether gravity has components along two axes or more, at one time or one after the other."""
        return sum(part > 0.0 for part in self.gravity_along) > 1

    @model_validator(mode="after")
    def _gravity_over_time(self) -> Domain:
        if self.gravity is not None:
            check_over_time("gravity_times", self.gravity_times, "gravity", self.gravity)
        elif self.gravity_times is not None:
            raise wrong("gravity_times", self.gravity_times, "needs gravity", "give gravity, one vector for each time")
        return self

    @model_validator(mode="after")
    def _depth_of_a_plane(self) -> Domain:
        if self.depth is not None and len(self.size) == 3:
            raise wrong("depth", self.depth, "is for 2-D scenes only", "remove this key")
        return self


class Time(Section):
    """Duration and output.

    Attributes:
        end: end of the simulation; of a scene with `[start]` counted from the very first run [s].
        output_interval: time between two frames and between two rows of `history.csv`; it must divide `end`, of a scene
            with `[start]` the time from there to `end` [s].
    """

    end: Positive
    output_interval: Positive

    @model_validator(mode="after")
    def _outputs(self, info: ValidationInfo) -> Time:
        """Outputs divide the run, and are no more than can be meant; when a run with `[start]` begins is not known."""
        end, frames = self.end, self.end / self.output_interval
        if frames > MOST_OUTPUTS:
            limit = f"makes {frames:.3g} outputs up to time.end = {end} s, the limit is {MOST_OUTPUTS}"
            remedy = f"raise it to at least {end / MOST_OUTPUTS:.3g} s"
            raise wrong("output_interval", self.output_interval, limit, remedy)
        if (info.context or {}).get("begins_later"):
            return self
        if frames < 1.0 - 1e-9 or abs(frames - round(frames)) > 1e-6 * frames:
            remedy = f"use, for example, time.output_interval = {_divisor(end, frames)}"
            raise wrong("output_interval", self.output_interval, f"must divide time.end = {end} s", remedy)
        return self

    def check_outputs(self, begin: Fraction) -> int:
        """Number of frames after the first of a run that begins at this time [s].

        Raises:
            InputError: it ends before it begins, or the output interval does not divide what is between.
        """
        end, output = self.end, self.output_interval
        if begin == 0:
            return round(end / output)
        number, start = float(Fraction(repr(float(end))) - begin) / output, float(begin)
        if number < 1e-6:
            limit = f"the run that the scene begins from is at t = {start:.9g} s, and time goes on from there"
            raise InputError("time.end", end, limit, f"raise it, for example to {start + output:.9g} s")
        if round(number) < 1 or abs(number - round(number)) > 1e-6 * number:
            limit = f"must divide the time from the start at {start:.9g} s to time.end = {end} s"
            remedy = f"use, for example, time.output_interval = {_divisor(end - start, number)}"
            raise InputError("time.output_interval", output, limit, remedy)
        return round(number)


def _divisor(time: float, parts: float) -> str:
    """An interval that divides a time into about so many parts, of few digits."""
    near = range(max(1, math.ceil(parts / 2.0)), max(1, math.floor(2.0 * parts)) + 1)
    if len(near) > 1000:
        near = range(round(parts) - 500, round(parts) + 500)
    best = min(near, key=lambda n: (len(f"{time / n:.6g}"), abs(math.log(n / max(parts, 1.0)))))
    return f"{time / best:.6g}"


class Output(Section):
    """Optional output.

    Attributes:
        samples: time between two samples of the inputs and results of the drag law; 0 for none [s].
        checkpoint_interval: wall time between two checkpoints; a checkpoint is written at the first output after it
            [s].
        energy: whether the energy that contacts give and take is summed in every contact step, for the balance of
            energy in the summary.
        walls: whether what is done to every wall of `[[walls]]` is written over time: force, torque, mass of the
            particles that touch it, and power of one that moves. Each that has no probe of kind "wall" gets one, of its
            name, or wall_K by the number of its table.
    """

    samples: NonNegative = 0.0
    checkpoint_interval: NonNegative = 60.0
    energy: bool = False
    walls: bool = False


def check_output(output: Output, has_particles: bool, has_walls: bool) -> None:
    """Refuses output of what a scene has not.

    Raises:
        InputError: naming the key.
    """
    if output.energy and not has_particles:
        limit = "is the balance of energy of particles, and the scene has none"
        raise InputError("output.energy", True, limit, "remove this key, or add [particles]")
    if output.walls and not has_walls:
        limit = "the scene has no [[walls]]; a side of the box needs a probe of kind wall"
        raise InputError("output.walls", True, limit, "remove this key, or add [[probes]]")
