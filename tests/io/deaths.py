"""A process that forks writers of a run directory and has them die: at random moments, inside writes, on a full disk.

One process, so that numpy and h5py are imported once; of its own, for a process with JAX in it must not fork.
"""

from __future__ import annotations

import os
import pathlib
import random
import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[2])]

import numpy as np  # noqa: E402
from made_frames import SCENE_2D, fluid_arrays, particle_arrays, row, sample_arrays, time_of, write_frames  # noqa: E402

from jaxdem.errors import InputError, RunError  # noqa: E402
from jaxdem.files import durable  # noqa: E402
from jaxdem.io import RunDirectory, load_run, read_checkpoint, run_folder  # noqa: E402

ENDLESS = 10**6

# Flushing is for a power cut; a killed process loses nothing that it has written, and a busy disk takes 0.1 s for it.
os.fsync = lambda descriptor: None


def write_on(path: Path, last: int, begun: Callable[[], object] = lambda: None) -> None:
    """Start the run or go on with it, up to frame `last`; `begun` is called after every new frame."""
    first = 0
    try:
        run = RunDirectory.resume(path, SCENE_2D)
    except InputError:
        run = RunDirectory.create(path, SCENE_2D)
    if run.has_checkpoint:
        arrays, attributes = run.checkpoint()
        first = int(attributes["frames"])
        assert first == int(arrays["step"])
        run.cut_back(first, int(attributes["samples"]))
    else:
        run.write_checkpoint({"step": np.array(0)}, {"frames": 0, "samples": 0})
    for index in range(first, last):
        write_frames(run, index, index + 1)
        begun()
        if index % 3 == 2:
            run.write_checkpoint({"step": np.array(index + 1)}, {"frames": index + 1, "samples": index + 1})
        if index % 10 == 9:
            # Joined again and again, so that kills fall into joins too.
            run.interrupt({"valid": True})
    run.finish({"valid": True})


def check(path: Path, last: int = ENDLESS) -> int:
    """What the checkpoint follows, and what was committed since, reads back; returns the number of frames.

    Args:
        path: of the run.
        last: number of frames to look into, from the end.
    """
    if not (path / "history.csv").exists():  # killed before there was a run
        return 0
    run = load_run(path)
    followed = {"frames": 0, "samples": 0}
    if (path / "checkpoint.h5").exists():
        followed = read_checkpoint(path / "checkpoint.h5")[1]
    assert run.number_of_frames >= followed["frames"]
    for index in range(max(run.number_of_frames - last, 0), run.number_of_frames):
        read = run.particles(index)
        np.testing.assert_array_equal(read["position"][:, :2], particle_arrays(index, 2)["position"])
        np.testing.assert_array_equal(run.fluid(index)["pressure"], fluid_arrays(index, 2)["pressure"])
        assert run.times[index] == time_of(index)
        assert run.history["runoff"][index] == row(index)["runoff"]
    if followed["samples"]:
        assert len(run.samples) >= followed["samples"]
        last = followed["samples"] - 1
        given = sample_arrays(last)["slip_velocity"]
        np.testing.assert_array_equal(run.samples.frame(last)["slip_velocity"], given)
    return run.number_of_frames


def die_in_write(number: int) -> None:
    """From now on the process is killed in its `number`-th write, half of it done, or rename or flush."""
    left = [number]

    def due() -> bool:
        left[0] -= 1
        return left[0] == 0

    def kill() -> None:
        os.kill(os.getpid(), signal.SIGKILL)

    def dying(call):
        def wrapped(*arguments):
            if due():
                kill()
            return call(*arguments)

        return wrapped

    def half_of(write):
        def wrapped(file, content):
            if due():
                view = memoryview(content).cast("B")
                write(file, view[: len(view) // 2])
                kill()
            return write(file, content)

        return wrapped

    os.replace, os.fsync = dying(os.replace), dying(os.fsync)
    pathlib.Path.write_bytes = half_of(pathlib.Path.write_bytes)
    durable.DeferredErrorFile.write = half_of(durable.DeferredErrorFile.write)


def child(work) -> int:
    """Fork, do the work there; the number of the new process."""
    process = os.fork()
    if process == 0:
        code = 1
        try:
            work()
            code = 0
        except RunError as error:
            print(error, flush=True)
            code = 10 + error.exit_code
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)
    return process


def kills(path: Path, seed: int, number: int) -> None:
    """Kill `number` writers, each going on with what the last one left.

    In turns at any moment, or once there are new frames, and inside a write.
    """
    generator = random.Random(seed)
    reached, survived = 0, 0
    while survived < number:
        inside = survived % 2 == 1
        frames = reached

        moment = generator.randint(1, 60)
        told, tell = os.pipe()

        def work(inside=inside, moment=moment, tell=tell):
            if inside:
                die_in_write(moment)
            write_on(path, ENDLESS, lambda: os.write(tell, b"."))

        process = child(work)
        if not inside:
            if survived % 4 == 0:  # however busy the machine is: three new frames, of which a checkpoint follows
                os.read(told, 1), os.read(told, 1), os.read(told, 1)
            time.sleep(generator.uniform(0.0, 0.12))
            os.kill(process, signal.SIGKILL)
        status = os.waitpid(process, 0)[1]
        os.close(told), os.close(tell)
        assert os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGKILL, status
        reached = check(path, 5)
        # What was there at the last checkpoint is never lost: at most three frames are done again.
        assert reached + 3 >= frames
        survived += 1
    last = reached + 5
    assert os.waitpid(child(lambda: write_on(path, last)), 0)[1] == 0
    assert check(path) == last
    assert run_folder.is_complete(path) and not (path / ".frames").exists()
    assert not list(path.glob(".*.tmp"))
    print(survived, reached)


def full_disk(path: Path, where: str) -> None:
    """A write beyond a size fails, as on a full disk: prints the error; the exit code is 10 and that of the error."""

    def work() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        run = RunDirectory.create(path, SCENE_2D)
        write_frames(run, 0, 5)
        run.write_checkpoint({"step": np.array(5)}, {"frames": 5, "samples": 5})
        history = (path / "history.csv").stat().st_size + 10
        size = {"frame": 2000, "history": history, "checkpoint": 8000, "join": 20000}[where]
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))
        if where == "frame":
            write_frames(run, 5, 6)
        elif where == "history":
            run.write_frame(5, 4.0, {}, {})
        elif where == "checkpoint":
            run.write_checkpoint({"x": np.zeros(5000)}, {"frames": 5, "samples": 5})
        else:
            run.finish({})

    status = os.waitpid(child(work), 0)[1]
    print(where, os.waitstatus_to_exitcode(status), flush=True)


if __name__ == "__main__":
    folder, wanted = Path(sys.argv[2]), sys.argv[1]
    if wanted == "kills":
        kills(folder, int(sys.argv[3]), int(sys.argv[4]))
    else:
        for place in sys.argv[3:]:
            full_disk(folder / place, place)
