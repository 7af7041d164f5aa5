"""report.html: one page that needs nothing beside it."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

from plotly.offline import get_plotlyjs  # type: ignore[import-untyped, unused-ignore]

from jaxdem.files.durable import write_bytes
from jaxdem.io.energy import energy_text
from jaxdem.metrics import METRICS
from jaxdem.report import runs as read
from jaxdem.report.chart import Panel, to_html
from jaxdem.report.comparison import Comparison, Row
from jaxdem.report.figures import left_out
from jaxdem.report.findings import FRONT_MEANING, duration, error_range, percent
from jaxdem.report.parity import Forces
from jaxdem.report.player import player
from jaxdem.report.probes import probe_differences

CSS = Path(__file__).with_name("page.css")
DASH = "&ndash;"


@dataclass(frozen=True)
class PageTable:
    """A table of words; the first column is text, the others are numbers as they shall stand there."""

    title: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""


@dataclass(frozen=True)
class PageSection:
    """A heading with sentences and tables of its own."""

    title: str
    text: Sequence[str]
    tables: Sequence[PageTable]


@dataclass(frozen=True)
class Page:
    """What the page has beside the comparison.

    Attributes:
        notes: sentences.
        parity: of closures, by a heading.
        sections: after the notes.
    """

    title: str = "Comparison of runs"
    notes: Sequence[str] = ()
    parity: Mapping[str, Forces] = field(default_factory=dict)
    sections: Sequence[PageSection] = ()


def write_page(
    page: Page, comparison: Comparison, error: Panel, metrics: Sequence[Panel], probes: Sequence[Panel], path: Path
) -> None:
    """Write the page, with the PNG files that `comparison.files` names; of them snapshots where nothing is played."""
    clips, front = player(comparison.rows), len(comparison.front) > 1
    packs = any(len(row.trials) > 1 for row in comparison.rows)
    trained = any(row.training_cost_s > 0 for row in comparison.rows)
    note = left_out(comparison.every)
    body = [
        f"<h1>{escape(page.title)}</h1>",
        "<h2>Summary</h2>",
        _list(comparison.sentences, "lead"),
        _warnings([sentence for sentence in comparison.warnings if sentence != note]),
        "<h2>Error against run time</h2>",
        to_html([error], "error-plot"),
        _caption(
            "Each point is a run. Lower and further to the left is better. The run time does not include compilation. "
            "The error is the mean over the metrics."
            + (" Small points are the same run with other packs, bars their range." if packs else "")
            + (" A hollow point includes the training time." if trained else "")
            + " The vertical line is the run time of the reference, whose error is zero by definition."
            + (f" Of a run on the Pareto front it holds that {FRONT_MEANING}." if front else "")
        ),
        "<h2>Errors by metric</h2>",
        _error_table(comparison),
        "<h2>Final values</h2>",
        _final_table(comparison),
        *_energies(comparison),
        "<h2>The metrics over time</h2>",
        to_html(metrics, "metrics-plot"),
        _caption(
            "Click a name in the legend to hide that run in all panels. Drag to zoom; double-click to zoom out."
            + (f" {note}" if note else "")
        ),
        *(_probes(comparison, probes) if probes else []),
        *(["<h2>Animations</h2>", clips] if clips else _image(comparison, "snapshots")),
        *_image(comparison, "parity"),
        *(["<h2>Notes</h2>", _list(page.notes, "notes")] if page.notes else []),
        *map(_section, page.sections),
        "<h2>Differences from the scene of the reference</h2>",
        _difference_table(comparison),
        "<h2>Versions, machines and state of the runs</h2>",
        _machine_table(comparison),
    ]
    head = (
        f'<meta charset="utf-8"><title>{escape(page.title)}</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<style>{CSS.read_text(encoding='utf-8')}</style><script>{get_plotlyjs()}</script>"
    )
    lines = "\n".join(body)
    html = f'<!doctype html>\n<html lang="en"><head>{head}</head>\n<body>\n{lines}\n</body></html>\n'
    write_bytes(path, html.encode())


def _probes(comparison: Comparison, panels: Sequence[Panel]) -> list[str]:
    """Figures of the probes, and their means beside those of the reference."""
    blocks = ["<h2>Probes</h2>", to_html(panels, "probes-plot")]
    blocks.append(_caption("Series over time; profiles are those of the last time, and their axis points upwards."))
    found = probe_differences(comparison.reference, comparison.runs)
    if not found:
        return blocks
    body = []
    for run, probe, column, own, there in found:
        change = f"{100.0 * (own - there) / abs(there):+.3g} %" if there else ""
        body.append(("", [escape(run), escape(probe), escape(column), f"{own:.4g}", f"{there:.4g}", change]))
    head = ["run", "probe", "quantity", "mean", "mean of the reference", "difference"]
    note = "Means over all lines of a probe's file, whatever their times."
    return [*blocks, _table(head, body, text_columns=(0, 1, 2)), _caption(note)]


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


def _warnings(sentences: Sequence[str]) -> str:
    if not sentences:
        return ""
    return f'<div class="warning"><strong>Warnings</strong>{_list(sentences, "notes")}</div>'


IMAGES = {
    "snapshots": ("Snapshots", "Particles have their true radius. All panels have the same colour scales."),
    "parity": ("Force from the closure and from its base law against the target", ""),
}
"""Heading and caption of the PNG files in the page."""


def _image(comparison: Comparison, name: str) -> list[str]:
    if name not in comparison.files:
        return []
    heading, caption = IMAGES[name]
    data = base64.b64encode(comparison.files[name].read_bytes()).decode("ascii")
    image = f'<img alt="{escape(heading)}" src="data:image/png;base64,{data}">'
    return [f"<h2>{escape(heading)}</h2>", image, _caption(caption)]


def _table(head: Sequence[str], body: Sequence[tuple[str, Sequence[str]]], text_columns: Sequence[int] = ()) -> str:
    """A table of cells that are HTML already; `body` has (class of the row, cells), a cell may begin with <td."""

    def cells(kind: str, row: Sequence[str]) -> str:
        names = (' class="text"' if column in text_columns else "" for column in range(len(row)))
        pairs = zip(row, names, strict=True)
        return "".join(cell if cell.startswith("<td") else f"<{kind}{name}>{cell}</{kind}>" for cell, name in pairs)

    lines = "".join(f'<tr class="{kind}">{cells("td", row)}</tr>' for kind, row in body)
    return f'<div class="wide"><table><thead><tr>{cells("th", head)}</tr></thead><tbody>{lines}</tbody></table></div>'


def _kind(row: Row) -> str:
    return " ".join(filter(None, (row.role if row.role != "run" else "", "" if row.ranked else "unsound")))


def _name(row: Row) -> str:
    return f'<span class="swatch" style="background:{row.look.color}"></span>{escape(row.label)}'


def _value(number: float, pattern: str = ".4g") -> str:
    return format(number, pattern) if math.isfinite(number) else DASH


def _seconds(number: float, unknown: str = DASH) -> str:
    return duration(number) if math.isfinite(number) else unknown


def _error_table(comparison: Comparison) -> str:
    noise, packs = bool(comparison.noise_rows), any(len(row.trials) > 1 for row in comparison.rows)
    head = ["run", "cells", "run time", "compile time", "speed-up", *(metric.label for metric in METRICS), "mean"]
    head += ["range over packs"] * packs + ["mean over noise"] * noise
    body = []
    for row in comparison.runs:
        speed_up = comparison.reference.run_time_s / row.run_time_s if row.run_time_s > 0 else math.nan
        line = [_name(row), row.cells_text, _seconds(row.run_time_s), _seconds(row.compile_time_s)]
        line += [_value(speed_up, ".2f"), *(_error_cell(row, metric.name, comparison) for metric in METRICS)]
        line.append(f"<td><strong>{percent(row.mean_error)}</strong></td>")
        line += [error_range(row) if len(row.trials) > 1 else DASH] * packs
        body.append((_kind(row), line + [_value(comparison.over_noise(row), ".2f")] * noise))
    if math.isfinite(comparison.noise_mean):
        floor = [percent(comparison.noise_floor[metric.name]) for metric in METRICS]
        body.append(("noise", ["noise", *[""] * 4, *floor, percent(comparison.noise_mean), *[""] * packs, "1"]))
    return _table(head, body) + _caption(
        "Bold: the smallest error in that metric among valid, complete runs. The run time does not include "
        "compilation; loading a program from the cache counts as compilation."
        + (" Errors are means over the packs, times are medians." if packs else "")
    )


def _error_cell(row: Row, name: str, comparison: Comparison) -> str:
    error = row.errors[name]
    others = [r.errors[name] for r in comparison.runs if r.ranked and math.isfinite(r.errors[name])]
    text = percent(error) if math.isfinite(error) else "&infin;" if error == math.inf else DASH
    best = len(others) > 1 and row.ranked and error == min(others)
    return f'<td class="best">{text}</td>' if best else f"<td>{text}</td>"


def _final_table(comparison: Comparison) -> str:
    head = ["run", "at time [s]", *(f"{metric.label} [{metric.unit}]" for metric in METRICS)]
    return _table(
        head,
        [
            (_kind(row), [_name(row), _value(row.end_time), *map(_value, row.final.values())])
            for row in comparison.every
        ],
    )  # fmt: skip


def _energies(comparison: Comparison) -> list[str]:
    """What the particles of each run store at its start and end, and the balance; nothing without particles."""
    body, springs = [], ("normal", "tangential", "rolling", "surface", "bonds")
    for row in comparison.every:
        told = read.lookup(row.run.summary, "energy")
        if not isinstance(told, Mapping):
            continue
        cells = [_name(row)]
        for names in (("translation", "rotation"), ("potential",), springs):
            for moment in ("start", "end"):
                known = [read.number(read.lookup(told, f"{moment}.{name}")) for name in names]
                cells.append(_value(sum(known)))
        body.append((_kind(row), [*cells, escape(energy_text(told) or "not known")]))
    if not body:
        return []
    stores = ("kinetic energy", "potential energy", "springs, surfaces, bonds")
    head = ["run", *(f"{store}, {moment} [J]" for store in stores for moment in ("start", "end")), "balance"]
    note = (
        "What is taken is what the particles have less at the end. A run with output.energy tells the parts, "
        "in its summary.json."
    )
    return ["<h2>Energy of the particles</h2>", _table(head, body, text_columns=(len(head) - 1,)), _caption(note)]


def _difference_table(comparison: Comparison) -> str:
    body = [
        ("", [escape(text) for text in (row.name, key, _short(here), _short(there))])
        for row in comparison.every[1:]
        for key, (here, there) in read.scene_differences(row.run.scene, comparison.reference.run.scene).items()
    ]
    if not body:
        return _caption("None: all scenes are the same.")
    return _table(["run", "key", "value", "in the reference"], body, text_columns=(1, 2, 3))


def _short(value: object) -> str:
    text = "not set" if value is None else str(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _machine_table(comparison: Comparison) -> str:
    head = ["run", "state", "run time", "compile time", "time steps [s]", "closure", "out of range"]
    recorded = ("residuals", "precision", "device")
    body = []
    for row in comparison.every:
        summary = row.run.summary
        outside = read.number(read.lookup(summary, "closure.out_of_range_fraction"))
        line = [row.name, row.status]
        line += [_seconds(time, "not recorded") for time in (row.run_time_s, row.compile_time_s)]
        line += [read.text(read.lookup(summary, "time_steps")), row.closure or f"none ({row.drag or 'no drag'})"]
        line += [percent(outside) if math.isfinite(outside) else "-"]
        line += [read.text(read.lookup(summary, key)) for key in recorded]
        body.append((_kind(row), [escape(cell) for cell in line]))
    versions = sorted({read.text(read.lookup(row.run.summary, "versions")) for row in comparison.every})
    columns = range(1, len(head) + len(recorded))
    return _table([*head, *recorded], body, columns) + _caption("Versions: " + "; ".join(versions) + ".")
