"""Rows of numbers from a scene: given in it, or in a file that it names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from jaxdem.errors import InputError, cut
from jaxdem.files.reading import TABLE_BYTES, parse_array, read_bytes, read_text
from jaxdem.files.text_table import fields_of, lines_of, number_of
from jaxdem.numerics.axes import AXES

UNITS = {
    "position": "m",
    "velocity": "m/s",
    "angular_velocity": "rad/s",
    "radius": "m",
    "density": "kg/m3",
    "pairs": "1",
}
PREFIXES = {"position": "", "velocity": "v", "angular_velocity": "w"}
"""Before the name of the axis, in the name of a column."""

Numbers = Sequence[float] | Sequence[Sequence[float]] | np.ndarray

BEGINS_NUMBER = "+-.0123456789"


def rows_of(
    key: str, source: str | Numbers | None, width: int, count: int | None = None, of_frame: bool = False
) -> np.ndarray | None:
    """As `given_rows`; None stays None."""
    return None if source is None else given_rows(key, source, width, count, of_frame)


def given_rows(
    key: str, source: str | Numbers, width: int, count: int | None = None, of_frame: bool = False
) -> np.ndarray:
    """Rows of `width` numbers from rows, from a flat list where the width is 1, or from a file.

    Args:
        key: scene key, for the messages.
        source: rows, list, or name of a .npy file or of a text file of comma or blank separated rows.
        width: numbers per row.
        count: rows expected, if known.
        of_frame: vectors may have the three components of a run's frames in 2-D too: (x, z, 0), and (0, 0, scalar) of
            an angular velocity.

    Raises:
        InputError: a file that cannot be read, a row of another width or with something that is no finite number (the
            line of the file is named), a column of a header that is not used, or another number of rows.
    """
    if isinstance(source, str):
        rows = _read_rows(key, source, width, of_frame)
    else:
        rows = _as_array(key, source, width, of_frame)
    if rows.shape[1] != width:
        rows = _of_plane(key, rows, width)
    if count is not None and len(rows) != count:
        raise InputError(key, f"{len(rows)} rows", f"there are {count} particles", "give one row per particle")
    return rows


def _of_plane(key: str, rows: np.ndarray, width: int) -> np.ndarray:
    """The components in the plane of rows of three, or the one across it of an angular velocity."""
    kept = slice(2, 3) if width == 1 else slice(0, 2)
    across = np.delete(rows, kept, axis=1).any(axis=1)
    if across.any():
        row = int(np.argmax(across))
        form = "(0, 0, scalar)" if width == 1 else "(x, z, 0)"
        raise InputError(
            key, f"row {row}: {rows[row].tolist()}", f"three components are {form} in 2-D", "correct the row"
        )
    return rows[:, kept]


def _columns(found: int, width: int, of_frame: bool) -> int:
    """Numbers that a row should have, where the first has `found`."""
    return 3 if of_frame and found == 3 else width


def _read_rows(key: str, name: str, width: int, of_frame: bool) -> np.ndarray:
    path = Path(name)
    try:
        if path.suffix == ".npy":
            rows = _plain_numbers(parse_array(read_bytes(path, TABLE_BYTES)))
            width = _columns(rows.shape[-1] if rows.ndim == 2 else 0, width, of_frame)
            return _checked(key, rows, width, lambda row: f"row {row} of {name}", name)
        text = read_text(path, TABLE_BYTES)
    except FileNotFoundError:
        raise InputError(key, name, "no such file", "give a name relative to the scene file") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        if isinstance(error, UnicodeDecodeError):
            reason = "it is not text in UTF-8"
        remedy = f"give a .npy file, or text with rows of {_expected(key, width)}"
        raise InputError(key, name, f"cannot be read as rows of numbers ({reason})", remedy) from None
    return _parsed(key, name, text, width, of_frame)


def _parsed(key: str, name: str, text: str, width: int, of_frame: bool) -> np.ndarray:
    """Rows of a text: comments begin with #, blank lines do not count, a row of names may come first."""
    lines = lines_of(text, "#")
    if lines and (_is_header(lines[0][1]) or all(number_of(field) is not None for field in fields_of(lines[0][1]))):
        width = _columns(len(fields_of(lines[0][1])), width, of_frame)
    order: Sequence[int] = range(width)
    if lines and _is_header(lines[0][1]):
        number, line = lines.pop(0)
        order = _order(key, f"line {number} of {name}", line, width)
    if not lines:
        raise InputError(key, name, "holds no number", f"give rows of {_expected(key, width)}")
    numbers = np.asarray([_numbers(key, f"line {number} of {name}", line, width) for number, line in lines])
    return _checked(key, numbers, width, lambda row: f"line {lines[row][0]} of {name}", name)[:, order]


def _is_header(line: str) -> bool:
    """Whether a line is a row of names; one with a number, or with what begins as one, is not."""
    return not any(number_of(field) is not None or field.startswith(tuple(BEGINS_NUMBER)) for field in fields_of(line))


def _order(key: str, place: str, line: str, width: int) -> list[int]:
    """In which column each number of a row stands, from the names of the columns."""
    found = [_plain_name(field, UNITS[_last(key)]) for field in fields_of(line)]
    order = []
    for names in _names(key, width):
        columns = [column for column, name in enumerate(found) if name in names]
        if len(columns) == 1:
            order += columns
    if len(order) < width or len(found) > width:
        strange = [name for column, name in enumerate(found) if column not in order]
        problem = f"and {cut(', '.join(strange), 100)} is not used" if strange else "and one is missing"
        limit = f"{cut(repr(line), 100)} names the columns, {problem}; a row needs {_expected(key, width)}"
        raise InputError(key, place, limit, "keep the columns that are needed")
    return order


def _numbers(key: str, place: str, line: str, width: int) -> list[float]:
    fields = fields_of(line)
    values = [number_of(field) for field in fields]
    shown = cut(repr(line), 100)
    if None in values:
        column = values.index(None)
        what = f"{cut(repr(fields[column]), 60)} is no number" if fields[column] else "nothing"
        limit = f"in {shown}, column {column + 1}: {what}; a row needs {_expected(key, width)}"
        remedy = "separate columns by commas or blanks, and write decimals with a point"
        raise InputError(key, place, limit, remedy)
    if len(values) != width:
        limit = f"{shown} has {len(values)} column(s), a row needs {_expected(key, width)}"
        raise InputError(key, place, limit, "keep the columns that are needed, in this order")
    return values  # type: ignore[return-value]


def _last(key: str) -> str:
    return key.rpartition(".")[2]


def _names(key: str, width: int) -> list[tuple[str, ...]]:
    """Names that each column may have, the usual one first; the second axis of a 2-D scene may be called y."""
    name = _last(key)
    if name == "pairs":
        return [("first",), ("second",)]
    if width == 1:
        return [(name,)]
    axes = [("x",), ("z", "y")] if width == 2 else [(axis,) for axis in AXES[width]]
    return [tuple(given for axis in some for given in (PREFIXES[name] + axis, axis, f"{name}_{axis}")) for some in axes]


def _plain_name(field: str, unit: str) -> str:
    """The name of a column without quotes, and without the unit where it is the right one."""
    name = field.strip("\"'").strip().lower()
    for mark in (f"[{unit}]", f"({unit})"):
        name = name.removesuffix(mark).rstrip()
    return name


def _expected(key: str, width: int) -> str:
    names = ", ".join(names[0] for names in _names(key, width))
    return f"{width} number{'s' if width > 1 else ''}: {names} [{UNITS[_last(key)]}]"


def _checked(key: str, rows: np.ndarray, width: int, place: Callable[[int], str], whole: str) -> np.ndarray:
    """The rows, if they have the width and are finite."""
    if rows.ndim == 1 and (width == 1 or rows.size == 0):
        rows = rows.reshape(-1, width)
    if rows.ndim != 2 or rows.shape[1] != width:
        limit = f"is an array of shape {rows.shape}, a row needs {_expected(key, width)}"
        raise InputError(key, whole, limit, "keep the columns that are needed, in this order")
    finite = np.isfinite(rows).all(axis=1)
    if not finite.all():
        raise InputError(key, place(int(np.argmin(finite))), "must be finite", "correct the number")
    return rows


def _plain_numbers(stored: np.ndarray) -> np.ndarray:
    if stored.dtype.kind not in "iuf":
        raise ValueError(f"it holds {stored.dtype}")
    if stored.size == 0:
        raise ValueError("it holds no number")
    return stored.astype(float)


def _as_array(key: str, rows: Numbers, width: int, of_frame: bool) -> np.ndarray:
    """Rows that stand in the scene itself."""
    if len(rows) and isinstance(rows[0], list | tuple | np.ndarray):
        width = _columns(len(rows[0]), width, of_frame)
    if isinstance(rows, list | tuple):
        for number, row in enumerate(rows):
            found = len(row) if isinstance(row, list | tuple | np.ndarray) else 1
            if found != width:
                limit = f"has {found} number(s), a row needs {_expected(key, width)}"
                raise InputError(key, f"row {number}", limit, "give every row these")
    return _checked(key, np.asarray(rows, float), width, lambda row: f"row {row}", "rows")
