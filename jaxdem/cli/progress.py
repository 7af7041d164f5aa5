"""How long work goes on: bars where standard output is a terminal, else now and then a line on standard error."""

from __future__ import annotations

import sys
import threading
import time as clock
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, Progress, ProgressColumn, SpinnerColumn, Task, TaskID, TextColumn
from rich.text import Text

from jaxdem.cli.console import output
from jaxdem.errors import visible

PAUSE = 60.0
"""Time between two lines of a log [s]."""


class Pace:
    """How fast work goes and how long it still takes, by what was reported in the last minute.

    Counting begins anew with another end and where a report is no further than the one before: then something else was
    done in between, such as compiling for a longer neighbour list, and its time says nothing about the rest.
    """

    def __init__(self, unit: str):
        self._unit, self._end = unit, 0.0
        self._seen: deque[tuple[float, float]] = deque()

    def report(self, done: float, end: float) -> None:
        """So much of the work is done."""
        if end != self._end or (self._seen and done <= self._seen[-1][1]):
            self._seen.clear()
        now = clock.monotonic()
        while len(self._seen) > 1 and self._seen[1][0] < now - PAUSE:
            self._seen.popleft()
        self._end = end
        self._seen.append((now, done))

    def text(self) -> str:
        """Rate and time left; empty as long as they are not known."""
        seen, end = tuple(self._seen), self._end  # another thread may report meanwhile
        if not seen:
            return ""
        (since, start), (until, done) = seen[0], seen[-1]
        if done <= start or until <= since or done >= end:
            return ""
        rate = (done - start) / (until - since)
        hours, rest = divmod(round((end - done) / rate), 3600)
        speed = f"{rate:.3g} {self._unit}/s  " if self._unit else ""
        return f"{speed}{hours:d}:{rest // 60:02d}:{rest % 60:02d} left"


class _Rate(ProgressColumn):
    """The pace of a task."""

    def render(self, task: Task) -> Text:
        """Text of the column."""
        return Text("" if task.finished or task.stop_time is not None else task.fields["pace"].text())


class Lines:
    """Lines of a log: what is under way, how far it is, and how long it still takes.

    A thread writes them, so that work that does not report, such as compiling, is told of too.
    """

    def __init__(self, unit: str, what: str, silent: bool = False):
        self._unit, self._what, self._silent = unit, what, silent
        self._pace = Pace(unit)
        self._over = threading.Event()

    def __enter__(self) -> Lines:
        if not self._silent:
            threading.Thread(target=self._write, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()

    def begin(self, what: str) -> None:
        """Other work is under way."""
        self._what, self._pace = what, Pace(self._unit)

    def report(self, done: float, end: float, what: str) -> None:
        """So much of the work is done."""
        self._what = what
        self._pace.report(done, end)

    def text(self) -> str:
        """The line."""
        return ", ".join(filter(None, (self._what, self._pace.text())))

    def _write(self) -> None:
        while not self._over.wait(PAUSE):
            try:
                print(f"jaxdem: {visible(self.text())}", file=sys.stderr, flush=True)
            except (OSError, ValueError):
                return  # nobody listens


@contextmanager
def _bar(unit: str, pattern: str, waiting: str, quiet: bool) -> Iterator[Callable[[float, float, str], None]]:
    """A function that is told how far the work is."""
    bar = sys.stdout.isatty() and not quiet
    with _progress(bar) as progress, Lines(unit, waiting, silent=bar or quiet) as lines:
        pace = Pace(unit)
        task = progress.add_task(waiting, total=None, pace=pace)

        def report(done: float, end: float, note: str) -> None:
            what = pattern.format(done, end) + note
            if bar:
                pace.report(done, end)
                progress.update(task, total=end, completed=done, description=what)
            else:
                lines.report(done, end, what)

        yield report


@contextmanager
def simulated_time(quiet: bool = False) -> Iterator[Callable[..., None]]:
    """Progress of a run: a function of the simulated time, the end [s], and a note."""
    with _bar("s", "t = {:.4g} of {:g} s", "preparing and compiling", quiet) as report:
        yield lambda time, end, note="": report(time, end, note)


@contextmanager
def counted(what: str, quiet: bool = False) -> Iterator[Callable[..., None]]:
    """Progress of counted work: a function of the number done, the number in all and, for a fit, the loss."""
    with _bar(what, what + " {:g} of {:g}", "starting", quiet) as report:
        yield lambda done, total, loss=None: report(done, total, "" if loss is None else f", loss {loss:.4g}")


class StudyDisplay:
    """Shows the stages of a study: a bar each where standard output is a terminal, the messages always."""

    def __init__(self, progress: Progress, lines: Lines):
        self._progress, self._lines = progress, lines
        self._task: TaskID | None = None

    def stage(self, name: str, total: float) -> Callable[[float], None]:
        """A stage of the given length starts; the result is called with how much of it is done."""
        self._finish()
        pace = Pace("")
        task = self._task = self._progress.add_task(name, total=total, pace=pace)
        self._lines.begin(name)

        def advance(done: float) -> None:
            if self._progress.disable:
                self._lines.report(done, total, f"{name}, {done / total:.0%}")
            else:
                pace.report(done, total)
                self._progress.update(task, completed=done)

        return advance

    def say(self, message: str) -> None:
        """A line for the reader."""
        self._finish()
        self._progress.console.print(message, markup=False, highlight=False, soft_wrap=True)

    def _finish(self) -> None:
        """A stage that is over has no time left to show."""
        if self._task is not None:
            self._progress.stop_task(self._task)
            self._task = None


@contextmanager
def study_display(quiet: bool = False) -> Iterator[StudyDisplay]:
    """Display of a study; no bars where standard output is not a terminal."""
    bar = sys.stdout.isatty() and not quiet
    with _progress(bar) as progress, Lines("", "starting", silent=bar or quiet) as lines:
        yield StudyDisplay(progress, lines)


def _progress(shown: bool) -> Progress:
    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), BarColumn(), _Rate())
    return Progress(*columns, console=output(), disable=not shown)
