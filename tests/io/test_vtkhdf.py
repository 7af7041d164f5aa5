"""Our files as the vtk package reads them: the judge is not our own reader."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
import vtk
from made_frames import fluid_arrays, particle_arrays, scene_of, time_of, write_frames
from vtk.util.numpy_support import vtk_to_numpy

from jaxdem.io import FluidFormat, FrameSeries, ParticleFormat, RunDirectory, fluid_frame, particle_frame

DEPTH = 0.02


def read_with_vtk(path, time=None):
    reader = vtk.vtkHDFReader()
    assert reader.CanReadFile(str(path))
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    information = reader.GetOutputInformation(0)
    times = information.Get(vtk.vtkStreamingDemandDrivenPipeline.TIME_STEPS())
    if time is None:
        reader.Update()
    else:
        reader.UpdateTimeStep(time)
    return times, reader.GetOutputDataObject(0)


def expected_vector(array: np.ndarray) -> np.ndarray:
    if array.ndim == 1:
        return np.stack([0 * array, 0 * array, array], axis=1)
    return np.pad(array, ((0, 0), (0, 3 - array.shape[1])))


@pytest.fixture(scope="module", params=[2, 3])
def finished(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "run"
    with RunDirectory.create(path, scene_of(request.param)) as run:
        write_frames(run, 0, 4, request.param)
        run.finish({"valid": True})
    return request.param, path


def test_particles_in_vtk(finished):
    dimension, path = finished
    for index in (0, 2, 3, 1):
        times, data = read_with_vtk(path / "particles.vtkhdf", time_of(index))
        assert list(times) == [time_of(frame) for frame in range(4)]
        given = particle_arrays(index, dimension)
        assert data.GetNumberOfVerts() == data.GetNumberOfCells() == 5
        np.testing.assert_array_equal(vtk_to_numpy(data.GetPoints().GetData()), expected_vector(given["position"]))
        point_data = data.GetPointData()
        for name in ("velocity", "angular_velocity", "drag_force", "contact_force"):
            stored = vtk_to_numpy(point_data.GetArray(name))
            np.testing.assert_array_equal(stored, expected_vector(given[name]), err_msg=name)
            assert stored.dtype == np.float32
        np.testing.assert_array_equal(vtk_to_numpy(point_data.GetArray("radius")), given["radius"])
        np.testing.assert_array_equal(vtk_to_numpy(point_data.GetArray("id")), given["id"])
        # Each vertex is its own point.
        vertices = [data.GetCell(cell).GetPointId(0) for cell in range(5)]
        assert vertices == [0, 1, 2, 3, 4]


def test_fluid_in_vtk(finished):
    dimension, path = finished
    for index in (0, 3, 1):
        times, image = read_with_vtk(path / "fluid.vtkhdf", time_of(index))
        assert list(times) == [time_of(frame) for frame in range(4)]
        given = fluid_arrays(index, dimension)
        cells = given["pressure"].shape
        assert image.GetNumberOfCells() == np.prod(cells)
        stored = {
            name: vtk_to_numpy(image.GetCellData().GetArray(name)) for name in ("velocity", "pressure", "void_fraction")
        }
        half = np.array([0.05, 0.05, 0.1][:dimension])
        for cell in np.ndindex(cells):
            # Found by place, not by number: the cell at the centre of ours must hold our values.
            centre = (2 * np.array(cell) + 1) * half
            centre = np.append(centre, 0.0) if dimension == 2 else centre
            found = image.FindCell(centre, None, 0, 1e-9, vtk.reference(0), [0.0] * 3, [0.0] * 8)
            bounds = image.GetCell(found).GetBounds()
            np.testing.assert_allclose(np.mean(np.reshape(bounds, (3, 2)), axis=1), centre, atol=1e-12)
            assert stored["pressure"][found] == given["pressure"][cell]
            assert stored["void_fraction"][found] == given["void_fraction"][cell]
            np.testing.assert_array_equal(stored["velocity"][found][:dimension], given["velocity"][cell])
            assert stored["velocity"].shape[1] == 3
        depth = DEPTH if dimension == 2 else 0.4
        assert np.isclose(np.ptp(image.GetBounds()[4:]), depth)


PARTICLE_ARRAYS = {"velocity", "angular_velocity", "drag_force", "contact_force", "radius", "id"}
FLUID_ARRAYS = {"velocity", "pressure", "void_fraction"}


def names_of(data):
    return {data.GetArrayName(number) for number in range(data.GetNumberOfArrays())}


def test_names_components_and_units_are_the_contracts(finished):
    """What a reader of the files may rely on, and nothing unnamed beside it."""
    _, path = finished
    _, particles = read_with_vtk(path / "particles.vtkhdf", time_of(1))
    _, image = read_with_vtk(path / "fluid.vtkhdf", time_of(1))
    assert names_of(particles.GetPointData()) == PARTICLE_ARRAYS and names_of(image.GetCellData()) == FLUID_ARRAYS
    assert not names_of(particles.GetCellData()) and not names_of(image.GetPointData())
    scalars = {"radius", "id", "pressure", "void_fraction"}
    for data in (particles.GetPointData(), image.GetCellData()):
        for name in names_of(data):
            assert data.GetArray(name).GetNumberOfComponents() == (1 if name in scalars else 3), name
    units = {"velocity": "m/s", "angular_velocity": "rad/s", "drag_force": "N", "contact_force": "N"}
    units |= {"radius": "m", "id": "1", "pressure": "Pa", "void_fraction": "1"}
    for file_name, group in (("particles", "PointData"), ("fluid", "CellData")):
        with h5py.File(path / f"{file_name}.vtkhdf") as file:
            stored = {name: dataset.attrs["units"] for name, dataset in file[f"VTKHDF/{group}"].items()}
            assert stored == {name: units[name] for name in stored} and stored
            assert file["VTKHDF/Steps/Values"].attrs["units"] == "s"
            assert file_name == "fluid" or file["VTKHDF/Points"].attrs["units"] == "m"


@pytest.mark.parametrize("present", ["particles", "fluid"])
def test_a_scene_without_the_other_part_has_one_file(tmp_path, present):
    with RunDirectory.create(tmp_path / "run", scene_of(2)) as run:
        for index in range(2):
            arrays = particle_arrays if present == "particles" else fluid_arrays
            run.write_frame(index, time_of(index), {present: arrays(index, 2)}, {})
        run.finish({})
    assert [path.stem for path in (tmp_path / "run").glob("*.vtkhdf")] == [present]
    times, data = read_with_vtk(tmp_path / "run" / f"{present}.vtkhdf", time_of(1))
    assert list(times) == [time_of(0), time_of(1)]
    names = names_of(data.GetPointData() if present == "particles" else data.GetCellData())
    assert names == (PARTICLE_ARRAYS if present == "particles" else FLUID_ARRAYS)


def test_a_part_is_a_valid_file_by_itself(tmp_path):
    with RunDirectory.create(tmp_path / "run", scene_of(2)) as run:
        write_frames(run, 0, 2)
    times, data = read_with_vtk(tmp_path / "run/.frames/particles.000001.vtkhdf")
    assert times is None
    position = expected_vector(particle_arrays(1, 2)["position"])
    np.testing.assert_array_equal(vtk_to_numpy(data.GetPoints().GetData()), position)
    times, image = read_with_vtk(tmp_path / "run/.frames/fluid.000001.vtkhdf")
    assert times is None
    assert vtk_to_numpy(image.GetCellData().GetArray("pressure")).min() == 1000


def test_a_run_of_one_frame(tmp_path):
    with RunDirectory.create(tmp_path / "run", scene_of(3)) as run:
        write_frames(run, 0, 1, 3)
        run.finish({})
    _, data = read_with_vtk(tmp_path / "run/particles.vtkhdf")
    position = particle_arrays(0, 3)["position"]
    np.testing.assert_array_equal(vtk_to_numpy(data.GetPoints().GetData()), position)
    _, image = read_with_vtk(tmp_path / "run/fluid.vtkhdf")
    pressure = fluid_arrays(0, 3)["pressure"]
    stored = vtk_to_numpy(image.GetCellData().GetArray("pressure"))
    np.testing.assert_array_equal(stored, pressure.transpose(2, 1, 0).ravel())


def test_no_particles_at_all(tmp_path):
    series = FrameSeries(tmp_path, ParticleFormat())
    for index in range(2):
        series.write(index, particle_frame(time_of(index), particle_arrays(index, 3, number=0)))
    series.join()
    times, data = read_with_vtk(series.joined, time_of(1))
    assert times == (time_of(0), time_of(1))
    assert data.GetNumberOfPoints() == data.GetNumberOfCells() == 0
    assert series.read(1).arrays["velocity"].shape == (0, 3)


@pytest.mark.parametrize("odd", [{"number": 4}, {"more": "torque"}])
def test_frames_that_do_not_fit_each_other_are_refused_and_kept(tmp_path, odd):
    series = FrameSeries(tmp_path, ParticleFormat())
    later = particle_arrays(1, 3, number=odd.get("number", 5))
    if "more" in odd:
        later[odd["more"]] = later["velocity"]
    series.write(0, particle_frame(0.0, particle_arrays(0, 3)))
    with pytest.raises(ValueError, match="after frames of"):
        series.write(1, particle_frame(1.0, later))
    assert series.count() == 1
    # Another process, resuming, has not seen the first.
    FrameSeries(tmp_path, ParticleFormat()).write(1, particle_frame(1.0, later))
    with pytest.raises(ValueError, match="after frames of"):
        series.join()
    assert not series.joined.exists() and series.count() == 2
    assert not list(tmp_path.glob(".*.tmp"))


def test_what_does_not_change_is_stored_once_and_a_change_is_kept(tmp_path):
    series = FrameSeries(tmp_path, ParticleFormat())
    frames = [particle_arrays(index, 3) for index in range(3)]
    frames[2]["radius"] = frames[2]["radius"] * 2
    for index, arrays in enumerate(frames):
        series.write(index, particle_frame(index, arrays))
    series.join()
    with h5py.File(series.joined) as file:
        point_data = file["VTKHDF/PointData"]
        assert point_data["id"].shape == (5,)
        assert point_data["radius"].shape == (10,)
        assert point_data["velocity"].shape == (15, 3)
        assert file["VTKHDF/Vertices/Connectivity"].shape == (5,)
    for index, arrays in enumerate(frames):
        _, data = read_with_vtk(series.joined, float(index))
        radius = vtk_to_numpy(data.GetPointData().GetArray("radius"))
        np.testing.assert_array_equal(radius, arrays["radius"])


def test_float64_is_kept(tmp_path):
    particles, fluid = FrameSeries(tmp_path, ParticleFormat()), FrameSeries(tmp_path, FluidFormat())
    particles.write(0, particle_frame(0.0, particle_arrays(0, 2, dtype=np.float64)))
    fluid.write(0, fluid_frame(0.0, fluid_arrays(0, 2, np.float64), (0.1, 0.1), 0.1))
    _, data = read_with_vtk(particles.part(0))
    points = vtk_to_numpy(data.GetPoints().GetData())
    assert points.dtype == np.float64
    np.testing.assert_array_equal(points[:, :2], particle_arrays(0, 2, dtype=np.float64)["position"])
    _, image = read_with_vtk(fluid.part(0))
    assert vtk_to_numpy(image.GetCellData().GetArray("velocity")).dtype == np.float64


def test_without_ids_row_i_is_particle_i():
    arrays = {"position": np.zeros((4, 2))}
    frame = particle_frame(0.0, arrays)
    assert frame.arrays["id"].tolist() == [0, 1, 2, 3] and frame.arrays["id"].dtype == np.int64


@pytest.mark.parametrize(
    "arrays",
    [
        {"position": np.zeros((4, 1))},
        {"position": np.zeros(4)},
        {"position": np.zeros((4, 3)), "radius": np.zeros(3)},
    ],
)
def test_particle_shapes_are_checked(arrays):
    with pytest.raises(ValueError, match="shape"):
        particle_frame(0.0, arrays)


def test_fluid_shapes_are_checked():
    arrays = fluid_arrays(0, 3)
    with pytest.raises(ValueError, match="void_fraction has shape"):
        fluid_frame(0.0, {**arrays, "void_fraction": arrays["void_fraction"].T}, (1, 1, 1), 1)
    with pytest.raises(ValueError, match="cell sizes"):
        fluid_frame(0.0, arrays, (1, 1), 1)
