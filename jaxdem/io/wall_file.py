"""The walls of a run that are meshes, for ParaView and for pictures: `walls.vtkhdf`, PolyData of VTKHDF.

Triangles, in 2-D lines with a third coordinate of zero; cell data `wall`, the number of the table in `[[walls]]`. With
several times it is temporal: the points of each time one after the other, the cells and `wall` once. At the end of a
run with wear also `wear_volume` [m3] and, in 3-D, `wear_depth` [m].
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np

from jaxdem.errors import InputError
from jaxdem.files.durable import aside
from jaxdem.files.hdf5 import store
from jaxdem.io.vtkhdf import ROOT, TOPOLOGIES, VERSION

WALLS = "walls.vtkhdf"
"""Name of the file in a run directory."""


class WallSurfaces(NamedTuple):
    """Meshes of a run, together.

    Attributes:
        points: (V, D) corners where the scene puts them, before any motion [m].
        cells: (F, D) numbers of the corners of each triangle or line.
        wall: (F,) number of the table in `[[walls]]`.
    """

    points: np.ndarray
    cells: np.ndarray
    wall: np.ndarray


def write_walls(folder: Path, surfaces: WallSurfaces, times: Sequence[float], places: Sequence[np.ndarray]) -> None:
    """Write the file.

    Args:
        folder: run directory.
        surfaces: the meshes.
        times: T of them, increasing; one for walls at rest [s].
        places: (V, D) corners at each time [m].
    """

    with aside(folder / WALLS) as temporary, h5py.File(temporary, "w") as file:
        _fill(file, surfaces, times, places)


def _fill(file: h5py.File, surfaces: WallSurfaces, times: Sequence[float], places: Sequence[np.ndarray]) -> None:
    count, dimension = surfaces.points.shape
    file.attrs["dimension"] = dimension
    store(file, "points", np.asarray(surfaces.points, np.float64))
    root = file.create_group(ROOT)
    root.attrs["Version"] = np.array(VERSION, np.int64)
    root.attrs.create("Type", np.bytes_("PolyData"), dtype=h5py.string_dtype("ascii", len("PolyData")))
    store(root, "NumberOfPoints", np.full(len(times), count, np.int64))
    flat = [np.pad(np.asarray(place, np.float32), ((0, 0), (0, 3 - dimension))) for place in places]
    store(root, "Points", np.concatenate(flat))
    root["Points"].attrs["units"] = "m"
    own = "Lines" if dimension == 2 else "Polygons"
    cells = len(surfaces.cells)
    for name in TOPOLOGIES:
        there = name == own
        group = root.create_group(name)
        store(group, "NumberOfCells", np.array([cells if there else 0], np.int64))
        store(group, "NumberOfConnectivityIds", np.array([surfaces.cells.size if there else 0], np.int64))
        store(group, "Connectivity", surfaces.cells.ravel().astype(np.int64) if there else np.zeros(0, np.int64))
        store(group, "Offsets", dimension * np.arange(cells + 1 if there else 1, dtype=np.int64))
    data = root.create_group("CellData")
    store(data, "wall", surfaces.wall.astype(np.int64))
    if len(times) < 2:
        file.attrs["time"] = float(times[0])
        return
    steps = root.create_group("Steps")
    steps.attrs["NSteps"] = len(times)
    nothing = np.zeros(len(times), np.int64)
    store(steps, "Values", np.asarray(times, np.float64))
    store(steps, "PartOffsets", nothing)
    store(steps, "NumberOfParts", nothing + 1)
    store(steps, "PointOffsets", count * np.arange(len(times), dtype=np.int64))
    store(steps, "CellOffsets", np.zeros((len(times), len(TOPOLOGIES)), np.int64))
    store(steps, "ConnectivityIdOffsets", np.zeros((len(times), len(TOPOLOGIES)), np.int64))
    store(steps.create_group("CellDataOffsets"), "wall", nothing)


def add_cell_data(folder: Path, arrays: Mapping[str, tuple[np.ndarray, str]]) -> None:
    """Put values of every cell, the same at all times, into the file of a run; they replace those of the same name.

    Args:
        folder: run directory.
        arrays: (F,) and their unit, by name.
    """
    with aside(folder / WALLS) as temporary:
        shutil.copyfile(folder / WALLS, temporary)
        with h5py.File(temporary, "r+") as file:
            root = file[ROOT]
            for name, (values, unit) in arrays.items():
                if name in root["CellData"]:
                    del root["CellData"][name]
                store(root["CellData"], name, np.asarray(values, np.float64))
                root["CellData"][name].attrs["units"] = unit
                if "Steps" in root and name not in root["Steps/CellDataOffsets"]:
                    steps = int(root["Steps"].attrs["NSteps"])
                    store(root["Steps/CellDataOffsets"], name, np.zeros(steps, np.int64))


def read_walls(folder: str | Path) -> WallSurfaces | None:
    """The meshes of a run; None where it has none.

    Raises:
        InputError: the file is damaged.
    """
    path = Path(folder) / WALLS
    if not path.is_file():
        return None
    try:
        with h5py.File(path, "r") as file:
            points = file["points"][...]
            own = file[ROOT]["Lines" if points.shape[1] == 2 else "Polygons"]
            cells = own["Connectivity"][...].reshape(-1, points.shape[1])
            return WallSurfaces(points, cells, file[ROOT]["CellData/wall"][...])
    except (OSError, KeyError, ValueError, IndexError) as error:
        raise InputError(WALLS, str(path), f"cannot be read ({error})", "run the scene again") from error
