"""`history.csv`: one line of metrics an output time; see `lines`, and `part_columns` for further columns."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from jaxdem.files.reading import TABLE_BYTES, read_bytes
from jaxdem.io.lines import LineFile, read_columns
from jaxdem.io.part_columns import is_of_a_part
from jaxdem.metrics import HISTORY_COLUMNS

_HEADER = ",".join(HISTORY_COLUMNS)


class History(LineFile):
    """Writer of a `history.csv`, with further columns if asked; see `LineFile`.

    A file that a version of jaxdem before has begun, which had not all of these, keeps the columns that it has.
    """

    def __init__(self, path: Path, extra: tuple[str, ...] = ()):
        self._known = HISTORY_COLUMNS + extra
        super().__init__(path, _begun_with(path, self._known))

    def append(self, row: Mapping[str, float | None]) -> None:
        """Add a line and put it on disk; columns that `row` lacks, None and NaN are left empty.

        Raises:
            ValueError: `row` has a key that is no column, or no time.
            OSError: the disk refused; the file is then as it was.
        """
        unknown = set(row) - set(self._known)
        if unknown or row.get("time") is None:
            raise ValueError(f"a row of the history needs a time and has no columns {sorted(unknown)}")
        self.append_rows([[row.get(name) for name in self.columns]])


class CountedHistory(History):
    """In the place of a `History` for a process that another one writes it for: lines are counted, none is written."""

    def __init__(self, path: Path, extra: tuple[str, ...] = ()):
        self._known = HISTORY_COLUMNS + extra
        self.path, self.columns = path, _begun_with(path, self._known)
        self.rows = len(read_history(path)["time"]) if path.exists() else 0

    def append(self, row: Mapping[str, float | None]) -> None:
        """See `History`."""
        self.rows += 1

    def cut(self, rows: int) -> None:
        """See `LineFile`."""
        self.rows = min(self.rows, rows)


def _begun_with(path: Path, columns: tuple[str, ...]) -> tuple[str, ...]:
    """Those of the columns that a file has already; all of them where there is no history."""
    try:
        header = read_bytes(path, TABLE_BYTES).decode(errors="replace").partition("\n")[0].strip().split(",")
    except OSError:  # none, or one that cannot be read, which its writer says
        return columns
    found = tuple(name for name in columns if name in header)
    return found if set(HISTORY_COLUMNS) <= set(found) else columns


def read_history(path: str | Path) -> dict[str, np.ndarray]:
    """Columns by name, float64 (T,), units of the metrics (SI).

    Raises:
        InputError: the file is missing or is not a history.
    """
    return read_columns(Path(path), _of_a_history, _HEADER)


def _of_a_history(names: tuple[str, ...]) -> bool:
    return names[: len(HISTORY_COLUMNS)] == HISTORY_COLUMNS and all(map(is_of_a_part, names[len(HISTORY_COLUMNS) :]))
