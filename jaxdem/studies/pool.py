"""Pieces of work shared among processes, each on a core of its own, those first that nothing has to wait for.

A piece that fails is noted; what needs it is not begun, everything else is done. At SIGINT or SIGTERM the processes
are asked to stop, leave their checkpoints, and the pool ends.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time as clock
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from jaxdem.run.signals import noted_signals
from jaxdem.run.simulate import Interrupted
from jaxdem.studies.work import CORE

POLL = 0.2
"""Time after which the pool looks for a signal [s]."""


class Bars(Protocol):
    """Who shows how far the pieces are; the command line draws a bar for each."""

    def begin(self, name: str, total: float) -> Callable[[float], None]:
        """A piece of the given length starts; the result is called with how much of it is done."""
        ...

    def end(self, name: str) -> None:
        """A piece is over."""
        ...

    def say(self, message: str) -> None:
        """A line for the reader."""
        ...


@dataclasses.dataclass(frozen=True)
class Piece:
    """One piece of work.

    Attributes:
        name: shown, and of the log file.
        work: what `studies.work` is told; "kind" and what that kind needs.
        total: how long it is, in its own unit: simulated time, epochs, samples.
        needs: names of pieces that must be done before.
        done: whether there is nothing to do.
    """

    name: str
    work: Mapping[str, Any]
    total: float
    needs: tuple[str, ...] = ()
    done: bool = False


@dataclasses.dataclass
class _Running:
    piece: Piece
    process: subprocess.Popen[str]
    core: int | None
    advance: Callable[[float], None]
    word: dict[str, Any] = dataclasses.field(default_factory=dict)
    begin: float = dataclasses.field(default_factory=clock.perf_counter)


class Pool:
    """Does pieces of work in processes.

    Args:
        jobs: number of processes at once; each is bound to a core where there is more than one.
        logs: folder for what the processes write to standard error.
        bars: shows how it goes on.
        command: of a process, which reads the work as JSON.
    """

    def __init__(self, jobs: int, logs: Path, bars: Bars, command: Sequence[str] | None = None):
        self.jobs, self.logs, self.bars = jobs, logs, bars
        self.command = list(command or (sys.executable, "-m", "jaxdem.studies.work"))
        self.problems: dict[str, str] = {}
        self._told: queue.Queue[tuple[_Running, dict[str, Any] | None]] = queue.Queue()
        self._running: list[_Running] = []
        self._cores: list[int | None] = [None] * jobs
        if jobs > 1 and hasattr(os, "sched_getaffinity"):
            cores = sorted(os.sched_getaffinity(0))
            self._cores = [cores[i % len(cores)] for i in range(jobs)]

    def do(self, pieces: Sequence[Piece]) -> dict[str, str]:
        """Do all pieces; returns why not, by name, for those that are not done.

        Raises:
            Interrupted: SIGINT or SIGTERM; the processes have stopped.
        """
        self.logs.mkdir(parents=True, exist_ok=True)
        done = {piece.name for piece in pieces if piece.done}
        waiting = [piece for piece in pieces if not piece.done]
        with noted_signals() as caught:
            try:
                while (waiting or self._running) and not caught:
                    waiting = self._skip(waiting)
                    self._start(waiting, done)
                    self._listen(done)
            finally:
                self._stop(caught)
        if caught:
            raise Interrupted(caught[0], 0.0)
        return self.problems

    def _skip(self, waiting: list[Piece]) -> list[Piece]:
        """The pieces without those that need one that failed."""
        kept = []
        for piece in waiting:
            failed = [name for name in piece.needs if name in self.problems]
            if failed:
                self.problems[piece.name] = f"needs {', '.join(failed)}"
            else:
                kept.append(piece)
        return kept

    def _start(self, waiting: list[Piece], done: set[str]) -> None:
        """Start what may start, as far as there are cores."""
        for piece in list(waiting):
            if not self._cores:
                return
            if set(piece.needs) <= done:
                waiting.remove(piece)
                self._launch(piece, self._cores.pop(0))

    def _launch(self, piece: Piece, core: int | None) -> None:
        # One thread: two processes on a core each do twice the work of one on both.
        environment = {**os.environ, "PJRT_NPROC": "1", "OMP_NUM_THREADS": "1"} if core is not None else {**os.environ}
        if core is not None:
            environment[CORE] = str(core)
        with (self.logs / f"{piece.name}.log").open("w", encoding="utf-8") as log:
            # A session of its own: Ctrl-C reaches the processes once, from here.
            process = subprocess.Popen(
                self.command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, text=True, env=environment,
                start_new_session=True,
            )  # fmt: skip
        running = _Running(piece, process, core, self.bars.begin(piece.name, piece.total))
        self._running.append(running)
        assert process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            process.stdin.write(json.dumps(dict(piece.work)))
            process.stdin.close()
        threading.Thread(target=self._read, args=(running,), daemon=True).start()

    def _read(self, running: _Running) -> None:
        assert running.process.stdout is not None
        for line in running.process.stdout:
            with contextlib.suppress(json.JSONDecodeError):
                self._told.put((running, json.loads(line)))
        running.process.wait()
        self._told.put((running, None))

    def _listen(self, done: set[str]) -> None:
        """Take one word of a process, if there is one soon."""
        try:
            running, word = self._told.get(timeout=POLL)
        except queue.Empty:
            return
        if word is None:
            self._finish(running, done)
        elif "done" in word:
            running.advance(word["done"])
        else:
            running.word = word

    def _finish(self, running: _Running, done: set[str]) -> None:
        name = running.piece.name
        self._running.remove(running)
        self._cores.insert(0, running.core)
        self.bars.end(name)
        if running.word.get("finished"):
            done.add(name)
            self.bars.say(f"{name}: done after {clock.perf_counter() - running.begin:.0f} s")
        elif "stopped" not in running.word:
            self.problems[name] = running.word.get("failed") or self._last_line(name)
            self.bars.say(f"{name}: failed. {self.problems[name]}")
        else:
            self.problems[name] = f"stopped by signal {running.word['stopped']}"

    def _last_line(self, name: str) -> str:
        log = self.logs / f"{name}.log"
        lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        return f"{lines[-1] if lines else 'ended without a word'} (see {log})"

    def _stop(self, caught: list[int]) -> None:
        """Ask the processes that are left to stop, and wait for them."""
        for running in self._running:
            with contextlib.suppress(ProcessLookupError):
                running.process.send_signal(caught[0] if caught else signal.SIGTERM)
        for running in self._running:
            running.process.wait()
            self.bars.end(running.piece.name)
