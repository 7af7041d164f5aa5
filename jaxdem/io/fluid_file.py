"""Frames of the fluid: temporal ImageData."""

from __future__ import annotations

from collections.abc import Sequence

import h5py
import numpy as np

from jaxdem.io.frames import Arrays, Entries, Frame, extend
from jaxdem.io.vtkhdf import NUMBERS, ROOT, StepFormat, dimension_of, name_unit, three_components


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
        stored[name] = three_components(array) if vector else array
    origin, size = [0.0, 0.0, 0.0], [float(length) for length in spacing]
    if dimension == 2:
        origin, size = [0.0, 0.0, -0.5 * float(depth)], [*size, float(depth)]
    geometry = {"dimension": dimension, "origin": np.array(origin), "spacing": np.array(size)}
    return Frame(float(time), stored, geometry)


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


def _x_fastest(array: np.ndarray, dimension: int) -> np.ndarray:
    """[ix, iy(, iz)(, component)] to [iz, iy, ix(, component)]; in 2-D with a single layer iz."""
    turned = array.swapaxes(0, dimension - 1)
    return turned[None] if dimension == 2 else turned


def _x_first(array: np.ndarray, dimension: int) -> np.ndarray:
    """The inverse of `_x_fastest`."""
    layer = array[0] if dimension == 2 else array
    return np.ascontiguousarray(layer.swapaxes(0, dimension - 1))
