"""Tables of numbers as text, one line a row, to which a run appends.

Numbers are written so that they read back exactly; a field without a value is empty and reads as NaN. A last line that
a kill cut short is dropped.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from jaxdem.errors import InputError
from jaxdem.files.durable import write_bytes
from jaxdem.files.reading import TABLE_BYTES, read_bytes

REMEDY = "Give a folder that `jaxdem run` wrote, with its files as they were."


class LineFile:
    """Writer of a table; `rows` is the number of lines that are safely on disk.

    An absent file is made with its header. Of an existing one a partial last line is cut off.

    Args:
        path: of the file.
        columns: names in the header, the first of a column that has a value in every row.

    Raises:
        InputError: the file is there and has another header.
    """

    def __init__(self, path: Path, columns: Sequence[str]):
        self.path, self.columns = path, tuple(columns)
        self._header = ",".join(self.columns) + "\n"
        if not path.exists():
            write_bytes(path, self._header.encode())
        header, lines = complete_lines(path, self.columns.__eq__, self._header.strip())
        self.rows = len(lines)
        if path.stat().st_size != len(header.encode()) + sum(len(line.encode()) for line in lines):
            self.cut(self.rows)

    def append_rows(self, rows: Sequence[Sequence[float | None]]) -> None:
        """Add lines and put them on disk; None and NaN are left empty.

        Raises:
            OSError: the disk refused; the file is then as it was.
        """
        self._append("".join(",".join(map(_field, row)) + "\n" for row in rows), len(rows))

    def append_table(self, table: np.ndarray) -> None:
        """Add the lines (L, number of columns) of an array of numbers; see `append_rows`."""
        # The same text; one by one the fields would take twice the time.
        text = "".join(",".join(map(repr, row)) + "\n" for row in table.astype(np.float64).tolist())
        self._append(text.replace("nan", ""), len(table))

    def _append(self, lines: str, number: int) -> None:
        text = lines.encode()
        with open(self.path, "r+b", buffering=0) as file:
            end = file.seek(0, os.SEEK_END)
            try:
                if file.write(text) != len(text):
                    raise OSError(f"{self.path}: the lines were written in part")
                os.fsync(file.fileno())
            except OSError:
                file.truncate(end)
                raise
        self.rows += number

    def cut(self, rows: int) -> None:
        """Keep the first `rows` lines."""
        lines = complete_lines(self.path, self.columns.__eq__, self._header.strip())[1][:rows]
        write_bytes(self.path, (self._header + "".join(lines)).encode())
        self.rows = len(lines)


def read_columns(path: Path, known: Callable[[tuple[str, ...]], bool], expected: str) -> dict[str, np.ndarray]:
    """Columns by name, float64 (T,); see `complete_lines`."""
    header, lines = complete_lines(path, known, expected)
    columns = header.strip().split(",")
    rows = [_values(line, len(columns)) for line in lines]
    table = np.array(rows, np.float64).reshape(len(rows), len(columns))
    return {name: table[:, column].copy() for column, name in enumerate(columns)}


def complete_lines(path: Path, known: Callable[[tuple[str, ...]], bool], expected: str) -> tuple[str, list[str]]:
    """The header, and the lines that are whole; only the last may be damaged.

    Args:
        path: of the file.
        known: whether the names in the header are those of such a table.
        expected: the header, for the message.

    Raises:
        InputError: the file cannot be read, has another header, or a line that is none of ours.
    """
    try:
        text = read_bytes(path, TABLE_BYTES).decode(errors="replace")
        lines = text.replace("\r\n", "\n").splitlines(keepends=True)
    except OSError as error:
        raise InputError(path.name, str(path), f"cannot be read ({error.strerror})", REMEDY) from error
    if not lines or not known(tuple(lines[0].rstrip("\n").split(","))):
        raise InputError(path.name, str(path), f"does not start with the header {expected}", REMEDY)
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
            raise InputError(path.name, line, limit, REMEDY) from error
        complete.append(line)
    return lines[0], complete


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
