"""report.html: one page that needs nothing beside it."""

from __future__ import annotations

import base64
import dataclasses
import math
from collections.abc import Sequence
from html import escape
from pathlib import Path

from jaxdem.io.durable import write_bytes
from jaxdem.metrics import METRICS
from jaxdem.report import interactive, player
from jaxdem.report import runs as read
from jaxdem.report.comparison import Comparison, Entry, Row
from jaxdem.report.figures import label
from jaxdem.report.findings import duration, error_range, percent
from jaxdem.report.style import RunStyle

CSS = """
:root { color-scheme: light; }
body { font: 16px/1.5 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; color: #1c1c1c; background: #fff;
  margin: 0 auto; padding: 1.5rem; max-width: 1280px; }
h1 { font-size: 1.7rem; margin: 0 0 .3rem; } h2 { font-size: 1.2rem; margin: 2.2rem 0 .5rem; }
h3 { font-size: 1rem; margin: 1.4rem 0 .4rem; }
.lead li, .notes li { margin: .25rem 0; max-width: 58rem; }
.warning { border-left: 4px solid #B00020; background: #fdf1f2; padding: .5rem 1rem; margin: 1rem 0; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .86rem; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .6rem; border-bottom: 1px solid #e2e2e2; text-align: right; vertical-align: top; }
th { font-weight: 600; border-bottom: 2px solid #888; vertical-align: bottom; }
th:first-child, td:first-child, td.text, th.text { text-align: left; }
td:not(.text) { white-space: nowrap; } tr.reference td { background: #f4f4f4; } tr.noise td { color: #666; } tr.unsound td, .bad { color: #B00020; }
td.best { font-weight: 700; } .swatch { display: inline-block; width: .8em; height: .8em; margin-right: .4em; }
#player .controls { display: flex; flex-wrap: wrap; gap: .6rem 1rem; align-items: center; margin: .4rem 0; }
#player input { flex: 1 1 12rem; } #player button { min-width: 5rem; } #player output { min-width: 7rem; }
#player .panels { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 300px), 1fr)); gap: .6rem 1rem; }
#player .panels.long { grid-template-columns: repeat(auto-fit, minmax(min(100%, 480px), 1fr)); }
#player figure { margin: 0; } #player figcaption { font-size: .88rem; } #player small { color: #B00020; }
#player canvas { width: 100%; display: block; outline: 1px solid #888; }
#player .scale { display: flex; justify-content: space-between; gap: 1rem; font-size: .8rem; width: 22rem; height: 10px; }
#player .scale span { margin-top: 12px; } #player .controls:last-child { min-height: 2.2rem; align-items: flex-start; }
img { max-width: 100%; height: auto; } .caption { color: #555; font-size: .88rem; max-width: 58rem; }
"""


@dataclasses.dataclass(frozen=True)
class PageTable:
    """A table of words; the first column is text, the others are numbers as they shall stand there."""

    title: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""


@dataclasses.dataclass(frozen=True)
class PageSection:
    """A heading with sentences and tables of its own."""

    title: str
    text: Sequence[str]
    tables: Sequence[PageTable]


def write_page(
    title: str,
    comparison: Comparison,
    entries: Sequence[Entry],
    styles: dict[str, RunStyle],
    path: Path,
    sections: Sequence[PageSection] = (),
) -> None:
    """Write the page; the PNG files named in `comparison.files` are embedded.

    Args:
        entries: reference, runs and noise runs, in the order of the rows.
        styles: by name; noise runs have none.
        sections: after the notes.
    """
    body = [
        f"<h1>{escape(title)}</h1>",
        "<h2>Summary</h2>",
        _list(comparison.sentences, "lead"),
        _warnings(comparison),
        "<h2>Error against run time</h2>",
        interactive.error_plot(comparison, styles),
        _caption(
            "Each point is a run. Lower and further to the left is better. The run time does not include compilation. The error is the mean over the "
            "metrics. Small points are the same run with other packs. A hollow point includes the training time. The vertical line is the run time of the reference, whose error is zero by definition."
        ),
        "<h2>Errors by metric</h2>",
        _error_table(comparison, styles),
        "<h2>Final values</h2>",
        _final_table(comparison, styles),
        "<h2>The nine metrics over time</h2>",
        interactive.metrics_plot(entries, comparison, styles),
        _caption(
            "Click a name in the legend to hide that run in all panels. Drag to zoom in; double-click to zoom out."
        ),
        *_animations(entries, comparison, styles),
        *_image(
            comparison,
            "snapshots",
            "Snapshots",
            "Particles are drawn with their true radius. All panels have the same colour scale.",
        ),
        *_image(comparison, "parity", "Force from the closure and from its base law against the target", ""),
        *(["<h2>Notes</h2>", _list(comparison.notes, "notes")] if comparison.notes else []),
        *map(_section, sections),
        "<h2>Differences from the scene of the reference</h2>",
        _difference_table(entries),
        "<h2>Versions, machines and state of the runs</h2>",
        _machine_table(comparison, entries),
    ]
    page = (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><style>{CSS}</style>'
        f"<script>{interactive.plotly_script()}</script></head>\n<body>\n" + "\n".join(body) + "\n</body></html>\n"
    )
    write_bytes(path, page.encode())


def _section(section: PageSection) -> str:
    blocks = [f"<h2>{escape(section.title)}</h2>", _list(section.text, "notes") if section.text else ""]
    for table in section.tables:
        rows = [("", [escape(cell) for cell in row]) for row in table.rows]
        blocks.append(f"<h3>{escape(table.title)}</h3>")
        blocks.append(_table([escape(heading) for heading in table.headings], rows) + _caption(table.note))
    return "\n".join(blocks)


def _list(items: Sequence[str], kind: str) -> str:
    return f'<ul class="{kind}">' + "".join(f"<li>{escape(item)}</li>" for item in items) + "</ul>"


def _caption(text: str) -> str:
    return f'<p class="caption">{escape(text)}</p>' if text else ""


def _warnings(comparison: Comparison) -> str:
    if not comparison.warnings:
        return ""
    return f'<div class="warning"><strong>Warnings</strong>{_list(comparison.warnings, "notes")}</div>'


def _image(comparison: Comparison, name: str, heading: str, caption: str) -> list[str]:
    if name not in comparison.files:
        return []
    data = base64.b64encode(comparison.files[name].read_bytes()).decode("ascii")
    image = f'<img alt="{escape(heading)}" src="data:image/png;base64,{data}">'
    return [f"<h2>{escape(heading)}</h2>", image, _caption(caption)]


def _animations(entries: Sequence[Entry], comparison: Comparison, styles: dict[str, RunStyle]) -> list[str]:
    rows = {row.name: row for row in comparison.rows}
    shown = player.player([entry for entry in entries if entry.role != "noise"], rows, styles)
    if shown is None:
        return []
    return ["<h2>Animations</h2>", shown.html, _caption(shown.caption)]


def _table(head: Sequence[str], body: Sequence[tuple[str, Sequence[str]]], text_columns: Sequence[int] = ()) -> str:
    """A table of cells that are HTML already; `body` has (class of the row, cells), a cell may begin with <td."""

    def cell(kind: str, column: int, content: str) -> str:
        if content.startswith("<td"):
            return content
        name = ' class="text"' if column in text_columns else ""
        return f"<{kind}{name}>{content}</{kind}>"

    def cells(kind: str, row: Sequence[str]) -> str:
        return "".join(cell(kind, column, content) for column, content in enumerate(row))

    lines = "".join(f'<tr class="{kind}">{cells("td", row)}</tr>' for kind, row in body)
    return f'<div class="wide"><table><thead><tr>{cells("th", head)}</tr></thead><tbody>{lines}</tbody></table></div>'


def _kind(row: Row) -> str:
    return " ".join(filter(None, (row.role if row.role != "run" else "", "" if row.ranked else "unsound")))


def _name(row: Row, styles: dict[str, RunStyle]) -> str:
    look = styles.get(row.name)
    swatch = f'<span class="swatch" style="background:{look.color}"></span>' if look else ""
    return swatch + escape(label(row))


def _value(number: float, pattern: str = ".4g") -> str:
    return format(number, pattern) if math.isfinite(number) else "&ndash;"


def _seconds(number: float) -> str:
    return duration(number) if math.isfinite(number) else "&ndash;"


def _error_table(comparison: Comparison, styles: dict[str, RunStyle]) -> str:
    noise = bool(comparison.noise_rows)
    packs = any(len(row.packs) > 1 for row in comparison.rows)
    head = [
        "run",
        "cells",
        "run time",
        "compile time",
        "speed-up",
        *(metric.label for metric in METRICS),
        "mean",
    ]
    head += ["range over packs"] if packs else []
    head += ["mean over noise"] if noise else []
    body = []
    for row in comparison.rows[1:]:
        speed_up = comparison.reference.run_time_s / row.run_time_s if row.run_time_s > 0 else math.nan
        line = [_name(row, styles), row.cells_text, _seconds(row.run_time_s), _seconds(row.compile_time_s)]
        line.append(_value(speed_up, ".2f"))
        line += [_error_cell(row, metric.name, comparison) for metric in METRICS]
        line.append(f"<td><strong>{percent(row.mean_error)}</strong></td>")
        line += [error_range(row) if len(row.packs) > 1 else "&ndash;"] if packs else []
        body.append((_kind(row), line + ([_value(row.error_over_noise, ".2f")] if noise else [])))
    if math.isfinite(comparison.noise_mean):
        floor = [percent(comparison.noise_floor[metric.name]) for metric in METRICS]
        floor += [percent(comparison.noise_mean), *([""] if packs else []), "1"]
        body.append(("noise", ["noise", "", "", "", "", *floor]))
    return _table(head, body) + _caption(
        "Bold: the smallest error in that metric among valid, complete runs. The run time does not include compilation; loading a program from "
        "the cache counts as compilation." + (" Errors are means over the packs, times are medians." if packs else "")
    )


def _error_cell(row: Row, name: str, comparison: Comparison) -> str:
    error = row.errors[name]
    others = [r.errors[name] for r in comparison.rows[1:] if r.ranked and math.isfinite(r.errors[name])]
    text = percent(error) if math.isfinite(error) else "&infin;" if error == math.inf else "&ndash;"
    best = len(others) > 1 and row.ranked and error == min(others)
    return f'<td class="best">{text}</td>' if best else f"<td>{text}</td>"


def _final_table(comparison: Comparison, styles: dict[str, RunStyle]) -> str:
    head = ["run", "at time [s]", *(f"{metric.label} [{metric.unit}]" for metric in METRICS)]
    body = []
    for row in (*comparison.rows, *comparison.noise_rows):
        values = [_value(row.final[metric.name]) for metric in METRICS]
        body.append((_kind(row), [_name(row, styles), _value(row.end_time), *values]))
    return _table(head, body)


def _difference_table(entries: Sequence[Entry]) -> str:
    body = []
    for entry in entries[1:]:
        changed = read.scene_differences(entry.run.scene, entries[0].run.scene)
        for key, (here, there) in changed.items():
            values = [escape(_short(value)) for value in (here, there)]
            body.append(("", [escape(entry.name), escape(key), *values]))
    if not body:
        return _caption("None: all scenes are the same.")
    return _table(["run", "key", "value", "in the reference"], body, text_columns=(1, 2, 3))


def _short(value: object) -> str:
    text = "not set" if value is None else str(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _machine_table(comparison: Comparison, entries: Sequence[Entry]) -> str:
    head = [
        "run",
        "state",
        "run time",
        "compile time",
        "time steps [s]",
        "closure",
        "out of range",
        "residuals",
        "precision",
        "device",
    ]
    body = []
    for row, entry in zip((*comparison.rows, *comparison.noise_rows), entries, strict=True):
        summary = entry.run.summary
        outside = read.number(read.lookup(summary, "closure.out_of_range_fraction"))
        line = [
            row.name,
            row.status,
            *(
                duration(time) if math.isfinite(time) else "not recorded"
                for time in (row.run_time_s, row.compile_time_s)
            ),
        ]
        line += [
            read.text(read.lookup(summary, "time_steps")),
            row.closure or f"none ({row.drag or 'no drag'})",
        ]
        line += [percent(outside) if math.isfinite(outside) else "-"]
        line += [read.text(read.lookup(summary, key)) for key in ("residuals", "precision", "device")]
        body.append((_kind(row), [escape(cell) for cell in line]))
    versions = sorted({read.text(read.lookup(entry.run.summary, "versions")) for entry in entries})
    text = _caption("Versions: " + "; ".join(versions) + ".")
    return _table(head, body, text_columns=range(1, len(head))) + text
