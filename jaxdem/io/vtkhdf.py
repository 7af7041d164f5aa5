"""VTKHDF 2.0 frames that open in ParaView: particles as temporal PolyData, the fluid as ImageData.

Coordinates are VTK's: three components. A 2-D scene (x, z) is stored as (x, z, 0); its scalar angular
velocity, about the axis out of the plane, is the third component. Layout after the "VTKHDF format
specification" (docs.vtk.org, vtk_file_formats/vtkhdf_file_format).
"""

from __future__ import annotations

from collections.abc import Sequence

import h5py
import numpy as np

from jaxdem.files.hdf5 import store
from jaxdem.io.frames import Arrays, Entries, Frame, extend

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

UNCHANGING = ("id", "radius")
"""Point data stored once while it stays the same; later steps point at the same rows."""


def particle_frame(time: float, arrays: Arrays) -> Frame:
    """Particle arrays as VTK wants them.

    Args:
        time: simulated time [s].
        arrays: `position` (N, D) [m]; any of `velocity` (N, D) [m/s], `angular_velocity` (N, 3), in 2-D
            (N,) or (N, 1) [rad/s], `drag_force`, `contact_force` (N, D) [N], `radius` (N,) [m], `id` (N,);
            others as (N,) or (N, D). Without `id`, row i is particle i.

    Returns:
        A frame with vectors (N, 3); dtypes as given, `id` int64.

    Raises:
        ValueError: an array does not have N rows, or D is neither 2 nor 3.
    """
    position = np.asarray(arrays["position"])
    if position.ndim != 2 or position.shape[1] not in (2, 3):
        raise ValueError(f"position has shape {position.shape}, expected (N, 2) or (N, 3)")
    number, dimension = position.shape
    stored: dict[str, np.ndarray] = {}
    for name, given in {"id": np.arange(number), **arrays}.items():
        array = np.asarray(given)
        if array.shape[:1] != (number,):
            raise ValueError(f"{name} has shape {array.shape}, expected {number} rows")
        if name == "id":
            array = array.astype(np.int64)
        elif name == "angular_velocity" and dimension == 2:
            array = _out_of_plane(array)
        elif array.ndim == 2 and array.shape[1] == 2:
            array = _three_components(array)
        stored[name] = array
    return Frame(float(time), stored, {"dimension": dimension})


def fluid_frame(time: float, arrays: Arrays, spacing: Sequence[float], depth: float) -> Frame:
    """Cell arrays of the fluid with the geometry of the grid; the corner of the domain is the origin.

    Args:
        time: simulated time [s].
        arrays: `velocity` cells + (D,) [m/s], `pressure` cells [Pa], `void_fraction` cells, indexed
            [ix, iy] or [ix, iy, iz].
        spacing: size (D,) of a cell [m].
        depth: thickness [m] of the one layer of cells of a 2-D scene, centred on the plane of the
            particles; not used in 3-D.

    Raises:
        ValueError: the arrays are not on the same cells, or these are neither 2-D nor 3-D.
    """
    cells = np.asarray(arrays["pressure"]).shape
    dimension = len(cells)
    if dimension not in (2, 3) or len(spacing) != dimension:
        raise ValueError(f"pressure has shape {cells} with {len(spacing)} cell sizes, expected 2 or 3 of both")
    stored: dict[str, np.ndarray] = {}
    for name, given in arrays.items():
        array = np.asarray(given)
        if array.shape[:dimension] != cells or array.ndim > dimension + 1:
            raise ValueError(f"{name} has shape {array.shape}, expected cells {cells} first")
        vector = array.ndim == dimension + 1 and array.shape[-1] == 2
        stored[name] = _three_components(array) if vector else array
    origin, size = [0.0, 0.0, 0.0], [float(length) for length in spacing]
    if dimension == 2:
        origin, size = [0.0, 0.0, -0.5 * float(depth)], [*size, float(depth)]
    geometry = {"dimension": dimension, "origin": np.array(origin), "spacing": np.array(size)}
    return Frame(float(time), stored, geometry)


def _three_components(array: np.ndarray) -> np.ndarray:
    """(x, z) as (x, z, 0) along the last axis."""
    return np.pad(array, [(0, 0)] * (array.ndim - 1) + [(0, 1)])


def _out_of_plane(array: np.ndarray) -> np.ndarray:
    """Scalar angular velocity (N,) or (N, 1) as (0, 0, scalar); three components pass."""
    columns = array if array.ndim == 2 else array[:, None]
    return np.pad(columns, [(0, 0), (3 - columns.shape[1], 0)])


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


class ParticleFormat(StepFormat):
    """Temporal PolyData: one vertex a particle, their number the same in all frames.

    The topology (which point is which vertex) and the arrays of `UNCHANGING` are then the same in all
    steps; they are stored once and the later steps carry the same offsets.
    """

    stem = "particles"

    def append(self, file: h5py.File, frame: Frame, growing: bool) -> Entries:
        position = frame.arrays["position"]
        names = set(frame.arrays) - {"position"}
        if ROOT not in file:
            self.head(file, "PolyData", frame, growing)
            write_topology(file[ROOT], "Vertices", 1, len(position))
        root = file[ROOT]
        if root["NumberOfPoints"][0] != len(position):
            raise ValueError(f"{len(position)} particles after frames of {root['NumberOfPoints'][0]}")
        if "PointData" in root and set(root["PointData"]) != names:
            raise ValueError(f"particle arrays {sorted(names)} after frames of {sorted(root['PointData'])}")
        entries, chunk = append_points(root, frame, growing)
        point_data = root.require_group("PointData")
        for name in sorted(names):
            start = _same_rows(point_data, name, frame.arrays[name])
            if start is None:
                start = extend(point_data, name, frame.arrays[name], growing, chunk)
            entries[f"PointDataOffsets/{name}"] = start
            name_unit(point_data[name], name)
        return entries

    def read(self, file: h5py.File, index: int) -> Frame:
        root = file[ROOT]
        number = int(root["NumberOfPoints"][0])
        start = self.entry(file, "PointOffsets", index)
        arrays = {"position": root["Points"][start : start + number]}
        for name, dataset in root["PointData"].items():
            start = self.entry(file, f"PointDataOffsets/{name}", index)
            arrays[name] = dataset[start : start + number]
        for name, array in arrays.items():
            if len(array) != number or array.dtype.kind not in NUMBERS:
                raise ValueError(f"{name} holds {array.dtype} of shape {array.shape} for {number} particles")
        return Frame(float(self.times(file)[index]), arrays, {"dimension": dimension_of(file)})


class SphereFormat(ParticleFormat):
    """Members of clumps, each as a particle whose `id` is that of its body."""

    stem = "spheres"


class FluidFormat(StepFormat):
    """Temporal ImageData with cell data of shape (T, nz, ny, nx[, 3]) (one frame: without T): x fastest."""

    stem = "fluid"

    def append(self, file: h5py.File, frame: Frame, growing: bool) -> Entries:
        dimension = frame.attributes["dimension"]
        if ROOT not in file:
            self.head(file, "ImageData", frame, growing)
            self._geometry(file[ROOT], frame)
        root = file[ROOT]
        if "CellData" in root and set(root["CellData"]) != set(frame.arrays):
            raise ValueError(f"fluid arrays {sorted(frame.arrays)} after frames of {sorted(root['CellData'])}")
        cell_data = root.require_group("CellData")
        entries: Entries = {"Values": frame.time}
        for name, array in sorted(frame.arrays.items()):
            turned = _x_fastest(array, dimension)
            start = extend(cell_data, name, turned[None] if growing else turned, growing, 1)
            entries[f"CellDataOffsets/{name}"] = start
            name_unit(cell_data[name], name)
        return entries

    @staticmethod
    def _geometry(root: h5py.Group, frame: Frame) -> None:
        cells = frame.arrays["pressure"].shape
        cells = (*cells, 1) if len(cells) == 2 else cells
        root.attrs["WholeExtent"] = np.array([0, cells[0], 0, cells[1], 0, cells[2]], np.int32)
        root.attrs["Origin"] = frame.attributes["origin"]
        root.attrs["Spacing"] = frame.attributes["spacing"]
        root.attrs["Direction"] = np.eye(3).ravel()

    def read(self, file: h5py.File, index: int) -> Frame:
        root = file[ROOT]
        dimension, arrays = dimension_of(file), {}
        for name, dataset in root["CellData"].items():
            row = self.entry(file, f"CellDataOffsets/{name}", index)
            arrays[name] = _x_first(dataset[row] if "Steps" in root else dataset[...], dimension)
        cells = arrays["pressure"].shape
        for name, array in arrays.items():
            if len(cells) != dimension or array.shape[:dimension] != cells or array.dtype.kind not in NUMBERS:
                raise ValueError(f"{name} holds {array.dtype} of shape {array.shape} for cells {cells}")
        geometry = {"dimension": dimension, "origin": root.attrs["Origin"], "spacing": root.attrs["Spacing"]}
        return Frame(float(self.times(file)[index]), arrays, geometry)


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


def _same_rows(point_data: h5py.Group, name: str, array: np.ndarray) -> int | None:
    """Row where the last stored `name` starts, if it may be shared and is the same as `array`."""
    if name not in UNCHANGING or name not in point_data:
        return None
    start = int(point_data[name].shape[0]) - len(array)
    stored = point_data[name][start:]
    return start if stored.dtype == array.dtype and np.array_equal(stored, array) else None


def _x_fastest(array: np.ndarray, dimension: int) -> np.ndarray:
    """[ix, iy(, iz)(, component)] to [iz, iy, ix(, component)]; in 2-D with a single layer iz."""
    turned = array.swapaxes(0, dimension - 1)
    return turned[None] if dimension == 2 else turned


def _x_first(array: np.ndarray, dimension: int) -> np.ndarray:
    """The inverse of `_x_fastest`."""
    layer = array[0] if dimension == 2 else array
    return np.ascontiguousarray(layer.swapaxes(0, dimension - 1))
