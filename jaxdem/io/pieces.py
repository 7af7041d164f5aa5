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

import h5py
import numpy as np

from jaxdem.errors import InputError
from jaxdem.files.durable import sync_directory
from jaxdem.io.fluid_file import FluidFormat
from jaxdem.io.frames import PARTS_FOLDER, Entries, Format, Frame, FrameSeries
from jaxdem.io.master import write_master
from jaxdem.io.particle_file import ParticleFormat

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
            self._write_master()
        self._share.barrier()

    def _write_master(self) -> None:
        """The master of the files of all processes; none where they have no frame."""
        series = PieceSeries(self._master.parent, self._whole, self._share.number)
        times = series.times()
        if len(times):
            write_master(self._master, self._whole, series.read(0), times, series.files)
        else:
            self._master.unlink(missing_ok=True)


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
