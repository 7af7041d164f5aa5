"""Tables of numbers as text, one line a row, to which a run appends.

Numbers are written so that they read back exactly, each in its precision; a field without a value is empty and reads
as NaN. A last line that a kill cut short is dropped.
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
from jaxdem.io import digits

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
        if path.stat().st_size != len(header.encode()) + sum(len(line.encode()) + 1 for line in lines):
            self.cut(self.rows)

    def append_rows(self, rows: Sequence[Sequence[float | None]]) -> None:
        """Add lines and put them on disk; None and NaN are left empty.

        Raises:
            OSError: the disk refused; the file is then as it was.
        """
        self._append("".join(",".join(map(_field, row)) + "\n" for row in rows).encode(), len(rows))

    def append_table(self, leading: np.ndarray, table: np.ndarray) -> None:
        """Add the lines of two arrays of numbers side by side; see `append_rows`.

        Args:
            leading: (L, P) float64.
            table: (L, C); of float32 with nine digits each, which read back exactly in single precision, see
                `io.digits`.
        """
        if table.dtype == np.float32:
            self._append(digits.text_of(leading, table), len(table))
            return
        # The same text as of `append_rows`; one by one the fields would take twice the time.
        rows = np.concatenate([leading, table], axis=1).tolist()
        text = "".join(",".join(map(repr, row)) + "\n" for row in rows)
        self._append(text.replace("nan", "").encode(), len(table))

    def _append(self, text: bytes, number: int) -> None:
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
        write_bytes(self.path, (self._header + "".join(f"{line}\n" for line in lines)).encode())
        self.rows = len(lines)


class CountedFile(LineFile):
    """In the place of a `LineFile` for a process that another one writes it for: lines are counted, none is written."""

    def __init__(self, path: Path, columns: Sequence[str]):
        self.path, self.columns = path, tuple(columns)
        known, header = self.columns.__eq__, ",".join(self.columns)
        self.rows = len(complete_lines(path, known, header)[1]) if path.exists() else 0

    def append_table(self, leading: np.ndarray, table: np.ndarray) -> None:
        """See `LineFile`."""
        self.rows += len(table)

    def cut(self, rows: int) -> None:
        """See `LineFile`."""
        self.rows = min(self.rows, rows)


def read_columns(path: Path, known: Callable[[tuple[str, ...]], bool], expected: str) -> dict[str, np.ndarray]:
    """Columns by name, float64 (T,); see `complete_lines`."""
    header, _, table = _read(path, known, expected)
    return {name: table[:, column].copy() for column, name in enumerate(header.strip().split(","))}


def complete_lines(path: Path, known: Callable[[tuple[str, ...]], bool], expected: str) -> tuple[str, list[str]]:
    """The header with its end, and the lines that are whole, without; see `_read`."""
    header, lines, _ = _read(path, known, expected)
    return header, lines


def _read(path: Path, known: Callable[[tuple[str, ...]], bool], expected: str) -> tuple[str, list[str], np.ndarray]:
    """The header, the lines that are whole, and their numbers (T, C); only the last line may be damaged.

    Args:
        path: of the file.
        known: whether the names in the header are those of such a table.
        expected: the header, for the message.

    Raises:
        InputError: the file cannot be read, has another header, or a line that is none of ours.
    """
    try:
        text = read_bytes(path, TABLE_BYTES).decode(errors="replace")
    except OSError as error:
        raise InputError(path.name, str(path), f"cannot be read ({error.strerror})", REMEDY) from error
    first, ended, body = text.replace("\r\n", "\n").partition("\n") if "\r" in text else text.partition("\n")
    if not text or not known(tuple(first.split(","))):
        raise InputError(path.name, str(path), f"does not start with the header {expected}", REMEDY)
    rows, columns = body.split("\n"), first.count(",") + 1
    rows.pop()  # "", or what a kill has left of a line
    if rows and not _sound(rows[-1], columns):
        rows.pop()
    try:
        return first + ended, rows, _table(rows, columns)
    except ValueError:
        number, line = next((n, line) for n, line in enumerate(rows, start=2) if not _sound(line, columns))
        raise InputError(path.name, line, f"line {number} does not hold {columns} numbers", REMEDY) from None


def _field(value: float | None) -> str:
    if value is None or math.isnan(float(value)):
        return ""
    return repr(float(value))


def _sound(line: str, columns: int) -> bool:
    """Whether it is a line of ours."""
    try:
        return bool(line.strip()) and len(_table([line], columns)) == 1
    except ValueError:
        return False


def _table(lines: list[str], columns: int) -> np.ndarray:
    """(T, columns) numbers; raises ValueError where a line is not one of ours."""
    if not lines:
        return np.zeros((0, columns))
    text = "\n".join(["", *lines, ""])
    if "\n," in text or "\n\n" in text:
        raise ValueError(text)
    if ",," in text or ",\n" in text:
        # Twice: of three commas in a row the one in the middle is of both pairs.
        filled = text.replace(",,", ",nan,").replace(",,", ",nan,").replace(",\n", ",nan\n")
        lines = filled.split("\n")[1:-1]
    table = np.loadtxt(lines, delimiter=",", comments=None, ndmin=2)
    if table.shape != (len(lines), columns):
        raise ValueError(text)
    return table
