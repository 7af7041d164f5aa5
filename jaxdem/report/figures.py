"""Still figures of numbers: metrics over time, error against run time, parity of a closure."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import FigureBase
from matplotlib.lines import Line2D

from jaxdem.errors import InputError
from jaxdem.metrics import METRICS, Metric
from jaxdem.report import style
from jaxdem.report.comparison import Comparison, Entry, Row
from jaxdem.report.runs import Array
from jaxdem.report.style import RunStyle

OFF_SCALE = 3.0
"""An unsound run may stretch an axis by this factor; beyond, it leaves the panel, and the panel says so."""


def metrics_figure(
    entries: Sequence[Entry], comparison: Comparison, styles: Mapping[str, RunStyle], path: Path
) -> Path:
    """metrics.png: the nine metrics over time, all runs; noise runs thin and grey, unsound runs end in a cross."""
    rows = {row.name: row for row in (*comparison.rows, *comparison.noise_rows)}
    with style.look():
        handles = _legend_handles(comparison, styles)
        columns = style.legend_columns([str(handle.get_label()) for handle in handles], 12.0)
        figure = style.new_figure(12.5, 9.0 + style.LEGEND_LINE * math.ceil(len(handles) / columns))
        metrics_panels(figure, METRICS, entries, rows, styles)
        figure.legend(handles=handles, loc="outside lower center", ncols=columns)
        return style.save(figure, path)


def metrics_panels(
    figure: FigureBase,
    metrics: Sequence[Metric],
    entries: Sequence[Entry],
    rows: Mapping[str, Row],
    styles: Mapping[str, RunStyle],
) -> list[Axes]:
    """Metrics over time in up to three columns, all entries in each panel."""
    columns = min(3, len(metrics))
    lines = math.ceil(len(metrics) / columns)
    axes = [figure.add_subplot(lines, columns, number + 1) for number in range(len(metrics))]
    for number, (axis, metric) in enumerate(zip(axes, metrics, strict=True)):
        if number:
            axis.sharex(axes[0])
        drawn = [_line(axis, entry, metric.name, rows[entry.name], styles) for entry in entries]
        axis.set_ylabel(f"{metric.label} [{metric.unit}]")
        axis.ticklabel_format(axis="y", scilimits=(-3, 4), useMathText=True)
        if not any(drawn):
            axis.text(0.5, 0.5, "not in these runs", transform=axis.transAxes, ha="center", color="#666666")
            axis.set_yticks([])
        elif limits := sound_limits(entries, metric.name, rows):
            axis.set_ylim(*limits)
            axis.set_title("an unsound run leaves this panel", color=style.INVALID)
        lowest = number + columns >= len(metrics)
        axis.tick_params(labelbottom=lowest)
        axis.set_xlabel("time [s]" if lowest else "")
    return axes


def _line(axis: Axes, entry: Entry, name: str, row: Row, styles: Mapping[str, RunStyle]) -> bool:
    values = entry.history.get(name)
    if values is None or not np.isfinite(values).any():
        return False
    times = entry.history["time"]
    if entry.role == "noise":
        axis.plot(times, values, color=style.NOISE, linewidth=0.9, zorder=1)
        return True
    look = styles[entry.name]
    order = 2.2 if entry.role == "reference" else 2.5
    axis.plot(times, values, color=look.color, linestyle=look.dash, linewidth=look.width, zorder=order)
    if not row.ranked:
        last = np.flatnonzero(np.isfinite(values))[-1]
        axis.plot(times[last], values[last], "X", color=look.color, markeredgecolor="white", markersize=9, zorder=4)
    return True


def sound_limits(entries: Sequence[Entry], name: str, rows: Mapping[str, Row]) -> tuple[float, float] | None:
    """Axis limits by the sound runs, where an unsound one would flatten all others; None where none would."""
    sound = _finite(entry.history.get(name) for entry in entries if rows[entry.name].ranked)
    every = _finite(entry.history.get(name) for entry in entries)
    if not len(sound) or len(sound) == len(every) or np.ptp(every) <= OFF_SCALE * np.ptp(sound):
        return None
    margin = 0.08 * (np.ptp(sound) or abs(sound[0]) or 1.0)
    return float(sound.min() - margin), float(sound.max() + margin)


def _finite(columns: Any) -> Array:
    arrays = [np.asarray(column)[np.isfinite(column)] for column in columns if column is not None]
    return np.concatenate(arrays) if arrays else np.empty(0)


def _legend_handles(comparison: Comparison, styles: Mapping[str, RunStyle]) -> list[Line2D]:
    handles = [
        Line2D(
            [],
            [],
            color=look.color,
            linestyle=look.dash,
            linewidth=look.width,
            label=style.escaped(label(row)),
        )
        for row in comparison.rows
        for look in (styles[row.name],)
    ]
    if comparison.noise_rows:
        handles.append(Line2D([], [], color=style.NOISE, linewidth=0.9, label="reference, jittered pack"))
    if any(not row.ranked for row in comparison.rows):
        handles.append(Line2D([], [], color="#555555", marker="X", linestyle="", label="end of an unsound run"))
    return handles


def label(row: Row) -> str:
    """Name in a legend, with what one must know of the run."""
    if row.role == "reference":
        return f"{row.name} (reference)" + ("" if row.ranked else " INVALID" if not row.valid else " incomplete")
    return row.name + ("" if row.ranked else " (INVALID)" if not row.valid else " (incomplete)")


def error_figure(comparison: Comparison, styles: Mapping[str, RunStyle], path: Path) -> Path:
    """error_vs_time.png: mean error against run time, both logarithmic, with the Pareto front of the sound runs."""
    with style.look():
        points = drawable(comparison)
        # One entry for each point, one more for its training, and three lines.
        entries = 3 + sum(2 if row.training_cost_s > 0 else 1 for row in points)
        figure = style.new_figure(10.5, max(5.6, 0.5 + style.LEGEND_LINE * entries))
        axis = figure.subplots()
        axis.set_xscale("log")
        axis.set_yscale("log")
        floor = 0.5 * min((row.mean_error for row in points if row.mean_error > 0), default=1e-3)
        noise = [comparison.noise_mean] if 0 < comparison.noise_mean < math.inf else []
        times = [row.run_time_s for row in (comparison.reference, *points) if row.run_time_s > 0]
        totals = [row.run_time_s + row.training_cost_s for row in points if row.training_cost_s > 0]
        times += [time for row in points for time, _ in row.packs if time > 0]
        _room_for_one_number([*times, *totals], axis.set_xlim)
        _room_for_one_number([*noise, *(max(row.mean_error, floor) for row in points)], axis.set_ylim)
        for row in points:
            _point(axis, row, styles[row.name], floor)
        front = sorted((row for row in points if row.pareto), key=lambda row: row.run_time_s)
        if len(front) > 1:
            xy = [(row.run_time_s, max(row.mean_error, floor)) for row in front]
            axis.plot(
                *zip(*xy, strict=True),
                color="#555555",
                linewidth=1.0,
                drawstyle="steps-post",
                zorder=1,
                label="Pareto front (run time)",
            )
        for level in noise:
            axis.axhline(level, color=style.NOISE, linewidth=1.6, zorder=1, label="noise")
        if comparison.reference.run_time_s > 0:
            axis.axvline(comparison.reference.run_time_s, color=style.REFERENCE, linewidth=1.2, zorder=1)
            axis.plot([], [], color=style.REFERENCE, label="reference (error 0)")
        if not points:
            axis.text(0.5, 0.5, "no run has both a run time and an error", transform=axis.transAxes, ha="center")
        axis.set_xlabel("run time [s]")
        axis.set_ylabel("mean relative error over the metrics [-]")
        _plain_log_ticks(axis)
        handles, labels = axis.get_legend_handles_labels()
        if handles:
            figure.legend(handles, labels, loc="outside right upper")
        return style.save(figure, path)


def drawable(comparison: Comparison) -> list[Row]:
    """Runs (not the reference) that have a run time and an error."""
    return [row for row in comparison.rows[1:] if row.run_time_s > 0 and math.isfinite(row.mean_error)]


def _point(axis: Axes, row: Row, look: RunStyle, floor: float) -> None:
    y = max(row.mean_error, floor)
    name = style.escaped(label(row)) + (" (error 0, drawn at the edge)" if row.mean_error == 0 else "")
    marker = look.marker if row.ranked else "X"
    edge = "white" if row.ranked else style.INVALID
    axis.plot(
        row.run_time_s,
        y,
        marker,
        color=look.color,
        markeredgecolor=edge,
        markersize=10,
        zorder=3,
        linestyle="",
        label=name,
    )
    if len(row.packs) > 1:
        axis.plot(*zip(*row.packs, strict=True), ".", color=look.color, markersize=5, zorder=2)
    if row.training_cost_s > 0:
        total = row.run_time_s + row.training_cost_s
        axis.plot([row.run_time_s, total], [y, y], ":", color=look.color, linewidth=1.0, zorder=1.5)
        axis.plot(
            total, y, marker, markerfacecolor="white", markeredgecolor=look.color, markeredgewidth=1.8, markersize=9,
            zorder=2.5, linestyle="", label=f"{style.escaped(row.name)}, with training",
        )  # fmt: skip


def _room_for_one_number(values: Sequence[float], set_limits: Callable[[float, float], Any]) -> None:
    """Runs of one run time, or of one error: matplotlib's own limits may be one number too, apart by rounding."""
    if values and max(values) < 1.01 * min(values):
        set_limits(0.5 * min(values), 2.0 * max(values))


def _plain_log_ticks(axis: Axes) -> None:
    """Numbers as 0.02 and 200, not as powers, also between decades where the axis spans few of them."""

    def plain(value: float, _: object) -> str:
        return f"{value:g}"

    axis.tick_params(which="both", length=4)
    for which, limits in ((axis.xaxis, axis.get_xlim()), (axis.yaxis, axis.get_ylim())):
        decades = math.log10(limits[1] / limits[0])
        which.set_major_formatter(plain)
        leading = (2.0, 3.0, 5.0) if decades < 1.2 else (2.0, 5.0) if decades < 3.2 else ()
        # Within half a decade the ticks stand at all kinds of numbers, and every one is written.
        which.set_minor_formatter(plain if decades < 0.5 else partial(_minor, leading))


def _minor(leading: Sequence[float], value: float, _: object) -> str:
    """The number where its first digit is one of those to be written, else nothing."""
    digit = round(value / 10 ** math.floor(math.log10(value) + 1e-9), 6) if value > 0 else 0.0
    return f"{value:g}" if digit in leading else ""


def r_squared(target: Array, estimate: Array) -> float:
    """R2 = 1 - sum |t - e|^2 / sum |t - mean t|^2 over all components together, the mean by component; (M, D) each."""
    spread = float(np.sum((target - target.mean(axis=0)) ** 2))
    return 1.0 - float(np.sum((target - estimate) ** 2)) / spread if spread > 0 else float("nan")


def check_parity(parity: Mapping[str, Mapping[str, Any]]) -> None:
    """Refuse arrays of unlike, empty or other than (M, D) shape, and entries without a target or a prediction.

    Raises:
        InputError: naming the entry and the array.
    """
    for name, arrays in parity.items():
        for column in ("target", "predicted", "base"):
            given = arrays.get(column)
            if given is None and column == "base":
                continue
            shape, wanted = (np.asarray(array).shape for array in (given, arrays.get("target")))
            if given is None or shape != wanted or len(shape) != 2 or 0 in shape:
                limit = f"(M, D) like the target, {wanted}"
                raise InputError(f"parity[{name!r}].{column}", shape, limit, "Give arrays of one shape.")


def parity_figure(parity: Mapping[str, Mapping[str, Any]], path: Path) -> Path:
    """parity.png: force by the base law and by the closure against the target, one row for each entry.

    Args:
        parity: name -> {predicted, target, base}, each (M, D) [N]; `base` may be missing.
    """
    with style.look():
        figure = style.new_figure(9.6, 4.6 * len(parity))
        rows = figure.subfigures(len(parity), 1, squeeze=False)[:, 0]
        for row, (name, arrays) in zip(rows, parity.items(), strict=True):
            row.suptitle(style.escaped(name, 9.0, 12.0), fontsize=12)
            columns = [column for column in ("base", "predicted") if arrays.get(column) is not None]
            axes = row.subplots(1, 2, squeeze=False)[0]
            for axis in axes[len(columns) :]:
                axis.set_axis_off()
            panels = zip(axes, columns, strict=False)
            images = [image for axis, column in panels if (image := _parity_panel(axis, column, arrays))]
            if images:
                # One scale for both panels, so that their shades can be compared.
                counts = LogNorm(1.0, max(2.0, *(np.max(image.get_array()) for image in images)))  # type: ignore[arg-type]
                for image in images:
                    image.set_norm(counts)
                row.colorbar(images[0], ax=list(axes), label="values in a cell", shrink=0.8)
        return style.save(figure, path)


def _parity_panel(axis: Axes, column: str, arrays: Mapping[str, Any]) -> PolyCollection | None:
    """Estimates against targets; of many the density, which is returned to be given its scale."""
    target = np.asarray(arrays["target"], dtype=np.float64)
    estimate = np.asarray(arrays[column], dtype=np.float64)
    low, high = np.percentile(target, [0.1, 99.9])
    margin = 0.1 * ((high - low) or 1.0)
    span = (low - margin, high + margin)
    outside = np.mean((estimate < span[0]) | (estimate > span[1]) | (target < span[0]) | (target > span[1]))
    image = None
    if target.size > 3000:
        image = axis.hexbin(
            target.ravel(), estimate.ravel(), gridsize=60, extent=(*span, *span), mincnt=1, cmap="viridis_r", linewidths=0.1,
        )  # fmt: skip
    else:
        axis.plot(
            target.ravel(),
            estimate.ravel(),
            "o",
            markersize=3,
            alpha=0.5,
            color=style.COLOURS[0],
            markeredgewidth=0,
        )
    axis.plot(span, span, color="#333333", linewidth=1.0)
    axis.set(xlim=span, ylim=span, aspect="equal", xlabel="target force [N]")
    axis.set_ylabel("base law's force [N]" if column == "base" else "closure's force [N]")
    axis.locator_params(nbins=6)
    axis.ticklabel_format(scilimits=(-3, 4), useMathText=True)
    word = "base law" if column == "base" else "closure"
    note = f", {100 * outside:.1f} % outside the panel" if outside > 0.005 else ""
    axis.set_title(f"{word}: R² = {r_squared(target, estimate):.3f}{note}")
    return image
