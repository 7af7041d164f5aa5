"""Columns of `history.csv` beside the metrics: those of a part of a scene, in runs that have it."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

from jaxdem.io.scene_text import comes_and_goes, driven_axes

Tables = Mapping[str, Any]
"""A scene as nested dicts."""


SIDES = ("left", "right", "front", "back", "bottom", "top")
"""Of the box, in the order of their columns."""

PASSING = ("inflow", "outflow", "liquid_inflow", "liquid_outflow")
"""Beginnings of the columns of a boundary that fluid may pass."""


class PartColumns(NamedTuple):
    """The columns of a part.

    Attributes:
        pattern: that their names match.
        names: those of a scene; none where it has not the part.
        meaning: what they hold.
        units: by the beginning of a name; the first that fits.
    """

    pattern: str
    names: Callable[[Tables], Iterable[str]]
    meaning: str
    units: Mapping[str, str]


def _walls(scene: Tables, key: str, column: str) -> list[str]:
    """A column of every wall that has a key, by the number of the wall."""
    walls = scene.get("walls", []) if "particles" in scene else []
    return [f"wall_{number}_{column}" for number, wall in enumerate(walls) if wall.get(key) is not None]


def _temperatures(scene: Tables) -> list[str]:
    parts = {"fluid": "fluid_temperature_mean", "particles": "particle_temperature_mean"}
    return [column for part, column in parts.items() if "heat" in scene and part in scene]


def _along(scene: Tables) -> list[str]:
    names = ("pressure_gradient", "bulk_velocity")
    return [f"{name}_{axis}" for name in names for axis in driven_axes(scene)]


def _passages(scene: Tables) -> list[str]:
    """What comes in and leaves, of every boundary that fluid may pass."""
    sides, walls = scene.get("boundary", {}), scene.get("walls", [])
    names = [name for name in SIDES if sides.get(name, {}).get("kind") in ("inlet", "outlet")]
    openings = ((n, k) for n, wall in enumerate(walls) for k, _ in enumerate(wall.get("opening", [])))
    names += [f"wall_{n}_opening_{k}" for n, k in openings]
    kinds = PASSING[: 4 if "surface" in scene else 2]
    return [f"{kind}_{name}" for name in names for kind in kinds] if "fluid" in scene else []


PARTS: tuple[PartColumns, ...] = (
    PartColumns(
        r"present|removed",
        lambda scene: ("present", "removed") if comes_and_goes(scene) else (),
        "numbers of particles that are there and that have left",
        {"": "-"},
    ),
    PartColumns(
        r"bonds_(intact|broken|left)",
        lambda scene: ("bonds_intact", "bonds_broken", "bonds_left") if scene.get("bonds") else (),
        "numbers of bonds that hold, that broke, and that went with a grain",
        {"": "-"},
    ),
    PartColumns(
        r"(pressure_gradient|bulk_velocity)_[xyz]",
        _along,
        "mean gradient of the pressure and bulk velocity along every periodic axis of a driven fluid",
        {"pressure": "Pa/m", "bulk": "m/s"},
    ),
    PartColumns(
        r"wall_\d+_displacement",
        lambda scene: _walls(scene, "piston", "displacement"),
        "how far a wall that a force holds has moved",
        {"": "m"},
    ),
    PartColumns(
        r"wall_\d+_wear",
        lambda scene: _walls(scene, "wear", "wear"),
        "what has been worn off a mesh",
        {"": "m3"},
    ),
    PartColumns(
        r"(fluid|particle)_temperature_mean",
        _temperatures,
        "mean temperatures of the fluid, by volume, and of the particles, by heat capacity",
        {"": "K"},
    ),
    PartColumns(
        r"scalar_\w+_mean",
        lambda scene: [f"scalar_{table['name']}_mean" for table in scene.get("scalars", [])],
        "mean of a scalar over the volume of the fluid, in its unit",
        {"": ""},
    ),
    PartColumns(
        r"liquid_(volume|centre_height)",
        lambda scene: ("liquid_volume", "liquid_centre_height") if "surface" in scene else (),
        "volume of the liquid and height of its centre, of two fluids",
        {"liquid_volume": "m3", "": "m"},
    ),
    PartColumns(
        rf"({'|'.join(PASSING)})_({'|'.join(SIDES)}|wall_\d+_opening_\d+)",
        _passages,
        "volume per time that comes in and that leaves through every inlet, outlet and opening, mean since the last "
        "output; of two fluids also that of the liquid",
        {"": "m3/s"},
    ),
)
"""In the order of their columns."""

_KNOWN = re.compile("|".join(f"(?:{part.pattern})" for part in PARTS))


def columns_of_parts(scene: Tables) -> tuple[str, ...]:
    """Columns of the history of a scene, beside the metrics."""
    return tuple(name for part in PARTS for name in part.names(scene))


def is_of_a_part(name: str) -> bool:
    """Whether a column may be that of a part."""
    return _KNOWN.fullmatch(name) is not None


def unit_of(name: str) -> str:
    """Unit of a column of a part; empty where it has none that is known."""
    part = next(part for part in PARTS if re.fullmatch(part.pattern, name))
    return next(unit for start, unit in part.units.items() if name.startswith(start))
