"""Real deaths: SIGKILL at random moments, and a disk that takes no more."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from made_frames import SCENE_2D, fluid_arrays, particle_arrays, row, sample_arrays, time_of

from jaxdem.io import RunDirectory, load_run, read_checkpoint

HERE = Path(__file__).parent

WRITER = """
import sys
sys.path[:0] = [sys.argv[2], sys.argv[3]]
import numpy as np
from made_frames import SCENE_2D, write_frames
from jaxdem.io import RunDirectory
path, last = sys.argv[1], int(sys.argv[4])
first = 0
try:
    run = RunDirectory.resume(path, SCENE_2D)
except Exception:
    run = RunDirectory.create(path, SCENE_2D)
    run.write_checkpoint({"step": np.array(0)}, {"frames": 0, "samples": 0})
else:
    arrays, attributes = run.checkpoint()
    first = attributes["frames"]
    assert first == int(arrays["step"])
    run.cut_back(first, attributes["samples"])
print("ready", flush=True)
for index in range(first, last):
    write_frames(run, index, index + 1)
    print(index, flush=True)
    if index % 3 == 2:
        run.write_checkpoint({"step": np.array(index + 1)}, {"frames": index + 1, "samples": index + 1})
    if index % 10 == 9:
        # Joined again and again, so that kills fall into joins too.
        run.interrupt({"valid": True})
run.finish({"valid": True})
"""


def start(path, last: int) -> subprocess.Popen:
    command = [sys.executable, "-c", WRITER, str(path), str(HERE), str(HERE.parents[1]), str(last)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def check(path) -> int:
    """Everything the checkpoint follows, and everything committed since, reads back; returns the frames."""
    run = load_run(path)
    attributes = read_checkpoint(path / "checkpoint.h5")[1]
    assert run.number_of_frames >= attributes["frames"]
    for index in range(run.number_of_frames):
        read = run.particles(index)
        np.testing.assert_array_equal(read["position"][:, :2], particle_arrays(index, 2)["position"])
        np.testing.assert_array_equal(run.fluid(index)["pressure"], fluid_arrays(index, 2)["pressure"])
        assert run.times[index] == time_of(index)
        assert run.history["runoff"][index] == row(index)["runoff"]
    if attributes["samples"]:
        assert len(run.samples) >= attributes["samples"]
        last = attributes["samples"] - 1
        given = sample_arrays(last)["slip_velocity"]
        np.testing.assert_array_equal(run.samples.frame(last)["slip_velocity"], given)
    return run.number_of_frames


def test_sigkill_at_random_moments(tmp_path):
    path = tmp_path / "run"
    generator = random.Random(5)
    reached = []
    for _ in range(4):
        process = start(path, 100000)
        assert process.stdout.readline() == "ready\n", process.stderr.read()
        # Frames are counted and not seconds, so that a loaded machine tests the same.
        for _ in range(generator.randint(4, 11)):
            process.stdout.readline()
        time.sleep(generator.uniform(0.0, 0.05))
        process.send_signal(signal.SIGKILL)
        process.communicate()
        assert process.returncode == -signal.SIGKILL
        reached.append(check(path))
    assert reached[-1] >= 10, f"four runs of three frames and more, resumed, reached only {reached}"
    last = reached[-1] + 5
    process = start(path, last)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors
    assert check(path) == last
    assert RunDirectory.is_complete(path) and not (path / ".frames").exists()
    assert not list(path.glob(".*.tmp"))


FULL_DISK = """
import os, resource, signal, sys
sys.path[:0] = [sys.argv[2], sys.argv[3]]
import numpy as np
from made_frames import SCENE_2D, write_frames
from jaxdem.errors import RunError
from jaxdem.io import RunDirectory
where = sys.argv[4]
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
run = RunDirectory.create(sys.argv[1], SCENE_2D)
write_frames(run, 0, 5)
run.write_checkpoint({"step": np.array(5)}, {"frames": 5, "samples": 5})
# A write beyond this size fails as on a full disk.
def limit(size): resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))
history = os.path.getsize(sys.argv[1] + "/history.csv") + 10
limit({"frame": 2000, "history": history, "checkpoint": 8000, "join": 20000}[where])
try:
    if where == "frame":
        write_frames(run, 5, 6)
    elif where == "history":
        run.write_frame(5, 4.0, None, None, None, {})
    elif where == "checkpoint":
        run.write_checkpoint({"x": np.zeros(5000)}, {"frames": 5, "samples": 5})
    else:
        run.finish({})
except RunError as error:
    print(error)
    sys.exit(error.exit_code)
"""


@pytest.mark.parametrize("where", ["frame", "history", "checkpoint", "join"])
def test_a_full_disk_is_a_message_and_earlier_frames_stay(tmp_path, where):
    path = tmp_path / "run"
    command = [sys.executable, "-c", FULL_DISK, str(path), str(HERE), str(HERE.parents[1]), where]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1, done.stdout + done.stderr
    assert "cannot write" in done.stdout and str(path) in done.stdout and "--resume" in done.stdout
    assert done.stderr == ""
    assert not list(path.glob(".*.tmp")) and not list(path.glob(".frames/.*.tmp"))
    assert check(path) == 5
    history = (path / "history.csv").read_text()
    assert history.count("\n") == 6 and history.endswith("\n")
    with RunDirectory.resume(path, SCENE_2D) as run:
        run.cut_back(5, 5)
        run.finish({"valid": True})
    assert check(path) == 5
