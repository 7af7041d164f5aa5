"""`history.csv`: one line of metrics an output time.

Numbers are written so that they read back exactly; a field without a value (no fluid) is empty and
reads as NaN. A last line that a kill cut short is dropped.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from jaxdem.errors import InputError
from jaxdem.files.durable import write_bytes
from jaxdem.files.reading import TABLE_BYTES, read_bytes

COLUMNS = (
    "time",
    "drag_force_mean",
    "particle_velocity_mean",
    "collision_force_mean",
    "kinetic_energy",
    "runoff",
    "height",
    "fluid_pressure_mean",
    "fluid_velocity_mean",
    "fluid_velocity_median",
)
POPULATION_COLUMNS = ("present", "removed")
"""Numbers of particles, in runs in which they change."""
AXES = {2: "xz", 3: "xyz"}
"""Names of the axes in columns, by dimension."""
DRIVE_COLUMNS = ("pressure_gradient", "bulk_velocity")
"""Of the fluid along each periodic axis, `pressure_gradient_x` and so on, in runs in which something drives it."""

_HEADER = ",".join(COLUMNS)
_EXTRA = {*POPULATION_COLUMNS, *(f"{name}_{axis}" for name in DRIVE_COLUMNS for axis in "xyz")}


class History:
    """Writer of a `history.csv`; `rows` is the number of lines that are safely on disk.

    An absent file is made with its header, with further columns if asked. Of an existing one a partial last line is cut
    off.

    Raises:
        InputError: the file is there and is not a history.
    """

    def __init__(self, path: Path, extra: tuple[str, ...] = ()):
        self.path = path
        self._columns = COLUMNS + extra
        self._header = ",".join(self._columns) + "\n"
        if not path.exists():
            write_bytes(path, self._header.encode())
        header, lines = _complete_lines(path)
        if header != self._header:
            limit = f"does not start with the header {self._header.strip()}"
            raise InputError(path.name, str(path), limit, "Give another folder.")
        self.rows = len(lines)
        if path.stat().st_size != _size(header, lines):
            self.cut(self.rows)

    def append(self, row: Mapping[str, float | None]) -> None:
        """Add a line and put it on disk; columns that `row` lacks, None and NaN are left empty.

        Raises:
            ValueError: `row` has a key that is no column, or no time.
            OSError: the disk refused; the file is then as it was.
        """
        unknown = set(row) - set(self._columns)
        if unknown or row.get("time") is None:
            raise ValueError(f"a row of the history needs a time and has no columns {sorted(unknown)}")
        line = ",".join(_field(row.get(name)) for name in self._columns) + "\n"
        with open(self.path, "r+b", buffering=0) as file:
            end = file.seek(0, os.SEEK_END)
            try:
                if file.write(line.encode()) != len(line):
                    raise OSError(f"{self.path}: the line was written in part")
                os.fsync(file.fileno())
            except OSError:
                file.truncate(end)
                raise
        self.rows += 1

    def cut(self, rows: int) -> None:
        """Keep the first `rows` lines."""
        lines = _complete_lines(self.path)[1][:rows]
        write_bytes(self.path, (self._header + "".join(lines)).encode())
        self.rows = len(lines)


def read_history(path: str | Path) -> dict[str, np.ndarray]:
    """Columns by name, float64 (T,), units of the metrics (SI).

    Raises:
        InputError: the file is missing or is not a history.
    """
    header, lines = _complete_lines(Path(path))
    columns = header.strip().split(",")
    rows = [_values(line, len(columns)) for line in lines]
    table = np.array(rows, np.float64).reshape(len(rows), len(columns))
    return {name: table[:, column].copy() for column, name in enumerate(columns)}


def _field(value: float | None) -> str:
    if value is None or math.isnan(float(value)):
        return ""
    return repr(float(value))


def _values(line: str, number: int) -> list[float]:
    """Numbers of one line; raises ValueError where it is not one of ours."""
    fields = line.rstrip("\n").split(",")
    if len(fields) != number or not fields[0]:
        raise ValueError(line)
    return [float(field) if field else math.nan for field in fields]


def _complete_lines(path: Path) -> tuple[str, list[str]]:
    """The header, and the data lines that are whole; only the last may be damaged."""
    remedy = "Give a folder that `jaxdem run` wrote, with its files as they were."
    try:
        text = read_bytes(path, TABLE_BYTES).decode(errors="replace")
        lines = text.replace("\r\n", "\n").splitlines(keepends=True)
    except OSError as error:
        raise InputError(path.name, str(path), f"cannot be read ({error.strerror})", remedy) from error
    columns_there = lines[0].rstrip("\n").split(",") if lines else []
    if columns_there[: len(COLUMNS)] != list(COLUMNS) or not _EXTRA.issuperset(columns_there[len(COLUMNS) :]):
        raise InputError(path.name, str(path), f"does not start with the header {_HEADER}", remedy)
    complete, columns = [], lines[0].count(",") + 1
    for number, line in enumerate(lines[1:], start=2):
        try:
            _values(line, columns)
            if not line.endswith("\n"):
                raise ValueError(line)
        except ValueError as error:
            if number == len(lines):
                break
            limit = f"line {number} does not hold {columns} numbers"
            raise InputError(path.name, line, limit, remedy) from error
        complete.append(line)
    return lines[0], complete


def _size(header: str, lines: list[str]) -> int:
    return len(header.encode()) + sum(len(line.encode()) for line in lines)
