"""What VTKHDF 2.0 files share, which open in ParaView; those of particles, bonds and fluid have a module each.

Coordinates are VTK's: three components. A 2-D scene (x, z) is stored as (x, z, 0); its scalar angular
velocity, about the axis out of the plane, is the third component. Layout after the "VTKHDF format
specification" (docs.vtk.org, vtk_file_formats/vtkhdf_file_format).
"""

from __future__ import annotations

import h5py
import numpy as np

from jaxdem.files.hdf5 import store
from jaxdem.io.frames import Entries, Frame, extend

ROOT = "VTKHDF"
VERSION = (2, 0)
"""2.0 is the first with time and PolyData; nothing later is used, so older ParaView (5.12) reads it."""

TOPOLOGIES = ("Vertices", "Lines", "Polygons", "Strips")
"""The kinds of cells of PolyData in the order of the columns of `Steps/CellOffsets`."""

UNITS = {
    "position": "m",
    "velocity": "m/s",
    "angular_velocity": "rad/s",
    "radius": "m",
    "orientation": "1",
    "id": "1",
    "active": "1",
    "pressure": "Pa",
    "void_fraction": "1",
    "liquid_fraction": "1",
    "temperature": "K",
    "time": "s",
    "bending_moment": "N m",
    "twisting_moment": "N m",
    "tensile_stress": "Pa",
    "shear_stress": "Pa",
    "bond_energy": "J",
}
"""Stored beside each array as its HDF5 attribute `units`, which VTK passes over; forces, `*_force`, have N."""

NUMBERS = "biuf"
"""Kinds of arrays that a frame holds: whole numbers and floats."""


def three_components(array: np.ndarray) -> np.ndarray:
    """(x, z) as (x, z, 0) along the last axis."""
    return np.pad(array, [(0, 0)] * (array.ndim - 1) + [(0, 1)])


class StepFormat:
    """What all kinds share: the group `Steps` of a file of many frames.

    A file of one frame has none and is static for VTK: readers disagree on `Steps` with a single entry
    (VTK 9.7 then expects no time axis, earlier ones do). Its time is a root attribute, which VTK ignores.
    """

    suffix = ".vtkhdf"

    def count(self, file: h5py.File) -> int:
        root = file[ROOT]
        if "Steps" not in root:
            return 1
        number = int(root["Steps"].attrs["NSteps"])
        if root["Steps/Values"].shape != (number,):
            raise ValueError(f"{number} steps with times of shape {root['Steps/Values'].shape}")
        return number

    def times(self, file: h5py.File) -> np.ndarray:
        root = file[ROOT]
        return np.asarray(root["Steps/Values"][...] if "Steps" in root else [file.attrs["time"]], np.float64)

    @staticmethod
    def head(file: h5py.File, kind: str, frame: Frame, growing: bool) -> None:
        """Write what VTK looks at first; the scene's own dimension is a root attribute too."""
        file.attrs["dimension"] = frame.attributes["dimension"]
        root = file.create_group(ROOT)
        root.attrs["Version"] = np.array(VERSION, np.int64)
        # A fixed-length ASCII string: the reader does not accept h5py's default variable-length one.
        root.attrs.create("Type", np.bytes_(kind), dtype=h5py.string_dtype("ascii", len(kind)))
        if growing:
            root.create_group("Steps")
        else:
            file.attrs["time"] = frame.time

    def finish(self, file: h5py.File, entries: list[Entries]) -> None:
        """Write the columns of `Steps`; a file of one frame has none."""
        if "Steps" in file[ROOT]:
            steps = file[ROOT]["Steps"]
            steps.attrs["NSteps"] = len(entries)
            for name in entries[0]:
                store(steps, name, np.array([entry[name] for entry in entries]))
            name_unit(steps["Values"], "time")

    @staticmethod
    def entry(file: h5py.File, name: str, index: int) -> int:
        """Entry `index` of `Steps/name`; 0, the start, in a file of one frame."""
        root = file[ROOT]
        return int(root["Steps"][name][index]) if "Steps" in root else 0


class PolyDataFormat(StepFormat):
    """Cells that are the same in all frames, with points of their own.

    Attributes:
        data: group of the arrays beside the points.
        points: of a cell, all of which one row of `data` stands for.
        content: what the cells are, for messages.
    """

    data: str
    points: int
    content: str

    def read(self, file: h5py.File, index: int) -> Frame:
        """See `frames.Format`."""
        root = file[ROOT]
        number = int(root["NumberOfPoints"][0])
        rows = number // self.points
        start = self.entry(file, "PointOffsets", index)
        arrays, lengths = {"position": root["Points"][start : start + number]}, {"position": number}
        for name, dataset in root[self.data].items():
            start = self.entry(file, f"{self.data}Offsets/{name}", index)
            arrays[name] = dataset[start : start + rows]
        for name, array in arrays.items():
            if len(array) != lengths.get(name, rows) or array.dtype.kind not in NUMBERS:
                raise ValueError(f"{name} holds {array.dtype} of shape {array.shape} for {rows} {self.content}")
        return Frame(float(self.times(file)[index]), arrays, {"dimension": dimension_of(file)})


def dimension_of(file: h5py.File) -> int:
    """Of the scene, 2 or 3."""
    dimension = int(file.attrs["dimension"])
    if dimension not in (2, 3):
        raise ValueError(f"{dimension} dimensions")
    return dimension


def name_unit(dataset: h5py.Dataset, name: str) -> None:
    """Store the unit of an array that has one, once: for others to read, who expect text of variable length."""
    unit = "N" if name.endswith("_force") else UNITS.get(name)
    if unit is not None and "units" not in dataset.attrs:
        dataset.attrs["units"] = unit


def write_topology(root: h5py.Group, kind: str, points: int, number: int) -> None:
    """One part of `number` cells of a kind with so many points of their own each, in their order, and no others."""
    store(root, "NumberOfPoints", np.array([points * number], np.int64))
    for name in TOPOLOGIES:
        cells = number if name == kind else 0
        group = root.create_group(name)
        store(group, "NumberOfCells", np.array([cells], np.int64))
        store(group, "NumberOfConnectivityIds", np.array([points * cells], np.int64))
        store(group, "Connectivity", np.arange(points * cells, dtype=np.int64))
        store(group, "Offsets", points * np.arange(cells + 1, dtype=np.int64))


def append_points(root: h5py.Group, frame: Frame, growing: bool) -> tuple[Entries, int]:
    """The points of a frame of PolyData whose cells are the same in all frames: its entries so far, and the number of
    rows in a chunk."""
    points = frame.arrays["position"]
    chunk = min(max(len(points), 256), 65536)
    entries: Entries = {"Values": frame.time, "PartOffsets": 0, "NumberOfParts": 1}
    entries |= {"CellOffsets": [0] * len(TOPOLOGIES), "ConnectivityIdOffsets": [0] * len(TOPOLOGIES)}
    entries["PointOffsets"] = extend(root, "Points", points, growing, chunk)
    name_unit(root["Points"], "position")
    return entries, chunk
