"""The files of probes: `probes/NAME.csv`, to which a run appends, and `probes.h5`, made of them when it ends.

Both are tables with a line for every place that a probe measures at and every time, the time in the first column.
A table of `probes.h5` is one dataset NAME of records, so that `pandas.DataFrame(file["NAME"][:])` is the table; its
attribute `units` has the unit of every column.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from jaxdem.errors import InputError
from jaxdem.files.durable import write_bytes
from jaxdem.files.hdf5 import (
    UNREADABLE,
    attributes_of,
    image_of,
    in_memory,
    open_for_reading,
    store,
    write_attributes,
)
from jaxdem.io.lines import REMEDY, CountedFile, LineFile, read_columns

PROBES_FOLDER, PROBES_FILE = "probes", "probes.h5"

Columns = tuple[tuple[str, str], ...]
"""Name and unit of every column of a file, the time first."""

Table = dict[str, np.ndarray]


class ProbeFiles:
    """Writer of the files of all probes of a run.

    Args:
        path: run directory.
        columns: of every probe by name.
        first: whether this process writes them; of others the lines are counted.
    """

    def __init__(self, path: Path, columns: Mapping[str, Columns], first: bool = True):
        self.path, self.columns, self._first = path, dict(columns), first
        if columns:
            (path / PROBES_FOLDER).mkdir(exist_ok=True)
        kind = LineFile if first else CountedFile
        self._files = {
            name: kind(path / PROBES_FOLDER / f"{name}.csv", [column for column, _ in of_probe])
            for name, of_probe in columns.items()
        }

    @property
    def rows(self) -> dict[str, int]:
        """By name, number of lines that are safely on disk."""
        return {name: file.rows for name, file in self._files.items()}

    def append(self, name: str, leading: np.ndarray, table: np.ndarray) -> None:
        """Add lines to the file of a probe.

        Args:
            name: of the probe.
            leading: (L, P) float64, the first columns: time and places.
            table: (L, C) the others, in the precision of the run.

        Raises:
            OSError: the disk refused; the file is then as it was.
        """
        self._files[name].append_table(leading, table)

    def cut(self, rows: Mapping[str, int]) -> None:
        """Keep so many lines of each."""
        for name, file in self._files.items():
            file.cut(rows[name])
        if self._first:
            (self.path / PROBES_FILE).unlink(missing_ok=True)

    def join(self) -> None:
        """Write `probes.h5`."""
        if not self._files:
            return
        with in_memory(PROBES_FILE) as file:
            for name, columns in self.columns.items():
                table = read_columns(self._files[name].path, lambda _: True, "")
                lines = np.stack(list(table.values()), axis=1)
                records = lines.view([(column, np.float64) for column in table])[:, 0]
                dataset = store(file, name, records)
                write_attributes(dataset, {"columns": list(table), "units": [unit for _, unit in columns]})
            content = image_of(file)
        write_bytes(self.path / PROBES_FILE, content)


class Probes(Mapping[str, Table]):
    """The tables of the probes of a run by name; each is read when it is asked for.

    A table is a dict from column to float64 (L,): all lines of the file, time after time.
    """

    def __init__(self, path: Path, names: list[str]):
        self._path, self._names = path, names
        self._read: dict[str, Table] = {}

    def __getitem__(self, name: str) -> Table:
        if name not in self._names:
            raise KeyError(f"{name!r}: the probes of this run are {', '.join(self._names) or 'none'}")
        if name not in self._read:
            path = self._path / PROBES_FOLDER / f"{name}.csv"
            self._read[name] = read_columns(path, lambda names: names[0] == "time", "time,...")
        return self._read[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def units(self, name: str) -> dict[str, str]:
        """Unit of every column of a probe, from `probes.h5`; {} while there is none (running, or killed).

        Raises:
            InputError: the file is damaged.
        """
        path = self._path / PROBES_FILE
        if not path.is_file():
            return {}
        try:
            with open_for_reading(path) as file:
                attributes = attributes_of(file[name])
                return dict(zip(attributes["columns"], attributes["units"], strict=True))
        except UNREADABLE as error:
            raise InputError(PROBES_FILE, str(path), f"cannot be read ({error})", REMEDY) from error
