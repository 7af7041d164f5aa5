"""The same figures of numbers for the page, with zoom and hover: metrics over time, error against run time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape

import numpy as np
import plotly.graph_objects as go  # type: ignore[import-untyped, unused-ignore]
from plotly.offline import get_plotlyjs  # type: ignore[import-untyped, unused-ignore]
from plotly.subplots import make_subplots  # type: ignore[import-untyped, unused-ignore]

from jaxdem.metrics import METRICS
from jaxdem.report import style
from jaxdem.report.comparison import Comparison, Entry, Row
from jaxdem.report.figures import drawable, label, sound_limits
from jaxdem.report.style import RunStyle

MAX_POINTS = 2000
"""Longer histories are thinned evenly for the page; the errors use every output."""

FONT = {"family": "system-ui, sans-serif", "size": 13, "color": "#222222"}
AXIS = {
    "gridcolor": "#E3E3E3",
    "zeroline": False,
    "linecolor": "#888888",
    "ticks": "outside",
    "exponentformat": "power",
}


DIGITS = (
    (3.0, [*np.arange(10, 20) / 10, *np.arange(20, 50, 2) / 10, *np.arange(50, 100, 5) / 10]),
    (10.0, [1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]),
    (math.inf, [1.0, 2.0, 5.0]),
)
"""First digits of the ticks of a logarithmic axis, by the ratio of its ends up to which they are taken."""


def plotly_script() -> str:
    """plotly.js itself (4 to 5 MB), to be put into the page once so that it works without a network."""
    return str(get_plotlyjs())


def metrics_plot(entries: Sequence[Entry], comparison: Comparison, styles: Mapping[str, RunStyle]) -> str:
    """HTML fragment: the metrics that a run has over time; a click in the legend hides a run in all panels."""
    rows = {row.name: row for row in (*comparison.rows, *comparison.noise_rows)}
    metrics = [metric for metric in METRICS if any(_has(entry, metric.name) for entry in entries)]
    lines = max(1, math.ceil(len(metrics) / 3))
    figure = make_subplots(lines, 3, horizontal_spacing=0.08, vertical_spacing=0.15 / lines)
    figure.update_xaxes(matches="x")
    listed: set[str] = set()
    for i, metric in enumerate(metrics):
        position = {"row": i // 3 + 1, "col": i % 3 + 1}
        figure.update_yaxes(title_text=f"{metric.label} [{metric.unit}]", title_standoff=4, **AXIS, **position)
        lowest = i + 3 >= len(metrics)
        time = {"title_text": "time [s]" if lowest else None, "showticklabels": lowest}
        figure.update_xaxes(**time, **AXIS, **position)
        if limits := sound_limits(entries, metric.name, rows):
            figure.update_yaxes(range=limits, **position)
        for entry in entries:
            if _has(entry, metric.name):
                trace = _trace(entry, rows[entry.name], entry.history[metric.name], styles, listed)
                figure.add_trace(trace, **position)
    layout = _layout(-0.21 / lines)
    figure.update_layout(height=80 + 300 * lines, hovermode="x unified", hoverlabel={"namelength": -1}, **layout)
    return _fragment(figure, "metrics-plot")


def _has(entry: Entry, metric: str) -> bool:
    return metric in entry.history and bool(np.isfinite(entry.history[metric]).any())


def _trace(entry: Entry, row: Row, values: np.ndarray, styles: Mapping[str, RunStyle], listed: set[str]) -> go.Scatter:
    look = styles.get(entry.name)
    noise = entry.role == "noise" or look is None
    group = "noise" if noise else entry.name
    step = max(1, math.ceil(len(values) / MAX_POINTS))
    trace = go.Scatter(
        x=_plain(entry.history["time"][::step]),
        y=_plain(values[::step]),
        mode="lines",
        name="reference, jittered pack" if noise else _escape(label(row)),
        legendgroup=group,
        showlegend=group not in listed,
        line={"color": style.NOISE, "width": 1}
        if noise or look is None
        else {"color": look.color, "dash": look.plotly_dash, "width": look.width + 0.4},
        hovertemplate="%{y:.4g}",
    )
    listed.add(group)
    return trace


def error_plot(comparison: Comparison, styles: Mapping[str, RunStyle]) -> str:
    """HTML fragment: mean error against run time, logarithmic, training cost hollow, Pareto front and noise floor."""
    figure = go.Figure()
    points = drawable(comparison)
    floor = 0.5 * min((row.mean_error for row in points if row.mean_error > 0), default=1e-3)
    front = sorted((row for row in points if row.pareto), key=lambda row: row.run_time_s)
    if len(front) > 1:
        figure.add_scatter(
            x=[row.run_time_s for row in front], y=[max(row.mean_error, floor) for row in front], mode="lines",
            line={"color": "#555555", "width": 1.2, "shape": "hv"}, name="Pareto front (run time)", hoverinfo="skip",
        )  # fmt: skip
    for row in points:
        _add_point(figure, row, styles[row.name], max(row.mean_error, floor))
    _add_lines(figure, comparison, points, floor)
    across = [value for trace in figure.data for value in trace.x]
    upwards = [value for trace in figure.data for value in trace.y]
    figure.update_xaxes(type="log", title_text="run time [s]", **_ticks(across), **AXIS)
    title = "mean relative error over the metrics [-]"
    figure.update_yaxes(type="log", title_text=title, **_ticks(upwards), **AXIS)
    figure.update_layout(height=580, **_layout(-0.16))
    return _fragment(figure, "error-plot")


def _ticks(values: Sequence[float]) -> dict[str, object]:
    """Ticks at plain numbers, close enough that some are in sight."""
    ratio = max(values) / min(values) if values else 1.0
    digits = next(digits for most, digits in DIGITS if ratio <= most)
    ticks = [float(digit * 10.0**power) for power in range(-8, 9) for digit in digits]
    return {"tickvals": ticks, "ticktext": [f"{tick:g}" for tick in ticks]}


def _add_lines(figure: go.Figure, comparison: Comparison, points: Sequence[Row], floor: float) -> None:
    """Noise floor and reference as lines across the points; plotly's own ones do not widen a logarithmic axis."""
    reference, noise = comparison.reference.run_time_s, comparison.noise_mean
    costs = [row.run_time_s for row in points] + [reference] * (reference > 0)
    costs += [row.run_time_s + row.training_cost_s for row in points if row.training_cost_s > 0]
    levels = [max(row.mean_error, floor) for row in points] + [noise] * (noise > 0)
    if noise > 0 and costs:
        figure.add_scatter(
            x=[0.9 * min(costs), 1.1 * max(costs)], y=[noise, noise], mode="lines", name="noise",
            line={"color": style.NOISE, "width": 2}, hovertemplate="noise %{y:.3g}<extra></extra>",
        )  # fmt: skip
    if reference > 0 and levels:
        figure.add_scatter(
            x=[reference, reference], y=[0.8 * min(levels), 1.2 * max(levels)], mode="lines", name="reference (error 0)",
            line={"color": style.REFERENCE, "width": 1.4}, hovertemplate="reference %{x:.4g} s<extra></extra>",
        )  # fmt: skip


def _add_point(figure: go.Figure, row: Row, look: RunStyle, y: float) -> None:
    worst = [
        f"{metric.label} {100 * row.errors[metric.name]:.3g} %"
        for metric in METRICS
        if math.isfinite(row.errors[metric.name])
    ]
    hover = "<br>".join([f"{row.cells_text} cells, {_escape(row.status)}", *worst])
    template = "%{x:.4g} s, error " + f"{row.mean_error:.3g}<br>{hover}"
    marker = {"size": 12, "color": look.color, "symbol": look.plotly_marker if row.ranked else "x"}
    figure.add_scatter(
        x=[row.run_time_s], y=[y], mode="markers", marker=marker, name=_escape(label(row)), legendgroup=row.name,
        hovertemplate=template,
    )  # fmt: skip
    if len(row.packs) > 1:
        x, y_packs = zip(*row.packs, strict=True)
        figure.add_scatter(
            x=x, y=y_packs, mode="markers", marker={"size": 5, "color": look.color}, name=f"{_escape(row.name)}, each pack",
            legendgroup=row.name, showlegend=False, hovertemplate="one pack: %{x:.4g} s, error %{y:.3g}<extra></extra>",
        )  # fmt: skip
    if row.training_cost_s > 0:
        figure.add_scatter(
            x=[row.run_time_s, row.run_time_s + row.training_cost_s], y=[y, y], mode="lines+markers",
            line={"color": look.color, "dash": "dot", "width": 1.2}, legendgroup=row.name,
            marker={"size": [0, 12], "symbol": f"{look.plotly_marker}-open", "color": look.color, "line": {"width": 2}},
            name=f"{_escape(row.name)}, with training", hovertemplate="%{x:.4g} s with training",
        )  # fmt: skip


def _escape(text: str) -> str:
    """Names come from directories and reasons from summaries: no markup of plotly's in them, nor templates as %{x}."""
    return escape(text, quote=False).replace("{", "&#123;").replace("$", "&#36;")


def _plain(values: np.ndarray) -> list[float | None]:
    """A list with None for what is not finite: JSON has no NaN."""
    return [float(f"{value:.6g}") if math.isfinite(value) else None for value in values]


def _layout(legend_y: float) -> dict[str, object]:
    return {
        "template": "none",
        "font": FONT,
        "paper_bgcolor": "white",
        "plot_bgcolor": "white",
        "margin": {"l": 70, "r": 20, "t": 40, "b": 60},
        "legend": {"orientation": "h", "y": legend_y, "yanchor": "top", "x": 0},
    }


def _fragment(figure: go.Figure, identity: str) -> str:
    html: str = figure.to_html(
        full_html=False,
        include_plotlyjs=False,
        div_id=identity,
        config={"responsive": True, "displaylogo": False, "modeBarButtonsToRemove": ["select2d", "lasso2d"]},
    )
    return html
