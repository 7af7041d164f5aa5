"""Creating, locking, resuming, cutting back, joining; the reader `load_run` beside the writer."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from made_frames import (
    SCENE_2D,
    fluid_arrays,
    particle_arrays,
    row,
    sample_arrays,
    scene_of,
    time_of,
    write_frames,
)

import jaxdem.io
from jaxdem.errors import InputError, RunError
from jaxdem.files.durable import write_bytes
from jaxdem.files.stored import write_whole
from jaxdem.io import FluidFormat, FrameSeries, ParticleFormat, RunDirectory, SampleFormat, load_run, run_folder
from jaxdem.io.access import acquire_lock


def check_frames(path, number: int, dimension: int = 2, fluid: bool = True) -> None:
    """All `number` frames and samples of the run are there, with the values they were given."""
    run = load_run(path)
    assert run.number_of_frames == number and run.dimension == dimension
    assert run.times.tolist() == [time_of(index) for index in range(number)]
    for index in range(number):
        given = particle_arrays(index, dimension)
        read = run.particles(index)
        np.testing.assert_array_equal(read["position"][:, :dimension], given["position"])
        np.testing.assert_array_equal(read["velocity"][:, :dimension], given["velocity"])
        spin = read["angular_velocity"][:, 2] if dimension == 2 else read["angular_velocity"]
        np.testing.assert_array_equal(spin, given["angular_velocity"])
        np.testing.assert_array_equal(read["id"], given["id"])
        assert run.history["drag_force_mean"][index] == row(index)["drag_force_mean"]
        if fluid:
            given, read = fluid_arrays(index, dimension), run.fluid(index)
            np.testing.assert_array_equal(read["pressure"], given["pressure"])
            np.testing.assert_array_equal(read["void_fraction"], given["void_fraction"])
            np.testing.assert_array_equal(read["velocity"][..., :dimension], given["velocity"])
            assert read["velocity"].shape == (*given["pressure"].shape, 3)
        sample = run.samples.frame(index)
        np.testing.assert_array_equal(sample["slip_velocity"], sample_arrays(index)["slip_velocity"])


def write_closure_bytes(path, content):
    write_whole(path, content, "closure.file")


def names(path) -> set[str]:
    return {entry.name for entry in Path(path).iterdir()}


def new_run(path, frames: int, checkpoint: int, end: str = "") -> None:
    """A run of `frames` frames whose checkpoint follows the first `checkpoint` of them."""
    with RunDirectory.create(path, SCENE_2D) as run:
        write_frames(run, 0, checkpoint)
        run.write_checkpoint({"step": np.array(checkpoint)}, {"frames": checkpoint, "samples": checkpoint})
        write_frames(run, checkpoint, frames)
        if end:
            getattr(run, end)({"valid": True})


def resume_to(path, last: int) -> None:
    with RunDirectory.resume(path, SCENE_2D) as run:
        arrays, attributes = run.checkpoint()
        assert int(arrays["step"]) == attributes["frames"]
        run.cut_back(attributes["frames"], attributes["samples"])
        assert run.frames == run.samples == attributes["frames"]
        write_frames(run, attributes["frames"], last)
        run.finish({"valid": True})


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("joined", [True, False])
def test_a_run_reads_back(tmp_path, dimension, joined):
    with RunDirectory.create(tmp_path / "a/b/run", scene_of(dimension)) as run:
        write_frames(run, 0, 4, dimension)
        if joined:
            run.finish({"valid": True, "wall_time_s": np.float32(1.5), "rate": np.nan, "counts": np.arange(2)})
    path = tmp_path / "a/b/run"
    check_frames(path, 4, dimension)
    run = load_run(path)
    assert run.scene_toml == scene_of(dimension) and run.scene["seed"] == 1
    assert run.cells == (4, 3, 2)[:dimension]
    np.testing.assert_allclose(run.spacing, (0.1, 0.1, 0.2)[:dimension])
    np.testing.assert_array_equal(run.particles(-1)["id"], run.particles(3)["id"])
    with pytest.raises(IndexError):
        run.particles(4)
    if joined:
        expected = {"complete": True, "valid": True, "wall_time_s": 1.5, "rate": None, "counts": [0, 1]}
        assert run.summary == expected
        files = {
            "scene.toml",
            "particles.vtkhdf",
            "fluid.vtkhdf",
            "samples.h5",
            "history.csv",
            "summary.json",
        }
        assert names(path) == files | {".lock"}
    else:
        assert run.summary == {}


def test_without_fluid_or_particles_there_are_no_such_files(tmp_path):
    with RunDirectory.create(tmp_path / "dry", SCENE_2D) as run:
        write_frames(run, 0, 2, fluid=False)
        run.finish({})
    assert "fluid.vtkhdf" not in names(tmp_path / "dry")
    check_frames(tmp_path / "dry", 2, fluid=False)
    assert load_run(tmp_path / "dry").fluid(0) is None
    with RunDirectory.create(tmp_path / "wet", SCENE_2D) as run:
        run.write_frame(0, 0.0, {"fluid": fluid_arrays(0, 2)}, {"fluid_velocity_mean": 1.0})
        run.finish({})
    run = load_run(tmp_path / "wet")
    assert run.particles(0) == {} and run.samples is None and run.number_of_frames == 1
    assert "particles.vtkhdf" not in names(tmp_path / "wet") and "samples.h5" not in names(tmp_path / "wet")


@pytest.mark.parametrize("end", ["", "interrupt", "finish"])
@pytest.mark.parametrize("checkpoint", [0, 2, 3])
def test_resume_cuts_back_and_goes_on(tmp_path, end, checkpoint):
    path = tmp_path / "run"
    new_run(path, 3, checkpoint, end)
    with RunDirectory.resume(path, SCENE_2D) as run:
        run.cut_back(checkpoint, checkpoint)
        assert not (path / "summary.json").exists()
    for kind in (ParticleFormat(), FluidFormat(), SampleFormat()):
        assert FrameSeries(path, kind).count() == checkpoint
    check_frames(path, checkpoint)
    resume_to(path, 5)
    check_frames(path, 5)
    assert run_folder.is_complete(path) and ".frames" not in names(path)
    with h5py.File(path / "particles.vtkhdf") as file:
        assert file["VTKHDF/Steps/Values"].shape == (5,)


def test_complete_means_valid_and_complete(tmp_path):
    assert not run_folder.is_complete(tmp_path)
    for name, end, summary, expected in (
        ("a", "finish", {"valid": True}, True),
        ("b", "finish", {"valid": False}, False),
        ("c", "interrupt", {"valid": True}, False),
    ):
        with RunDirectory.create(tmp_path / name, SCENE_2D) as run:
            write_frames(run, 0, 1)
            getattr(run, end)(summary)
        assert run_folder.is_complete(tmp_path / name) is expected
    (tmp_path / "a/summary.json").write_text("{")
    assert not run_folder.is_complete(tmp_path / "a")


def test_create_refuses_a_folder_in_use_for_something(tmp_path):
    new_run(tmp_path / "run", 1, 1)
    with pytest.raises(InputError, match="--resume to continue") as caught:
        RunDirectory.create(tmp_path / "run", SCENE_2D)
    assert caught.value.key == "--out"
    (tmp_path / "other").mkdir()
    (tmp_path / "other/notes.txt").write_text("mine")
    with pytest.raises(InputError, match="is not empty"):
        RunDirectory.create(tmp_path / "other", SCENE_2D)
    assert names(tmp_path / "other") == {"notes.txt"}
    for path in (tmp_path / "other/notes.txt", tmp_path / "other/notes.txt/run"):
        with pytest.raises(InputError, match="cannot be written"):
            RunDirectory.create(path, SCENE_2D)
    (tmp_path / "empty").mkdir()
    RunDirectory.create(tmp_path / "empty", SCENE_2D).close()
    assert load_run(tmp_path / "empty").number_of_frames == 0


def test_resume_needs_a_checkpoint_and_the_same_scene(tmp_path):
    with RunDirectory.create(tmp_path / "run", SCENE_2D) as run:
        write_frames(run, 0, 1)
    with pytest.raises(InputError, match=r"checkpoint\.h5"):
        RunDirectory.resume(tmp_path / "run", SCENE_2D)
    with pytest.raises(InputError, match=r"checkpoint\.h5"):
        RunDirectory.resume(tmp_path / "absent", SCENE_2D)
    new_run(tmp_path / "other", 1, 1)
    changed = {
        "domain.depth": (SCENE_2D.replace("0.02", "0.03"), 0.03),
        "fluid.cells": (SCENE_2D.replace("[4, 3]", "[4, 4]"), [4, 4]),
        "seed": (SCENE_2D.replace("seed = 1", "seed = 1.0"), 1.0),
        "time.end": (SCENE_2D + "[time]\nend = 2.0\n", 2.0),
    }
    for key, (scene, value) in changed.items():
        with pytest.raises(InputError) as caught:
            RunDirectory.resume(tmp_path / "other", scene)
        assert (caught.value.key, caught.value.value) == (key, value)
    same = "# a remark\n" + SCENE_2D.replace("size = [0.4, 0.3]", "size = [0.40, 0.3]")
    RunDirectory.resume(tmp_path / "other", same).close()


def test_two_runs_cannot_share_a_folder(tmp_path):
    path = tmp_path / "run"
    with RunDirectory.create(path, SCENE_2D) as run:
        write_frames(run, 0, 1)
        run.write_checkpoint({}, {"frames": 1, "samples": 1})
        with pytest.raises(InputError, match="another run"):
            RunDirectory.resume(path, SCENE_2D)
        code = (
            "from jaxdem.io import RunDirectory; from jaxdem.errors import InputError; import sys\n"
            "try: RunDirectory.resume(sys.argv[1], sys.argv[2])\n"
            "except InputError as error: print(error)"
        )
        command = [sys.executable, "-c", code, path, SCENE_2D]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert "another run (process" in done.stdout, done.stderr
    RunDirectory.resume(path, SCENE_2D).close()


def test_a_run_writes_to_the_folder_that_it_locked_only(tmp_path):
    """Moved away, with another run in its place: the lock is held by identity, not by name."""
    path, moved = tmp_path / "run", tmp_path / "moved"
    with RunDirectory.create(path, SCENE_2D) as run:
        run.write_checkpoint({}, {"frames": 0, "samples": 0})
        path.rename(moved)
        with RunDirectory.create(path, SCENE_2D):
            before, old = names(path), names(moved)
            for write in (
                lambda: run.write_checkpoint({}, {"frames": 0, "samples": 0}),
                lambda: run.write_frame(0, 0.0, {}, {}),
                lambda: run.cut_back(0, 0),
                lambda: run.interrupt({}),
            ):
                with pytest.raises(RunError, match="moved, replaced"):
                    write()
            assert names(path) == before and names(moved) == old
    with RunDirectory.resume(moved, SCENE_2D) as run:
        run.cut_back(0, 0)


def test_a_create_that_lost_the_race_for_an_empty_folder(tmp_path):
    lock = acquire_lock(tmp_path)
    with pytest.raises(InputError, match="another run"):
        RunDirectory.create(tmp_path, SCENE_2D)
    os.close(lock)
    RunDirectory.create(tmp_path, SCENE_2D).close()


@pytest.mark.parametrize("write", [write_bytes, write_closure_bytes], ids=["io", "closures"])
def test_two_processes_that_write_one_file_do_not_meet(tmp_path, monkeypatch, write):
    """The second writes aside, moves into place while the first is at it: no file is missing, the later one stays."""
    path, numbers = tmp_path / "report.html", iter((1, 2))
    with monkeypatch.context() as patch:
        own = Path.write_bytes

        def slow(self, content):
            own(self, content)
            if content == b"first":
                patch.setattr(os, "getpid", lambda: next(numbers))
                write(path, b"second")
                assert path.read_bytes() == b"second"

        patch.setattr(Path, "write_bytes", slow)
        write(path, b"first")
    assert path.read_bytes() == b"first" and names(tmp_path) == {"report.html"}


def test_what_a_kill_leaves_is_harmless(tmp_path):
    path = tmp_path / "run"
    new_run(path, 4, 2)
    parts = path / ".frames"
    (parts / ".particles.000004.vtkhdf.4711.tmp").write_bytes(b"half")
    (path / ".checkpoint.h5.4711.tmp").write_bytes(b"half")
    # Frame 4: fluid written, particles cut short, history line cut short.
    (parts / "fluid.000004.vtkhdf").write_bytes((parts / "fluid.000003.vtkhdf").read_bytes())
    whole = (parts / "particles.000003.vtkhdf").read_bytes()
    (parts / "particles.000004.vtkhdf").write_bytes(whole[: len(whole) // 2])
    with open(path / "history.csv", "a") as file:
        file.write("0.4,1.")
    check_frames(path, 4)
    resume_to(path, 6)
    check_frames(path, 6)
    assert not list(path.glob(".*tmp")) and ".frames" not in names(path)


def test_a_damaged_part_ends_the_run_there(tmp_path):
    path = tmp_path / "run"
    new_run(path, 4, 3)
    part = path / ".frames/particles.000002.vtkhdf"
    part.write_bytes(part.read_bytes()[:1000])
    run = load_run(path)
    assert run.number_of_frames == 2 and run.history["time"].shape == (2,)
    expected = pytest.raises(InputError, match="follows 3 frames, only 2 can be read")
    with RunDirectory.resume(path, SCENE_2D) as run, expected:
        run.cut_back(3, 3)


def test_a_kill_between_join_and_the_end(tmp_path):
    """The joined file and all its parts are both there, and parts of later frames too."""
    path = tmp_path / "run"
    new_run(path, 5, 4)
    FrameSeries(path, ParticleFormat()).join(3)
    check_frames(path, 5)
    resume_to(path, 7)
    check_frames(path, 7)


def test_frames_come_in_order(tmp_path):
    with RunDirectory.create(tmp_path / "run", SCENE_2D) as run:
        write_frames(run, 0, 2)
        with pytest.raises(ValueError, match="2 are written"):
            run.write_frame(3, 0.3, {"particles": particle_arrays(3, 2)}, {})
        with pytest.raises(ValueError, match="2 are written"):
            run.write_sample(1, 0.3, sample_arrays(3))
        with pytest.raises(ValueError, match="checkpoint after 3 frames"):
            run.write_checkpoint({}, {"frames": 3, "samples": 0})


def test_fluid_needs_the_size_of_the_domain(tmp_path):
    expected = pytest.raises(InputError, match=r"domain\.size")
    with RunDirectory.create(tmp_path / "run", "seed = 1") as run, expected:
        run.write_frame(0, 0.0, {"fluid": fluid_arrays(0, 2)}, {})


def test_load_refuses_other_folders(tmp_path):
    for path in (tmp_path, tmp_path / "absent", tmp_path / "scene.toml"):
        with pytest.raises(InputError, match="is not a run directory") as caught:
            load_run(path)
        assert "jaxdem run" in caught.value.remedy
    new_run(tmp_path / "run", 2, 1, "finish")
    (tmp_path / "run/particles.vtkhdf").write_bytes(b"other")
    with pytest.raises(InputError, match="particles.vtkhdf"):
        load_run(tmp_path / "run")


def test_a_reader_outlives_the_join(tmp_path):
    with RunDirectory.create(tmp_path / "run", SCENE_2D) as run:
        write_frames(run, 0, 2)
        opened = load_run(tmp_path / "run")
        run.finish({})
    np.testing.assert_array_equal(opened.particles(1)["id"], particle_arrays(1, 2)["id"])


def test_io_imports_neither_jax_nor_pickle():
    roots = set()
    for module in Path(jaxdem.io.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(module.read_text())):
            if isinstance(node, ast.Import):
                roots |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                roots.add(node.module if node.module.startswith("jaxdem") else node.module.split(".")[0])
    assert {"numpy", "h5py", "jaxdem.errors"} <= roots
    third_party = roots - set(sys.stdlib_module_names) - {"numpy", "h5py"}
    third_party -= {"jaxdem.metrics", "jaxdem.numerics.axes"}  # of numpy alone
    assert all(name == "jaxdem.errors" or name.startswith(("jaxdem.files", "jaxdem.io")) for name in third_party)
    assert not roots & {"pickle", "shelve", "marshal"}


def test_summary_is_strict_json(tmp_path):
    with RunDirectory.create(tmp_path / "run", SCENE_2D) as run:
        run.finish({"a": {"b": [np.inf, 1.0, np.float32("nan")]}, "path": Path("x"), "flag": np.bool_(True)})
    text = (tmp_path / "run/summary.json").read_text()
    parsed = json.loads(text, parse_constant=pytest.fail)
    assert parsed == {"a": {"b": [None, 1.0, None]}, "path": "x", "flag": True, "complete": True}
