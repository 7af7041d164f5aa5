"""Looks at an HDF5 file before anything of it is read: all must lie in it, and nothing may claim more than there is.

HDF5 files may name other files (external links, external storage, virtual data sets), which a reader would follow, and
may claim data sets of any size, for which a reader would make room. This module imports nothing of jaxdem, for it is a
program too: `python hdf5_contents.py FILE` looks, and then reads all there is.
"""

from __future__ import annotations

import math
import os
import sys

import h5py

FILTERS = (h5py.h5z.FILTER_FLETCHER32, h5py.h5z.FILTER_SHUFFLE)
"""What may have been done to numbers on their way into the file: they have the same size behind it."""

BYTES_AT_ONCE = 1 << 24
"""Of a data set that is read only to see that it can be."""


def contents(file: h5py.File, size: int) -> list[h5py.Group | h5py.Dataset]:
    """All groups and data sets of an open file of `size` bytes.

    Raises:
        OSError: a link, or data that lie in another file, are compressed, or are claimed to be more than is stored.
    """
    found: list[h5py.Group | h5py.Dataset] = []
    waiting, seen, stored = [file["/"]], set(), 0
    while waiting:
        entry = waiting.pop()
        address = h5py.h5o.get_info(entry.id).addr
        if address in seen:
            continue
        seen.add(address)
        found.append(entry)
        if isinstance(entry, h5py.Dataset):
            stored += _stored(entry, size)
        else:
            waiting += [_linked(entry, name) for name in entry]
    if stored > size:
        raise OSError(f"claims {stored} bytes of data in {size} bytes")
    return found


def _linked(group: h5py.Group, name: str) -> h5py.Group | h5py.Dataset:
    place = f"{group.name.rstrip('/')}/{name}"
    link = group.id.links.get_info(name.encode("utf-8", "surrogateescape"))
    if link.type != h5py.h5l.TYPE_HARD:
        raise OSError(f"{place} is a link to another place or file")
    entry = group[name]
    if not isinstance(entry, h5py.Group | h5py.Dataset):
        raise OSError(f"{place} is neither a group nor a data set")
    return entry


def _stored(dataset: h5py.Dataset, size: int) -> int:
    """Bytes that a data set has in a file of `size` bytes; not fewer than its shape asks for."""
    if dataset.is_virtual or dataset.external:
        raise OSError(f"{dataset.name} lies in another file")
    layout = dataset.id.get_create_plist()
    filters = {layout.get_filter(number)[0] for number in range(layout.get_nfilters())}
    if not filters <= set(FILTERS):
        raise OSError(f"{dataset.name} is compressed")
    if dataset.shape is None:
        raise OSError(f"{dataset.name} has no shape")
    item, stored = dataset.id.get_type().get_size(), dataset.id.get_storage_size()
    if math.prod(dataset.shape) * item > stored:
        raise OSError(f"{dataset.name} claims {math.prod(dataset.shape) * item} bytes and has {stored}")
    if math.prod(dataset.chunks or ()) * item > max(size, item):
        raise OSError(f"{dataset.name} claims chunks larger than the file")
    return int(stored)


def read_all(path: str) -> None:
    """Read every attribute and number of a file."""
    with h5py.File(path, "r", locking=False) as file:
        for entry in contents(file, os.stat(path).st_size):
            list(entry.attrs.items())
            if isinstance(entry, h5py.Dataset) and entry.shape:
                row = max(1, entry.dtype.itemsize * math.prod(entry.shape[1:]))
                rows = max(1, BYTES_AT_ONCE // row)
                for start in range(0, entry.shape[0], rows):
                    entry[start : start + rows]
            elif isinstance(entry, h5py.Dataset):
                entry[()]


if __name__ == "__main__":
    read_all(sys.argv[1])
