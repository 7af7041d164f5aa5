"""Given motions of rigid bodies: translation, rotation, oscillation and tables over time, several on top of each other.

A motion is static: its kind, directions and centres. Its numbers (speed, rate, amplitude, frequency, phase, table) are
traced, a dict for each part. Time is a pair of floats in float32 (see `numerics.pair_arithmetic`), so that a wall has
no noise after hours.

Also on the host, with arrays of NumPy in float64.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from jax import Array

from jaxdem.numerics import pair_arithmetic as pairs
from jaxdem.numerics.compensated import Pair
from jaxdem.numerics.host import namespace
from jaxdem.numerics.placement import Placement, at_rest
from jaxdem.numerics.static import static

Numbers = Mapping[str, Array]
"""Traced numbers of one part of a motion."""


@static
class ActiveTime:
    """When a part of a motion goes on; before and after, it stands still where it is then.

    Attributes:
        begin, end: [s].
    """

    begin: float = 0.0
    end: float = math.inf

    def clock(self, time: Pair) -> tuple[Pair, Array]:
        """Time since it began, and () whether it goes on as 1 or 0."""
        dtype, on = time[0].dtype, namespace(time[0]).ones_like(time[0])
        if math.isfinite(self.end):
            past = time[0] >= self.end
            time, on = pairs.chosen(past, pairs.pair_of(self.end, dtype), time), on * (1.0 - past)
        if self.begin > 0.0:
            early = time[0] < self.begin
            time, on = pairs.chosen(early, pairs.pair_of(self.begin, dtype), time), on * (1.0 - early)
            time = pairs.total(time, pairs.pair_of(-self.begin, dtype))
        return time, on


class Course:
    """How a scalar changes with time: a distance [m] or an angle [rad]."""

    NUMBERS: ClassVar[tuple[str, ...]] = ()

    def at(self, numbers: Numbers, time: Pair) -> tuple[Pair, Array]:
        """The scalar as a pair, and its rate, at a time of its own clock.

        Args:
            numbers: traced, by the names in `NUMBERS`.
            time: () since it began [s].
        """
        raise NotImplementedError


@static
class Uniform(Course):
    """rate t, with `rate` [m/s or rad/s]."""

    NUMBERS: ClassVar[tuple[str, ...]] = ("rate",)

    def at(self, numbers: Numbers, time: Pair) -> tuple[Pair, Array]:
        """See `Course`."""
        return pairs.product(time, pairs.as_pair(numbers["rate"])), numbers["rate"]


@static
class Oscillation(Course):
    """A sin(2 pi f t + p), with `amplitude` A [m or rad], `frequency` f [Hz] and `phase` p [rad]."""

    NUMBERS: ClassVar[tuple[str, ...]] = ("amplitude", "frequency", "phase")

    def at(self, numbers: Numbers, time: Pair) -> tuple[Pair, Array]:
        """See `Course`."""
        amplitude, frequency = numbers["amplitude"], numbers["frequency"]
        turns = pairs.product(time, pairs.as_pair(frequency))
        turns = pairs.total(pairs.fraction(turns), pairs.as_pair(numbers["phase"] / (2.0 * math.pi)))
        sine, cosine = pairs.sine_and_cosine(turns)
        return pairs.product(sine, pairs.as_pair(amplitude)), 2.0 * math.pi * frequency * amplitude * cosine[0]


@static
class Table(Course):
    """Linear between the `values` (T,) [m or rad] at given times, constant before the first and after the last.

    Attributes:
        times: T of them, increasing, at least two [s].
    """

    times: tuple[float, ...]
    NUMBERS: ClassVar[tuple[str, ...]] = ("values",)

    def at(self, numbers: Numbers, time: Pair) -> tuple[Pair, Array]:
        """See `Course`."""
        values, dtype = numbers["values"], time[0].dtype
        xp = namespace(time[0])
        start, low = pairs.pair_of(self.times, dtype)
        spans = np.diff(np.asarray(self.times)).astype(dtype)
        piece = xp.clip(xp.searchsorted(xp.asarray(start), time[0], side="right") - 1, 0, len(spans) - 1)
        inside = (time[0] >= start[0]) & (time[0] < start[-1])
        rate = (values[piece + 1] - values[piece]) / xp.asarray(spans)[piece]
        begun = xp.asarray(start)[piece], None if low is None else xp.asarray(low)[piece]
        way = pairs.product(pairs.total(time, pairs.negative(begun)), pairs.as_pair(rate))
        here = pairs.total(way, pairs.as_pair(values[piece]))
        here = pairs.chosen(time[0] < start[0], pairs.as_pair(values[0]), here)
        here = pairs.chosen(time[0] >= start[-1], pairs.as_pair(values[-1]), here)
        return here, xp.where(inside, rate, 0.0)


@static
class Drift(Course):
    """x + v (t - t0): what a force holds, within an interval. Numbers are `displacement` x as a pair [m], `velocity` v
    [m/s] and `since` t0 as a pair [s]."""

    NUMBERS: ClassVar[tuple[str, ...]] = ("displacement", "velocity", "since")

    def at(self, numbers: Any, time: Pair) -> tuple[Pair, Array]:
        """See `Course`."""
        elapsed = pairs.total(time, pairs.negative(numbers["since"]))
        way = pairs.product(elapsed, pairs.as_pair(numbers["velocity"]))
        return pairs.total(way, numbers["displacement"]), numbers["velocity"]


@static
class Translation:
    """The body moves along a direction.

    Attributes:
        direction: D numbers, a unit vector.
        course: of the distance along it [m].
        active: when it goes on.
    """

    direction: tuple[float, ...]
    course: Course
    active: ActiveTime = ActiveTime()

    def at(self, numbers: Numbers, time: Pair) -> Placement:
        """The placement at a time [s]."""
        own, on = self.active.clock(time)
        way, rate = self.course.at(numbers, own)
        return at_rest(len(self.direction), way[0]).moved(way, self.direction, on * rate)


@static
class Rotation:
    """The body turns about an axis.

    Attributes:
        centre: a point of the axis, D numbers [m].
        axis: unit vector, three numbers; None in 2-D, where it turns from the first axis to the second.
        course: of the angle [rad].
        active: when it goes on.
    """

    centre: tuple[float, ...]
    axis: tuple[float, ...] | None
    course: Course
    active: ActiveTime = ActiveTime()

    def at(self, numbers: Numbers, time: Pair) -> Placement:
        """The placement at a time [s]: R = cos I + sin [a] + (1 - cos) a a^T, s = c - R c."""
        own, on = self.active.clock(time)
        angle, rate = self.course.at(numbers, own)
        dtype, xp = angle[0].dtype, namespace(angle[0])
        sine, cosine = pairs.sine_and_cosine(pairs.product(angle, pairs.pair_of(0.5 / math.pi, dtype)))
        along, across, turned = self._matrices(dtype)
        rotation = pairs.total(pairs.product(_grid(cosine), across), pairs.product(_grid(sine), turned))
        rotation = pairs.total(rotation, along)
        centre = np.asarray(self.centre)
        carried = [
            pairs.product(pairs.entry(rotation, np.s_[:, k]), pairs.pair_of(-component, dtype))
            for k, component in enumerate(self.centre)
        ]
        shift = carried[0]
        for part in carried[1:]:
            shift = pairs.total(shift, part)
        shift = pairs.total(shift, pairs.pair_of(centre, dtype))
        direction, _ = pairs.pair_of((1.0,) if self.axis is None else self.axis, dtype)
        middle, _ = pairs.pair_of(centre, dtype)
        return Placement(*rotation, *shift, xp.zeros_like(shift[0]), direction * (on * rate), xp.asarray(middle))

    def _matrices(self, dtype: np.dtype) -> tuple[Pair, Pair, Pair]:
        """a a^T, I - a a^T and [a], with [a] x = a cross x."""
        if self.axis is None:
            parts = np.zeros((2, 2)), np.eye(2), np.array([[0.0, -1.0], [1.0, 0.0]])
        else:
            a = np.asarray(self.axis)
            parts = np.outer(a, a), np.eye(3) - np.outer(a, a), np.cross(np.eye(3), a)
        along, across, turned = (pairs.pair_of(part, dtype) for part in parts)
        return along, across, turned


@static
class RigidMotion:
    """Motions on top of each other: the first moves the body, each further one what is before it as a whole.

    Axes and centres are those of the box: to turn about an axis that moves, turn first and then move.

    Attributes:
        parts: in this order; at least one.
    """

    parts: tuple[Translation | Rotation, ...]

    def at(self, numbers: Sequence[Numbers], time: Pair) -> Placement:
        """The placement at a time.

        Args:
            numbers: of each part, traced; see `Course`.
            time: () as a pair [s].
        """
        found = self.parts[0].at(numbers[0], time)
        for part, own in zip(self.parts[1:], numbers[1:], strict=True):
            found = part.at(own, time).after(found)
        return found

    @property
    def turns(self) -> bool:
        """Whether the body turns."""
        return any(isinstance(part, Rotation) for part in self.parts)


def _grid(scalar: Pair) -> Pair:
    return pairs.entry(scalar, np.s_[None, None])
