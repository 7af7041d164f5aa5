"""Comparison of runs with a reference: the nine metrics, error against run time, snapshots, one HTML page.

Example:
    >>> comparison = compare(load_run("runs/fine"), [load_run("runs/coarse")], Path("runs/report"))  # doctest: +SKIP
    >>> rich.print(terminal_table(comparison))  # doctest: +SKIP
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jaxdem.errors import InputError
from jaxdem.report import comparison as numbers
from jaxdem.report import figures, findings, page, snapshots, style
from jaxdem.report.comparison import Comparison, Entry, Row
from jaxdem.report.runs import RunLike, history_until
from jaxdem.report.table import terminal_table

__all__ = ["Comparison", "Row", "compare", "terminal_table"]


def compare(
    reference: RunLike,
    runs: Sequence[RunLike],
    out: Path,
    *,
    names: Sequence[str] | None = None,
    noise: Sequence[RunLike] = (),
    packs: Mapping[str, Sequence[RunLike]] | None = None,
    parity: Mapping[str, Mapping[str, Any]] | None = None,
    training_cost: Mapping[str, float] | None = None,
    notes: Sequence[str] = (),
    sections: Sequence[page.PageSection] = (),
    until: float | None = None,
    title: str = "Comparison of runs",
) -> Comparison:
    """Compare runs with a reference and write report.html, comparison.csv and PNG files into a directory.

    A run that is invalid or ended early is shown and marked everywhere, and stays off the Pareto front. Runs of
    different length are compared over the span each shares with the reference.

    Args:
        reference, runs: as `jaxdem.load_run` gives them; at least one run.
        out: directory, made if missing; files of the same names are replaced.
        names: one a run, or one more with the reference's first; by default their directories' names.
        noise: runs of the reference that differ in a jitter of the pack alone: the noise floor.
        packs: name of a run -> the same run with other packs; its errors are means over all of them, its scatter is shown.
        parity: name -> {predicted, target, base}, each (M, D) [N]; `base` may be missing.
        training_cost: name of a run -> time spent to train its closure [s].
        notes: sentences for the page.
        sections: tables of one's own for the page, after the notes.
        until: nothing after this time is compared [s], e.g. when the front reaches the outlet.
        title: of the page.

    Returns:
        The figures, the findings in words, and where the files are.

    Raises:
        InputError: no run, names that are too few or equal, training cost or packs of an unknown run, a history whose times
            do not increase, parity arrays of unlike shape.
    """
    if not runs:
        raise InputError("runs", list(runs), "needs at least one run", "Name a run to compare with the reference.")
    chosen = numbers.choose_names(reference, runs, names)
    cost = {name: float(seconds) for name, seconds in (training_cost or {}).items()}
    for key, given in (("training_cost", cost), ("packs", packs or {})):
        if unknown := [name for name in given if name not in chosen[1:]]:
            limit = f"must have names of runs: {', '.join(chosen[1:])}"
            raise InputError(key, unknown, limit, "Use the names of the runs.")
    figures.check_parity(parity or {})
    roles = ["reference"] + ["run"] * len(runs)
    more = {name: tuple((run, history_until(run, until)) for run in others) for name, others in (packs or {}).items()}
    entries = [
        Entry(name, role, run, history_until(run, until), more.get(name, ()))
        for name, role, run in zip(chosen, roles, (reference, *runs), strict=True)
    ]
    jittered = [Entry(f"noise {i}", "noise", run, history_until(run, until)) for i, run in enumerate(noise, start=1)]
    result = numbers.build(entries[0], entries[1:], jittered, cost, until)
    result.sentences = findings.sentences(result)
    result.warnings = findings.warnings(result, [*entries, *jittered], until)
    result.notes = list(notes)
    _write(title, result, entries, jittered, parity, Path(out), sections)
    return result


def _write(
    title: str,
    result: Comparison,
    entries: list[Entry],
    jittered: list[Entry],
    parity: Mapping[str, Mapping[str, Any]] | None,
    out: Path,
    sections: Sequence[page.PageSection],
) -> None:
    """All files; `result.files` names them."""
    out.mkdir(parents=True, exist_ok=True)
    looks = style.styles([entry.name for entry in entries])
    every = [*entries, *jittered]
    files = result.files
    files["csv"] = out / "comparison.csv"
    numbers.write_csv(result, files["csv"])
    files["metrics"] = figures.metrics_figure(every, result, looks, out / "metrics.png")
    files["error_vs_time"] = figures.error_figure(result, looks, out / "error_vs_time.png")
    if shot := snapshots.snapshots_figure(entries, result, looks, out / "snapshots.png"):
        files["snapshots"] = shot
    if parity:
        files["parity"] = figures.parity_figure(parity, out / "parity.png")
    files["html"] = out / "report.html"
    page.write_page(title, result, every, looks, files["html"], sections)
