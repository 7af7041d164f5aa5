"""`samples.h5`: what the drag law saw and gave, at sampled times.

Datasets have the time first, (T, ...), with one chunk a sample; `time` (T,) [s]; constants are root
attributes. Shapes and names stay the same over a run.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import h5py
import numpy as np

from jaxdem.files.hdf5 import attributes_of, store, write_attributes
from jaxdem.io.frames import Arrays, Entries, Frame, FrameSeries, extend

FORMAT_NAME = "jaxdem samples"
FORMAT_VERSION = 1
_RESERVED = ("format", "format_version")


def sample_frame(time: float, arrays: Arrays, attributes: Arrays) -> Frame:
    """One sample: `arrays` by name (any shape, the same at all times), `attributes` scalars or small arrays.

    Raises:
        ValueError: a name is taken (`time`; `format`, `format_version` among the attributes) or holds '/'.
    """
    for name in (*arrays, *attributes):
        if name in ("time", *_RESERVED) or "/" in name:
            raise ValueError(f"{name!r} cannot be the name of a sampled array or attribute")
    return Frame(float(time), {name: np.asarray(array) for name, array in arrays.items()}, dict(attributes))


class SampleFormat:
    """Layout of `samples.h5` and of its parts."""

    stem = "samples"
    suffix = ".h5"

    def append(self, file: h5py.File, frame: Frame, growing: bool) -> Entries:
        if "format" not in file.attrs:
            own = {"format": FORMAT_NAME, "format_version": FORMAT_VERSION}
            write_attributes(file, own | frame.attributes)
        elif set(file) != set(frame.arrays):
            raise ValueError(f"sampled arrays {sorted(frame.arrays)} after samples of {sorted(file)}")
        for name, array in frame.arrays.items():
            extend(file, name, array[None], growing, 1)
        return {"time": frame.time}

    def finish(self, file: h5py.File, entries: list[Entries]) -> None:
        store(file, "time", np.array([entry["time"] for entry in entries], np.float64))

    def count(self, file: h5py.File) -> int:
        own = attributes_of(file)
        if own["format"] != FORMAT_NAME or own["format_version"] != FORMAT_VERSION:
            raise ValueError(f"not a file of {FORMAT_NAME}, version {FORMAT_VERSION}")
        return int(file["time"].shape[0])

    def times(self, file: h5py.File) -> np.ndarray:
        return np.asarray(file["time"][...])

    def read(self, file: h5py.File, index: int) -> Frame:
        arrays = {name: np.asarray(dataset[index]) for name, dataset in file.items() if name != "time"}
        attributes = {name: value for name, value in attributes_of(file).items() if name not in _RESERVED}
        return Frame(float(file["time"][index]), arrays, attributes)


class Samples:
    """The samples of a run, read one at a time.

    Attributes:
        attributes: constants of the run by name.
        times: (T,) [s].
        names: names of the arrays of each sample.
    """

    def __init__(self, series: FrameSeries, number: int):
        self._series, self._number = series, number

    def __len__(self) -> int:
        return self._number

    @cached_property
    def times(self) -> np.ndarray:
        return self._series.times(self._number)

    @cached_property
    def attributes(self) -> dict[str, Any]:
        return self._series.read(0).attributes if self._number else {}

    @cached_property
    def names(self) -> tuple[str, ...]:
        return tuple(sorted(self._series.read(0).arrays)) if self._number else ()

    def frame(self, index: int) -> dict[str, np.ndarray]:
        """Arrays by name of sample `index`, negative from the end.

        Raises:
            IndexError: there is no such sample.
        """
        if not -self._number <= index < self._number:
            raise IndexError(f"sample {index} of {self._number}")
        return self._series.read(index % self._number).arrays
