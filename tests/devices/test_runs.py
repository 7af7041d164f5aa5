"""Runs on several devices and by several processes, as the command line does them."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOHDF import vtkHDFReader

import jaxdem
from jaxdem.cli import library_output, members
from jaxdem.cli.cluster import member
from jaxdem.cli.inputs import set_collective_timeouts
from jaxdem.cli.launch import Outcome
from jaxdem.cli.main import app
from jaxdem.errors import InputError
from jaxdem.io import load_run
from jaxdem.run import peers
from jaxdem.run.peers import heartbeat
from tests.cases.tiers import COMBINATION

ROOT = Path(__file__).parents[2]
ENVIRONMENT = {name: value for name, value in os.environ.items() if "XLA_FLAGS" not in name} | {
    "PYTHONPATH": str(ROOT),
    "XLA_FLAGS": " ".join(one for one in os.environ.get("XLA_FLAGS", "").split() if "device_count" not in one),
    # XLA makes other programs for other numbers of threads, which round differently; a process has one a device.
    "NPROC": "2",
}

SCENE = """
precision = "float64"
[domain]
size = [0.32, 0.12]
depth = 0.02
gravity = [3.0, -9.81]
[particles]
count = 60
radius = 0.01
density = 2500.0
[particles.pack]
kind = "lattice"
start = [0.0, 0.0]
stop = [0.32, 0.1]
jitter = 0.002
[contact]
young_modulus = 1e6
friction = 0.4
restitution = 0.6
[time]
end = 0.12
output_interval = 0.01
[output]
checkpoint_interval = 1e-3
energy = true
[[probes]]
name = "middle"
kind = "plane"
axis = "x"
at = 0.16
interval = 0.01
[[probes]]
name = "contacts"
kind = "contacts"
interval = 0.02
"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "scene.toml"
    path.write_text(SCENE)
    return path


def line(*arguments):
    return [sys.executable, "-m", "jaxdem", *map(str, arguments)]


def command(*arguments):
    return subprocess.run(line(*arguments), env=ENVIRONMENT, capture_output=True, text=True, timeout=280, check=False)


@pytest.fixture(scope="module")
def on_two(scene, tmp_path_factory):
    """A run on two devices of one process."""
    out = tmp_path_factory.mktemp("two") / "run"
    done = command("run", scene, "--out", out, "--devices", 2, "--quiet")
    assert done.returncode == 0, done.stderr
    return load_run(out)


def largest_difference(one, other):
    """At the last output that both have."""
    last = min(one.number_of_frames, other.number_of_frames) - 1
    first, second = one.particles(last), other.particles(last)
    return {name: np.abs(np.subtract(first[name], second[name], dtype=float)).max() for name in first}


@COMBINATION
def test_four_devices_do_what_one_does(scene, tmp_path):
    for out, end, more in (
        ("one", 0.12, ()),
        ("four", 0.1, ("--devices", 4)),
    ):
        done = command("run", scene, "--out", tmp_path / out, "--set", f"time.end={end}", "--quiet", *more)
        assert done.returncode == 0, done.stderr
    one, four = load_run(tmp_path / "one"), load_run(tmp_path / "four")
    difference = largest_difference(one, four)
    assert difference["position"] < 1e-12 and difference["velocity"] < 1e-10 and difference["contact_force"] < 1e-8
    told = four.summary["devices"]
    assert told["number"] == 4 and sum(told["particles"]) == 60 and told["migrations"] > 0
    np.testing.assert_allclose(four.history["kinetic_energy"], one.history["kinetic_energy"][:11], rtol=1e-10)
    assert not (tmp_path / "four" / ".checkpoint").exists(), "one process has one file"
    # It goes on on one device, to rounding.
    done = command("run", scene, "--out", tmp_path / "four", "--set", "time.end=0.12", "--resume", "--quiet")
    assert done.returncode == 0, done.stderr
    four = load_run(tmp_path / "four")
    assert four.number_of_frames == one.number_of_frames == 13
    assert 0.0 < largest_difference(one, four)["position"] < 1e-12
    for name in ("start", "end", "work", "dissipated"):
        for part, expected in one.summary["energy"][name].items():
            assert four.summary["energy"][name][part] == pytest.approx(expected, rel=1e-9, abs=1e-12), part


def frames(out):
    path = out / "history.csv"
    return len(path.read_text().splitlines()) - 1 if path.is_file() else 0


def started(scene, out, *more, ready=None, **variables):
    """A run by two processes, and those, when it has written further frames, or is `ready`."""
    before = frames(out)
    launcher = subprocess.Popen(
        line("run", scene, "--out", out, "--processes", 2, "--quiet", *more),
        env=ENVIRONMENT | variables,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 240
    while not (ready() if ready else frames(out) >= before + 3):
        assert launcher.poll() is None and time.monotonic() < deadline, launcher.communicate()[1]
        time.sleep(0.02)
    children = Path(f"/proc/{launcher.pid}/task/{launcher.pid}/children").read_text().split()
    return launcher, [int(child) for child in children]


def by_srun(*arguments):
    """The command as two processes with what Slurm sets for each; exit codes, and what both have shown."""
    for job in range(2**12):  # whose number is that of a port above the first one
        with contextlib.suppress(OSError), socket.create_server(("127.0.0.1", FIRST_PORT + job)):
            break
    processes = [
        subprocess.Popen(
            line(*arguments),
            env=ENVIRONMENT | {name: str(value) for name, value in of_slurm(rank, 2, job=job).items()},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for rank in range(2)
    ]
    shown = [process.communicate(timeout=280) for process in processes]
    return [process.returncode for process in processes], *("".join(texts) for texts in zip(*shown, strict=True))


def of_slurm(rank, number, job=7):
    """What `srun` of Slurm 22.05 sets, as far as it tells who a process is."""
    return {
        "SLURM_JOB_ID": job, "SLURM_STEP_NODELIST": "localhost", "SLURM_STEP_NUM_NODES": 1, "SLURM_NTASKS": number,
        "SLURM_PROCID": rank, "SLURM_LOCALID": rank,
    }  # fmt: skip


def messages(said):
    """How many there are, but for the one that two processes share the only core of a machine."""
    return said.count("jaxdem:") - said.count("processes share one core")


def alive(process):
    try:
        return Path(f"/proc/{process}/stat").read_text().split(")")[1].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="finds the processes in /proc")
def test_two_processes_of_which_one_is_held_or_killed_go_on(scene, on_two, tmp_path):
    out = tmp_path / "run"
    # Held before they compile: the other one has not heard of it for 5 s.
    launcher, processes = started(scene, out, ready=(out / "scene.toml").is_file, JAXDEM_HEARTBEAT="5")
    assert len(processes) == 2
    os.kill(processes[1], signal.SIGSTOP)
    shown, said = launcher.communicate(timeout=60)
    assert launcher.returncode == 1 and messages(said) == 1 and "--resume" in said
    assert "Process 1 of 2 did not answer any more" in said and shown == "" and not any(map(alive, processes))

    launcher, processes = started(scene, out, "--resume")
    begin = time.monotonic()
    os.kill(processes[1], signal.SIGKILL)
    shown, said = launcher.communicate(timeout=60)
    assert launcher.returncode == 1 and time.monotonic() - begin < 10, "they do not wait for its heartbeat"
    assert messages(said) == 1 and "Process 1 of 2 was ended by signal 9" in said and "--resume" in said
    assert shown == "" and not any(map(alive, processes))

    codes, shown, said = by_srun("run", scene, "--out", out, "--resume")
    assert codes == [0, 0], said
    assert shown.startswith("valid     yes") and shown.count("valid") == 1 and "Gloo" not in said
    run = load_run(out)
    assert run.number_of_frames == on_two.number_of_frames
    assert max(largest_difference(run, on_two).values()) == 0.0, "bit for bit, on the same number of devices"
    for name, column in on_two.history.items():
        assert np.array_equal(run.history[name], column, equal_nan=True), name
    assert len(on_two.probes["contacts"]["time"]) > 50
    for name in ("middle", "contacts"):
        for column, values in on_two.probes[name].items():
            assert np.array_equal(run.probes[name][column], values), (name, column)
    assert run.probes.units("middle")["mass_flow"] == "kg/s"
    told = run.summary["devices"]
    assert told["processes"] == 2 and run.summary["complete"]
    assert 0.0 <= told["move_s"] < run.summary["stages_s"]["step"], "of 60 grains; there only if grains went"
    assert told["cuts_s"] == told["cuts"] * told["move_s"]
    assert run.summary["energy"] == on_two.summary["energy"]

    reader = vtkHDFReader()
    reader.SetFileName(str(out / "particles.vtkhdf"))
    reader.UpdateInformation()
    assert reader.GetNumberOfSteps() == run.number_of_frames
    reader.SetStep(run.number_of_frames - 1)
    reader.Update()
    points = vtk_to_numpy(reader.GetOutput().GetPoints().GetData())
    assert np.array_equal(points, run.particles(-1)["position"])


WIDE = """
precision = "float64"
[domain]
size = [0.36, 0.12]
depth = 0.02
gravity = [4.0, -9.81]
[particles]
density = 2500.0
[[particles.pack]]
kind = "lattice"
radius = 0.016
count = 4
spacing = 1.5
start = [0.0, 0.0]
stop = [0.36, 0.04]
[[particles.pack]]
kind = "random"
radius = 0.0025
count = 250
start = [0.0, 0.041]
stop = [0.36, 0.12]
[contact]
young_modulus = 1e6
friction = 0.4
rolling_friction = 0.1
rolling_model = "epsd"
[time]
end = 0.2
output_interval = 0.01
[output]
checkpoint_interval = 1e-3
"""
"""Large grains among small ones: lists by levels of size."""


@COMBINATION
@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="finds the processes in /proc")
def test_two_processes_with_grains_of_wide_sizes_go_on_bit_for_bit(tmp_path):
    scene, out = tmp_path / "wide.toml", tmp_path / "run"
    scene.write_text(WIDE)
    assert jaxdem.build(jaxdem.load_scene(scene))[0].search.levels is not None
    done = command("run", scene, "--out", tmp_path / "two", "--devices", 2, "--quiet")
    assert done.returncode == 0, done.stderr
    launcher, processes = started(scene, out)
    os.kill(processes[0], signal.SIGKILL)
    _, said = launcher.communicate(timeout=60)
    assert launcher.returncode == 1 and messages(said) == 1 and not any(map(alive, processes)), said
    done = command("run", scene, "--out", out, "--processes", 2, "--resume", "--quiet")
    assert done.returncode == 0, done.stderr
    run, two = load_run(out), load_run(tmp_path / "two")
    assert run.summary["devices"]["processes"] == 2 and run.summary["devices"]["migrations"] > 4
    assert run.number_of_frames == two.number_of_frames == 21
    assert max(largest_difference(run, two).values()) == 0.0
    for name, column in two.history.items():
        np.testing.assert_array_equal(run.history[name], column, err_msg=name)


@COMBINATION
@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="finds the processes in /proc")
def test_a_signal_to_one_of_two_processes_stops_both_with_a_checkpoint(scene, on_two, tmp_path):
    out = tmp_path / "run"
    launcher, processes = started(scene, out)
    os.kill(processes[1], signal.SIGINT)
    shown, said = launcher.communicate(timeout=60)
    assert launcher.returncode == 130 and messages(said) == 1 and "checkpoint" in said
    assert not any(map(alive, processes)) and frames(out) < on_two.number_of_frames
    done = command("run", scene, "--out", out, "--processes", 2, "--resume", "--quiet")
    assert done.returncode == 0, done.stderr
    run = load_run(out)
    assert max(largest_difference(run, on_two).values()) == 0.0 and run.summary["energy"] == on_two.summary["energy"]


def test_a_message_comes_once(scene, tmp_path):
    """What is wrong is said before processes are started."""
    for arguments, text in (
        (("--processes", 2, "--devices", 3), "must be a multiple of the number of processes, 2"),
        (("--processes", 2, "--set", "particles.count=-1"), "particles.count"),
    ):
        done = command("run", scene, "--out", tmp_path / "run", *arguments)
        assert done.returncode == 2 and done.stderr.count("jaxdem:") == 1 and text in done.stderr, done.stderr
        assert not (tmp_path / "run").exists()


def test_more_processes_than_cores_or_slabs(scene, tmp_path, monkeypatch):
    """None is started where the box cannot be cut so, also of fewer than the cores; what is more than these is told."""
    started = []
    monkeypatch.setattr(members, "run_processes", lambda number, _: started.append(number) or Outcome(0, None))
    monkeypatch.setattr(members.process, "be_silent", lambda: None)
    monkeypatch.setattr(members, "start_jax", lambda precision: None)  # as the other tests have it
    cores = {0, 1, 2, 3}
    monkeypatch.setattr(members.os, "sched_getaffinity", lambda _: cores)

    def run(processes, *more):
        given = ["run", scene, "--out", tmp_path / "run", "--set", "precision=float32", "--processes", processes, *more]
        return CliRunner().invoke(app, [str(one) for one in given])

    for number, more in ((99, ()), (3, ("--set", "contact.skin=2.0"))):
        refused = run(number, *more)
        text = " ".join(refused.output.split())
        assert refused.exit_code == 2 and f"cut into {number} slabs" in text and not started, text
    with monkeypatch.context() as given:
        given.setenv("JAXDEM_HEARTBEAT", "soon")
        refused = run(2)
    assert refused.exit_code == 2 and "JAXDEM_HEARTBEAT" in refused.output and not started
    cores -= {2, 3}
    for number, told in ((3, "3 processes share 2 cores and wait for each other; give --processes 2"), (2, None)):
        said = run(number)
        assert said.exit_code == 0 and shared(said.output) == told, said.output
    cores -= {1}
    assert shared(run(2).output) == "2 processes share one core and wait for each other; leave --processes out"
    assert started == [3, 2, 2]


def shared(output):
    """What is told of processes that share cores; None where nothing is."""
    text = " ".join(output.split())
    return text.split("jaxdem: ")[1] if "processes share" in text else None


def test_who_a_process_is():
    slurm = {name: str(value) for name, value in of_slurm(3, 4).items()}
    assert member({}) is None
    assert member(slurm)[:3] == (3, 4, None)
    assert member(slurm | {"SLURM_NTASKS": "1", "SLURM_PROCID": "0"}) is None
    assert member(slurm | {"JAXDEM_PROCESSES": "1"}) is None
    del slurm["SLURM_STEP_NODELIST"]  # a batch script, outside of srun
    assert member(slurm) is None
    given = {"JAXDEM_PROCESS": "1", "JAXDEM_PROCESSES": "2", "JAXDEM_COORDINATOR": "host:1234"}
    assert member(given)[:3] == (1, 2, "host:1234")
    with pytest.raises(InputError, match="0 to 1"):
        member(given | {"JAXDEM_PROCESS": "2"})
    with pytest.raises(InputError, match="whole number"):
        member(given | {"JAXDEM_PROCESS": "one"})
    mpi = {"OMPI_COMM_WORLD_RANK": "1", "OMPI_COMM_WORLD_SIZE": "2"}
    with pytest.raises(InputError, match="JAX_COORDINATOR_ADDRESS"):
        member(mpi)
    assert member(mpi | {"JAX_COORDINATOR_ADDRESS": "host:1"})[:3] == (1, 2, "host:1")
    # Open MPI 4.1 says where its mpirun is. On the other nodes of a job of Slurm its daemons are tasks of srun.
    mpi["OMPI_MCA_orte_hnp_uri"] = OPEN_MPI["OMPI_MCA_orte_hnp_uri"]
    daemon = {name: str(value) for name, value in of_slurm(1, 2).items()}
    assert member(mpi)[:3] == (1, 2, None)
    assert member(mpi | daemon | {"OMPI_COMM_WORLD_RANK": "5", "OMPI_COMM_WORLD_SIZE": "8"})[:3] == (5, 8, None)
    # srun sets the variables of MPICH too where it is asked to; mpiexec of MPICH has daemons like those.
    assert member(daemon | {"PMI_RANK": "1", "PMI_SIZE": "2"})[:3] == (1, 2, None)
    with pytest.raises(InputError, match="JAX_COORDINATOR_ADDRESS"):
        member(daemon | {"PMI_RANK": "5", "PMI_SIZE": "8"})


OPEN_MPI = {
    "OMPI_COMM_WORLD_RANK": 1, "OMPI_COMM_WORLD_SIZE": 2, "OMPI_COMM_WORLD_LOCAL_RANK": 1,
    "OMPI_MCA_orte_hnp_uri": "1354104832.0;tcp://192.0.2.2:41811;tcp6://[fd00::2]:58565",
}  # fmt: skip
FIRST_PORT = 65535 - 2**12 + 1  # JAX takes one of those above it by the number of the job
AT_MPIRUN = f"192.0.2.2:{FIRST_PORT + (1354104832 // 2**12) % 2**12}"


@pytest.mark.parametrize(
    ("variables", "address"),
    [
        (of_slurm(1, 2) | {"SLURM_STEP_NODELIST": "node[03-04,07]"}, f"node03:{FIRST_PORT + 7}"),
        (OPEN_MPI, AT_MPIRUN),
        (of_slurm(0, 2) | OPEN_MPI, AT_MPIRUN),
    ],
    ids=["slurm", "open_mpi", "open_mpi_in_slurm"],
)
def test_jax_finds_the_first_process(monkeypatch, variables, address):
    """By the variables that `member` relies on."""
    from jax._src import clusters

    for name, value in variables.items():
        monkeypatch.setenv(name, str(value))
    assert member()[:3] == (1, 2, None)
    found = clusters.ClusterEnv.auto_detect_unset_distributed_params(None, None, None, None, None, 1)
    assert found[:3] == (address, 2, 1)


LOST = """E1130 20:07:36.297378    9656 coordination_service.cc:1549] [9] Use error polling to propagate to all tasks: \
UNAVAILABLE: The following tasks are unhealthy (stopped sending heartbeats):
1
The tasks have crashed. Check the task logs for an earlier error
F1130 20:07:36.298096 9667 client.h:80] Terminating process because the JAX distributed service detected fatal errors.
*** Check failure stack trace: ***
    @     0x7f31ed040634  absl::lts_20260107::log_internal::LogMessage::SendToLog()
"""


def test_what_libraries_write():
    """It is handed on, but for a greeting of gloo; of the traces of processes that have lost another a sentence."""
    told = "jaxdem: Process 1 of 3 was ended or does not answer any more. The run has stopped. Go on with --resume\n"
    reset = LOST.replace("stopped sending heartbeats):\n1\n", "Connection reset by peer)\n")
    for rank, written, shown in (
        (0, "[Gloo] Rank 0 is connected to 2 peer ranks\na warning\nmore", "a warning\nmore"),
        (0, f"a warning\n{LOST}", f"a warning\n{told}"),
        (2, LOST, ""),
        (1, reset, told.replace("Process 1", "Process 0")),
        (1, LOST.partition("F1130")[0], LOST.partition("F1130")[0]),
    ):
        command = [sys.executable, "-I", "-S", library_output.__file__, str(rank), "3"]
        done = subprocess.run(command, input=written, capture_output=True, text=True, timeout=60, check=True)
        assert (done.stdout, done.stderr) == ("", shown)


def test_lines_that_are_held_back_come_after_a_while_also_where_others_follow():
    script = f"""import runpy
given = runpy.run_path({library_output.__file__!r})
given["hand_on"].__globals__["HELD"] = 0.2
given["hand_on"](0, 3)"""
    helper = subprocess.Popen([sys.executable, "-c", script], stdin=subprocess.PIPE, stderr=subprocess.PIPE)
    os.set_blocking(helper.stderr.fileno(), False)
    shown, until = b"", time.monotonic() + 30.0
    while b"unhealthy" not in shown and time.monotonic() < until:
        helper.stdin.write(LOST.partition("F1130")[0].encode() if not shown else b"a line\n")
        helper.stdin.flush()
        time.sleep(0.1)
        shown += helper.stderr.read() or b""
    helper.stdin.close()
    helper.kill()
    helper.wait()
    assert b"unhealthy" in shown


def test_heartbeat():
    assert heartbeat({}) == 30 and heartbeat({"JAXDEM_HEARTBEAT": "100"}) == 100
    for text in ("0", "soon", "-1"):
        with pytest.raises(InputError, match="JAXDEM_HEARTBEAT"):
            heartbeat({"JAXDEM_HEARTBEAT": text})


def test_devices_of_one_processor_wait_for_each_other(monkeypatch):
    """XLA ends a process where one is 40 s late; what somebody has set stays. (Runs show that XLA knows the flags.)"""
    own = "--xla_cpu_collective_call_terminate_timeout_seconds=7"
    for before, expected in (("", 3600), (own, 7)):
        monkeypatch.setenv("XLA_FLAGS", before)
        set_collective_timeouts()
        flags = dict(one.split("=") for one in os.environ["XLA_FLAGS"].split())
        assert flags["--xla_cpu_collective_call_terminate_timeout_seconds"] == str(expected)
        assert flags["--xla_cpu_collective_call_warn_stuck_timeout_seconds"] == "300"


def test_who_looks_for_failures_of_others_ends_before_the_interpreter(monkeypatch):
    """Else the thread may be inside of JAX's client then, and the process ends by a signal after its work."""
    looks, at_exit, found = threading.Event(), [], []

    def look(self):
        looks.set()

    monkeypatch.setattr(peers.Peers, "reported", look)
    monkeypatch.setattr(peers.atexit, "register", at_exit.append)
    before = set(threading.enumerate())
    peers.Peers(1, 2).watch(found.append)
    (thread,) = set(threading.enumerate()) - before
    assert looks.wait(10.0) and thread.is_alive()
    (stop,) = at_exit
    stop()
    assert not thread.is_alive() and not found
    monkeypatch.setattr(peers.Peers, "reported", lambda self: "a process ran out of memory")
    peers.Peers(1, 2).watch(found.append)
    at_exit[-1]()
    assert found == ["a process ran out of memory"]
