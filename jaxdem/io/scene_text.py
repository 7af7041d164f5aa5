"""What the run directory needs to know of the scene it stores: how two differ, and the size of a cell."""

from __future__ import annotations

import errno
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jaxdem.errors import InputError
from jaxdem.files.reading import parse_toml, read_text
from jaxdem.numerics.axes import AXES

LOWER_SIDES = {2: ("left", "bottom"), 3: ("left", "front", "bottom")}
"""By dimension the names of the sides at the lower ends of the axes."""

_ABSENT = "(not set)"

TABLES = ("domain", "particles", "contact", "fluid", "boundary", "coupling", "closure", "start", "time", "output")
"""Of a scene, those that are one table each."""


def parse(text: str, source: str) -> dict[str, Any]:
    """The TOML `text` as nested dicts.

    Raises:
        InputError: it is not TOML, or not a scene's; `source` names where it came from.
    """
    try:
        tables = parse_toml(text)
    except ValueError as error:
        raise InputError("scene.toml", source, f"is not TOML ({error})", "Correct the file.") from error
    for name in TABLES:
        if not isinstance(tables.get(name, {}), dict):
            raise InputError("scene.toml", source, f"{name} is not a table", "Correct the file.")
    for name, key in (("domain", "size"), ("fluid", "cells")):
        given = tables.get(name, {}).get(key, [1, 1])
        if not isinstance(given, list) or not all(_positive(number) for number in given):
            limit = f"{name}.{key} is not a list of positive numbers"
            raise InputError("scene.toml", source, limit, "Correct the file.")
    return tables


def read(path: Path) -> str:
    """The text of a stored scene.

    Raises:
        OSError: it cannot be read.
    """
    try:
        return read_text(path)
    except UnicodeDecodeError:
        raise OSError(errno.EILSEQ, "is not UTF-8 text", str(path)) from None


def _positive(number: object) -> bool:
    return isinstance(number, int | float) and 0 < number < math.inf


def without_folders(tables: Mapping[str, Any]) -> dict[str, Any]:
    """The scene with closures and the run that it starts from by their names alone.

    A study may be moved; a checkpoint knows the weights, and what the run began from.
    """
    found = dict(tables)
    for table, key in (("closure", "file"), ("fluid", "subgrid"), ("start", "from")):
        if tables.get(table, {}).get(key):
            found[table] = {**tables[table], key: Path(tables[table][key]).name}
    return found


def end_of(scene: Mapping[str, Any]) -> float:
    """`time.end` [s]; infinite where it is not there."""
    end = scene.get("time", {}).get("end")
    return float(end) if isinstance(end, int | float) else math.inf


def without_end(scene: Mapping[str, Any]) -> dict[str, Any]:
    """The scene without its end, and without that of inlets which go on to it: what a longer run has in common."""
    found, end = dict(scene), end_of(scene)
    if isinstance(scene.get("time"), dict):
        found["time"] = {key: value for key, value in scene["time"].items() if key != "end"}
    inlets = scene.get("particles", {}).get("inlet")
    if isinstance(inlets, list):
        kept = [{k: v for k, v in one.items() if (k, v) != ("end", end)} for one in inlets if isinstance(one, dict)]
        found["particles"] = {**scene["particles"], "inlet": kept}
    return found


def first_difference(
    stored: dict[str, Any], given: dict[str, Any], defaults: Mapping[str, object] | None = None
) -> tuple[str, object, object] | None:
    """Dotted key, stored value and given value of the first key that differs; None if the scenes agree.

    Comments, order and layout of the text do not count, nor in which folder a closure's file lies, nor a table without
    keys, nor a key that the stored scene, of a version before, has not yet, while the given one has its default.

    Args:
        stored: tables of the one scene.
        given: of the other.
        defaults: by dotted key.
    """
    old, new = _flat(without_folders(stored)), _flat(without_folders(given))
    for key in (*old, *(key for key in new if key not in old)):
        before, after = old.get(key, _ABSENT), new.get(key, _ABSENT)
        # 1 == 1.0 == True in Python, yet a changed type may change what is run.
        if before is _ABSENT and key in (defaults or {}) and after == (defaults or {})[key]:
            continue
        if type(before) is not type(after) or before != after:
            return key, before, after
    return None


def spacing(scene: Mapping[str, Any], cells: tuple[int, ...]) -> tuple[float, ...]:
    """Size (D,) [m] of a cell: `domain.size` over `cells`.

    Raises:
        InputError: `domain.size` is absent or has not as many entries as `cells`.
    """
    size = scene.get("domain", {}).get("size")
    if not isinstance(size, list) or len(size) != len(cells):
        remedy = "Give the size [m] of the domain along each axis."
        raise InputError("domain.size", size, f"fluid with cells {cells} needs {len(cells)} entries", remedy)
    return tuple(float(length) / number for length, number in zip(size, cells, strict=True))


def depth(scene: Mapping[str, Any], cell: tuple[float, ...]) -> float:
    """Thickness [m] of the layer of a 2-D scene: `domain.depth`, else the smallest side of a cell."""
    return float(scene.get("domain", {}).get("depth") or min(cell))


def probe_names(scene: dict[str, Any]) -> list[str]:
    """Names of the probes of a scene."""
    probes = scene.get("probes", [])
    tables = probes if isinstance(probes, list) else []
    return [str(table["name"]) for table in tables if isinstance(table, dict) and "name" in table]


def driven_axes(scene: Mapping[str, Any]) -> str:
    """Names of the periodic axes of a fluid that something drives along one of them."""
    fluid, given = scene.get("fluid"), scene.get("domain", {}).get("gravity", [])
    rows = given if given and isinstance(given[0], list) else [given]  # one for each time, or one
    gravity = [max(map(abs, column)) for column in zip(*rows, strict=True)]
    names, lower = AXES.get(len(gravity), ""), LOWER_SIDES.get(len(gravity), ())
    sides = scene.get("boundary", {})
    wraps = [sides.get(side, {}).get("kind") == "periodic" for side in lower]
    drives = isinstance(fluid, dict) and ("pressure_gradient" in fluid or "bulk_velocity" in fluid)
    driven = any(wrap and (drives or component != 0.0) for wrap, component in zip(wraps, gravity, strict=False))
    if fluid is None or not driven:
        return ""
    return "".join(name for name, wrap in zip(names, wraps, strict=True) if wrap)


def comes_and_goes(scene: Mapping[str, Any]) -> bool:
    """Whether the number of particles changes while the scene runs."""
    sides = scene.get("boundary", {}).values()
    leaves = any(isinstance(side, dict) and side.get("particles") == "remove" for side in sides)
    absent = scene.get("start", {}).get("absent", False)
    return leaves or bool(absent) or bool(scene.get("particles", {}).get("inlet"))


def _flat(scene: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in scene.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat
