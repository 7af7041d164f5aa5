"""What the command line shows: messages, tables and progress bars."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NoReturn

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, ProgressColumn, SpinnerColumn, Task, TaskID, TextColumn
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from jaxdem.io import Run
    from jaxdem.report import Comparison
    from jaxdem.sweep import Sweep


def output() -> Console:
    """Console on standard output; tables are not wrapped to 80 columns in a file."""
    return Console() if sys.stdout.isatty() else Console(width=120)


def fail(message: str, code: int) -> NoReturn:
    """One message on standard error, and the exit code."""
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    console.print(Text.assemble(("jaxdem: ", "bold red"), message))
    raise typer.Exit(code)


def warn(message: str) -> None:
    """One line on standard error."""
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    console.print(Text.assemble(("jaxdem: ", "bold yellow"), message))


def print_run(result: Run) -> None:
    """Whether the run is valid, its run and compile time, the time by stage and its folder."""
    from jaxdem.metrics import compile_time, run_time

    summary = result.summary
    stages = summary.get("stages_s", {})
    marked = summary.get("estimated", ())
    parts = [
        f"{name} {seconds:.3g} s{' (estimated)' if name in marked else ''}"
        for name, seconds in stages.items()
        if seconds is not None and name != "compile"
    ]
    console = output()

    def line(label: str, text: str) -> None:
        console.print(f"{label:<10}{text}", markup=False, highlight=False, soft_wrap=True)

    line("valid", "yes" if summary.get("valid") else "no")
    line("run time", f"{run_time(summary):.3g} s, and {compile_time(summary):.3g} s compiling")
    line("stages", ", ".join(parts))
    line("output", str(result.path))


def fit_table(metadata: dict[str, Any]) -> Table:
    """R2 on held-out rows by coarsening."""
    table = Table(title="R2 on held-out rows", title_justify="left")
    names = ("closure", "base", "regression")
    headings = ("coarsening", "closure", metadata["base_law"], "regression", "out of range", "rows")
    for heading in headings:
        table.add_column(heading, justify="right")
    for coarsening, row in metadata["r2"].items():
        values = [f"{row[name]:.4f}" for name in names]
        table.add_row(str(coarsening), *values, f"{100 * row['out_of_range']:.2g} %", str(row["samples"]))
    return table


def print_comparison(comparison: Comparison) -> None:
    """The table, what to beware of, and where the page is."""
    from jaxdem.report import terminal_table

    console = output()
    console.print(terminal_table(comparison))
    for warning in comparison.warnings:
        console.print(f"Note: {warning}", markup=False, highlight=False, soft_wrap=True)
    console.print(f"Report: {comparison.files['html']}", markup=False, highlight=False, soft_wrap=True)


def print_sweep(sweep: Sweep) -> None:
    """One line a run: what was varied, whether it is valid, run time and metrics at the end; then where the table is."""
    from jaxdem.metrics import METRICS

    table = Table(title="Metrics at the end, SI", title_justify="left", pad_edge=False)
    shown = [m for m in METRICS if any(math.isfinite(run.final[m.name]) for run in sweep.runs)]
    for key in sweep.keys:
        table.add_column(escape(key), overflow="fold")
    for heading in ("valid", "run [s]", "compile [s]", *(metric.label for metric in shown)):
        table.add_column(escape(heading), justify="right")
    for run in sweep.runs:
        values = [escape(text) for text in run.texts.values()]
        state = "refused" if run.refused else "yes" if run.valid else "no"
        numbers = [run.run_time_s, run.compile_time_s, *(run.final[metric.name] for metric in shown)]
        cells = [f"{number:.3g}" if math.isfinite(number) else "-" for number in numbers]
        table.add_row(*values, state, *cells, style=None if run.valid else "red")
    console = output()
    console.print(table)
    for run in sweep.problems:
        console.print(f"{run.name}: {run.reason}", markup=False, highlight=False, soft_wrap=True)
    console.print(f"Table: {sweep.table}", markup=False, highlight=False, soft_wrap=True)


class _Rate(ProgressColumn):
    """Progress per second of wall time and the time left, counted from the first report."""

    def __init__(self, unit: str):
        super().__init__()
        self.unit = unit

    def render(self, task: Task) -> Text:
        """Text of the column."""
        rate = task.speed
        if not rate or task.total is None or task.finished or task.stop_time is not None:
            return Text("")
        left = (task.total - task.completed) / rate
        hours, rest = divmod(round(left), 3600)
        pace = f"{rate:.3g} {self.unit}/s  " if self.unit else ""
        return Text(f"{pace}{hours:d}:{rest // 60:02d}:{rest % 60:02d} left")


@contextmanager
def _bar(unit: str, pattern: str, waiting: str) -> Iterator[Callable[[float, float, str], None]]:
    """A progress bar; silent when standard output is not a terminal."""
    # The rate is a mean over the last minute, as far as there are not more than a thousand reports in it.
    with _progress(unit) as progress:
        task = progress.add_task(waiting, total=None)

        def report(done: float, end: float, note: str) -> None:
            if progress.disable:
                return
            progress.update(task, total=end, completed=done, description=pattern.format(done, end) + note)

        yield report


@contextmanager
def simulated_time() -> Iterator[Callable[[float, float], None]]:
    """Bar of a run: a function of the simulated time and the end [s]."""
    with _bar("s", "t = {:.4g} of {:g} s", "compiling") as report:
        yield lambda time, end: report(time, end, "")


@contextmanager
def counted(what: str) -> Iterator[Callable[..., None]]:
    """Bar of counted work: a function of the number done, the number in all and, for a fit, the loss."""
    with _bar(what, what + " {:g} of {:g}", "starting") as report:
        yield lambda done, total, loss=None: report(done, total, "" if loss is None else f", loss {loss:.4g}")


class StudyDisplay:
    """Shows the stages of a study: a bar each where standard output is a terminal, the messages always."""

    def __init__(self, progress: Progress):
        self._progress = progress
        self._task: TaskID | None = None
        self._pieces: dict[str, TaskID] = {}

    def stage(self, name: str, total: float) -> Callable[[float], None]:
        """A stage of the given length starts; the result is called with how much of it is done."""
        self._finish()
        task = self._task = self._progress.add_task(name, total=total)

        def advance(done: float) -> None:
            if not self._progress.disable:
                self._progress.update(task, completed=done)

        return advance

    def begin(self, name: str, total: float) -> Callable[[float], None]:
        """One of several pieces of work at once starts; its bar goes when it is over."""
        self._finish()
        task = self._pieces[name] = self._progress.add_task(name, total=total)
        return lambda done: self._progress.update(task, completed=done)

    def end(self, name: str) -> None:
        """That piece is over."""
        self._progress.remove_task(self._pieces.pop(name))

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
def study_display() -> Iterator[StudyDisplay]:
    """Display of a study; no bars where standard output is not a terminal."""
    with _progress("") as progress:
        yield StudyDisplay(progress)


def _progress(unit: str) -> Progress:
    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), _Rate(unit))
    return Progress(*columns, console=output(), speed_estimate_period=60.0, disable=not sys.stdout.isatty())
