"""Texts of all figures as drawn, with names that look like markup; the reader itself; what plotly and the page get.

Every figure that any test saves is read (`figure_names` in tests/conftest.py); here are those that no other test saves,
and the names that matplotlib, plotly and HTML would take for their own.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from figure_texts import as_shown, drawn, faults
from matplotlib.figure import Figure

from jaxdem.report import Candidate, Page, animation, chart, compare, figures, parity, single, snapshots, style
from jaxdem.report.comparison import build
from tests.cases.tiers import COMBINATION

HOSTILE = ("a$b_c^2$", "$\\frac{1}{0}$", "_hidden $", "<b>&amp;</b>%{x}", "two\nlines\x1b[31m", "n" * 250)


def test_the_reader_finds_what_is_wrong() -> None:
    """Each fault by itself, and none in a figure as matplotlib makes it."""
    figure = Figure(figsize=(4, 3), layout="constrained")
    axis = figure.subplots()
    axis.plot([1e-9, 2e-9], [1e8, 3e8])
    axis.ticklabel_format(useMathText=True)
    assert faults(figure) == []
    for x, y, text, words in (
        (0.5, 0.5, r"$\mathdefault{0.12}$", "raw markup"),
        (0.5, 0.5, "3 x 10^{2}", "raw markup"),
        (0.9, 0.5, "long enough", "outside the canvas"),
        (0.0, -0.1, "wide", "over '"),
    ):
        note = axis.text(x, y, text, transform=axis.transAxes, parse_math=False, in_layout=False)
        assert any(words in fault for fault in faults(figure)), text
        note.remove()
    title = figure.text(0.5, 0.5, "over the panel")
    assert any("over other axes" in fault for fault in faults(figure))
    title.remove()
    assert faults(figure) == []


@pytest.mark.parametrize("name", [*HOSTILE, "", "plain", "\\$", "$" * 40])
def test_a_name_is_shown_as_it_is(name: str) -> None:
    """No mathematics, one line, nothing but its middle is lost, and a legend takes it."""
    with style.look():
        figure = style.new_figure(6.0, 2.0)
        text = figure.text(0.05, 0.5, style.escaped(name))
        (found,) = drawn(figure).texts.values() or [text]
    shown = as_shown(found).lstrip("\u200b")
    wanted = name.replace("\n", "\\n").replace("\x1b", "\\x1b")
    head, _, tail = shown.partition("\u2026")
    assert wanted.startswith(head) and wanted.endswith(tail) and (shown == wanted or "\u2026" in shown)
    assert style.text_width(style.escaped(name)) <= style.NAME_ROOM
    assert not text.get_text().startswith("_")


def hostile_runs(make: Any) -> list[Candidate]:
    cost = {2: 300.0, 3: 5.0}
    return [
        Candidate(make("run", wall=2.0**i, factor=1.0 + 0.03 * i), name, training_cost_s=cost.get(i, float("nan")))
        for i, name in enumerate(HOSTILE)
    ]


def test_a_comparison_of_hostile_names(make: Any, tmp_path: Path, figure_names: list[str]) -> None:
    figure_names += HOSTILE
    rng = np.random.default_rng(0)
    target = 1e-5 * rng.standard_normal((1700, 2))
    arrays = {"target": target, "predicted": 1.1 * target, "base": 1.5 * target}
    few = {name: array[:20] for name, array in arrays.items() if name != "base"}
    page = Page(parity={HOSTILE[0]: arrays, HOSTILE[-1]: few})
    noise = [make("again", factor=1.01)]
    result = compare(make("fine", wall=90.0), hostile_runs(make), tmp_path, noise=noise, page=page)
    assert {"metrics", "error_vs_time", "snapshots", "parity"} <= result.files.keys()


@COMBINATION
def test_pictures_of_a_run_with_a_hostile_name(make: Any, tmp_path: Path, figure_names: list[str]) -> None:
    """In 2-D and 3-D, valid or not; of a film every frame is read."""
    figure_names += HOSTILE
    flat = make(HOSTILE[0], valid=False, outputs=2)
    flat.summary["reason"] = f"{HOSTILE[1]} in cell $x_1$ " + "and so on " * 25
    figure_names.append("$x_1$")
    single.plot_run(flat, tmp_path / "both.png")
    single.plot_run(make("n" * 250, size=(0.5, 0.5, 2.0), cells=(4, 4, 8)), tmp_path / "two")
    animation.animate(flat, tmp_path / "film.gif", color="drag")


FURTHER = [pytest.param(size, marks=COMBINATION) for size in ((9.0, 0.5), (1200.0, 900.0))]


@pytest.mark.parametrize("size", [(4e-3, 3e-3), (4e-4, 4e-4, 5e-4), *FURTHER])
def test_boxes_of_any_size(make: Any, tmp_path: Path, size: tuple[float, ...]) -> None:
    """Numbers on the axes have up to seven characters."""
    runs = [make(name, size=size, cells=None, radius=0.01 * size[0], outputs=2) for name in "ab"]
    single.plot_run(runs[0], tmp_path)
    snapshots.snapshots_figure(build(Candidate(runs[0]), [Candidate(runs[1])]), tmp_path / "s.png")


def test_plotly_and_the_page_show_names_as_they_are(make: Any) -> None:
    """Plotly's markup is a kind of HTML and `%{x}` a template of its own; a script ends nowhere but at its end."""
    runs = hostile_runs(make)
    runs[1].run.summary.update(reason="%{y} </script><b>", valid=False)
    result = build(Candidate(make("fine")), runs)
    metrics = chart.to_html(figures.metrics_panels(result.every), "metrics")
    error = chart.to_html([figures.error_panel(result)], "error")
    for fragment in (metrics, error):
        assert fragment.count("</script>") == fragment.count("<script")
        data = json.loads(re.search(r'newPlot\(\s*"[^"]+",\s*(\[.*?\]),\s*\{', fragment, re.S)[1])
        names = {trace["name"] for trace in data}
        assert "&lt;b&gt;&amp;amp;&lt;/b&gt;%&#123;x}" in names
        assert all("<" not in name and "%{" not in name for name in names)
        templates = "".join(trace.get("hovertemplate", "") for trace in data)
        assert "<b>" not in templates and "%{y} " not in templates


def test_one_scale_for_both_panels_of_a_parity_plot(monkeypatch: pytest.MonkeyPatch) -> None:
    kept: list[Any] = []
    monkeypatch.setattr(style, "save", lambda figure, path, **_: kept.append(figure))
    target = np.random.default_rng(0).standard_normal((4000, 1))
    arrays = {"target": target, "predicted": target, "base": 0.5 * target}
    parity.parity_figure({"a": arrays}, Path("x.png"))
    panels = [axis for axis in kept[0].findobj(lambda item: hasattr(item, "get_xlabel")) if axis.collections]
    kept[0].canvas.draw()
    shapes = [axis.get_window_extent() for axis in panels if "force" in axis.get_ylabel()]
    assert len({axis.collections[0].get_clim() for axis in panels if "force" in axis.get_ylabel()}) == 1
    assert len(shapes) == 2 and all(box.width == pytest.approx(box.height, rel=0.01) for box in shapes)
    # As large as the figure allows: two squares side by side.
    assert sum(box.width for box in shapes) > 0.6 * kept[0].bbox.width
