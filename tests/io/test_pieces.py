"""Frames and checkpoints that several processes write: each has its own file, all of them read as one."""

from __future__ import annotations

import shutil
import threading

import numpy as np
import pytest
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOHDF import vtkHDFReader

from jaxdem.errors import InputError
from jaxdem.io import checkpoint
from jaxdem.io.access import LOCK
from jaxdem.io.fluid_file import FluidFormat, fluid_frame
from jaxdem.io.frames import FrameSeries
from jaxdem.io.outputs import refuse_run_folder, refuse_what_is_read
from jaxdem.io.particle_file import ParticleFormat, particle_frame
from jaxdem.io.pieces import PieceSeries, Share, SharedSeries, pieces_in, regroup, series_of
from jaxdem.io.run_folder import SCENE

NUMBER = 3


def particle_frames(steps):
    """Ten particles that do not divide among three processes, whose radius changes in the last frame."""
    random = np.random.default_rng(1)
    for step in range(steps):
        arrays = {"position": random.random((10, 3)), "velocity": random.random((10, 3)).astype(np.float32)}
        yield particle_frame(0.5 * step, arrays | {"radius": np.full(10, 1.0 + (step == steps - 1))})


def fluid_frames(steps, dimension):
    random = np.random.default_rng(2)
    cells = (7, 4, 3)[:dimension]
    for step in range(steps):
        arrays = {"pressure": random.random(cells), "velocity": random.random((*cells, dimension))}
        yield fluid_frame(0.5 * step, arrays, (0.1,) * dimension, 0.2)


def together(work):
    """`work(share)` by three processes, as threads."""
    barrier, errors = threading.Barrier(NUMBER, timeout=20), []

    def do(index):
        try:
            work(Share(index, NUMBER, barrier.wait))
        except BaseException as error:
            errors.append(error)
            barrier.abort()

    threads = [threading.Thread(target=do, args=(index,)) for index in range(NUMBER)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if errors:
        raise errors[0]


def written(folder, kind, frames):
    """By three processes, and by one beside it."""
    pieces, whole = folder / "pieces", folder / "whole"
    for place in (pieces, whole):
        place.mkdir(exist_ok=True)
    # One after the other, the first process last: it writes the master when all have their files.
    several = [SharedSeries(pieces, kind, Share(index, NUMBER, lambda: None)) for index in (1, 2, 0)]
    for series in several:
        for index, frame in enumerate(frames):
            series.write(index, frame)
    for series in several:
        series.join()
    alone = FrameSeries(whole, kind)
    for index, frame in enumerate(frames):
        alone.write(index, frame)
    alone.join()
    return pieces, whole


def as_vtk_reads(path, step):
    reader = vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    reader.SetStep(step)
    reader.Update()
    found = reader.GetOutput()
    data = found.GetPointData() if path.name.startswith("particles") else found.GetCellData()
    names = [data.GetArrayName(k) for k in range(data.GetNumberOfArrays())]
    arrays = {name: vtk_to_numpy(data.GetArray(name)).copy() for name in names}
    if path.name.startswith("particles"):
        arrays["points"] = vtk_to_numpy(found.GetPoints().GetData()).copy()
        arrays["vertices"] = np.array(found.GetNumberOfVerts())
    else:
        arrays["bounds"] = np.array(found.GetBounds())
    return arrays


@pytest.mark.parametrize("steps", [1, 3])
@pytest.mark.parametrize("kind", ["particles", "fluid 2", "fluid 3"])
def test_files_of_several_processes_are_read_as_the_file_of_one(tmp_path, kind, steps):
    kind, _, dimension = kind.partition(" ")
    if kind == "particles":
        frame_format, frames = ParticleFormat(), list(particle_frames(steps))
    else:
        frame_format, frames = FluidFormat(), list(fluid_frames(steps, int(dimension)))
    pieces, whole = written(tmp_path, frame_format, frames)
    read = series_of(pieces, frame_format)
    assert isinstance(read, PieceSeries) and read.count() == steps
    assert np.array_equal(read.times(), [frame.time for frame in frames])
    for index, frame in enumerate(frames):
        found = read.read(index)
        assert found.arrays.keys() == frame.arrays.keys()
        for name, array in frame.arrays.items():
            assert found.arrays[name].dtype == array.dtype and np.array_equal(found.arrays[name], array), name
    # A run directory may be moved, and is opened from elsewhere.
    moved = shutil.move(pieces, tmp_path / "moved")
    for step in range(steps):
        name = f"{frame_format.stem}.vtkhdf"
        one, several = as_vtk_reads(whole / name, step), as_vtk_reads(moved / name, step)
        assert one.keys() == several.keys() and len(one) > 2
        for array in one:
            assert np.array_equal(one[array], several[array]), array


def test_frames_go_over_to_another_number_of_processes(tmp_path):
    frames = list(particle_frames(2))
    folder, _ = written(tmp_path, ParticleFormat(), frames)
    for number in (2, 1, 4):
        regroup(folder, None if number == 1 else Share(0, number, lambda: None))
        assert pieces_in(folder) == (None if number == 1 else number)
        found = series_of(folder, ParticleFormat())
        for index, frame in enumerate(frames):
            assert np.array_equal(found.read(index).arrays["position"], frame.arrays["position"])


def test_files_of_two_runs_in_one_folder_are_refused(tmp_path):
    folder, _ = written(tmp_path, ParticleFormat(), list(particle_frames(1)))
    (folder / "particles.1-of-2.vtkhdf").write_bytes(b"")
    with pytest.raises(InputError, match="of 2 and of 3 processes"):
        series_of(folder, ParticleFormat())


def test_a_file_of_one_process_is_not_written_to(tmp_path):
    (tmp_path / SCENE).write_text("")
    (tmp_path / LOCK).write_text("")  # as results of earlier commands leave it
    refuse_what_is_read("--out", tmp_path / SCENE, [])  # a scene of that name
    refuse_run_folder("--out", tmp_path)
    (tmp_path / "history.csv").write_text("")
    for name in ("particles.2-of-4.vtkhdf", "start.h5", "walls.vtkhdf", "stages.toml"):
        (tmp_path / name).write_bytes(b"")
        with pytest.raises(InputError, match="is a file of a run"):
            refuse_what_is_read("--out", tmp_path / name, [])
    with pytest.raises(InputError, match="is a run directory"):
        refuse_run_folder("--out", tmp_path)
    refuse_what_is_read("--out", tmp_path / "closure.h5", [])


def test_a_checkpoint_of_several_processes_is_read_as_one(tmp_path):
    path = tmp_path / "checkpoint.h5"
    rows = np.arange(12.0).reshape(3, 4)

    def write(value):
        lock = threading.Lock()

        def work(share):
            blocks = {"state.x": rows[share.index : share.index + 1] + value}
            one_by_one = Share(share.index, share.number, lambda: (lock.release(), share.barrier(), lock.acquire()))
            with lock:
                checkpoint.write_shared_checkpoint(path, one_by_one, {"extra/done": np.array(value)}, blocks, {"a": 1})

        together(work)

    for value in (5, 6):
        write(value)
        arrays, attributes = checkpoint.read_checkpoint(path)
        assert attributes == {"a": 1} and int(arrays["extra/done"]) == value
        assert np.array_equal(arrays["state.x"], rows + value)
    assert len(list((tmp_path / checkpoint.PARTS).iterdir())) == NUMBER, "those of the first are deleted"
    one = sorted((tmp_path / checkpoint.PARTS).iterdir())[0]
    one.write_bytes(one.read_bytes()[:-100])
    with pytest.raises(InputError, match="checkpoint"):
        checkpoint.read_checkpoint(path)
    checkpoint.write_checkpoint(path, {"x": rows}, {})
    checkpoint.remove_old_parts(path)
    assert not (tmp_path / checkpoint.PARTS).exists()
