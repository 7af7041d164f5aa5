"""Pieces of work shared among processes, each on a core of its own, those first that wait for nothing.

Every piece has a process of its own, so that its memory is free after it and a crash costs one piece: what needs it is
not begun, and everything else is done. (A `concurrent.futures.ProcessPoolExecutor` ends all its processes when one of
them crashes.) At SIGINT or SIGTERM the processes are asked to stop, and leave checkpoints.
"""

from __future__ import annotations

import dataclasses
import multiprocessing
import os
import signal
import sys
import time as clock
from collections.abc import Callable, Sequence
from multiprocessing.connection import wait
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import Any

from rich.progress import Progress, TaskID

from jaxdem.errors import JaxdemError
from jaxdem.run.signals import noted_signals

POLL = 0.2
"""Time after which the pool looks for a signal, and how far the pieces are [s]."""

ONE_THREAD = {"PJRT_NPROC": "1", "OMP_NUM_THREADS": "1"}
"""For a process on one core: two of them do twice the work of one process on both."""

SPAWN = multiprocessing.get_context("spawn")

Report = Callable[[float], None]
"""Is told how much of a piece is done."""


class Stopped(Exception):
    """The pool was asked to stop; `number` is that of the signal."""

    def __init__(self, number: int):
        self.number = number
        super().__init__(f"stopped by signal {number}")


@dataclasses.dataclass(frozen=True)
class Piece:
    """One piece of work.

    Attributes:
        name: shown, and of the log file.
        make: does it; can be pickled.
        length: of it, in its own unit: simulated time, epochs, samples.
        needs: names of pieces that must be done before.
        done: whether there is nothing to do.
    """

    name: str
    make: Callable[[Report], None]
    length: float
    needs: tuple[str, ...] = ()
    done: bool = False


@dataclasses.dataclass
class _Running:
    piece: Piece
    process: SpawnProcess
    core: int | None
    progress: Any  # a shared number, for which multiprocessing has no type
    bar: TaskID
    begin: float


class Pool:
    """Does pieces of work.

    Args:
        jobs: number of processes at once; each is bound to a core where there is more than one.
        logs: folder for what the processes write.
        bars: shows how far they are.
    """

    def __init__(self, jobs: int, logs: Path, bars: Progress):
        self.logs, self.bars = logs, bars
        self.problems: dict[str, str] = {}
        self._running: list[_Running] = []
        self._cores: list[int | None] = [None] * jobs
        if jobs > 1 and hasattr(os, "sched_getaffinity"):
            cores = sorted(os.sched_getaffinity(0))
            self._cores = [cores[i % len(cores)] for i in range(jobs)]

    def do(self, pieces: Sequence[Piece]) -> dict[str, str]:
        """Do all pieces; returns why not, by name, for those that are not done.

        Raises:
            Stopped: SIGINT or SIGTERM; the processes have stopped.
        """
        self.logs.mkdir(parents=True, exist_ok=True)
        done = {piece.name for piece in pieces if piece.done}
        waiting = [piece for piece in pieces if not piece.done]
        with noted_signals() as caught:
            try:
                while (waiting or self._running) and not caught:
                    waiting = self._begin(waiting, done)
                    self._watch(done)
            finally:
                self._stop(caught[0] if caught else signal.SIGTERM)
        if caught:
            raise Stopped(caught[0])
        return self.problems

    def _begin(self, waiting: Sequence[Piece], done: set[str]) -> list[Piece]:
        """Begin what may begin, as far as there are cores; returns what has to wait."""
        kept = []
        for piece in waiting:
            if failed := [name for name in piece.needs if name in self.problems]:
                self.problems[piece.name] = f"needs {', '.join(failed)}"
            elif self._cores and set(piece.needs) <= done:
                self._launch(piece, self._cores.pop(0))
            else:
                kept.append(piece)
        return kept

    def _launch(self, piece: Piece, core: int | None) -> None:
        progress = SPAWN.Value("d", 0.0, lock=False)
        process = SPAWN.Process(target=_work, args=(piece.make, core, self._log(piece.name), progress))
        before = dict(os.environ)
        os.environ.update({} if core is None else ONE_THREAD)  # libraries read it as the process loads them
        try:
            process.start()
        finally:
            os.environ.clear()
            os.environ.update(before)
        bar = self.bars.add_task(piece.name, total=piece.length)
        self._running.append(_Running(piece, process, core, progress, bar, clock.perf_counter()))
        self._say(f"{piece.name}: begun")

    def _watch(self, done: set[str]) -> None:
        """Wait a little for a process to end, and show how far the others are."""
        wait([running.process.sentinel for running in self._running], POLL)
        for running in list(self._running):
            self.bars.update(running.bar, completed=running.progress.value)
            if not running.process.is_alive():
                self._finish(running, done)

    def _finish(self, running: _Running, done: set[str]) -> None:
        name, code = running.piece.name, running.process.exitcode
        self._running.remove(running)
        self._cores.insert(0, running.core)
        self.bars.remove_task(running.bar)
        if code == 0:
            done.add(name)
            self._say(f"{name}: done after {clock.perf_counter() - running.begin:.0f} s")
            return
        lines = self._log(name).read_text(encoding="utf-8", errors="replace").strip().splitlines()
        self.problems[name] = lines[-1] if lines else f"ended with code {code}, without a message"
        self._say(f"{name}: failed. {self.problems[name]} (see {self._log(name)})")

    def _stop(self, number: int) -> None:
        """Ask the processes that are left to stop, and wait for them."""
        for running in self._running:
            if running.process.is_alive():
                os.kill(running.process.pid or 0, number)
        for running in self._running:
            running.process.join()
            self.bars.remove_task(running.bar)

    def _log(self, name: str) -> Path:
        return self.logs / f"{name}.log"

    def _say(self, message: str) -> None:
        self.bars.console.print(message, markup=False, highlight=False, soft_wrap=True)


def _work(make: Callable[[Report], None], core: int | None, log: Path, progress: Any) -> None:
    """What a process does: the piece, with its messages in its log, and its exit code."""
    if hasattr(os, "setsid"):
        os.setsid()  # Ctrl-C reaches the process once, from the pool
    if core is not None:
        os.sched_setaffinity(0, {core})
    with log.open("w", encoding="utf-8") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    try:
        make(lambda value: setattr(progress, "value", value))
    except JaxdemError as error:
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)
