"""The comparison as a short table for the terminal."""

from __future__ import annotations

import math

from rich.markup import escape
from rich.table import Table

from jaxdem.report.comparison import Comparison, Row
from jaxdem.report.findings import percent


def terminal_table(comparison: Comparison) -> Table:
    """Run, mesh, run time, mean error, final run-off and height, state: one line a run, the reference first.

    It fits 80 columns; why a run is unsound stands below the table.
    """
    noise = math.isfinite(comparison.noise_mean)
    every = (*comparison.rows, *comparison.noise_rows)
    reasons = [f"{escape(row.name)}: {escape(row.status)}" for row in every if not row.ranked]
    caption = "\n".join(["* on the Pareto front of error against run time", *reasons])
    title = f"Compared with {escape(comparison.reference.name)}"
    table = Table(title=title, caption=caption, caption_justify="left", pad_edge=False)
    table.add_column("run", overflow="fold")
    columns = [
        "cells",
        "time\n[s]",
        "error",
        *(["over\nnoise"] if noise else []),
        "run-off\n[m]",
        "height\n[m]",
    ]
    for column in columns:
        table.add_column(escape(column), justify="right", no_wrap=column == "cells")
    table.add_column("state", no_wrap=True)
    for row in every:
        table.add_row(*_line(row, noise), style=None if row.ranked else "red")
    return table


def _line(row: Row, noise: bool) -> list[str]:
    def value(number: float, pattern: str) -> str:
        return format(number, pattern) if math.isfinite(number) else "-"

    is_reference = row.role == "reference"
    error = "-" if is_reference or not math.isfinite(row.mean_error) else percent(row.mean_error)
    line = [escape(row.name), "x".join(str(n) for n in row.cells or ()) or "-"]
    line += [value(row.wall_time_s, ".3g" if row.wall_time_s < 1000 else ".0f"), error]
    if noise:
        line.append("-" if is_reference else value(row.error_over_noise, ".1f"))
    line += [value(row.final["runoff"], ".2f"), value(row.final["height"], ".2f")]
    return [*line, "ok *" if row.pareto else "ok" if row.ranked else "incomplete" if row.valid else "INVALID"]
