"""`--processes N`: N copies of this command on this machine, one run. Nothing of JAX is loaded here.

The launcher hands signals on, waits for all, and says once why a run ended that did not end by itself. The processes
talk to each other through `jax.distributed` over loopback; the launcher does not.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, NamedTuple

from jaxdem.cli.cluster import COORDINATOR, LAUNCHED, PROCESS, PROCESSES
from jaxdem.cli.library_output import ABORTED

LOST_PEER = 75
"""Exit code of a process that ended because another one did: the cause lies there."""

GRACE = 15.0
"""Time that the others have to end by themselves after one has ended with a message [s]; then they are killed."""

GRACE_AFTER_KILL = 2.0
"""The same where a signal has ended one: nothing can be saved, and without it the others wait for its heartbeat [s]."""

POLL = 0.05
"""How often the processes are looked after [s]."""

LAST_LINES = 12
"""Of what a process wrote that ended without a word of jaxdem."""


class Outcome(NamedTuple):
    """How the processes ended.

    Attributes:
        code: exit code of the run.
        message: why it ended, where none of the processes has said so.
    """

    code: int
    message: str | None


def run_processes(number: int, arguments: Sequence[str]) -> Outcome:
    """`jaxdem ARGUMENTS` as so many processes, until all have ended.

    Args:
        number: of processes.
        arguments: of the command line.
    """
    with tempfile.TemporaryDirectory(prefix="jaxdem-") as folder:
        port = _free_port()
        group = _Group([_Process(index, number, port, arguments, Path(folder)) for index in range(number)])
        before = {one: signal.signal(one, group.hand_on) for one in (signal.SIGINT, signal.SIGTERM)}
        try:
            return group.wait()
        finally:
            group.kill()
            for one, handler in before.items():
                signal.signal(one, handler)


class _Process:
    """One of the processes, with a file for what libraries write to standard error."""

    def __init__(self, index: int, number: int, port: int, arguments: Sequence[str], folder: Path):
        self.index = index
        self.log = folder / f"{index}.log"
        names = {PROCESS: index, PROCESSES: number, COORDINATOR: f"127.0.0.1:{port}", LAUNCHED: self.log}
        with on_cores(cores_of(index, number)):
            self._process = subprocess.Popen(
                [sys.executable, "-m", "jaxdem", *arguments],
                env=os.environ | {name: str(one) for name, one in names.items()},
                stdin=subprocess.PIPE,
                stdout=None if index == 0 else subprocess.DEVNULL,
                start_new_session=True,  # the terminal's Ctrl-C comes to the launcher alone, which hands it on
            )

    @property
    def pipe(self) -> IO[bytes]:
        """Closed when the launcher ends, however it ends: the process then ends too."""
        assert self._process.stdin is not None
        return self._process.stdin

    def poll(self) -> int | None:
        """The exit code, negative after a signal; None while it runs."""
        return self._process.poll()

    def send(self, number: int) -> None:
        """A signal, if it still runs."""
        if self.poll() is None:
            self._process.send_signal(number)

    def lost_others(self, code: int) -> bool:
        """Whether it ended because another one did not answer; JAX aborts a process for that."""
        return code == LOST_PEER or (code == -signal.SIGABRT and ABORTED in self._written())

    def last_words(self) -> str:
        """The end of what it wrote to standard error past jaxdem."""
        return "\n".join(self._written().splitlines()[-LAST_LINES:])

    def _written(self) -> str:
        try:
            return self.log.read_text(errors="replace")
        except OSError:
            return ""


class _Group:
    """All processes of a run."""

    def __init__(self, processes: list[_Process]):
        self._processes = processes
        self._signals: list[int] = []
        self._failed: list[tuple[_Process, int]] = []

    def hand_on(self, number: int, _: object) -> None:
        """A signal of the launcher goes to all."""
        self._signals.append(number)
        for process in self._processes:
            process.send(number)

    def wait(self) -> Outcome:
        """Until all have ended; those that do not soon after one has failed are killed."""
        killed: set[int] = set()
        deadline = float("inf")
        while any(process.poll() is None for process in self._processes):
            self._look()
            if self._failed and deadline == float("inf"):
                deadline = time.monotonic() + (GRACE_AFTER_KILL if self._failed[0][1] < 0 else GRACE)
            if time.monotonic() > deadline:
                killed |= {process.index for process in self._processes if process.poll() is None}
                self.kill()
            time.sleep(POLL)
        self._look()
        return self._outcome(killed)

    def kill(self) -> None:
        """Ends what still runs."""
        for process in self._processes:
            process.send(signal.SIGKILL)
        for process in self._processes:
            if not process.pipe.closed:
                process.pipe.close()

    def _look(self) -> None:
        """Notes who has failed, in the order in which that is seen."""
        known = {process.index for process, _ in self._failed}
        for process in self._processes:
            code = process.poll()
            if code and process.index not in known:
                self._failed.append((process, code))

    def _outcome(self, killed: set[int]) -> Outcome:
        if not self._failed:
            return Outcome(0, None)
        causes = [(one, code) for one, code in self._failed if one.index not in killed and not one.lost_others(code)]
        if not causes:
            return Outcome(1, self._silent(killed))
        process, code = causes[0]
        if self._signals and 128 + self._signals[0] in [code for _, code in causes]:
            return Outcome(128 + self._signals[0], None)
        if code > 0:  # with a message, which the first process has shown
            return Outcome(code, None)
        told, number = "", len(self._processes)
        if -code not in (signal.SIGKILL, signal.SIGTERM, signal.SIGINT) and (words := process.last_words()):
            told = f" It wrote at last:\n{words}\n"
        name = signal.Signals(-code).name
        return Outcome(1, f"Process {process.index} of {number} was ended by signal {-code} ({name}).{told}")

    def _silent(self, killed: set[int]) -> str:
        """Why a run ended of which each process has only seen that another one was gone."""
        number = len(self._processes)
        if len(killed) == 1:
            return f"Process {min(killed)} of {number} did not answer any more, and was ended."
        return f"The {number} processes of the run lost each other."


def cores_of(index: int, number: int) -> list[int]:
    """The share that one of so many processes has of the cores that this one may use; one at least.

    Not bound, two processes that wait for each other in every contact step are often put on one core by the system, and
    the other core is idle.
    """
    cores = sorted(os.sched_getaffinity(0))
    first, end = (k * len(cores) // number for k in (index, index + 1))
    return cores[first : max(end, first + 1)]


@contextlib.contextmanager
def on_cores(cores: Sequence[int]) -> Iterator[None]:
    """What is started meanwhile has these cores from its first instruction on, so that XLA makes as many threads."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cores)
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def _free_port() -> int:
    """Of the loopback interface; free until somebody takes it."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
