"""Regions of a deck: blocks, cylinders along an axis and spheres."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from jaxdem.foreign.notes import Unknown
from jaxdem.particles import regions

AXES = "xyz"
LAST_DIGITS = 12
"""Significant digits of numbers that are computed: sums of decimal fractions are decimal again."""


def plain(value: float) -> float:
    """A number to `LAST_DIGITS`."""
    return float(f"{value:.{LAST_DIGITS}g}") + 0.0


@dataclass
class Region:
    """A block, or a cylinder or sphere with the box around it, in the coordinates of the deck [m].

    Attributes:
        shape: "block", "cylinder" or "sphere".
        lower, upper: corners of the box around it.
        center: of a sphere, or a point of the axis of a cylinder.
        radius: of these two.
        axis: number of the axis of a cylinder.
        inside: false for what lies outside (`side out`).
    """

    shape: str
    lower: list[float]
    upper: list[float]
    center: list[float] = field(default_factory=list)
    radius: float = 0.0
    axis: int = 2
    inside: bool = True

    def table(self, shift: list[float], axes: tuple[int, ...]) -> dict[str, Any]:
        """Keys of a region of a scene whose box begins `-shift` [m] away, with these axes of the deck.

        Raises:
            Unknown: it has no counterpart in a plane.
        """
        if not self.inside:
            raise Unknown("what lies outside of a region has no counterpart; write a region for what is meant")
        low = [plain(self.lower[k] + shift[k]) for k in axes]
        if self.shape == "block":
            return {"shape": "box", "start": low, "stop": [plain(self.upper[k] + shift[k]) for k in axes]}
        center = [plain(a + b) for a, b in zip(self.center, shift, strict=True)]
        if self.shape == "sphere" or (len(axes) == 2 and self.axis == 2):
            return {"shape": "sphere", "center": [center[k] for k in axes], "radius": plain(self.radius)}
        if len(axes) == 2:
            raise Unknown("a cylinder across z has no counterpart in a plane; use a block")
        axis = [float(k == self.axis) for k in range(3)]
        center[self.axis] = low[self.axis]
        length = plain(self.upper[self.axis] - self.lower[self.axis])
        return {"shape": "cylinder", "base": center, "axis": axis, "radius": plain(self.radius), "length": length}

    def space(self, axes: tuple[int, ...]) -> regions.Region:
        """The part of space that it is, in the coordinates of the deck.

        Raises:
            Unknown: it has no counterpart in a plane.
        """
        table = self.table([0.0] * 3, axes)
        if table["shape"] == "box":
            return regions.box(table["start"], table["stop"])
        if table["shape"] == "sphere":
            return regions.ball(table["center"], table["radius"])
        return regions.cylinder(table["base"], table["axis"], table["radius"], table["length"])

    def holds(self, points: np.ndarray, axes: tuple[int, ...]) -> np.ndarray:
        """(N,) which of the points (N, 3) lie in it."""
        whole = Region(self.shape, self.lower, self.upper, self.center, self.radius, self.axis)
        found: np.ndarray = whole.space(axes).inside(points[:, list(axes)])
        return found if self.inside else ~found


def block(lower: list[float], upper: list[float]) -> Region:
    """The block between two corners [m]."""
    return Region("block", list(lower), list(upper))


def cylinder(axis: int, middle: list[float], radius: float, ends: list[float]) -> Region:
    """A cylinder along an axis; `middle` are its coordinates along the two others [m]."""
    others = [k for k in range(3) if k != axis]
    center = [0.0] * 3
    center[others[0]], center[others[1]] = middle
    lower, upper = [c - radius for c in center], [c + radius for c in center]
    lower[axis], upper[axis] = ends
    return Region("cylinder", lower, upper, center, radius, axis)


def sphere(center: list[float], radius: float) -> Region:
    """A sphere [m]."""
    return Region("sphere", [c - radius for c in center], [c + radius for c in center], list(center), radius)


def around(points: np.ndarray) -> Region:
    """The block around points (N, 3) [m]."""
    return block(points.min(axis=0).tolist(), points.max(axis=0).tolist())


def together(parts: list[Region]) -> Region | None:
    """The block around several regions; None without any."""
    if not parts:
        return None
    ends = [[pick(part) for part in parts] for pick in (lambda r: r.lower, lambda r: r.upper)]
    return block([min(c) for c in zip(*ends[0], strict=True)], [max(c) for c in zip(*ends[1], strict=True)])


def pairs_of(words: list[str]) -> dict[str, str]:
    """Words as keys and values, from the first on."""
    return dict(itertools.pairwise(words))
