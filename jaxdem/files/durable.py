"""Files that are either whole or absent: write aside, flush, fsync, rename, fsync the directory.

A rename inside one directory is atomic on POSIX file systems, so a reader, or a run that resumes after
a kill, finds the old file or the new one, never half of one.
"""

from __future__ import annotations

import glob
import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

SUFFIX_ASIDE = ".tmp"


def sync_directory(folder: Path) -> None:
    """Put the directory entry itself (names after a rename or a removal) on disk."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def aside_name(path: Path) -> Path:
    """What a file is called while this process writes it: two processes that write one file do not meet."""
    return path.with_name(f".{path.name}.{os.getpid()}{SUFFIX_ASIDE}")


def aside_names(path: Path) -> set[str]:
    """Names in the folder under which processes write `path`, or were killed while they did."""
    return {entry.name for entry in path.parent.glob(f".{glob.escape(path.name)}*{SUFFIX_ASIDE}")}


@contextmanager
def aside(path: Path) -> Iterator[Path]:
    """Give a temporary name beside `path` to write to; when the block ends well it replaces `path`.

    If the block raises (an interrupt included) the temporary file is removed and `path` is as it was.
    """
    temporary = aside_name(path)
    try:
        yield temporary
        descriptor = os.open(temporary, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
        os.replace(temporary, path)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        if isinstance(error, OSError):  # a full disk is reported without a name
            error.filename = str(path)
        raise
    sync_directory(path.parent)


def write_bytes(path: Path, content: bytes) -> None:
    """Replace `path` by `content`, durably."""
    with aside(path) as temporary:
        temporary.write_bytes(content)


def remove_leftovers(folder: Path) -> None:
    """Remove what a killed writer left under its temporary name in `folder`, see `aside_name`."""
    for leftover in folder.glob(f".*.[0-9]*{SUFFIX_ASIDE}"):
        leftover.unlink(missing_ok=True)


class DeferredErrorFile(io.FileIO):
    """A file for HDF5 to write to that keeps the first error of the disk in `error` and goes on.

    HDF5 that cannot write can neither close its file nor release its objects, and says so again and
    again. Here it is told that all is well, closes, and the caller raises `error`.
    """

    def __init__(self, path: Path):
        super().__init__(path, "w+")
        self.error: OSError | None = None

    def write(self, data: Any, /) -> int:
        view = memoryview(data).cast("B")
        done = 0
        while self.error is None and done < len(view):
            try:
                done += super().write(view[done:])
            except OSError as error:
                self.error = error
        return len(view)

    def truncate(self, size: int | None = None, /) -> int:
        try:
            return super().truncate(size)
        except OSError as error:
            self.error = self.error or error
            return size or 0

    def raise_error(self) -> None:
        """Raise what the disk refused, if anything."""
        if self.error is not None:
            raise self.error
