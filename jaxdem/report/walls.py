"""Walls of `[[walls]]` and openings of the box for pictures, from the scene as run.

A wall is solid where its signed distance is negative. In 3-D the view is from the front: solid is averaged over the
depth, as the fluid's speed is, and the outline is that of the section at half depth.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from jaxdem.report.runs import Array, lookup

RESOLUTION = {2: 400, 3: 200}
"""Points along the longer side of a picture, by dimension."""
SLICES = 17
"""Points over the depth; the middle one is at half of it."""

INLET, OUTLET = "inlet", "outlet"


@dataclass(frozen=True)
class Solid:
    """The walls of a picture at points (nx, nz) of its plane, cell centres of a mesh over the box.

    Attributes:
        share: of the point's surroundings and of the depth that is solid, 0 to 1.
        distance: signed distance at half depth, negative in the wall [m].
    """

    share: Array
    distance: Array


class Opening(NamedTuple):
    """Where fluid or grains come in or leave: a patch of a side, or the box that grains appear in.

    Attributes:
        kind: `INLET` or `OUTLET`.
        start, stop: opposite corners (x, height) in the picture's plane [m].
    """

    kind: str
    start: tuple[float, float]
    stop: tuple[float, float]


def solid(
    scene: Mapping[str, Any], box: Sequence[float], time: float = 0.0, history: Mapping[str, Array] | None = None
) -> Solid | None:
    """The walls of a scene that are there at a time; None where there are none.

    Args:
        scene: tables of scene.toml.
        box: side lengths (D,) [m].
        time: of the frame [s].
        history: of the run, with the way of each piston.
    """
    # A wall that vanishes at the time of a frame has gone in it, whatever rounding the frame's time has.
    now = time * (1.0 + 1e-9)
    walls = [
        dict(wall) | _place(wall, time, _way(history, k, time))
        for k, wall in enumerate(scene.get("walls", ()))
        if wall.get("begin", 0.0) <= now < wall.get("end", math.inf)
    ]
    return _solid(json.dumps(walls), tuple(box)) if walls else None


def _place(wall: Mapping[str, Any], time: float, way: float) -> dict[str, Any]:
    """Where a wall has moved, {} for one at rest."""
    if not (wall.get("motion") or wall.get("piston")):
        return {}
    from jaxdem.solids.motion_tables import placement_of  # loads JAX

    placed = placement_of(wall, time, way)
    if placed is None:
        return {}
    turn = np.eye(placed.dimension) if placed.rotation is None else np.asarray(placed.rotation)
    if wall["kind"] == "cylinder" and _same_tube(wall, turn, np.asarray(placed.shift)):
        return {}  # one picture for all angles of a drum
    return {"rotation": turn.tolist(), "shift": np.asarray(placed.shift).tolist(), "motion": None}


def _same_tube(wall: Mapping[str, Any], turn: Array, shift: Array) -> bool:
    """Whether a cylinder covers itself after it has moved."""
    center, size = np.asarray(wall["center"]), 1e-9 * float(wall["radius"])
    axis = np.zeros(len(center)) if wall.get("axis") is None else _unit(wall["axis"])
    moved = turn @ center + shift - center
    return bool(np.abs(moved - (moved @ axis) * axis).max() < size and np.allclose(turn @ axis, axis, atol=1e-12))


def _way(history: Mapping[str, Array] | None, number: int, time: float) -> float:
    """How far a piston has moved at a time [m]."""
    column = None if history is None else history.get(f"wall_{number}_displacement")
    return 0.0 if history is None or column is None else float(np.interp(time, history["time"], column))


@lru_cache(maxsize=8)
def _solid(tables: str, box: tuple[float, ...]) -> Solid:
    """See `solid`; kept, for walls that stand still are the same in many frames of a run."""
    walls = json.loads(tables)
    spacing = max(box[0], box[-1]) / RESOLUTION[len(box)]
    counts = [max(2, round(box[0] / spacing)), *([SLICES] * (len(box) - 2)), max(2, round(box[-1] / spacing))]
    centres = [(np.arange(n) + 0.5) * side / n for n, side in zip(counts, box, strict=True)]
    distance = _distance(walls, np.stack(np.meshgrid(*centres, indexing="ij"), axis=-1))
    # Half of a point's surroundings is solid where the surface goes through it.
    share = np.clip(0.5 - distance / spacing, 0.0, 1.0)
    return Solid(share, distance) if len(box) == 2 else Solid(share.mean(axis=1), distance[:, SLICES // 2])


def _distance(walls: Sequence[Mapping[str, Any]], points: Array) -> Array:
    """Distance from the nearest wall, negative inside one; the signed distances of `jaxdem.particles.surfaces`."""
    return np.min([distance for wall in walls for distance in _distances(wall, points)], axis=0)


def _distances(wall: Mapping[str, Any], points: Array) -> list[Array]:
    """Of the surfaces that a wall consists of, at points (..., D); of one that has moved at X = R^T (x - s)."""
    if "shift" in wall:
        points = (points - np.asarray(wall["shift"])) @ np.asarray(wall["rotation"])
    if wall["kind"] == "plane":
        return [(points - np.asarray(wall["point"])) @ _unit(wall["normal"])]
    if wall["kind"] == "cylinder":
        across = points - np.asarray(wall["center"])
        if wall.get("axis") is not None:
            axis = _unit(wall["axis"])
            across = across - (across @ axis)[..., None] * axis
        gap = float(wall["radius"]) - np.linalg.norm(across, axis=-1)
        return [gap if wall.get("inside", True) else -gap]
    a, b = (_unit(direction) for direction in wall["directions"])
    return [(points - np.asarray(wall["apex"])) @ _unit(n) for n in (b - (a @ b) * a, a - (a @ b) * b)]


def _unit(vector: Sequence[float] | Array) -> Array:
    array = np.asarray(vector, dtype=np.float64)
    return array / math.hypot(*array)


def openings(scene: Mapping[str, Any], box: Sequence[float]) -> list[Opening]:
    """Where something comes in or leaves, but for front and back, which the view looks through.

    Args:
        scene: tables of scene.toml.
        box: side lengths (D,) [m].
    """
    found = []
    for name in ("left", "right", "bottom", "top"):
        side = lookup(scene, f"boundary.{name}", {})
        kind = side.get("kind")
        if kind in (INLET, OUTLET) or side.get("particles") == "remove":
            found.append(_patch(INLET if kind == INLET else OUTLET, name, side, (box[0], box[-1])))
    regions = lookup(scene, "particles.inlet", ())
    found += [Opening(INLET, *((corner[0], corner[-1]) for corner in _ends(inlet))) for inlet in regions]
    return found


def _ends(inlet: Mapping[str, Any]) -> tuple[Sequence[float], Sequence[float]]:
    """Lower and upper corner of the box round an inlet of particles [m]."""
    region = inlet.get("region")
    if region is None:
        return inlet["start"], inlet["stop"]
    if region["shape"] == "polygon":
        corners = np.asarray(region["vertices"])
        return corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    if region["shape"] == "sphere":
        center, reach = np.asarray(region["center"]), np.full(len(region["center"]), region["radius"])
        return (center - reach).tolist(), (center + reach).tolist()
    along = _unit(region["axis"])
    ends = np.asarray(region["base"]) + np.outer([0.0, region["length"]], along)
    reach = region["radius"] * np.sqrt(np.maximum(1.0 - along**2, 0.0))
    return (ends.min(axis=0) - reach).tolist(), (ends.max(axis=0) + reach).tolist()


def _patch(kind: str, name: str, side: Mapping[str, Any], size: tuple[float, float]) -> Opening:
    across = 0 if name in ("left", "right") else 1  # the axis of the picture that the side is normal to
    along = 1 - across
    ends = [0.0, size[along]]
    if side.get("from") is not None and side.get("to") is not None:
        # The corners have the side's own axes in order: the vertical one is the last, x the first.
        ends = [float(side[key][-1 if along else 0]) for key in ("from", "to")]
    place = size[across] if name in ("right", "top") else 0.0
    start, stop = ((place, end) if along else (end, place) for end in ends)
    return Opening(kind, start, stop)
