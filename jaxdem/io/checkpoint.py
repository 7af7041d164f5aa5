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
from jaxdem.io.pieces import Share

FORMAT_NAME = "jaxdem checkpoint"
FORMAT_VERSION = 6

Attributes = dict[str, str | int | float]

PARTS = ".checkpoint"
"""Folder beside the checkpoint with what each of several processes has of it."""

NUMBER, ROUND = "parts", "round"
"""Attributes of a checkpoint of several processes: how many, and which of their files belong to it."""


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
    """Arrays and attributes as they were given to `write_checkpoint`; of several processes their blocks as one.

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
    if NUMBER in attributes:
        arrays |= _blocks(path, int(attributes.pop(NUMBER)), int(attributes.pop(ROUND)))
    return arrays, attributes


def write_shared_checkpoint(
    path: Path, share: Share, arrays: Arrays, blocks: Arrays, attributes: Mapping[str, object]
) -> None:
    """Replace the checkpoint of several processes, durably; all of them call it alike.

    Each writes its blocks into a file of its own. When all have, the first one replaces the checkpoint, which names
    them; then those of the one before are deleted.

    Args:
        path: the file.
        share: of the process.
        arrays: that all have alike.
        blocks: part of the process of arrays that are distributed along their first axis, by name.
        attributes: see `write_checkpoint`.

    Raises:
        OSError: the disk refused; the old checkpoint is as it was.
    """
    number = _next_round(path)
    share.barrier()  # all have looked
    if share.first:
        (path.parent / PARTS).mkdir(exist_ok=True)
    share.barrier()
    write_checkpoint(_part(path, share.index, share.number, number), blocks, {ROUND: number})
    share.barrier()
    if share.first:
        write_checkpoint(path, arrays, {**attributes, NUMBER: share.number, ROUND: number})
        remove_old_parts(path)
    share.barrier()


def remove_old_parts(path: Path) -> None:
    """Delete the files of several processes that the checkpoint does not name."""
    folder = path.parent / PARTS
    if not folder.is_dir():
        return
    kept: set[Path] = set()
    if path.is_file():
        with open_for_reading(path) as file:
            attributes = parse_json(file["attributes"][...].tobytes().decode())
        if NUMBER in attributes:
            parts = int(attributes[NUMBER])
            kept = {_part(path, index, parts, int(attributes[ROUND])) for index in range(parts)}
    for old in set(folder.iterdir()) - kept:
        old.unlink(missing_ok=True)
    if not kept:
        folder.rmdir()


def _next_round(path: Path) -> int:
    """A number that no file beside the checkpoint has."""
    folder = path.parent / PARTS
    names = [entry.name.split(".") for entry in folder.iterdir()] if folder.is_dir() else []
    return 1 + max((int(name[2]) for name in names if len(name) == 4 and name[2].isdecimal()), default=0)


def _part(path: Path, index: int, number: int, turn: int) -> Path:
    return path.parent / PARTS / f"{path.stem}.{index + 1}-of-{number}.{turn}.h5"


def _blocks(path: Path, number: int, turn: int) -> dict[str, np.ndarray]:
    """The distributed arrays of a checkpoint, whole."""
    parts = []
    for index in range(number):
        arrays, attributes = read_checkpoint(_part(path, index, number, turn))
        if attributes.get(ROUND) != turn:
            raise _damaged(path, f"the file of process {index + 1} of {number} is of another checkpoint")
        parts.append(arrays)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


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
