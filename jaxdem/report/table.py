"""The comparison as tables: comparison.csv, and a short one for the terminal."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from jaxdem.files.durable import write_bytes
from jaxdem.report import runs as read
from jaxdem.report.comparison import Comparison, Row
from jaxdem.report.findings import FRONT_MEANING, error_range, percent


def terminal_table(comparison: Comparison) -> Table:
    """Run, mesh, run and compile time, mean error with its range over packs, final run-off and height, state.

    It fits 80 columns. Where several runs are ranked, a star marks those on the Pareto front. The reason for which a
    run is not ranked is printed below the table.
    """
    noise, starred = math.isfinite(comparison.noise_mean), sum(row.ranked for row in comparison.runs) > 1
    packs = any(len(row.trials) > 1 for row in comparison.rows)
    unknown = "" if math.isfinite(comparison.error_noise) else "; the noise is not known"
    notes = [f"*: {FRONT_MEANING} (Pareto front){unknown}"] * starred
    notes += [f"{escape(row.name)}: {escape(row.status)}" for row in comparison.every if not row.ranked]
    table = Table(
        title=f"Compared with {escape(comparison.reference.name)}", caption="\n".join(notes), caption_justify="left",
        pad_edge=False, box=SIMPLE_HEAD, padding=(0, 1, 0, 0),
    )  # fmt: skip
    table.add_column("run", overflow="fold")
    columns = ["cells", "run\n[s]", "compile\n[s]", "error,\npacks" if packs else "error", *["over\nnoise"] * noise]
    for column in (*columns, "run-off\n[m]", "height\n[m]"):
        table.add_column(escape(column), justify="right", no_wrap=column == "cells")
    table.add_column("state", no_wrap=True)
    for row in comparison.every:
        state = "ok" if row.ranked else "incomplete" if row.valid else "INVALID"
        star = " *" if starred and row in comparison.front else ""
        table.add_row(*_line(row, comparison, noise), state + star, style=None if row.ranked else "red")
    return table


def _line(row: Row, comparison: Comparison, noise: bool) -> list[str]:
    def value(number: float, pattern: str) -> str:
        return format(number, pattern) if math.isfinite(number) else "-"

    is_reference = row.role == "reference"
    error = "-" if is_reference or not math.isfinite(row.mean_error) else percent(row.mean_error)
    line = [escape(row.name), "x".join(str(n) for n in row.cells or ()) or "-"]
    line += [value(time, ".3g" if time < 1000 else ".0f") for time in (row.run_time_s, row.compile_time_s)]
    line.append(f"{error}\n{error_range(row)}" if len(row.trials) > 1 else error)
    line += ["-" if is_reference else value(comparison.over_noise(row), ".1f")] * noise
    return [*line, value(row.final["runoff"], ".2f"), value(row.final["height"], ".2f")]


def write_csv(comparison: Comparison, path: Path) -> None:
    """comparison.csv: one row a run, the reference first, noise runs last; missing numbers are `nan`."""
    records = [_record(row, comparison) for row in comparison.every]
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, fieldnames=list(records[0]))
    writer.writeheader()
    writer.writerows(records)
    write_bytes(path, text.getvalue().encode())


def _record(row: Row, comparison: Comparison) -> dict[str, object]:
    noise = {"error_over_noise": comparison.over_noise(row)} if comparison.noise_rows else {}
    return {
        "name": row.name,
        "cells": "x".join(str(n) for n in row.cells or ()),
        "particle_count": int(row.particles) if math.isfinite(row.particles) else "",
        "closure_file": row.closure,
        "drag_law": row.drag,
        "precision": str(read.recorded(row.run, "precision", "precision") or ""),
        "contact_time_step": read.number(read.recorded(row.run, "time_steps.contact", "contact.time_step")),
        "wall_time_s": row.run_time_s + row.compile_time_s,
        "valid": "true" if row.valid else "false",
        **row.final,
        **{f"error_{name}": error for name, error in row.errors.items()},
        "mean_error": row.mean_error,
        **noise,
        "role": row.role,
        "status": row.status,
        "end_time": row.end_time,
        "compared_from": row.compared_from,
        "compared_until": row.compared_until,
        "metrics_counted": row.metrics_counted,
        "run_time_s": row.run_time_s,
        "compile_time_s": row.compile_time_s,
        "packs": len(row.trials),
        "mean_error_lowest": min(row.pack_errors),
        "mean_error_highest": max(row.pack_errors),
        "training_cost_s": row.training_cost_s,
        "pareto": "true" if row in comparison.front else "false",
        "path": str(row.run.path),
    }
