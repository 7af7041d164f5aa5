"""`checkpoint.h5`: the newest restart state, exact to the bit.

Arrays keep dtype and shape; attributes keep their Python type. A SHA-256 over all of it is stored, so
a damaged checkpoint is refused instead of resumed from.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from urllib.parse import quote, unquote

import numpy as np

from jaxdem.errors import InputError
from jaxdem.files.durable import write_bytes
from jaxdem.files.hdf5 import UNREADABLE, attributes_of, image_of, in_memory, open_for_reading, store, write_attributes
from jaxdem.files.reading import parse_json
from jaxdem.io.frames import Arrays

FORMAT_NAME = "jaxdem checkpoint"
FORMAT_VERSION = 6

Attributes = dict[str, str | int | float]


def write_checkpoint(path: str | Path, arrays: Arrays, attributes: Mapping[str, object]) -> None:
    """Replace the checkpoint at `path`, durably; the old one stays until the new one is whole.

    Args:
        path: the file.
        arrays: numeric or bool arrays by name, any shape (0-d and empty too).
        attributes: str, int, float or bool by name.

    Raises:
        TypeError: an array or attribute of a kind that would not read back the same.
        OSError: the disk refused; the old checkpoint is as it was.
    """
    prepared = {name: _storable(name, array) for name, array in arrays.items()}
    text = json.dumps({name: _plain(name, value) for name, value in attributes.items()})
    with in_memory("checkpoint") as file:
        checksum = _checksum(prepared, text)
        write_attributes(file, {"format": FORMAT_NAME, "format_version": FORMAT_VERSION, "sha256": checksum})
        store(file, "attributes", np.frombuffer(text.encode(), np.uint8))
        group = file.create_group("arrays")
        for name, array in prepared.items():
            store(group, _quoted(name), array)
        content = image_of(file)
    write_bytes(Path(path), content)


def read_checkpoint(path: str | Path) -> tuple[dict[str, np.ndarray], Attributes]:
    """Arrays and attributes as they were given to `write_checkpoint`.

    Raises:
        InputError: the file is missing, truncated, altered, of another program or of another version.
    """
    path = Path(path)
    if not path.is_file():
        raise _refused(path, "there is no checkpoint", "Start the run anew, without --resume.")
    try:
        with open_for_reading(path) as file:
            own = attributes_of(file)
            name, version = own.get("format"), own.get("format_version")
            if name != FORMAT_NAME:
                remedy = "Give the folder of a run of jaxdem, or start the run anew."
                raise _refused(path, "is not a checkpoint of jaxdem", remedy)
            if version != FORMAT_VERSION:
                remedy = "Resume with the version of jaxdem that wrote it, or start the run anew."
                raise _refused(path, f"has format {version}, this version reads {FORMAT_VERSION}", remedy)
            text = file["attributes"][...].tobytes().decode()
            attributes = parse_json(text)
            arrays = {unquote(name): dataset[()] for name, dataset in file["arrays"].items()}
            expected = own["sha256"]
    except UNREADABLE as error:
        raise _damaged(path, "cannot be read as HDF5 (truncated or not a checkpoint)") from error
    # h5py gives 0-d datasets as scalars.
    arrays = {name: np.asarray(array) for name, array in arrays.items()}
    if _checksum(arrays, text) != expected:
        raise _damaged(path, "does not match its checksum")
    return arrays, attributes


def content_hash(arrays: Mapping[str, np.ndarray], attributes: Mapping[str, object]) -> str:
    """SHA-256 of what a checkpoint holds, as it is stored in its file."""
    return _checksum(arrays, json.dumps(dict(attributes)))


def _checksum(arrays: Mapping[str, np.ndarray], attributes: str) -> str:
    digest = hashlib.sha256(attributes.encode())
    for name in sorted(arrays):
        array = arrays[name]
        digest.update(f"\n{name}\n{array.dtype.str}\n{array.shape}\n".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def _storable(name: str, value: object) -> np.ndarray:
    array = np.asarray(value)
    if array.dtype.kind not in "biufc":
        raise TypeError(f"{name}: arrays of {array.dtype} cannot be kept in a checkpoint")
    return array


def _plain(name: str, value: object) -> str | int | float:
    if isinstance(value, np.generic):
        value = value.item()
    if not isinstance(value, (str, int, float)):
        raise TypeError(f"{name}: {type(value).__name__} cannot be an attribute of a checkpoint")
    return value


def _quoted(name: str) -> str:
    """HDF5 takes '/' for a group and '.' for the group itself; neither is safe in a name."""
    return quote(name, safe=" ").replace(".", "%2E")


def _refused(path: Path, limit: str, remedy: str) -> InputError:
    return InputError("checkpoint.h5", str(path), limit, remedy)


def _damaged(path: Path, limit: str) -> InputError:
    return _refused(path, limit, "Take the file from a backup, or start the run anew in another folder.")
