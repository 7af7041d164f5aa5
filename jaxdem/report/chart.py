"""Figures of numbers, described once and drawn twice: by matplotlib for a file, by plotly for a page.

A figure is a list of panels, a panel a list of series. The file is for print; on the page a reader can zoom, read
values under the pointer, and hide a run in all panels by a click on its name.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

import plotly.graph_objects as go  # type: ignore[import-untyped, unused-ignore]
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import FigureBase
from matplotlib.ticker import FixedLocator, LogLocator, MaxNLocator, NullLocator, StrMethodFormatter
from plotly.subplots import make_subplots  # type: ignore[import-untyped, unused-ignore]

from jaxdem.report import style
from jaxdem.report.runs import Array

COLUMNS = 3
LABEL = 2.0
"""Longest label beside an axis [inch]."""
X_TICKS = 5
"""Most intervals between the numbers of an x axis: more of them touch."""
MAX_POINTS = 2000
"""Longer series are thinned evenly for the page; errors are taken of every output."""

FONT = {"family": "system-ui, sans-serif", "size": 13, "color": "#222222"}
AXIS = {
    "gridcolor": "#E3E3E3", "zeroline": False, "linecolor": "#888888", "ticks": "outside", "automargin": True,
    "exponentformat": "power", "title_standoff": 6,
}  # fmt: skip
LOG_AXIS = {"type": "log", "exponentformat": "none", "nticks": 4}


@dataclass(frozen=True)
class Series:
    """A line, points, or both. Series of one label have one entry in the legend, which shows and hides them together.

    Attributes:
        line: a key of `style.DASHES`, "" for points alone; in steps where `steps`.
        width: of the line, and of the rim of hollow markers [pt].
        marker: a key of `style.MARKERS`, "" for a line alone.
        size: of the markers [pt].
        note: more to read under the pointer.
        place: what tells it from other series of its label; a file lists the places within the panel.
    """

    label: str
    x: Sequence[float] | Array
    y: Sequence[float] | Array
    color: str
    line: str = ""
    width: float = 1.6
    marker: str = ""
    size: float = 10.0
    hollow: bool = False
    steps: bool = False
    note: str = ""
    place: str = ""


@dataclass(frozen=True)
class Panel:
    """Axes with series, the first at the back.

    Attributes:
        x_limits, y_limits: None for what the series need.
        note: above the series, or in their place where there is none.
        logarithmic: both axes, which then have limits.
    """

    x_label: str
    y_label: str
    series: Sequence[Series] = field(default_factory=list)
    x_limits: tuple[float, float] | None = None
    y_limits: tuple[float, float] | None = None
    note: str = ""
    logarithmic: bool = False


def log_limits(values: Sequence[float]) -> tuple[float, float]:
    """Limits of a logarithmic axis: a quarter beyond the least and the greatest of the values, which are positive.

    So they are never so near to each other that no plain number lies between.
    """
    return min(values) / 1.25, 1.25 * max(values)


def draw_panels(figure: FigureBase, panels: Sequence[Panel]) -> list[Axes]:
    """Draw onto a figure of matplotlib's, in up to three columns, with one x axis where all have the same; without a
    legend."""
    columns = min(COLUMNS, len(panels))
    axes: list[Axes] = []
    shares = _one_axis(panels)
    for number, panel in enumerate(panels):
        shared = axes[0] if axes and shares else None
        axis = figure.add_subplot(math.ceil(len(panels) / columns), columns, number + 1, sharex=shared)
        places: dict[str, Artist] = {}
        for one in panel.series:
            (line,) = axis.plot(
                one.x, one.y, color=one.color, linestyle=style.DASHES.get(one.line, ""), linewidth=one.width,
                marker=style.MARKERS.get(one.marker, ""), markersize=one.size, label=style.escaped(one.label),
                markerfacecolor="white" if one.hollow else one.color, markeredgewidth=one.width if one.hollow else 0.8,
                markeredgecolor=one.color if one.hollow else "white", drawstyle="steps-post" if one.steps else None,
            )  # fmt: skip
            places.setdefault(one.place, line)
        lowest = number + columns >= len(panels) or not shares
        axis.set(xlabel=panel.x_label if lowest else "", ylabel=_in_lines(panel.y_label))
        axis.tick_params(labelbottom=lowest)
        if not panel.series:
            axis.text(0.5, 0.5, panel.note, transform=axis.transAxes, ha="center", va="center", color="#666666")
            axis.set_yticks([])
        else:
            axis.set_title(panel.note, color=style.INVALID)
            axis.ticklabel_format(axis="both", scilimits=(-3, 4), useMathText=True)
            axis.locator_params(axis="x", nbins=X_TICKS)
            if len(places) > 1:
                axis.legend(places.values(), places.keys(), fontsize=7, ncols=1 + len(places) // 6)
        if panel.logarithmic:
            axis.set(xscale="log", yscale="log")
        if panel.x_limits:
            axis.set_xlim(panel.x_limits)
        if panel.y_limits:
            axis.set_ylim(panel.y_limits)
        if panel.logarithmic:
            put_plain_numbers(axis.xaxis, axis.get_xlim())
            put_plain_numbers(axis.yaxis, axis.get_ylim())
        axes.append(axis)
    return axes


def _in_lines(label: str) -> str:
    """A label that is longer than a panel is high, in two lines: what measures, and what is measured."""
    return label.replace(": ", ":\n", 1) if style.text_width(label) > LABEL else label


def put_plain_numbers(axis: Axis, limits: tuple[float, float]) -> None:
    """Numbers as 0.02 and 200, not as powers, on a logarithmic axis with these limits."""
    axis.set_major_locator(FixedLocator(log_ticks(*limits)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_locator(NullLocator())


def log_ticks(low: float, high: float) -> list[float]:
    """Plain numbers between the limits of a logarithmic axis: in steps within a decade, then 1, 2, 5, then decades.

    Three at least where the limits are `log_limits`.
    """
    digits = (1.0, 2.0, 5.0) if high < 1000.0 * low else (1.0,)
    locator = MaxNLocator(8, steps=[1, 2, 5, 10]) if high < 10.0 * low else LogLocator(subs=digits)
    return [float(tick) for tick in locator.tick_values(low, high) if low <= tick <= high]


def write_png(panels: Sequence[Panel], path: Path, note: str = "") -> Path:
    """Draw into a file, with a note above and a legend below."""
    with style.look():
        alone = len(panels) == 1
        width = 9.0 if alone else 4.2 * min(COLUMNS, len(panels))
        names = {style.escaped(one.label) for panel in panels for one in panel.series}
        columns = style.legend_columns(names, width - 0.5)
        height = 5.4 if alone else 3.0 * math.ceil(len(panels) / COLUMNS)
        figure = style.new_figure(width, height + style.LEGEND_LINE * math.ceil(len(names) / columns))
        axes = draw_panels(figure, panels)
        figure.suptitle(note, fontsize=9, color="#666666", wrap=True)
        add_legend(figure, axes, columns)
        return style.save(figure, path)


def add_legend(figure: FigureBase, axes: Sequence[Axes], columns: int) -> None:
    """One legend for all panels, below them in so many columns; a name stands once, with the first of its marks."""
    handles: dict[str, Artist] = {}
    for axis in axes:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    if handles:
        figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=columns)


def to_html(panels: Sequence[Panel], identity: str) -> str:
    """A fragment of a page that has plotly's script already."""
    columns = min(COLUMNS, len(panels))
    lines = math.ceil(len(panels) / columns)
    shares = _one_axis(panels)
    gap = (0.15 if shares else 0.3) / lines
    figure = make_subplots(
        lines, columns, horizontal_spacing=0.08, vertical_spacing=gap, shared_xaxes="all" if shares else False
    )
    listed: set[str] = set()
    for number, panel in enumerate(panels):
        at = {"row": number // columns + 1, "col": number % columns + 1}
        look = AXIS | (LOG_AXIS if panel.logarithmic else {})
        lowest = number + columns >= len(panels) or not shares
        label = panel.x_label if lowest else ""
        figure.update_xaxes(title_text=label, showticklabels=lowest, range=_range(panel, panel.x_limits), **look, **at)
        figure.update_yaxes(title_text=panel.y_label, range=_range(panel, panel.y_limits), **look, **at)
        if not panel.series:  # without a trace there are no axes
            figure.add_scatter(x=[None], y=[None], showlegend=False, **at)
            figure.update_yaxes(showticklabels=False, showgrid=False, **at)
        if panel.note:
            which = number + 1 if number else ""
            domain = {"xref": f"x{which} domain", "yref": f"y{which} domain"}
            place = {"y": 1.0, "yanchor": "bottom"} if panel.series else {"y": 0.5}
            text = escape(panel.note).replace("\n", "<br>")
            figure.add_annotation(text=text, x=0.5, showarrow=False, font_color="#666666", **domain, **place)
        for one in panel.series:
            figure.add_trace(_trace(one, panel.logarithmic, one.label not in listed), **at)
            listed.add(one.label)
    figure.update_layout(
        height=580 if len(panels) == 1 else 80 + 300 * lines, hoverlabel={"namelength": -1}, template="none", font=FONT,
        hovermode="closest" if panels[0].logarithmic else "x unified", margin={"l": 70, "r": 20, "t": 40, "b": 60},
        legend={"orientation": "h", "y": -0.16 if len(panels) == 1 else -0.21 / lines, "yanchor": "top", "x": 0},
    )  # fmt: skip
    buttons = {"responsive": True, "displaylogo": False, "modeBarButtonsToRemove": ["select2d", "lasso2d"]}
    return str(figure.to_html(full_html=False, include_plotlyjs=False, div_id=identity, config=buttons))


def _one_axis(panels: Sequence[Panel]) -> bool:
    """Whether all panels have the same quantity on their x axis."""
    return len({panel.x_label for panel in panels}) == 1


def _range(panel: Panel, limits: tuple[float, float] | None) -> list[float] | None:
    """Limits as plotly wants them: powers of ten where the axis is logarithmic."""
    return [math.log10(limit) if panel.logarithmic else limit for limit in limits] if limits else None


def _trace(one: Series, both: bool, listed: bool) -> go.Scatter:
    """A series of plotly's; under the pointer stand both numbers or the upright one, and the note."""
    name, every = _plain_text(one.label), max(1, math.ceil(len(one.x) / MAX_POINTS))
    lines = ["%{x:.4g}, %{y:.4g}" if both else "%{y:.4g}", *map(_plain_text, one.note.splitlines())]
    shape, symbol = "hv" if one.steps else None, (one.marker + "-open" * one.hollow) or None
    return go.Scatter(
        x=_finite(one.x[::every]), y=_finite(one.y[::every]), name=name, legendgroup=name, showlegend=listed,
        mode="+".join(["lines"] * bool(one.line) + ["markers"] * bool(one.marker)), hovertemplate="<br>".join(lines),
        line={"color": one.color, "dash": one.line or None, "width": one.width + 0.4, "shape": shape},
        marker={"color": one.color, "size": 1.2 * one.size, "symbol": symbol, "line_width": 2 * one.hollow},
    )  # fmt: skip


def _plain_text(text: str) -> str:
    """Names come from directories and reasons from summaries: no markup of plotly's in them, nor templates as %{x}."""
    return escape(text, quote=False).replace("{", "&#123;").replace("$", "&#36;")


def _finite(values: Sequence[float] | Array) -> list[float | None]:
    """A list with None for what is not finite: JSON has no NaN."""
    return [float(f"{value:.6g}") if math.isfinite(value) else None for value in values]
