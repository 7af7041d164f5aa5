"""Files that anyone may have written: opened only where they are regular files, read and parsed within limits.

What is wrong is raised as OSError (it cannot be opened or is too large) or ValueError (what it holds); who reads it
knows the key and the remedy.
"""

from __future__ import annotations

import errno
import io
import json
import math
import os
import stat
import tomllib
import zipfile
import zlib
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any, BinaryIO

if TYPE_CHECKING:
    import numpy as np

TEXT_BYTES = 1 << 26
"""Largest scene, summary or other file that is parsed as a whole."""
TABLE_BYTES = 1 << 30
"""Largest file of rows of numbers, and the most that an .npz file may hold."""
MOST_LEVELS = 64
"""Tables and lists within each other; what works on them calls itself for every level."""
LARGEST_IN_TOML, LARGEST_IN_JSON = 1 << 63, 1 << 1000
"""Whole numbers of TOML have 64 bits; what JSON has must fit into a float."""

Name = str | os.PathLike[str]


def open_regular(path: Name) -> BinaryIO:
    """The file, open for reading; never waits for another program to open its other end.

    Raises:
        OSError: it cannot be opened, or is a folder, pipe, socket, device, or a file that the system makes up (/proc,
            /sys).
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode) or status.st_dev in _made_up():
            raise OSError(errno.EINVAL, "is not a regular file", str(path))
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


@cache
def _made_up() -> frozenset[int]:
    """Devices of file systems whose regular files have no size, and may have no end."""
    return frozenset(os.stat(place).st_dev for place in ("/proc", "/sys") if os.path.ismount(place))


def read_bytes(path: Name, limit: int = TEXT_BYTES) -> bytes:
    """The content of a regular file of at most `limit` bytes.

    Raises:
        OSError: as `open_regular`, or it is larger.
    """
    with open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        if size > limit:
            raise OSError(errno.EFBIG, f"has {size} bytes, the limit is {limit}", str(path))
        return file.read(size)


def read_text(path: Name, limit: int = TEXT_BYTES) -> str:
    """The content of a regular file in UTF-8, without a byte-order mark.

    Raises:
        OSError: as `read_bytes`.
        UnicodeDecodeError: it is not UTF-8.
    """
    return read_bytes(path, limit).decode("utf-8-sig")


def parse_toml(text: str) -> dict[str, Any]:
    """TOML as nested dicts.

    Raises:
        ValueError: it is not TOML (`tomllib.TOMLDecodeError`), is nested too deeply, or has a number of too many
            digits.
    """
    return _parsed(tomllib.loads, text, LARGEST_IN_TOML)


def parse_json(text: str) -> Any:
    """JSON as Python's objects.

    Raises:
        ValueError: it is not JSON, is nested too deeply, or has a number of too many digits.
    """
    return _parsed(json.loads, text, LARGEST_IN_JSON)


def _parsed(parse: Callable[[str], Any], text: str, largest: int) -> Any:
    try:
        value = parse(text)
    except RecursionError:
        raise ValueError("is nested too deeply") from None
    except (tomllib.TOMLDecodeError, json.JSONDecodeError):
        raise
    except ValueError:  # Python refuses to read thousands of digits
        raise ValueError("has a number of too many digits") from None
    waiting: list[tuple[str, Any, int]] = [("", value, 0)]
    while waiting:
        key, entry, level = waiting.pop()
        if isinstance(entry, dict):
            waiting += [(f"{key}.{name}"[-200:], inner, level + 1) for name, inner in entry.items()]
        elif isinstance(entry, list):
            waiting += [(key, inner, level + 1) for inner in entry]
        elif isinstance(entry, int) and not -largest <= entry < largest:
            raise ValueError(f"has a number of too many digits ({key.lstrip('.')})")
        if level > MOST_LEVELS:
            raise ValueError(f"is nested too deeply, the limit is {MOST_LEVELS} levels")
    return value


def parse_array(content: bytes) -> np.ndarray:
    """The array of an .npy file.

    Raises:
        ValueError: it is not such a file, holds objects, or claims another size than it has.
    """
    import numpy as np  # not at the top: scenes without arrays are read in half the time

    file = io.BytesIO(content)
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    try:
        version = np.lib.format.read_magic(file)
        if version not in readers:
            raise ValueError(f"it is an .npy file of version {version}")
        shape, _, kind = readers[version](file)
        claimed = math.prod(shape) * kind.itemsize
        held = len(content) - file.tell()
        if claimed != held:
            raise ValueError(f"its header claims {claimed} bytes, it has {held}")
        return np.lib.format.read_array(io.BytesIO(content), allow_pickle=False)
    except ValueError:
        raise
    except Exception as error:  # an altered header is Python's source to numpy's reader
        raise ValueError(f"it is not an .npy file ({type(error).__name__})") from None


def read_arrays(path: Name) -> dict[str, np.ndarray]:
    """The arrays of an .npz file by name.

    Raises:
        OSError: as `read_bytes`.
        ValueError: as `parse_arrays`.
    """
    return parse_arrays(read_bytes(path, TABLE_BYTES))


def parse_arrays(content: bytes) -> dict[str, np.ndarray]:
    """The arrays of the content of an .npz file by name.

    Raises:
        ValueError: it is not such a file, or unpacks to more than `TABLE_BYTES`.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            total = sum(entry.file_size for entry in archive.infolist())
            if total > TABLE_BYTES:
                raise ValueError(f"it unpacks to {total} bytes, the limit is {TABLE_BYTES}")
            names = archive.namelist()
            return {name.removesuffix(".npy"): parse_array(archive.read(name)) for name in names}
    except (zipfile.BadZipFile, zipfile.LargeZipFile, RuntimeError, EOFError, zlib.error) as error:
        raise ValueError(f"it is not an .npz file ({error})") from None
