"""Which quantity a named column is, in which unit; the state of the particles in SI units, sorted by id."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from jaxdem.errors import InputError, cut
from jaxdem.files.text_table import number_of
from jaxdem.particle_files.raw import KEY, Raw, Values, refusal

AXES = ("x", "y", "z")
LARGEST_NUMBER = 2**53
"""Ids and types are whole numbers, which may come as floats."""

AGREE = 0.02
"""Part by which two columns for one quantity may differ: a program may write three digits."""


class Quantity(NamedTuple):
    """A quantity of particles: its kind of unit, empty for a pure number, and its names, the usual one first."""

    kind: str
    names: tuple[str, ...]


def _vector(kind: str, short: tuple[str, ...], long: tuple[str, ...]) -> dict[str, Quantity]:
    """The components of a vector: vx after a short name, velocity_x and, as ParaView writes it, velocity:0 after a long
    one."""
    found = {}
    for number, axis in enumerate(AXES):
        names = [f"{name}{axis}" for name in short]
        names += [f"{name}{mark}" for name in long for mark in (f"_{axis}", f":{number}", f"_{number}")]
        found[names[0]] = Quantity(kind, tuple(names))
    return found


QUANTITIES: dict[str, Quantity] = {
    **_vector("length", ("",), ("position", "points", "coordinates")),
    **_vector("speed", ("v",), ("velocity",)),
    **_vector("rate", ("w", "omega"), ("angular_velocity", "omega")),
    "w": Quantity("rate", ("w", "omega", "angular_velocity")),
    "radius": Quantity("length", ("radius", "r")),
    "diameter": Quantity("length", ("diameter", "d")),
    "density": Quantity("density", ("density", "rho")),
    "mass": Quantity("mass", ("mass", "m")),
    "id": Quantity("", ("id",)),
    "type": Quantity("", ("type",)),
    "material": Quantity("", ("material",)),
}
"""What is known of particles. `w` is the spin of a 2-D file, about the axis out of its plane."""

UNITS: dict[str, dict[str, float]] = {
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
    "speed": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3},
    "rate": {"rad/s": 1.0, "1/s": 1.0},
    "density": {"kg/m3": 1.0, "g/cm3": 1e3},
    "mass": {"kg": 1.0, "g": 1e-3},
    "": {"1": 1.0, "-": 1.0},
}
"""Units that may stand behind the name of a column, in SI units."""

SYSTEMS: dict[str, dict[str, float]] = {
    "si": {},
    "cgs": {"length": 1e-2, "speed": 1e-2, "density": 1e3, "mass": 1e-3},
    "micro": {"length": 1e-6, "rate": 1e6, "density": 1e3, "mass": 1e-15},
}
"""Units of columns without one of their own, in SI units, as LAMMPS defines its systems; those not named are SI."""


class Source(NamedTuple):
    """Which particles of which file.

    Attributes:
        name: path of the file, or of the folder of a run.
        frame: number of the time step; None for the last.
        time: of the time step [s], in place of its number.
        units: system of units of columns without a unit of their own; None for that of the file, SI where it says
            none.
        ignore: names of columns that are not read.
    """

    name: str
    frame: int | None = None
    time: float | None = None
    units: str | None = None
    ignore: tuple[str, ...] = ()


class Columns(NamedTuple):
    """The particles of a file, sorted by id where there are ids.

    Attributes:
        numbers: float64 (N,) by quantity, in SI units: x, y, z, vx, vy, vz, wx, wy, wz, w, radius, density.
        types: int64 (N,) numbers of the types; None without.
        materials: name of the material of each particle; None without.
        unused: columns of the file that are not read.
        lower: lower corner of the box of the file [m], by axis; see `Raw`.
    """

    numbers: dict[str, np.ndarray]
    types: np.ndarray | None
    materials: tuple[str, ...] | None
    unused: tuple[str, ...]
    lower: dict[str, float]


def columns_of(raw: Raw, source: Source) -> Columns:
    """The state that the columns of a file hold.

    Raises:
        InputError: a column is not known, named twice, missing or not of numbers, a number is out of its range, or an
            id stands twice.
    """
    system = SYSTEMS[_system(raw, source)]
    found, unused = _known_columns(raw, source.ignore)
    if "x" not in found or not {"y", "z"} & set(found):
        missing = "x" if "x" not in found else "z"
        raise refusal(raw.header, f"there is no column {missing}; {_expected(raw)}", "name the columns after these")
    numbers: dict[str, np.ndarray] = {}
    for name, (column, unit) in found.items():
        kind = QUANTITIES[name].kind
        factor = UNITS[kind][unit] if unit else system.get(kind, 1.0)
        if name != "material":
            numbers[name] = _numbers(raw, raw.names[column], raw.values[column]) * factor
    materials = _materials(raw, found)
    _check_ranges(raw, numbers)
    order = _order(raw, numbers.pop("id", None))
    types = _whole(raw, "type", numbers.pop("type")) if "type" in numbers else None
    _merge(raw, numbers)
    return Columns(
        {name: values[order] for name, values in numbers.items()},
        None if types is None else types[order],
        None if materials is None else tuple(materials[row] for row in order),
        tuple(unused),
        {axis: value * system.get("length", 1.0) for axis, value in raw.lower.items()},
    )


def _system(raw: Raw, source: Source) -> str:
    if raw.units and source.units is not None and raw.units != source.units:
        raise InputError(f"{KEY}.units", source.units, f"the file says {raw.units!r}", "remove this key, or correct it")
    system = source.units or raw.units or "si"
    if system not in SYSTEMS:
        limit = f"is in units {system!r}; known are {', '.join(SYSTEMS)}"
        raise refusal(raw.header, limit, f"convert the file, or set {KEY}.units if it is wrong about itself")
    return system


def _known_columns(raw: Raw, ignore: tuple[str, ...]) -> tuple[dict[str, tuple[int, str]], list[str]]:
    """Column and unit of each quantity that the file has, and the names of the columns that are not read."""
    given = [_split(name) for name in raw.names]
    ignored = {_split(name)[0] for name in ignore}
    for name in ignore:
        if _split(name)[0] not in {plain for plain, _ in given} | {label.lower() for label in raw.dropped}:
            raise InputError(f"{KEY}.ignore", name, f"is no column of the file; {_expected(raw)}", "remove it")
    found: dict[str, tuple[int, str]] = {}
    used = {column for column, (name, _) in enumerate(given) if name in ignored}
    for quantity, (kind, names) in QUANTITIES.items():
        matches = [c for name in names for c, (n, unit) in enumerate(given) if n == name and c not in used]
        matches = [c for c in matches if given[c][1] in ("", *UNITS[kind])]
        if not matches:
            continue
        if raw.strict and len(matches) > 1:
            twice = ", ".join(raw.names[column] for column in matches)
            raise refusal(raw.header, f"the columns {cut(twice, 100)} are the same quantity", "keep one of them")
        found.setdefault(quantity, (matches[0], given[matches[0]][1]))
        used.update(matches)
    unused = [name for column, name in enumerate(raw.names) if column not in used]
    if raw.strict and unused:
        known = [name for quantity in QUANTITIES.values() for name in quantity.names]
        near = difflib.get_close_matches(_split(unused[0])[0], known, n=1)
        meant = f"did you mean {near[0]!r}? Else remove" if near else "remove"
        limit = f"the column {cut(unused[0], 60)!r} is not known; {_expected(raw)}"
        raise refusal(raw.header, limit, f"{meant} the column, or name it in {KEY}.ignore")
    return found, [*unused, *raw.dropped] + [name for name in raw.names if _split(name)[0] in ignored]


def _split(name: str) -> tuple[str, str]:
    """Name and unit of a column: `x [mm]` or `"x (mm)"`."""
    plain = name.strip().strip("\"'").strip().lower()
    match = re.fullmatch(r"(.*?)\s*[\[(]([^\[\]()]*)[\])]", plain)
    return (match[1], match[2].strip().replace("^", "")) if match else (plain, "")


def _expected(raw: Raw) -> str:
    shown = cut(" ".join(raw.names), 160)
    names = "x y z, vx vy vz, wx wy wz, radius or diameter, density or mass, id, type, material"
    return f"the columns are {shown!r}, known are {names}, with units as in 'x [mm]'"


def _numbers(raw: Raw, name: str, values: Values) -> np.ndarray:
    """A column as float64, all finite."""
    if isinstance(values, np.ndarray):
        if values.dtype.kind not in "iuf":
            raise refusal(raw.header, f"{cut(name, 60)!r} holds {values.dtype}, not numbers", "correct the file")
        numbers = values.astype(np.float64)
    else:
        parsed = [number_of(text) for text in values]
        if None in parsed:
            row = parsed.index(None)
            what = f"{cut(values[row], 60)!r} is no number" if values[row] else "there is nothing"
            remedy = "separate columns by commas or blanks, and write decimals with a point"
            raise refusal(raw.place(row), f"column {cut(name, 60)!r}: {what}", remedy)
        numbers = np.asarray(parsed, np.float64)
    if not np.isfinite(numbers).all():
        row = int(np.argmin(np.isfinite(numbers)))
        raise refusal(raw.place(row), f"column {cut(name, 60)!r} must be finite, it is {numbers[row]}", "correct it")
    return numbers


def _materials(raw: Raw, found: Mapping[str, tuple[int, str]]) -> list[str] | None:
    if "material" not in found:
        return None
    values = raw.values[found["material"][0]]
    if isinstance(values, np.ndarray) and values.dtype.kind != "U":
        remedy = f"call a column of numbers `type`, and name the materials in {KEY}.types"
        raise refusal(raw.header, f"the column 'material' holds {values.dtype}, not names", remedy)
    return [str(value).strip("\"'") for value in values]


def _check_ranges(raw: Raw, numbers: Mapping[str, np.ndarray]) -> None:
    """Sizes and densities are positive; no number is so large or small that its powers leave the range of floats."""
    for name, values in numbers.items():
        if name in ("id", "type"):
            continue
        size = np.abs(values)
        wrong = (size > 1e20) | ((size < 1e-20) & (size > 0.0))
        limit = "a number that is not zero must lie between 1e-20 and 1e20 in size, in SI units"
        if name in ("x", "y", "z", *(f"{v}{axis}" for v in "vw" for axis in AXES), "w"):
            wrong = size > 1e20  # a component may be next to nothing
            limit = "must not exceed 1e20 in size, in SI units"
        if name in ("radius", "diameter", "density", "mass") and not wrong.any():
            wrong, limit = values <= 0.0, "must be positive"
        if wrong.any():
            row = int(np.argmax(wrong))
            raise refusal(raw.place(row), f"{name} is {values[row]:.6g}: {limit}", "correct the number or the units")


def _whole(raw: Raw, name: str, values: np.ndarray) -> np.ndarray:
    wrong = (values != np.round(values)) | (np.abs(values) > LARGEST_NUMBER)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise refusal(raw.place(row), f"{name} is {values[row]!r}: it must be a whole number", "correct the number")
    return values.astype(np.int64)


def _order(raw: Raw, ids: np.ndarray | None) -> np.ndarray:
    """The rows in the order of their ids."""
    if ids is None:
        return np.arange(len(raw.values[0]))
    whole = _whole(raw, "id", ids)
    order = np.argsort(whole, kind="stable")
    twice = np.flatnonzero(np.diff(whole[order]) == 0)
    if len(twice):
        first, second = order[twice[0]], order[twice[0] + 1]
        limit = f"the id {whole[first]} stands there already, here again: {raw.place(int(second))}"
        raise refusal(raw.place(int(first)), limit, "give every particle its own id, or ignore the column: "
                      f'{KEY}.ignore = ["id"]')  # fmt: skip
    return order


def _merge(raw: Raw, numbers: dict[str, np.ndarray]) -> None:
    """Radius in place of diameter, and density in place of mass.

    Raises:
        InputError: two columns contradict each other, or there is a mass and no radius.
    """
    if "diameter" in numbers:
        _agreed(raw, numbers, "radius", "diameter", 0.5 * numbers.pop("diameter"))
    mass = numbers.pop("mass", None)
    if mass is None:
        return
    if "radius" not in numbers:
        limit = "has a column mass, which gives a density only together with a column radius or diameter"
        raise refusal(raw.header, limit, f'add one of these, or ignore the column: {KEY}.ignore = ["mass"]')
    _agreed(raw, numbers, "density", "mass", mass / (4.0 / 3.0 * math.pi * numbers["radius"] ** 3))


def _agreed(raw: Raw, numbers: dict[str, np.ndarray], name: str, other: str, values: np.ndarray) -> None:
    """The column `name`, or the same by another column where the file has no such column."""
    given = numbers.setdefault(name, values)
    wrong = np.abs(given - values) > AGREE * given
    if wrong.any():
        row = int(np.argmax(wrong))
        limit = f"{name} is {given[row]:.6g}, and by the column {other} it is {values[row]:.6g} (SI units)"
        raise refusal(raw.place(row), limit, f'correct one, or ignore it: {KEY}.ignore = ["{other}"]')
