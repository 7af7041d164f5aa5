"""Rows of numbers from a scene: given in it, or in a file that it names."""

from __future__ import annotations

import errno
import io
import os
import stat
import tokenize
from pathlib import Path
from typing import Any

import numpy as np

from jaxdem.errors import InputError

_UNREADABLE = (
    OSError, ValueError, TypeError, EOFError, SyntaxError, OverflowError, tokenize.TokenError, MemoryError,
)  # fmt: skip
"""What a text, or numpy's reader with an altered header, raises."""


def rows_of(
    key: str, source: Any, width: int, count: int | None = None, of_frame: bool = False
) -> np.ndarray | None:
    """Rows of `width` numbers from rows, from a flat list where the width is 1, or from a file; None stays None.

    Args:
        key: scene key, for the messages.
        source: rows, list, or name of a .npy file or of a text file of comma or blank separated rows.
        width: numbers per row.
        count: rows expected, if known.
        of_frame: vectors may have the three components of a run's frames in 2-D too: (x, z, 0), and (0, 0, scalar) of
            an angular velocity.
    """
    if source is None:
        return None
    rows = _read_rows(key, source) if isinstance(source, str) else _as_array(key, source)
    if rows.ndim == 1 and (width == 1 or rows.size == 0):
        rows = rows.reshape(-1, width)
    if of_frame and width < 3 and rows.ndim == 2 and rows.shape[1] == 3:
        rows = _of_plane(key, rows, width)
    if rows.ndim != 2 or rows.shape[1] != width:
        raise InputError(
            key, f"an array of shape {rows.shape}", f"needs rows of {width} number(s)", "correct it"
        )
    if not np.isfinite(rows).all():
        raise InputError(
            key, f"row {int(np.argmin(np.isfinite(rows).all(axis=1)))}", "must be finite", "correct it"
        )
    if count is not None and len(rows) != count:
        raise InputError(
            key, f"{len(rows)} rows", f"there are {count} particles", "give one row per particle"
        )
    return rows


def _of_plane(key: str, rows: np.ndarray, width: int) -> np.ndarray:
    """The components in the plane of rows of three, or the one across it of an angular velocity."""
    kept = slice(2, 3) if width == 1 else slice(0, 2)
    across = np.delete(rows, kept, axis=1).any(axis=1)
    if across.any():
        row = int(np.argmax(across))
        form = "(0, 0, scalar)" if width == 1 else "(x, z, 0)"
        raise InputError(
            key, f"row {row}: {rows[row].tolist()}", f"three components are {form} in 2-D", "correct it"
        )
    return rows[:, kept]


def read_whole(path: Path) -> bytes:
    """The content of a file.

    Raises:
        OSError: it cannot be read, or is a device, which may have no end.
    """
    with open(path, "rb") as file:
        mode = os.fstat(file.fileno()).st_mode
        if stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
            raise OSError(errno.EINVAL, "is a device", str(path))
        return file.read()


def _read_rows(key: str, name: str) -> np.ndarray:
    path = Path(name)
    try:
        content = read_whole(path)
        if path.suffix == ".npy":
            return _plain_numbers(np.lib.format.read_array(io.BytesIO(content), allow_pickle=False))
        text = content.decode("utf-8").replace(",", " ")
        lines = [
            line.split() for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")
        ]
        if lines and not _is_number(lines[0][0]):
            lines = lines[1:]  # a line of column names
        if not lines:
            raise ValueError("it holds no number")
        return np.asarray(lines, float)
    except FileNotFoundError:
        raise InputError(key, name, "no such file", "names are relative to the scene file") from None
    except _UNREADABLE as error:
        reason = getattr(error, "strerror", None) or str(error) or "too large"
        raise InputError(
            key, name, f"cannot be read as rows of numbers ({reason})", "correct the file"
        ) from None


def _plain_numbers(stored: np.ndarray) -> np.ndarray:
    if stored.dtype.kind not in "iuf":
        raise ValueError(f"it holds {stored.dtype}")
    if stored.size == 0:
        raise ValueError("it holds no number")
    return stored.astype(float)


def _as_array(key: str, rows: Any) -> np.ndarray:
    try:
        return np.asarray(rows, float)
    except ValueError:
        raise InputError(
            key, "rows of unequal length", "all rows need as many numbers", "correct it"
        ) from None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
