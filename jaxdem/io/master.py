"""The master of files of several processes, for VTK: its data sets lie in these files (virtual data sets of HDF5)."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from jaxdem.files.durable import aside
from jaxdem.files.hdf5 import create, open_for_reading
from jaxdem.io.frames import Format, Frame
from jaxdem.io.particle_file import ParticleFormat
from jaxdem.io.vtkhdf import ROOT


def write_master(place: Path, kind: Format, first: Frame, times: np.ndarray, paths: list[Path]) -> None:
    """A file in which the data sets of others, each with its part of every frame, stand as one each.

    Args:
        place: of the master, beside the others.
        kind: of the frames.
        first: the first frame, whole.
        times: of all frames (T,) [s].
        paths: the others, in the order of their parts.
    """
    count = len(times)
    with aside(place) as temporary, create(temporary) as file:
        head = kind.append(file, first, growing=count > 1)
        writer = _particles if isinstance(kind, ParticleFormat) else _cells
        entries = writer(file, paths, count)
        kind.finish(file, [{**head, **row, "Values": time} for row, time in zip(entries, times, strict=True)])


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
