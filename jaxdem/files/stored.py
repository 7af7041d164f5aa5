"""Files that jaxdem writes as a whole and reads with checks: closures and datasets."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import h5py

from jaxdem.errors import InputError
from jaxdem.files.durable import write_bytes
from jaxdem.files.hdf5 import UNREADABLE, attributes_of, open_for_reading

Name = str | os.PathLike[str]


class Kind(NamedTuple):
    """A kind of file.

    Attributes:
        key: that errors name.
        what: it is, "closure" or "dataset".
        format: what it says of itself in the attribute `format`.
        version: the newest that is read.
        writer: the commands that write it.
        again: remedy for a damaged one.
    """

    key: str
    what: str
    format: str
    version: int
    writer: str
    again: str

    def refusal(self, path: Name, limit: str, remedy: str = "") -> InputError:
        """The error for a file of this kind."""
        return InputError(self.key, str(path), limit, remedy or self.again)


CLOSURE = Kind(
    "closure.file", "closure", "jaxdem-closure", 1, "`jaxdem train` or `jaxdem finetune`", "Train or copy it again."
)
SUBGRID = CLOSURE._replace(key="fluid.subgrid", writer="`jaxdem finetune --subgrid`")
DATASET = Kind("dataset", "dataset", "jaxdem-dataset", 1, "`jaxdem dataset`", "Make it again with `jaxdem dataset`.")


@contextmanager
def reading(path: Name, kind: Kind) -> Iterator[h5py.File]:
    """The open file, which is of that kind and of a version that is known.

    Raises:
        InputError: it is not; or, while it is open, what reads it meets anything of `UNREADABLE`.
    """
    source = f"Give a file written by {kind.writer}."
    try:
        if not Path(path).is_file():
            raise kind.refusal(path, "is not a file", source)
        with open_for_reading(path) as file:
            own = attributes_of(file)
            if own.get("format") != kind.format:
                raise kind.refusal(path, f"is not a {kind.what} file", source)
            if int(own["version"]) > kind.version:
                limit = f"has version {own['version']}, this program reads up to {kind.version}"
                raise kind.refusal(path, limit, "Update jaxdem.")
            yield file
    except UNREADABLE as error:
        raise kind.refusal(path, f"cannot be read as a {kind.what} ({error})") from error


def write_whole(path: Name, content: bytes, key: str) -> None:
    """Write aside, sync and move into place, so that a file is whole or as it was.

    Raises:
        InputError: the place cannot be written; `key` is what the error names.
        OSError: there is no room on the disk.
    """
    try:
        write_bytes(Path(path), content)
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise InputError(key, str(path), f"cannot be written ({error})", "Choose a writable place.") from error
