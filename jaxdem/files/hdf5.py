"""HDF5 files in which an altered byte is noticed, and which cannot hold up the library that reads them.

Files are written in the format of HDF5 1.10, whose tables (headers, names, indices) carry a checksum each, with the
numbers either inside such a table or in chunks with a Fletcher-32 checksum, and with text of fixed length, since the
heap of HDF5's variable-length text has none. In the older format, and it is the default of most programs, a single
altered bit can send the library round in circles or out of its memory: a file in it is first read by a process of its
own, which may take so long and no longer. (`subprocess.run` ends a process that takes longer; a worker of
`concurrent.futures` that hangs cannot be ended.) `hdf5_contents` says what every file must be like.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import IO, Any

import h5py
import numpy as np
from numpy.typing import ArrayLike

from jaxdem.files import hdf5_contents
from jaxdem.files.reading import open_regular

LIBVER = ("v110", "v110")
"""The first format in which the indices of chunks have checksums; VTK and ParaView read it."""

SIGNATURE = b"\x89HDF\r\n\x1a\n"
CHECKED = 2
"""The version of the first block (byte 8 of a file) from which on tables have checksums."""

UNREADABLE = (
    OSError, KeyError, ValueError, RuntimeError, TypeError, IndexError, AttributeError, OverflowError, MemoryError,
)  # fmt: skip
"""What h5py raises on a file that is truncated, is not HDF5, or lacks what we look for."""

COMPACT_BYTES = 16384
"""Up to here an array lies in its header; HDF5's limit is 64 KiB for all of it."""

ONE_CHUNK_BYTES = 1 << 28
"""Up to here an array is one chunk; HDF5's limit is 4 GiB."""

TRIAL_SECONDS, TRIAL_RATE = 30.0, 10e6
"""What a trial may take at least, and the bytes in a second beyond that; a disk reads ten times faster."""

TRIAL = ("-P", hdf5_contents.__file__)
"""Arguments of Python for a process that reads all there is, to see whether it hangs or crashes."""


def create(target: str | os.PathLike[str] | IO[bytes], **options: Any) -> h5py.File:
    """A new file (path, or object to write to) with checked tables; `options` are those of `h5py.File`."""
    return h5py.File(target, "w", libver=LIBVER, **options)


def in_memory(name: str) -> h5py.File:
    """A new file that is only in memory; see `image_of`."""
    return create(name, driver="core", backing_store=False)


def image_of(file: h5py.File) -> bytes:
    """The bytes that the open file would have on disk."""
    file.flush()
    return bytes(file.id.get_file_image())


def store(group: h5py.Group, name: str, data: ArrayLike) -> h5py.Dataset:
    """Write an array of any shape with a checksum over its numbers."""
    array = np.asarray(data)
    if array.nbytes > COMPACT_BYTES:
        chunks = array.shape if array.nbytes <= ONE_CHUNK_BYTES else True
        return group.create_dataset(name, data=array, chunks=chunks, fletcher32=True)
    where, _, last = name.rpartition("/")
    parent = group.require_group(where) if where else group
    layout = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    layout.set_layout(h5py.h5d.COMPACT)
    kind, space = h5py.h5t.py_create(array.dtype, logical=True), h5py.h5s.create_simple(array.shape)
    dataset = h5py.Dataset(h5py.h5d.create(parent.id, last.encode(), kind, space, layout))
    if array.size:
        dataset[...] = array
    return dataset


def plain(value: object) -> Any:
    """An attribute as Python's own: text as `str`, numbers as they are, arrays of text as lists."""
    if isinstance(value, bytes):
        return value.decode()
    if isinstance(value, np.ndarray) and value.dtype.kind in "SO":
        return [plain(entry) for entry in value.tolist()]
    return value.item() if isinstance(value, np.generic) else value


def attributes_of(found: h5py.Group | h5py.Dataset) -> dict[str, Any]:
    """All attributes, each `plain`."""
    return {name: plain(value) for name, value in found.attrs.items()}


def write_attributes(found: h5py.Group | h5py.Dataset, values: Mapping[str, Any]) -> None:
    """Set attributes: text, lists of text, numbers and arrays of numbers."""
    for name, value in values.items():
        array = np.asarray(value)
        if array.dtype.kind == "U":
            encoded = np.char.encode(array, "utf-8")
            array = encoded.astype(f"S{max(1, encoded.dtype.itemsize)}")  # HDF5 has no text of no length
        found.attrs[name] = array


def open_for_reading(path: str | os.PathLike[str]) -> h5py.File:
    """Open without HDF5's own lock: our files are never changed in place, and the disk may be read-only.

    Raises:
        OSError: it is not a regular file, not HDF5, is damaged, holds up the library, names other files, or claims more
            data than it has.
    """
    with open_regular(path) as file:
        head = file.read(len(SIGNATURE) + 1)
        status = os.fstat(file.fileno())
    if len(head) <= len(SIGNATURE) or not head.startswith(SIGNATURE):
        raise OSError("file signature not found: it is not HDF5")
    identity = str(Path(path).resolve()), status.st_ino, status.st_size, status.st_mtime_ns
    if head[-1] < CHECKED:
        reason = _trial(*identity)
        if reason:
            raise OSError(reason)
    _look(*identity)
    return h5py.File(path, "r", locking=False)


@lru_cache(maxsize=4096)
def _look(path: str, inode: int, size: int, modified: int) -> None:
    """Raises OSError for contents that may not be read; looks once at the same file."""
    with h5py.File(path, "r", locking=False) as file:
        hdf5_contents.contents(file, size)


@lru_cache(maxsize=256)
def _trial(path: str, inode: int, size: int, modified: int) -> str:
    """What is wrong with a file without checksums as a process of its own finds it; empty where nothing is."""
    seconds = TRIAL_SECONDS + size / TRIAL_RATE
    try:
        done = subprocess.run(
            [sys.executable, *TRIAL, path],
            stdin=subprocess.DEVNULL, capture_output=True, check=False, timeout=seconds,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return f"the HDF5 library did not come to an end in it within {seconds:.0f} s"
    return f"the HDF5 library crashes in it (signal {-done.returncode})" if done.returncode < 0 else ""
