"""`history.csv`: one line of metrics an output time; see `lines`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from jaxdem.io.lines import LineFile, read_columns
from jaxdem.numerics.axes import AXES

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
DRIVE_COLUMNS = ("pressure_gradient", "bulk_velocity")
"""Of the fluid along each periodic axis, `pressure_gradient_x` and so on, in runs in which something drives it."""

BOND_COLUMNS = ("bonds_intact", "bonds_broken", "bonds_left")
"""Numbers of bonds that hold, that broke, and that went with a grain, in runs with bonds."""
WALL_COLUMN = re.compile(r"wall_\d+_(displacement|wear)")
"""How far a wall that a force holds has moved [m], and what has been worn off a mesh [m3]; with the wall's number."""

TEMPERATURE_COLUMNS = ("fluid_temperature_mean", "particle_temperature_mean")
"""Mean temperatures of the fluid, by volume, and of the particles, by heat capacity, in runs that have them [K]."""
SCALAR_COLUMN = re.compile(r"scalar_\w+_mean")
"""Mean of a scalar over the volume of the fluid, by its name."""

_HEADER = ",".join(COLUMNS)
_OF_PARTS = (*POPULATION_COLUMNS, *BOND_COLUMNS, *TEMPERATURE_COLUMNS)
_EXTRA = {*_OF_PARTS, *(f"{name}_{axis}" for name in DRIVE_COLUMNS for axis in AXES[3])}


class History(LineFile):
    """Writer of a `history.csv`, with further columns if asked; see `LineFile`."""

    def __init__(self, path: Path, extra: tuple[str, ...] = ()):
        super().__init__(path, COLUMNS + extra)

    def append(self, row: Mapping[str, float | None]) -> None:
        """Add a line and put it on disk; columns that `row` lacks, None and NaN are left empty.

        Raises:
            ValueError: `row` has a key that is no column, or no time.
            OSError: the disk refused; the file is then as it was.
        """
        unknown = set(row) - set(self.columns)
        if unknown or row.get("time") is None:
            raise ValueError(f"a row of the history needs a time and has no columns {sorted(unknown)}")
        self.append_rows([[row.get(name) for name in self.columns]])


class CountedHistory(History):
    """In the place of a `History` for a process that another one writes it for: lines are counted, none is written."""

    def __init__(self, path: Path, extra: tuple[str, ...] = ()):
        self.path, self.columns = path, COLUMNS + extra
        self.rows = len(read_history(path)["time"]) if path.exists() else 0

    def append(self, row: Mapping[str, float | None]) -> None:
        """See `History`."""
        self.rows += 1

    def cut(self, rows: int) -> None:
        """See `LineFile`."""
        self.rows = min(self.rows, rows)


def read_history(path: str | Path) -> dict[str, np.ndarray]:
    """Columns by name, float64 (T,), units of the metrics (SI).

    Raises:
        InputError: the file is missing or is not a history.
    """
    return read_columns(Path(path), _of_a_history, _HEADER)


def _of_a_history(names: tuple[str, ...]) -> bool:
    named = (WALL_COLUMN, SCALAR_COLUMN)
    others = [name for name in names[len(COLUMNS) :] if not any(column.fullmatch(name) for column in named)]
    return names[: len(COLUMNS)] == COLUMNS and _EXTRA.issuperset(others)
