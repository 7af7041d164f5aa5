"""The tables `[[walls.motion]]` and `[walls.piston]` of a scene: how a wall moves."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import model_validator

from jaxdem.errors import InputError
from jaxdem.scene.base import (
    Abscissae,
    Direction,
    Finite,
    NonNegative,
    Positive,
    Section,
    Vector,
    check_table,
    wrong,
)
from jaxdem.scene.domain import Box

TURN, SHIFT = ("center", "axis"), ("direction",)
"""Keys that say about which axis a motion turns, and along which direction it moves."""

NEEDED = {
    "translation": {"velocity": "how fast it moves"},
    "rotation": {"rate": "how fast it turns"},
    "oscillation": {"amplitude": "how far it moves or turns to either side", "frequency": "how often a second"},
    "table": {"times": "the times of its values"},
}
"""Keys that each kind of motion must have, and what they are."""

OPTIONAL = {
    "translation": (),
    "rotation": TURN,
    "oscillation": ("phase", *SHIFT, *TURN),
    "table": ("displacement", "angle", *SHIFT, *TURN),
}
"""Keys that it may have, beside `begin` and `end`."""


class WallMotion(Section):
    """A given motion. Several are on top of each other: the first moves the wall, each further one moves the wall
    with the motions before it as a whole. Centres and axes are those of the box, at rest.

    Attributes:
        kind: "translation", "rotation", "oscillation" (a sine, along a direction or about an axis) or "table" (linear
            between given times, along a direction or about an axis).
        velocity: velocity of a translation [m/s].
        rate: angular velocity of a rotation, positive counter-clockwise about the axis; in 2-D from x to z [rad/s].
        center: a point of the axis that it turns about. Default: the centre of a cylinder [m].
        axis: direction of that axis, any length; 3-D only. Default: the axis of a cylinder.
        direction: direction in which it oscillates, or moves by a table; any length.
        amplitude: A of an oscillation A sin(2 pi f t + p). It is a distance with `direction`, and an angle without
            [m or rad].
        frequency: frequency f of an oscillation [Hz].
        phase: phase p of an oscillation. The wall starts where p puts it: its own keys are the middle. Default: 0
            [rad].
        times: times of a table, increasing [s].
        displacement: displacements of a table, one number for each time, along `direction` [m].
        angle: angle of a table, one number for each time, about `axis` [rad].
        begin: time at which this motion begins: its own time is 0 then, and until then it stays where it begins.
            Default: 0 [s].
        end: time at which it ends; from then on it stays where it is. Default: never [s].
    """

    kind: Literal["translation", "rotation", "oscillation", "table"]
    velocity: Direction | None = None
    rate: Finite | None = None
    center: Vector | None = None
    axis: Direction | None = None
    direction: Direction | None = None
    amplitude: Positive | None = None
    frequency: Positive | None = None
    phase: Finite | None = None
    times: Abscissae | None = None
    displacement: tuple[Finite, ...] | None = None
    angle: tuple[Finite, ...] | None = None
    begin: NonNegative | None = None
    end: Positive | None = None

    @property
    def turns(self) -> bool:
        """Whether it turns the wall; else it moves it along a direction."""
        return self.kind == "rotation" or (self.kind != "translation" and self.direction is None)

    @model_validator(mode="after")
    def _keys_of_its_kind(self) -> WallMotion:
        needed, optional = NEEDED[self.kind], (*OPTIONAL[self.kind], "begin", "end")
        for name in type(self).model_fields:
            value = getattr(self, name)
            if value is None and name in needed:
                raise wrong(name, None, f"is needed by kind = {self.kind}: {needed[name]}", "add this key")
            if value is not None and name not in ("kind", *needed, *optional):
                limit = f"the keys of a motion of kind {self.kind} are {', '.join((*needed, *optional))}"
                raise wrong(name, value, limit, "remove this key")
        if self.rate == 0.0:
            raise wrong("rate", self.rate, "a rotation that does not turn", "remove this motion")
        if self.end is not None and self.end <= (self.begin or 0.0):
            raise wrong("end", self.end, f"must be after begin = {self.begin or 0.0} s", "raise end, or lower begin")
        return self

    @model_validator(mode="after")
    def _along_or_about(self) -> WallMotion:
        if self.direction is not None and (self.center is not None or self.axis is not None):
            limit = "a motion is along a direction, or about an axis, and not both"
            raise wrong("direction", self.direction, limit, "make two motions of it, or remove center and axis")
        if self.kind == "table":
            name = "angle" if self.turns else "displacement"
            other = "displacement" if self.turns else "angle"
            if getattr(self, other) is not None:
                words = "needs direction" if self.turns else "is about an axis, and there is a direction"
                remedy = "give direction" if self.turns else "remove direction, or give displacement"
                raise wrong(other, getattr(self, other), words, remedy)
            check_table("times", self.times, name, getattr(self, name))
        return self


class Piston(Section):
    """A wall that a force holds along a direction e: m dv/dt = F + m g.e - c v + f.e, with g gravity and f the force
    of the grains on it, and of the fluid that sees it. It starts at rest where the keys of the wall have it, and does
    not turn or move across e but by `motion`.

    Attributes:
        direction: direction e of its motion and of the force, any length.
        force: force F along the direction, beside the wall's weight; with `force_times` one number for each time [N].
        force_times: increasing times for `force`. Linear between them, constant before the first and after the last
            [s].
        mass: mass m of the wall. A heavy wall swings longer; its weight acts on the grains too, where the direction is
            not horizontal [kg].
        damping: damping c, a force against its motion over its speed. Default: 0 [N s/m].
    """

    direction: Direction
    force: Finite | tuple[Finite, ...]
    force_times: Abscissae | None = None
    mass: Positive
    damping: NonNegative = 0.0

    @property
    def forces(self) -> tuple[float, ...]:
        """The force at all its times [N]."""
        return self.force if isinstance(self.force, tuple) else (self.force,)

    @model_validator(mode="after")
    def _force_over_time(self) -> Piston:
        given = self.force if isinstance(self.force, tuple) else None
        if (given is None) != (self.force_times is None):
            limit = "is a list with force_times, and a number without"
            raise wrong("force", self.force, limit, "give one force for each of force_times, or remove force_times")
        check_table("force_times", self.force_times, "force", given)
        return self


def check_motion(key: str, motion: WallMotion, box: Box, of_wall: tuple[float, ...] | None) -> None:
    """Refuses a motion that does not fit the box.

    Args:
        key: of the motion.
        motion: as given.
        box: of the scene.
        of_wall: the centre of its cylinder; None for another wall.

    Raises:
        InputError: an axis in 2-D or none in 3-D, no centre, or a rotation that leads across a periodic axis.
    """
    if not motion.turns:
        return
    solid = len(box.size) == 3
    if motion.center is None and of_wall is None:
        remedy = "give center, a point of the axis"
        if motion.kind != "rotation":
            remedy += ", or give direction for a motion along a line"
        raise InputError(f"{key}.center", None, "is needed: the wall turns about it", remedy)
    if motion.axis is not None and not solid:
        raise InputError(f"{key}.axis", motion.axis, "is for 3-D scenes only", "remove this key")
    if motion.axis is None and solid and of_wall is None:
        raise InputError(f"{key}.axis", None, "is needed in 3-D", "give the direction of the axis it turns about")
    along = motion.axis or ()
    for axis, wraps in enumerate(box.periodic):
        if wraps and not (solid and along and math.hypot(*along) == abs(along[axis])):
            if solid and motion.axis is None and of_wall is not None:
                continue  # about its own axis, which is the periodic one
            limit = f"turns the wall across axis {axis}, along which the box is periodic"
            raise InputError(f"{key}.kind", motion.kind, limit, "turn it about that axis, or use walls there")
