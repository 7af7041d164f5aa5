"""Motions from the tables `motion` of a wall, as a scene file has them. Host."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from jaxdem.numerics.placement import Placement, at_rest
from jaxdem.solids.motion import (
    ActiveTime,
    Course,
    Oscillation,
    RigidMotion,
    Rotation,
    Table,
    Translation,
    Uniform,
)

Tables = Mapping[str, Any]


def motion_of(wall: Tables) -> RigidMotion | None:
    """The given motion of a wall; None where there is none.

    Args:
        wall: one of `[[walls]]`, whose `motion` has been checked.
    """
    motions = wall.get("motion") or ()
    return RigidMotion(tuple(_part(wall, motion) for motion in motions)) if motions else None


def numbers_of(wall: Tables) -> tuple[dict[str, Any], ...]:
    """The numbers of the parts of its motion, as the scene has them."""
    return tuple(_numbers(motion) for motion in wall.get("motion") or ())


def placement_of(wall: Tables, time: float, displacement: float = 0.0) -> Placement | None:
    """Where a wall is at a time, in float64; None where it does not move.

    Args:
        wall: one of `[[walls]]`.
        time: [s].
        displacement: of a piston [m].
    """
    motion, piston, placed = motion_of(wall), wall.get("piston"), None
    if motion is not None:
        numbers = [{name: number(value) for name, value in part.items()} for part in numbers_of(wall)]
        placed = motion.at(numbers, (number(time), None))
    if piston is not None:
        direction = unit(piston["direction"])
        placed = at_rest(len(direction), number(0.0)) if placed is None else placed
        placed = placed.moved((number(displacement), None), direction, number(0.0))
    return placed


def number(value: float | Sequence[float]) -> Any:
    """A value of a scene as float64."""
    return np.asarray(value, np.float64)[()]


def unit(vector: Sequence[float]) -> tuple[float, ...]:
    """The direction of a vector."""
    return tuple((np.asarray(vector) / math.hypot(*vector)).tolist())


def turns(motion: Tables) -> bool:
    """Whether a motion turns the wall; else it moves it along a direction."""
    return motion["kind"] == "rotation" or (motion["kind"] != "translation" and motion.get("direction") is None)


def _part(wall: Tables, motion: Tables) -> Translation | Rotation:
    active = ActiveTime(motion.get("begin") or 0.0, motion.get("end") or math.inf)
    if not turns(motion):
        return Translation(unit(motion.get("velocity") or motion["direction"]), _course(motion), active)
    axis = motion.get("axis") or wall.get("axis")
    centre = tuple(motion.get("center") or wall["center"])
    return Rotation(centre, None if axis is None else unit(axis), _course(motion), active)


def _course(motion: Tables) -> Course:
    if motion["kind"] == "oscillation":
        return Oscillation()
    return Table(tuple(motion["times"])) if motion["kind"] == "table" else Uniform()


def _numbers(motion: Tables) -> dict[str, Any]:
    if motion["kind"] == "oscillation":
        return {"phase": 0.0} | {name: motion[name] for name in Oscillation.NUMBERS if motion.get(name) is not None}
    if motion["kind"] == "table":
        return {"values": motion["angle" if turns(motion) else "displacement"]}
    velocity = motion.get("velocity")
    return {"rate": motion["rate"] if velocity is None else math.hypot(*velocity)}
