"""A file of particles of any format, known by what it holds and not by its name."""

from __future__ import annotations

import os
from functools import lru_cache
from pathlib import Path

from jaxdem.errors import InputError
from jaxdem.files.hdf5 import SIGNATURE
from jaxdem.files.reading import TABLE_BYTES, open_regular, parse_arrays, read_bytes
from jaxdem.particle_files.arrays import raw_of_arrays
from jaxdem.particle_files.columns import Columns, Source, columns_of
from jaxdem.particle_files.data_file import is_data_file, read_data_file
from jaxdem.particle_files.dump import ITEM, read_dump
from jaxdem.particle_files.frames import is_frames, particles_name, read_frame
from jaxdem.particle_files.raw import KEY, Raw, refusal
from jaxdem.particle_files.text import read_text_table
from jaxdem.particle_files.vtk import is_vtk, read_vtk

HEAD_BYTES = 4096
OF_SEVERAL_STEPS = "a dump or a run"


def read_columns(source: Source) -> Columns:
    """The particles of a file; read once as long as the file does not change.

    Raises:
        InputError: the file cannot be read, or does not hold particles; it names the line and what was expected.
    """
    try:
        place = Path(source.name)
        if place.is_dir() and (place / particles_name()).is_file():
            place = place / particles_name()
        if place.is_dir():
            return _read.__wrapped__(source, 0, 0, 0)  # a run goes on in it: it may have another last frame each time
        status = os.stat(place)
        return _read(source, status.st_ino, status.st_size, status.st_mtime_ns)
    except FileNotFoundError:
        raise InputError(KEY, source.name, "no such file", "give a name relative to the scene file") from None
    except UnicodeDecodeError:
        raise refusal(source.name, "is neither text in UTF-8 nor a format that is known", _REMEDY) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise refusal(source.name, f"cannot be read ({reason})", _REMEDY) from None


_REMEDY = (
    "give text with a row of names, .npz, a dump or data file of LAMMPS or LIGGGHTS, a VTK file, or a run directory"
)


@lru_cache(maxsize=4)
def _read(source: Source, inode: int, size: int, modified: int) -> Columns:
    return columns_of(_raw(source), source)


def _raw(source: Source) -> Raw:
    name = source.name
    if is_frames(Path(name)):
        return read_frame(source)
    with open_regular(name) as file:
        head = file.read(HEAD_BYTES)
    if head.startswith(SIGNATURE):
        raise refusal(name, f"is an HDF5 file that is not called {particles_name()}", "give the folder of a run")
    if head.lstrip().startswith(ITEM.encode()):
        return read_dump(source, read_bytes(name, TABLE_BYTES).decode("utf-8-sig"))
    for key in ("frame", "time"):
        if getattr(source, key) is not None:
            limit = f"is for files with several time steps, {OF_SEVERAL_STEPS}; {name} has one state"
            raise InputError(f"{KEY}.{key}", getattr(source, key), limit, "remove this key")
    if is_vtk(head):
        return read_vtk(name)
    content = read_bytes(name, TABLE_BYTES)
    if content.startswith(b"PK"):
        return raw_of_arrays(name, parse_arrays(content), strict=True)
    if content.startswith((b"\x1f\x8b", b"BZh", b"\xfd7zXZ")):
        raise refusal(name, "is compressed", "unpack it first")
    text = content.decode("utf-8-sig")
    return read_data_file(name, text) if is_data_file(text) else read_text_table(name, text)
