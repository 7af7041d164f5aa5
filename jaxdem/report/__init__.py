"""Comparison of runs with a reference: the nine metrics, error against run time, snapshots, one HTML page.

Example:
    >>> comparison = compare(load_run("runs/fine"), [load_run("runs/coarse")], Path("runs/report"))  # doctest: +SKIP
    >>> rich.print(terminal_table(comparison))  # doctest: +SKIP
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from jaxdem.io import Run
from jaxdem.report import chart, figures, findings, snapshots
from jaxdem.report.comparison import Candidate, Comparison, Row, build
from jaxdem.report.page import Page, write_page
from jaxdem.report.parity import check_parity, parity_figure
from jaxdem.report.probes import probe_panels
from jaxdem.report.table import terminal_table, write_csv

__all__ = ["Candidate", "Comparison", "Page", "Row", "compare", "terminal_table"]


def compare(
    reference: Run | Candidate,
    runs: Sequence[Run | Candidate],
    out: Path,
    *,
    noise: Sequence[Run] = (),
    until: float | None = None,
    page: Page | None = None,
) -> Comparison:
    """Compare runs with a reference and write report.html, comparison.csv and PNG files into a directory.

    A run that is invalid or ended early is shown and marked everywhere, and stays off the Pareto front. Runs of
    different length are compared over the span each shares with the reference.

    Args:
        reference, runs: as `jaxdem.load_run` gives them, or with a name, other packs and the cost of training; at least
            one run.
        out: directory, made if missing; files of the same names are replaced.
        noise: runs of the reference that differ in the random numbers of the pack alone: the noise floor.
        until: nothing after this time is compared [s], e.g. when the front reaches the outlet.
        page: what the page has beside the comparison.

    Returns:
        The figures, the findings in words, and where the files are.

    Raises:
        InputError: no run, two of one name, a reference without outputs, a history whose times do not increase, parity
            arrays of unlike shape.
    """
    page = page or Page()
    check_parity(page.parity)
    candidates = [run if isinstance(run, Candidate) else Candidate(run) for run in (reference, *runs)]
    result = build(candidates[0], candidates[1:], noise, until)
    result.sentences, result.warnings = findings.sentences(result), findings.warnings(result)
    result.warnings += filter(None, [figures.left_out(result.every)])
    _write(result, page, Path(out))
    return result


def _write(result: Comparison, page: Page, out: Path) -> None:
    """All files; `result.files` names them."""
    out.mkdir(parents=True, exist_ok=True)
    error, metrics, files = figures.error_panel(result), figures.metrics_panels(result.every), result.files
    files["csv"] = out / "comparison.csv"
    write_csv(result, files["csv"])
    files["metrics"] = chart.write_png(metrics, out / "metrics.png", figures.left_out(result.every))
    probes = probe_panels(result.every)
    if probes:
        files["probes"] = chart.write_png(probes, out / "probes.png")
    files["error_vs_time"] = chart.write_png([error], out / "error_vs_time.png")
    if shot := snapshots.snapshots_figure(result, out / "snapshots.png"):
        files["snapshots"] = shot
    if page.parity:
        files["parity"] = parity_figure(page.parity, out / "parity.png")
    files["html"] = out / "report.html"
    write_page(page, result, error, metrics, probes, files["html"])
