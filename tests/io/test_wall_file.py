"""The meshes of a run as VTK and our own reader see them, at rest and moving, in 2-D and 3-D."""

from __future__ import annotations

import numpy as np
import pytest

from jaxdem.errors import InputError
from jaxdem.io.wall_file import WALLS, WallSurfaces, read_walls, write_walls


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("times", [[0.0], [0.0, 0.5, 1.0]])
def test_vtk_reads_the_meshes(tmp_path, dimension, times):
    vtk = pytest.importorskip("vtk")
    from vtk.util.numpy_support import vtk_to_numpy

    points = np.random.default_rng(1).uniform(size=(5, dimension))
    cells = np.array([[0, 1, 2], [2, 3, 4]])[:, :dimension]
    surfaces = WallSurfaces(points, cells, np.array([0, 3]))
    places = [points + k for k in range(len(times))]
    write_walls(tmp_path, surfaces, times, places)
    reader = vtk.vtkHDFReader()
    reader.SetFileName(str(tmp_path / WALLS))
    for k, time in enumerate(times):
        reader.UpdateInformation()
        if len(times) > 1:
            reader.GetOutputInformation(0).Set(vtk.vtkStreamingDemandDrivenPipeline.UPDATE_TIME_STEP(), time)
        reader.Update()
        data = reader.GetOutput()
        assert data.GetNumberOfCells() == 2
        assert vtk_to_numpy(data.GetPoints().GetData())[:, :dimension] == pytest.approx(places[k], rel=1e-6)
        assert vtk_to_numpy(data.GetCellData().GetArray("wall")).tolist() == [0, 3]
    back = read_walls(tmp_path)
    assert np.array_equal(back.points, points)
    assert np.array_equal(back.cells, cells)
    assert back.wall.tolist() == [0, 3]


def test_no_file_and_a_damaged_one(tmp_path):
    assert read_walls(tmp_path) is None
    (tmp_path / WALLS).write_bytes(b"no HDF5")
    with pytest.raises(InputError, match="cannot be read"):
        read_walls(tmp_path)
