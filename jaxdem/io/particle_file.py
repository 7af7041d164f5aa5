"""Frames of particles: temporal PolyData, one vertex a particle."""

from __future__ import annotations

import h5py
import numpy as np

from jaxdem.io.frames import Arrays, Entries, Frame, extend
from jaxdem.io.vtkhdf import (
    ROOT,
    PolyDataFormat,
    append_points,
    name_unit,
    three_components,
    write_topology,
)

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
            array = three_components(array)
        stored[name] = array
    return Frame(float(time), stored, {"dimension": dimension})


def _out_of_plane(array: np.ndarray) -> np.ndarray:
    """Scalar angular velocity (N,) or (N, 1) as (0, 0, scalar); three components pass."""
    columns = array if array.ndim == 2 else array[:, None]
    return np.pad(columns, [(0, 0), (3 - columns.shape[1], 0)])


class ParticleFormat(PolyDataFormat):
    """Temporal PolyData: one vertex a particle, their number the same in all frames.

    The topology (which point is which vertex) and the arrays of `UNCHANGING` are then the same in all
    steps; they are stored once and the later steps carry the same offsets.
    """

    stem, data, points, content = "particles", "PointData", 1, "particles"

    def append(self, file: h5py.File, frame: Frame, growing: bool) -> Entries:
        position = frame.arrays["position"]
        names = set(frame.arrays) - {"position"}
        if ROOT not in file:
            self.head(file, "PolyData", frame, growing)
            write_topology(file[ROOT], "Vertices", self.points, len(position))
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


class SphereFormat(ParticleFormat):
    """Members of clumps, each as a particle whose `id` is that of its body."""

    stem = "spheres"


def _same_rows(point_data: h5py.Group, name: str, array: np.ndarray) -> int | None:
    """Row where the last stored `name` starts, if it may be shared and is the same as `array`."""
    if name not in UNCHANGING or name not in point_data:
        return None
    start = int(point_data[name].shape[0]) - len(array)
    stored = point_data[name][start:]
    return start if stored.dtype == array.dtype and np.array_equal(stored, array) else None
