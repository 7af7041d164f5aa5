"""The comparison as a short table for the terminal."""

from __future__ import annotations

import math

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from jaxdem.report.comparison import Comparison, Row
from jaxdem.report.findings import error_range, percent


def terminal_table(comparison: Comparison) -> Table:
    """Run, mesh, run and compile time, mean error with its range over packs, final run-off and height, state.

    It fits 80 columns. The reason for which a run is not ranked is printed below the table.
    """
    noise = math.isfinite(comparison.noise_mean)
    packs = any(len(row.packs) > 1 for row in comparison.rows)
    every = (*comparison.rows, *comparison.noise_rows)
    reasons = [f"{escape(row.name)}: {escape(row.status)}" for row in every if not row.ranked]
    front = "*: on the Pareto front of error against run time"
    if not math.isfinite(comparison.error_noise):
        front += "; the noise is not known"
    caption = "\n".join([front, *reasons])
    title = f"Compared with {escape(comparison.reference.name)}"
    table = Table(
        title=title,
        caption=caption,
        caption_justify="left",
        pad_edge=False,
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    table.add_column("run", overflow="fold")
    columns = [
        "cells",
        "run\n[s]",
        "compile\n[s]",
        "error,\npacks" if packs else "error",
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
    line += [value(time, ".3g" if time < 1000 else ".0f") for time in (row.run_time_s, row.compile_time_s)]
    line.append(f"{error}\n{error_range(row)}" if len(row.packs) > 1 else error)
    if noise:
        line.append("-" if is_reference else value(row.error_over_noise, ".1f"))
    line += [value(row.final["runoff"], ".2f"), value(row.final["height"], ".2f")]
    return [*line, "ok *" if row.pareto else "ok" if row.ranked else "incomplete" if row.valid else "INVALID"]
