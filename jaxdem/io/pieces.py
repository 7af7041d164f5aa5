"""Frames that several processes write: each a file of its own, and a master in which VTK reads them as one.

Process 2 of 4 writes `particles.2-of-4.vtkhdf`, made as `jaxdem.io.frames` makes the file of one process, with the
second quarter of the particles (rows in the order of `id`) or of the cells (along x). `particles.vtkhdf` then has data
sets that lie in these files (virtual data sets of HDF5) and has the layout of the file of one process. jaxdem itself
reads the pieces and not the master: a file from elsewhere that names others is refused.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from jaxdem.errors import InputError
from jaxdem.files.durable import aside, sync_directory
from jaxdem.files.hdf5 import create, open_for_reading
from jaxdem.io.fluid_file import FluidFormat
from jaxdem.io.frames import PARTS_FOLDER, Entries, Format, Frame, FrameSeries
from jaxdem.io.particle_file import ParticleFormat
from jaxdem.io.vtkhdf import ROOT

PIECE = re.compile(r"(?P<stem>[a-z]+)\.(?P<index>\d+)-of-(?P<number>\d+)(?:\.\d{6,})?(?P<suffix>\.[a-z0-9]+)")
"""Name of a file of one process: of all its frames, or of one."""


@dataclasses.dataclass(frozen=True)
class Share:
    """What one process of a run has to write.

    Attributes:
        index: of the process, from 0.
        number: of processes.
        barrier: waits until all processes are here.
    """

    index: int
    number: int
    barrier: Callable[[], None]

    @property
    def first(self) -> bool:
        """Whether this process writes what there is once."""
        return self.index == 0

    def part(self, size: int) -> slice:
        """Of so many rows those of this process."""
        return slice(*(size * k // self.number for k in (self.index, self.index + 1)))


class _PieceFormat:
    """The format of the frames, under the name of a process."""

    def __init__(self, whole: Format, index: int, number: int):
        self._whole = whole
        self.stem, self.suffix = f"{whole.stem}.{index + 1}-of-{number}", whole.suffix

    def append(self, file: h5py.File, frame: Frame, growing: bool) -> Entries:
        return self._whole.append(file, frame, growing)

    def finish(self, file: h5py.File, entries: list[Entries]) -> None:
        self._whole.finish(file, entries)

    def count(self, file: h5py.File) -> int:
        return self._whole.count(file)

    def times(self, file: h5py.File) -> np.ndarray:
        return self._whole.times(file)

    def read(self, file: h5py.File, index: int) -> Frame:
        return self._whole.read(file, index)


class SharedSeries(FrameSeries):
    """Writer of the frames of one kind for one process of several; all of them call it alike."""

    def __init__(self, folder: Path, frame_format: Format, share: Share):
        super().__init__(folder, _PieceFormat(frame_format, share.index, share.number))
        self._whole, self._share = frame_format, share
        self._master = folder / f"{frame_format.stem}{frame_format.suffix}"

    def write(self, index: int, frame: Frame) -> None:
        """Write this process's part of a whole frame, durably."""
        super().write(index, part_of(frame, self._share))

    def join(self, limit: int | None = None) -> None:
        """The file of this process and, by the first one when all have theirs, the master; see `FrameSeries.join`."""
        super().join(limit)
        self._share.barrier()
        if self._share.first:
            write_master(self._master.parent, self._whole, self._share.number)
        self._share.barrier()


class PieceSeries:
    """Reader of the frames of one kind that several processes have written, each frame as one."""

    def __init__(self, folder: Path, frame_format: Format, number: int):
        self._pieces = [FrameSeries(folder, _PieceFormat(frame_format, index, number)) for index in range(number)]
        self.number = number

    def exists(self) -> bool:
        """Whether there is a file of this kind at all."""
        return any(piece.exists() for piece in self._pieces)

    def count(self) -> int:
        """Number of leading frames that can be read of all processes."""
        return min(piece.count() for piece in self._pieces)

    def times(self, limit: int | None = None) -> np.ndarray:
        """Times (T,) [s] of the leading `limit` frames (default: of all)."""
        return self._pieces[0].times(self.count() if limit is None else limit)

    def read(self, index: int) -> Frame:
        """Frame `index`.

        Raises:
            InputError: a file that holds a part of it is missing or damaged.
        """
        return joined([piece.read(index) for piece in self._pieces])

    def frames(self, limit: int) -> Iterator[Frame]:
        """The leading `limit` frames, one at a time."""
        for parts in zip(*(piece.frames(limit) for piece in self._pieces), strict=True):
            yield joined(list(parts))

    @property
    def files(self) -> list[Path]:
        """That of each process with all its frames."""
        return [piece.joined for piece in self._pieces]

    def remove(self) -> None:
        """Deletes all files."""
        for piece in self._pieces:
            piece.joined.unlink(missing_ok=True)
            piece.drop_parts()


def series_of(folder: Path, frame_format: Format) -> FrameSeries | PieceSeries:
    """The frames of one kind in a run directory, whoever has written them."""
    number = pieces_in(folder)
    return FrameSeries(folder, frame_format) if number is None else PieceSeries(folder, frame_format, number)


def pieces_in(folder: Path) -> int | None:
    """Number of processes whose files are in a run directory; None where one process has written it.

    Raises:
        InputError: there are files of runs by different numbers of processes.
    """
    found: set[int] = set()
    for place in (folder, folder / PARTS_FOLDER):
        if place.is_dir():
            names = (PIECE.fullmatch(entry.name) for entry in place.iterdir())
            found |= {int(name["number"]) for name in names if name is not None}
    if len(found) > 1:
        limit = f"holds files of {' and of '.join(map(str, sorted(found)))} processes"
        raise InputError("run", str(folder), limit, "Take its files from a backup, or run the scene again.")
    return found.pop() if found else None


def regroup(folder: Path, share: Share | None) -> None:
    """Frames that another number of processes has written become those of this one; nothing where it is the same.

    Args:
        folder: run directory.
        share: of the process that does it, the others wait; None for a run by one process.
    """
    before, now = pieces_in(folder), None if share is None else share.number
    if before != now:
        for kind in (ParticleFormat(), FluidFormat()):
            old = series_of(folder, kind)
            if old.exists():
                _rewrite(folder, kind, old, now)
    elif share is not None:
        for kind in (ParticleFormat(), FluidFormat()):
            (folder / f"{kind.stem}{kind.suffix}").unlink(missing_ok=True)


def _rewrite(folder: Path, kind: Format, old: FrameSeries | PieceSeries, number: int | None) -> None:
    """All frames as so many pieces, or whole; one frame in memory at a time."""
    count = old.count()
    if number is None:
        new = FrameSeries(folder, kind)
        new.joined.unlink(missing_ok=True)  # the master of what is there
        for index, frame in enumerate(old.frames(count)):
            new.write(index, frame)
    else:
        shares = [Share(index, number, lambda: None) for index in range(number)]
        for index, frame in enumerate(old.frames(count)):
            for share in shares:
                SharedSeries(folder, kind, share).write(index, frame)
    if isinstance(old, PieceSeries):
        old.remove()
    else:
        old.joined.unlink(missing_ok=True)
        old.drop_parts()
    sync_directory(folder)


def part_of(frame: Frame, share: Share) -> Frame:
    """The part of a frame that a process writes: rows of the particles, or cells along x."""
    first = frame.arrays["position"] if "position" in frame.arrays else frame.arrays["pressure"]
    rows = share.part(len(first))
    attributes = dict(frame.attributes)
    if "origin" in attributes:
        attributes["origin"] = np.array(attributes["origin"], float)
        attributes["origin"][0] += rows.start * attributes["spacing"][0]
    return Frame(frame.time, {name: array[rows] for name, array in frame.arrays.items()}, attributes)


def joined(parts: list[Frame]) -> Frame:
    """The inverse of `part_of`."""
    names = parts[0].arrays.keys()
    arrays = {name: np.concatenate([part.arrays[name] for part in parts]) for name in names}
    return Frame(parts[0].time, arrays, parts[0].attributes)


def write_master(folder: Path, kind: Format, number: int) -> None:
    """The master of the files of all processes, in which their data sets stand as one each."""
    series = PieceSeries(folder, kind, number)
    count = series.count()
    place = folder / f"{kind.stem}{kind.suffix}"
    if count == 0:
        place.unlink(missing_ok=True)
        return
    paths = series.files
    with aside(place) as temporary, create(temporary) as file:
        head = kind.append(file, series.read(0), growing=count > 1)
        writer = _particles if isinstance(kind, ParticleFormat) else _cells
        entries = writer(file, paths, count)
        kind.finish(file, [{**head, **row, "Values": time} for row, time in zip(entries, series.times(), strict=True)])


def _particles(file: h5py.File, paths: list[Path], count: int) -> list[dict[str, Any]]:
    """Points and point data of all steps, virtual; the rows at which each step begins."""
    tables = {"Points": "PointOffsets"}
    data = file[ROOT]["PointData"]
    tables |= {f"PointData/{name}": f"PointDataOffsets/{name}" for name in data}
    rows: list[dict[str, Any]] = [{} for _ in range(count)]
    for name, offsets in tables.items():
        sources = [_Source.of(path, f"{ROOT}/{name}", offsets, count) for path in paths]
        starts = list(zip(*(source.starts for source in sources), strict=True))
        distinct = {key: k for k, key in enumerate(dict.fromkeys(starts))}
        sizes = [source.rows for source in sources]
        layout = h5py.VirtualLayout((len(distinct) * sum(sizes), *sources[0].shape[1:]), sources[0].dtype)
        for key, k in distinct.items():
            at = k * sum(sizes)
            for source, begin in zip(sources, key, strict=True):
                layout[at : at + source.rows] = source.virtual[begin : begin + source.rows]
                at += source.rows
        _replace(file[ROOT], name, layout)
        for row, key in zip(rows, starts, strict=True):
            row[offsets] = distinct[key] * sum(sizes)
    return rows


def _cells(file: h5py.File, paths: list[Path], count: int) -> list[dict[str, Any]]:
    """Cell data of all steps, virtual: (T, nz, ny, nx[, 3]), cut along x."""
    rows: list[dict[str, Any]] = [{} for _ in range(count)]
    axis = 3 if count > 1 else 2
    for name in file[ROOT]["CellData"]:
        sources = [_Source.of(path, f"{ROOT}/CellData/{name}", f"CellDataOffsets/{name}", count) for path in paths]
        shape = list(sources[0].shape)
        shape[axis] = sum(source.shape[axis] for source in sources)
        layout = h5py.VirtualLayout(tuple(shape), sources[0].dtype)
        at = 0
        for source in sources:
            place = [slice(None)] * len(shape)
            place[axis] = slice(at, at + source.shape[axis])
            layout[tuple(place)] = source.virtual
            at += source.shape[axis]
        _replace(file[ROOT], f"CellData/{name}", layout)
        for k, row in enumerate(rows):
            row[f"CellDataOffsets/{name}"] = k
    return rows


@dataclasses.dataclass(frozen=True)
class _Source:
    """A data set in the file of one process: where it is, and the row at which each step begins."""

    virtual: h5py.VirtualSource
    shape: tuple[int, ...]
    dtype: np.dtype
    rows: int
    starts: list[int]

    @classmethod
    def of(cls, path: Path, name: str, offsets: str, count: int) -> _Source:
        with open_for_reading(path) as file:
            root, dataset = file[ROOT], file[name]
            starts = root["Steps"][offsets][...].tolist() if "Steps" in root else [0] * count
            rows = int(root["NumberOfPoints"][0]) if "NumberOfPoints" in root else 1
            # By name, beside the master: a run directory may be moved.
            virtual = h5py.VirtualSource(path.name, name, dataset.shape, dataset.dtype)
            return cls(virtual, dataset.shape, dataset.dtype, rows, starts)


def _replace(group: h5py.Group, name: str, layout: h5py.VirtualLayout) -> None:
    """The data set of the first step that `append` wrote becomes the virtual one of all steps."""
    attributes = dict(group[name].attrs)
    del group[name]
    found = group.create_virtual_dataset(name, layout)
    found.attrs.update(attributes)


__all__ = [
    "PieceSeries",
    "Share",
    "SharedSeries",
    "joined",
    "part_of",
    "pieces_in",
    "regroup",
    "series_of",
    "write_master",
]
