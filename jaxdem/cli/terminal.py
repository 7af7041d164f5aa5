"""What the command line shows: messages and tables. Rich is imported when something is shown: `--help` does without."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NoReturn

import typer

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from jaxdem.foreign.notes import Note
    from jaxdem.io import Run
    from jaxdem.report import Comparison
    from jaxdem.run.sweep import Sweep


_told: list[Callable[[str], None]] = []


def tell_through(report: Callable[[str], None]) -> None:
    """Nothing is shown from now on: another process of the run shows it. Messages of errors go to `report`."""
    _told[:] = [report]


def show(content: RenderableType) -> None:
    """A table, or another thing that rich can draw, on standard output."""
    if _told:
        return
    from jaxdem.cli.console import output

    output().print(content)


def line(text: str) -> None:
    """A line as it is on standard output, however long."""
    if _told:
        return
    from jaxdem.cli.console import output

    output().print(text, markup=False, highlight=False, soft_wrap=True)


def fail(message: str, code: int) -> NoReturn:
    """One message on standard error, and the exit code."""
    if _told:
        _told[0](message)
        raise typer.Exit(code)
    from rich.text import Text

    from jaxdem.cli.console import errors

    errors().print(Text.assemble(("jaxdem: ", "bold red"), message))
    raise typer.Exit(code)


def warn(message: str) -> None:
    """One line on standard error."""
    if _told:
        return
    from rich.text import Text

    from jaxdem.cli.console import errors

    errors().print(Text.assemble(("jaxdem: ", "bold yellow"), message))


def print_run(result: Run) -> None:
    """Whether the run is valid, its times, its folder, and how often the drag law was asked outside its range."""
    from jaxdem.io.energy import energy_text
    from jaxdem.metrics import compile_time, run_time

    summary = result.summary
    stages = summary.get("stages_s", {})
    marked = summary.get("estimated", ())
    parts = [
        f"{name} {seconds:.3g} s{' (estimated)' if name in marked else ''}"
        for name, seconds in stages.items()
        if seconds and name != "compile"
    ]
    rows = {
        "valid": "yes" if summary.get("valid") else "no",
        "run time": f"{run_time(summary):.3g} s, plus {compile_time(summary):.3g} s for compilation",
        "stages": ", ".join(parts),
        "output": str(result.path),
    }
    closure = summary.get("closure", {})
    outside = closure.get("out_of_range_fraction", 0.0)
    if outside > 0.0 or closure.get("file"):
        rows["drag"] = f"{100.0 * outside:.2g} % of its evaluations outside the range of the law"
    if merge := summary.get("start", {}).get("merged"):
        rows["merged"] = merge_text(merge)
    if told := energy_text(summary.get("energy", {})):
        rows["energy"] = told
    for label, text in [*rows.items(), *(("not read", sentence) for sentence in summary.get("unread_keys", ()))]:
        line(f"{label:<10}{text}")


def merge_text(told: Any) -> str:
    """What a merge of particles into parcels took, in a line."""
    text = f"{told['particles']} particles into {told['parcels']} parcels, {told['to_one']:.6g} to one"
    if told["left_out_particles"]:
        text += f"; {told['left_out_particles']:.6g} left out ({told['left_out_mass']:.4g} kg)"
    text += f"; energy {told['energy_before']:.4g} J before, {told['energy_after']:.4g} J after"
    if "largest_move" in told:
        text += f"; moved by {told['mean_move']:.3g} m in the mean, {told['largest_move']:.3g} m at most"
    return f"{text}; springs of contacts begin at rest"


def fit_table(metadata: dict[str, Any]) -> Table:
    """R2 on held-out rows by coarsening."""
    from rich.table import Table

    table = Table(title="R2 on held-out rows", title_justify="left")
    names = ("closure", "base", "regression")
    headings = ("coarsening", "closure", metadata["base_law"], "regression", "out of range", "rows")
    for heading in headings:
        table.add_column(heading, justify="right")
    for coarsening, row in metadata["r2"].items():
        values = [f"{row[name]:.4f}" for name in names]
        table.add_row(str(coarsening), *values, f"{100 * row['out_of_range']:.2g} %", str(row["samples"]))
    return table


def sphere_table(scores: dict[str, dict[str, Any]], linear: dict[str, dict[str, Any]] | None = None) -> Table:
    """R2 of the fluctuations by Re and solid fraction, of a closure of neighbours and of pairwise least squares."""
    from rich.table import Table

    compared = () if linear is None else ("along", "across", "torque")
    table = Table(title="R2 of the fluctuations of force and torque", title_justify="left")
    table.add_column("group")
    headings = ("arrays", "along", "across", "torque", "mean factor", *(f"pairwise {name}" for name in compared))
    for heading in headings:
        table.add_column(heading, justify="right")
    for name, row in scores.items():
        values = [f"{row[key]:.3f}" for key in ("along", "across", "torque")]
        others = [f"{linear[name][key]:.3f}" for key in compared] if linear is not None else []
        table.add_row(name, str(row["arrays"]), *values, f"{row['mean_factor']:.4f}", *others)
    return table


def show_import(notes: list[Note]) -> None:
    """What became of every line of a deck."""
    for note in notes:
        line(f"{note.kind:<10}{note.place}: {note.text}")
        line(f"{'':<10}{note.reason}")
    kinds = dict.fromkeys(note.kind for note in notes)
    line(", ".join(f"{kind}: {sum(note.kind == kind for note in notes)}" for kind in kinds))


def print_comparison(comparison: Comparison) -> None:
    """The table, the warnings, and the place of the page."""
    from jaxdem.report import terminal_table

    show(terminal_table(comparison))
    for warning in comparison.warnings:
        line(f"Note: {warning}")
    line(f"Report: {comparison.files['html']}")


def print_sweep(sweep: Sweep) -> None:
    """One line a run: what was varied, whether it is valid, run time and metrics at the end; then the table's place."""
    from rich.box import SIMPLE
    from rich.markup import escape
    from rich.table import Table

    from jaxdem.metrics import METRICS

    table = Table(title="Metrics at the end, SI", title_justify="left", pad_edge=False, box=SIMPLE)
    shown = [m for m in METRICS if any(math.isfinite(run.final[m.name]) for run in sweep.runs)]
    for key in sweep.keys:
        table.add_column(escape(key), overflow="fold")
    for heading in ("valid", "run [s]", "compile [s]", *(metric.label for metric in shown)):
        table.add_column(escape(heading), justify="right", overflow="fold")
    for run in sweep.runs:
        values = [escape(text) for text in run.texts.values()]
        state = "refused" if run.refused else "yes" if run.valid else "no"
        numbers = [run.run_time_s, run.compile_time_s, *(run.final[metric.name] for metric in shown)]
        cells = [f"{number:.3g}" if math.isfinite(number) else "-" for number in numbers]
        table.add_row(*values, state, *cells, style=None if run.valid else "red")
    show(table)
    for run in sweep.problems:
        line(f"{run.name}: {run.reason}")
    line(f"Table: {sweep.table}")
