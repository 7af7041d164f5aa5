"""What the figures of a comparison show: the metrics over time, and error against run time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from jaxdem.io.part_columns import is_of_a_part, unit_of
from jaxdem.metrics import METRICS
from jaxdem.report import runs as read
from jaxdem.report import style
from jaxdem.report.chart import Panel, Series, log_limits
from jaxdem.report.comparison import Comparison, Row
from jaxdem.report.runs import Array

OFF_SCALE = 3.0
"""An unsound run may stretch an axis by this factor; beyond, it leaves the panel, and the panel says so."""

STEADY = 2e-3
"""What changes by less than this part of its size is drawn on an axis of that length [-]."""

FRONT = "Pareto front: none is both faster and better"


def metrics_panels(rows: Sequence[Row]) -> list[Panel]:
    """The metrics that the runs have, over time, and what the parts of their scenes have put beside them; an unsound
    run ends in a cross. Metrics without meaning in the box are left out; `left_out` says why. So are further columns
    that have one value in all runs throughout, such as a pressure gradient that is given.
    """
    labels = {metric.name: f"{metric.label} [{metric.unit}]" for metric in METRICS}
    for name in dict.fromkeys(name for row in rows for name in row.history if is_of_a_part(name)):
        labels[name] = name.replace("_", " ") + (f" [{unit}]" if (unit := unit_of(name)) else "")
    panels = [panel for name, label in labels.items() if (panel := _history_panel(name, label, rows))]
    return panels or [Panel("time [s]", "", note="no output yet")]


def left_out(rows: Sequence[Row]) -> str:
    """A sentence on the metrics that the runs have and that tell nothing in their box; empty without any."""
    reasons = {
        metric.label: why
        for row in rows
        for metric in METRICS
        if _has(row.run.history, metric.name) and (why := read.without_meaning(row.run).get(metric.name))
    }
    listed = ", ".join(f"{label} ({why})" for label, why in reasons.items())
    return f"Left out: {listed}." if listed else ""


def _history_panel(name: str, y_label: str, rows: Sequence[Row]) -> Panel | None:
    """A column of the history; None for one that no run has."""
    shown = [(row, row.history[name]) for row in rows if _has(row.history, name)]
    if not shown or (is_of_a_part(name) and _is_one_value([values for _, values in shown])):
        return None
    series = []
    # Noise runs lie behind the others.
    for row, values in sorted(shown, key=lambda pair: pair[0].role != "noise"):
        label = "reference, other packs" if row.role == "noise" else row.label
        times, look = row.history["time"], row.look
        series.append(Series(label, times, values, look.color, look.dash, look.width))
        if not row.ranked and row.role != "noise":
            last = [np.flatnonzero(np.isfinite(values))[-1]]
            series.append(Series("end of an unsound run", times[last], values[last], style.INVALID, marker="x"))
    every = [values for _, values in shown]
    limits = sound_limits([values for row, values in shown if row.ranked], every)
    note = "an unsound run leaves this panel" if limits else ""
    if limits is None and "temperature" not in name:  # of which a thousandth may be what counts
        limits = steady_limits(every)
    return Panel("time [s]", y_label, series, y_limits=limits, note=note)


def _is_one_value(columns: Sequence[Array]) -> bool:
    """Whether all numbers in some columns are the same; empty entries do not count."""
    numbers = np.concatenate(columns)
    numbers = numbers[np.isfinite(numbers)]
    return not numbers.size or bool(numbers.min() == numbers.max())


def _has(history: dict[str, Array] | None, name: str) -> bool:
    return bool(np.isfinite((history or {}).get(name, ())).any())


def sound_limits(sound: Sequence[Array], every: Sequence[Array]) -> tuple[float, float] | None:
    """Axis limits by the sound runs, where an unsound one would flatten all others; None where none would."""
    inner, outer = (np.concatenate([np.empty(0), *columns]) for columns in (sound, every))
    inner, outer = inner[np.isfinite(inner)], outer[np.isfinite(outer)]
    if not len(inner) or len(inner) == len(outer) or np.ptp(outer) <= OFF_SCALE * np.ptp(inner):
        return None
    margin = 0.08 * (np.ptp(inner) or abs(inner[0]) or 1.0)
    return float(inner.min() - margin), float(inner.max() + margin)


def steady_limits(every: Sequence[Array]) -> tuple[float, float] | None:
    """Axis limits where nothing changes by more than `STEADY`, so that its last digits do not fill the panel; else
    None."""
    values = np.concatenate([np.empty(0), *every])
    values = values[np.isfinite(values)]
    largest = float(np.abs(values).max(initial=0.0))
    if not len(values) or np.ptp(values) >= STEADY * largest:
        return None
    middle = 0.5 * float(values.min() + values.max())
    return middle - 0.5 * STEADY * largest, middle + 0.5 * STEADY * largest


def error_panel(comparison: Comparison) -> Panel:
    """Mean error against run time, both logarithmic: runs, their packs and training, noise, reference, Pareto front.

    Of a run with several packs there are bars over the range of both, and a small point for each.

    An error of zero is drawn at half of the smallest other one.
    """
    points = [row for row in comparison.runs if row.run_time_s > 0 and math.isfinite(row.mean_error)]
    axes = ("run time [s]", "mean relative error over the metrics [-]")
    if not points:
        return Panel(*axes, note="no run has both a run time and an error")
    floor = 0.5 * min((row.mean_error for row in points if row.mean_error > 0), default=1e-3)
    marks = [mark for row in points for mark in _marks(row, floor)]
    reference, noise = comparison.reference.run_time_s, comparison.noise_mean
    times = log_limits([time for mark in marks for time in mark.x] + [reference] * (reference > 0))
    errors = log_limits([error for mark in marks for error in mark.y] + [noise] * (noise > 0))
    lines = []
    front = [row for row in comparison.front if row in points]
    if len(front) > 1:
        xy = [row.run_time_s for row in front], [max(row.mean_error, floor) for row in front]
        lines.append(Series(FRONT, *xy, "#555555", "solid", 1.0, steps=True))
    if noise > 0:
        lines.append(Series("noise", times, [noise, noise], style.NOISE, "solid"))
    if reference > 0:
        name = "time of the reference (error 0)"
        lines.append(Series(name, [reference, reference], errors, style.REFERENCE, "solid", 1.2))
    return Panel(*axes, [*lines, *marks], times, errors, logarithmic=True)


def _marks(row: Row, floor: float) -> Iterator[Series]:
    """The point of a run, smaller ones for its packs, and a hollow one that adds its training."""
    look, time, error = row.look, row.run_time_s, max(row.mean_error, floor)
    name = row.label + (" (error 0, drawn at the edge)" if row.mean_error == 0 else "")
    known = [f"{m.label} {100 * row.errors[m.name]:.3g} %" for m in METRICS if math.isfinite(row.errors[m.name])]
    note = "\n".join([f"{row.cells_text} cells, {row.status}", *known])
    if row.training_cost_s > 0:
        total, label = time + row.training_cost_s, f"{row.name}, with training"
        yield Series(label, [time, total], [error, error], look.color, "dot", 1.4, look.marker, 9.0, hollow=True)
    yield Series(name, [time], [error], look.color, marker=look.marker if row.ranked else "x", note=note)
    if len(row.trials) > 1:
        x, y = zip(*((trial.run_time_s, max(trial.mean_error, floor)) for trial in row.trials), strict=True)
        yield Series(name, [time, time], [min(y), max(y)], look.color, "solid", 1.6)
        yield Series(name, [min(x), max(x)], [error, error], look.color, "solid", 1.6)
        yield Series(name, x, y, look.color, marker="circle", size=4.0, note="one pack")
