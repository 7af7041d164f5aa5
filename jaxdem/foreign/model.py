"""What a deck describes, before it is a scene: in SI units and in the deck's own coordinates."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

AXES = "xyz"
SIDES = (("left", "right"), ("front", "back"), ("bottom", "top"))
"""Names of the two sides of each axis in a scene."""

LENGTHS = {"si": 1.0, "cgs": 0.01}
MASSES = {"si": 1.0, "cgs": 1e-3}


@dataclass
class Template:
    """A kind of particle for insertion: type, radius [m], density [kg/m3]."""

    type: int = 1
    radius: float = 0.0
    density: float = 0.0

    @property
    def mass(self) -> float:
        """[kg]."""
        return 4.0 / 3.0 * math.pi * self.radius**3 * self.density


@dataclass
class Region:
    """A block (lower, upper) or a cylinder or sphere with a table of a scene but for the shift of the origin."""

    shape: str
    lower: list[float]
    upper: list[float]
    center: list[float] = field(default_factory=list)
    radius: float = 0.0
    axis: int = 2

    def table(self, shift: list[float]) -> dict[str, Any]:
        """Keys of `particles.pack.region`."""
        low = [a + b for a, b in zip(self.lower, shift, strict=True)]
        if self.shape == "block":
            return {"shape": "box", "start": low, "stop": [a + b for a, b in zip(self.upper, shift, strict=True)]}
        center = [a + b for a, b in zip(self.center, shift, strict=True)]
        if self.shape == "sphere":
            return {"shape": "sphere", "center": center, "radius": self.radius}
        axis = [float(k == self.axis) for k in range(3)]
        center[self.axis] = low[self.axis]
        length = self.upper[self.axis] - self.lower[self.axis]
        return {"shape": "cylinder", "base": center, "axis": axis, "radius": self.radius, "length": length}


@dataclass
class Insertion:
    """Particles that a deck inserts: at the start (`rate` None) or over time."""

    place: str
    distribution: str
    region: Region
    count: int | None = None
    solid_fraction: float | None = None
    rate: float | None = None
    mass_rate: float | None = None
    velocity: tuple[float, ...] = (0.0, 0.0, 0.0)
    begin: float = 0.0


@dataclass
class Deck:
    """All of a deck that a scene can take.

    Attributes:
        units: "si" or "cgs".
        boundary: kinds of both ends of each axis, such as "ff".
        lower, upper: corners of the box [m]; empty before it is known.
        planes: coordinates of plane walls of each axis [m], with the type of their material.
        cylinders: axis, radius, two coordinates of the middle, type.
        properties: by name of LIGGGHTS: values for each type, or for each pair of types.
        contact: words of the pair style.
        time_step: [s].
        steps: number of steps of all runs.
        output_steps: steps between two outputs.
    """

    units: str = "si"
    boundary: list[str] = field(default_factory=lambda: ["pp", "pp", "pp"])
    lower: list[float] = field(default_factory=list)
    upper: list[float] = field(default_factory=list)
    types: int = 1
    planes: list[list[tuple[float, int]]] = field(default_factory=lambda: [[], [], []])
    cylinders: list[tuple[int, float, tuple[float, float], int]] = field(default_factory=list)
    properties: dict[str, list[float]] = field(default_factory=dict)
    contact: dict[str, str] = field(default_factory=dict)
    gravity: list[float] | None = None
    time_step: float = 0.0
    steps: int = 0
    output_steps: int = 0
    lost: str = "error"
    regions: dict[str, Region] = field(default_factory=dict)
    templates: dict[str, Template] = field(default_factory=dict)
    distributions: dict[str, list[tuple[str, float, bool]]] = field(default_factory=dict)
    insertions: list[Insertion] = field(default_factory=list)
    data_file: str = ""

    @property
    def length(self) -> float:
        """Unit of length [m]."""
        return LENGTHS[self.units]

    @property
    def mass(self) -> float:
        """Unit of mass [kg]."""
        return MASSES[self.units]
