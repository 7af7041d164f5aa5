"""A series of frames on disk: every frame first its own whole file, one file for all of them at the end.

While a run goes on, frame 12 of the particles is `RUN/.frames/particles.000012.vtkhdf`, complete and
readable by itself. `FrameSeries.join` streams the parts, one frame in memory at a time, into the file
`RUN/particles.vtkhdf` and then drops them. Where both exist (a kill between the two, or a run resumed
after a join) the joined file holds the leading frames and the parts go on from there; what a part and
the joined file both hold is the same frame.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import h5py
import numpy as np
from numpy.typing import ArrayLike

from jaxdem.errors import InputError
from jaxdem.files.durable import DeferredErrorFile, aside, sync_directory, write_bytes
from jaxdem.files.hdf5 import UNREADABLE, create, image_of, in_memory, open_for_reading, store
from jaxdem.io.access import reason_of

PARTS_FOLDER = ".frames"

Arrays = Mapping[str, ArrayLike]
"""Arrays by name."""


@dataclass(frozen=True)
class Frame:
    """One output time: `time` [s], arrays by name, and what holds for all frames (geometry, constants)."""

    time: float
    arrays: dict[str, np.ndarray]
    attributes: dict[str, Any] = field(default_factory=dict)


Entries = dict[str, Any]
"""Of one frame: its row in each table of a file (times, offsets)."""


class Format(Protocol):
    """How frames of one kind lie in an HDF5 file."""

    stem: str
    suffix: str

    def append(self, file: h5py.File, frame: Frame, growing: bool) -> Entries:
        """Write `frame` after those in `file`; into an empty file it writes the head too.

        A file that is not `growing` is for this one frame and may have a layout of its own. Returns what
        `finish` needs to know of the frame.
        """

    def finish(self, file: h5py.File, entries: list[Entries]) -> None:
        """Write the tables with one row a frame, from what `append` returned."""

    def count(self, file: h5py.File) -> int:
        """Number of frames in `file`."""

    def times(self, file: h5py.File) -> np.ndarray:
        """Times (T,) [s] of the frames in `file`."""

    def read(self, file: h5py.File, index: int) -> Frame:
        """Frame `index` of `file`, equal to the one appended."""


def image(frame: Frame, frame_format: Format) -> bytes:
    """The file of a single frame as bytes.

    HDF5 builds it in memory: our own plain write then meets a full disk as an OSError at a known place,
    where HDF5 would meet it in some flush of its own and could not close the file any more.
    """
    with in_memory("frame") as file:
        frame_format.finish(file, [frame_format.append(file, frame, growing=False)])
        return image_of(file)


def extend(group: h5py.Group, name: str, rows: np.ndarray, growing: bool, chunk: int) -> int:
    """Append `rows` (n, ...) to the dataset `name`, created if absent; returns the row they start at.

    `chunk` is the number of rows in one chunk of a growing dataset.
    """
    if name not in group:
        if growing:
            row = tuple(max(length, 1) for length in rows.shape[1:])
            limits = (None, *rows.shape[1:])
            group.create_dataset(name, data=rows, maxshape=limits, chunks=(chunk, *row), fletcher32=True)
        else:
            store(group, name, rows)
        return 0
    dataset = group[name]
    start = int(dataset.shape[0])
    if dataset.shape[1:] != rows.shape[1:]:
        raise ValueError(f"{name}: a frame of shape {rows.shape[1:]} after frames of {dataset.shape[1:]}")
    dataset.resize(start + rows.shape[0], axis=0)
    dataset[start:] = rows
    return start


class FrameSeries:
    """The frames of one kind in a run directory, whether joined, in parts, or both."""

    def __init__(self, folder: Path, frame_format: Format):
        self.format = frame_format
        self.joined = folder / f"{frame_format.stem}{frame_format.suffix}"
        self.parts = folder / PARTS_FOLDER
        self._layout: dict[str, tuple[tuple[int, ...], np.dtype]] = {}

    def exists(self) -> bool:
        """Whether there is a file of this kind at all."""
        return self.joined.exists() or bool(self.part_indices())

    def part(self, index: int) -> Path:
        """Path of the part that holds frame `index`."""
        return self.parts / f"{self.format.stem}.{index:06d}{self.format.suffix}"

    def part_indices(self) -> list[int]:
        """Frame numbers of the parts on disk, whole or not, in order."""
        pattern = re.compile(rf"{re.escape(self.format.stem)}\.(\d{{6,}}){re.escape(self.format.suffix)}")
        if not self.parts.is_dir():
            return []
        found = (pattern.fullmatch(path.name) for path in self.parts.iterdir())
        return sorted(int(match.group(1)) for match in found if match)

    def joined_count(self) -> int:
        """Number of frames in the joined file, 0 without one.

        Raises:
            InputError: the joined file is there and cannot be read.
        """
        if not self.joined.exists():
            return 0
        with self._opened(self.joined) as file:
            return self.format.count(file)

    def count(self) -> int:
        """Number of leading frames that can be read; a damaged or missing part ends the series."""
        number = self.joined_count()
        indices = set(self.part_indices())
        while number in indices and self._part_is_whole(number):
            number += 1
        return number

    def times(self, limit: int | None = None) -> np.ndarray:
        """Times (T,) [s] of the leading `limit` frames (default: of all)."""
        number = self.count() if limit is None else limit
        times: list[float] = []
        if self.joined.exists():
            with self._opened(self.joined) as file:
                times = list(self.format.times(file)[:number])
        for index in range(len(times), number):
            with self._opened(self.part(index)) as file:
                times.append(float(self.format.times(file)[0]))
        return np.asarray(times, np.float64)

    def write(self, index: int, frame: Frame) -> None:
        """Write `frame` as the part `index`, durably.

        Raises:
            ValueError: it has other arrays, shapes or types than the frames this object wrote before;
                said here, because at the join the run would be over.
        """
        layout = {name: (array.shape, array.dtype) for name, array in frame.arrays.items()}
        self._layout = self._layout or layout
        if layout != self._layout:
            raise ValueError(f"{self.format.stem}: {layout} after frames of {self._layout}")
        if not self.parts.is_dir():
            self.parts.mkdir(exist_ok=True)
            sync_directory(self.parts.parent)
        write_bytes(self.part(index), image(frame, self.format))

    def read(self, index: int) -> Frame:
        """Frame `index`; looked up at each call, so a run that joins meanwhile is no obstacle.

        Raises:
            InputError: the file that holds the frame is missing or damaged.
        """
        if self.joined.exists():
            with self._opened(self.joined) as file:
                if index < self.format.count(file):
                    return self.format.read(file, index)
        with self._opened(self.part(index)) as file:
            return self.format.read(file, 0)

    def frames(self, limit: int) -> Iterator[Frame]:
        """The leading `limit` frames, one at a time; the joined file is opened once."""
        from_joined = min(self.joined_count(), limit)
        if from_joined:
            with self._opened(self.joined) as file:
                for index in range(from_joined):
                    yield self.format.read(file, index)
        for index in range(from_joined, limit):
            yield self.read(index)

    def join(self, limit: int | None = None) -> None:
        """Make the joined file of the leading `limit` frames (default: all readable); parts stay.

        Memory: one frame. The old joined file is replaced only when the new one is complete on disk.
        """
        number = self.count() if limit is None else limit
        if number == self.joined_count():
            return
        if number == 0:
            self.joined.unlink(missing_ok=True)
            sync_directory(self.joined.parent)
            return
        with aside(self.joined) as temporary, DeferredErrorFile(temporary) as target:
            with create(target) as file:
                entries = []
                for frame in self.frames(number):
                    entries.append(self.format.append(file, frame, growing=number > 1))
                    target.raise_error()
                self.format.finish(file, entries)
            target.raise_error()

    def cut(self, number: int) -> None:
        """Keep the leading `number` frames and remove later ones, in the joined file and in parts."""
        if self.joined_count() > number:
            self.join(number)
        self.drop_parts(number)

    def drop_parts(self, first: int = 0) -> None:
        """Remove the parts from `first` on."""
        for index in reversed(self.part_indices()):
            if index >= first:
                self.part(index).unlink(missing_ok=True)

    def _part_is_whole(self, index: int) -> bool:
        try:
            with open_for_reading(self.part(index)) as file:
                return self.format.count(file) == 1
        except UNREADABLE:
            return False

    @contextmanager
    def _opened(self, path: Path) -> Iterator[h5py.File]:
        """The file open for reading; what is wrong with it, or with what is read from it, is an InputError."""
        try:
            with open_for_reading(path) as file:
                yield file
        except UNREADABLE as error:
            reason = f"cannot be read ({reason_of(error)})"
            remedy = "The file is missing, damaged or not of jaxdem; take it from a backup or run the scene again."
            raise InputError(path.name, str(path), reason, remedy) from error
