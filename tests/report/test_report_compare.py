"""The comparison's figures, files and words on fake runs whose errors are known."""

from __future__ import annotations

import ast
import csv
import io
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

import jaxdem.metrics
import jaxdem.report
from jaxdem.errors import InputError
from jaxdem.metrics import METRICS
from jaxdem.report import Candidate, Page, compare, terminal_table
from jaxdem.report.page import PageSection, PageTable
from jaxdem.report.runs import number, scene_differences, text

NAMES = [metric.name for metric in METRICS]


@pytest.fixture
def no_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the drawing out where only the numbers and the words matter."""
    monkeypatch.setattr(jaxdem.report, "_write", lambda *_: None)


def read_csv(path: Path) -> list[dict[str, str]]:
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def test_files_and_columns(make: Any, tmp_path: Path) -> None:
    """All files of the contract, one row a run, the known error in every column, and a page that needs no network."""
    noise = [make("jitter", factor=1.02, wall=20.0)]
    arrays = np.random.default_rng(0).standard_normal((3, 100, 2))
    runs = [
        Candidate(make("coarse", factor=1.2, wall=5.0), "coarse", training_cost_s=30.0),
        Candidate(make("odd", factor=0.9, wall=8.0, closure="c.h5"), "<b>odd</b></script>"),
    ]
    page = Page(
        notes=["a <note>"], parity={"16 cm": dict(zip(("predicted", "target", "base"), arrays, strict=True))},
        sections=[PageSection("Mesh & drag", ["a < b"], [PageTable("T", ["what", "[%]"], [["<i>", "3"]], "said")])],
    )  # fmt: skip
    fine = make("fine", cells=(300, 50), wall=20.0)
    result = compare(fine, runs, tmp_path / "new" / "out", noise=noise, page=page)
    out = tmp_path / "new" / "out"
    for file in (
        "report.html",
        "comparison.csv",
        "metrics.png",
        "snapshots.png",
        "error_vs_time.png",
        "parity.png",
    ):
        assert (out / file).stat().st_size > 500, file
    rows = read_csv(out / "comparison.csv")
    assert [row["role"] for row in rows] == ["reference", "run", "run", "noise"]
    first = ["name", "cells", "particle_count", "closure_file", "drag_law", "precision"]
    first += ["contact_time_step", "wall_time_s", "valid"]
    wanted = [*first, *NAMES, *(f"error_{name}" for name in NAMES), "mean_error", "error_over_noise"]
    assert list(rows[0])[: len(wanted)] == wanted
    assert rows[0]["cells"] == "300x50" and rows[1]["drag_law"] == "koch_hill" and rows[2]["closure_file"] == "c.h5"
    assert [float(row["mean_error"]) for row in rows] == pytest.approx([0.0, 0.2, 0.1, 0.02])
    assert [float(row["error_over_noise"]) for row in rows] == pytest.approx([0.0, 10.0, 5.0, 1.0])
    assert float(rows[1]["error_runoff"]) == pytest.approx(0.2)
    assert float(rows[1]["runoff"]) == pytest.approx(1.2 * 2.2 * 3.0**-0.3)
    assert rows[1]["training_cost_s"] == "30.0" and result.noise_floor["height"] == pytest.approx(0.02)
    html = (out / "report.html").read_text()
    # The parity plot; the snapshots are beside it, for the page plays all outputs.
    assert html.count('<script src="http') == 0 and html.count('<img alt="') == 1
    assert html.count("plotly.js v") == 1 and len(html) < 9_000_000
    assert "<b>odd" not in html and "odd</b></script>" not in html and "a &lt;note&gt;" in html
    for words in (
        "<h2>Mesh &amp; drag</h2>",
        "<li>a &lt; b</li>",
        "<h3>T</h3>",
        "&lt;i&gt;</td><td>3</td>",
        ">said<",
        "<h2>Energy of the particles</h2>",
        ">2.5</td>",  # five stores of springs, surfaces and bonds at the end
        "4 J taken from the particles by contacts and fluid",
    ):
        assert words in html
    assert {path.name for path in result.files.values()} == {path.name for path in out.iterdir()}


def test_without_fluid_or_parity(make: Any, tmp_path: Path) -> None:
    """Contact mechanics alone: five metrics, no parity file, a page all the same."""
    result = compare(make("a", cells=None), [make("b", cells=None, factor=1.5)], tmp_path)
    row = result.rows[1]
    assert row.metrics_counted == 5 and row.mean_error == pytest.approx(0.5) and row.cells is None
    assert math.isnan(row.errors["fluid_pressure_mean"]) and math.isnan(result.over_noise(row))
    assert "error_over_noise" not in read_csv(tmp_path / "comparison.csv")[0]
    assert not (tmp_path / "parity.png").exists() and (tmp_path / "snapshots.png").exists()
    assert "not defined" not in " ".join(result.sentences)


def test_invalid_and_short_runs_are_marked_and_not_ranked(
    make: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run that failed early is the cheapest, yet on no front; every output names it."""
    monkeypatch.setattr(jaxdem.report.snapshots, "snapshots_figure", lambda *_: None)
    bad = make("failed", factor=1.001, end=1.0, outputs=11, wall=0.1, valid=False)
    bad.history["runoff"][-2:] = [np.inf, np.nan]
    short = make("short", factor=1.001, end=1.0, outputs=11, wall=0.2)
    killed = make("killed", end=0.5, outputs=6)
    killed.summary = {}
    others = [make("good", factor=1.1, wall=5.0), make("dear", factor=1.1, wall=9.0)]
    result = compare(make("fine"), [bad, short, killed, *others], tmp_path)
    failed, shorter, dead, good, _ = result.runs
    assert result.front == [good] and good.ranked
    assert "INVALID: CFL exceeded" in failed.status and failed.errors["runoff"] == pytest.approx(0.001)
    assert shorter.valid and not shorter.complete and "ended at 1 s of 2 s" in shorter.status
    assert dead.status.startswith("INVALID: no summary") and math.isnan(dead.run_time_s)
    assert shorter.compared_until == 1.0 and good.compared_until == 2.0
    words = " ".join(result.warnings)
    assert "failed" in words and "short 0 to 1 s" in words and "last output" in words and "killed" in words
    page = (tmp_path / "report.html").read_text()
    assert "failed (INVALID)" in page and "short (incomplete)" in page and "Warnings" in page
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(terminal_table(result))
    shown = console.export_text()
    assert "[s]" in shown and "[m]" in shown
    assert "INVALID" in shown and "incomplete" in shown and "CFL exceeded" in shown and "ok *" in shown


FACTORS, WALLS = (1.05, 1.19, 1.2, 1.21, 1.4), (2.0, 6.0, 26.0, 40.0, None)


@pytest.mark.parametrize("noisy", [False, True])
@pytest.mark.parametrize("wall", WALLS)
@pytest.mark.parametrize("factor", FACTORS)
def test_no_two_findings_contradict_each_other(
    make: Any, tmp_path: Path, no_page: None, factor: float, wall: float | None, noisy: bool
) -> None:
    """The error is 0.2, with the closure factor - 1, the noise 0.02: what is said of error, cost and front follows."""
    plain, learned = (
        make("plain", factor=1.2, wall=6.0),
        make("learned", factor=factor, wall=wall, closure="c.h5"),
    )
    noise = [make("jitter", factor=1.02, wall=26.0)] * noisy
    runs = [plain, Candidate(learned, training_cost_s=1000.0)]
    result = compare(make("fine", wall=26.0), runs, tmp_path, noise=noise)
    words = " ".join(result.sentences)
    gain = 1.2 - factor
    differs = abs(gain) > (0.02 if noisy else 0.0) + 1e-12
    said = {
        "lowers the mean error": noisy and differs and gain > 0,
        "the closure raises the mean error": noisy and differs and gain < 0,
        "is no better than the run without it": not differs,
        "is lower with the closure": not noisy and differs and gain > 0,
        "is higher with the closure": not noisy and differs and gain < 0,
        "is not regained": not differs or gain < 0,
        "never regained": differs and gain > 0 and wall is not None and wall >= 26.0,
        "is regained after": differs and gain > 0 and wall is not None and wall < 26.0,
        "not known when this time is regained": differs and gain > 0 and wall is None,
        "the noise is not known": not noisy,
    }
    assert {phrase: phrase in words for phrase in said} == said, words
    assert sum(phrase in words for phrase in list(said)[:5]) == 1
    if said["is regained after"]:
        assert f"after {math.ceil(1000 / (26 - wall))} run(s)" in words
    front = {row.name for row in result.front}
    if wall is not None and differs and gain < 0:
        assert "learned" not in front or wall < 6.0
    if wall == 6.0 and differs:
        assert front == {"learned" if gain > 0 else "plain"}
    ratio = {
        2.0: "13 times faster than",
        6.0: "4.3 times faster than",
        26.0: "as fast as",
        40.0: "1.5 times slower than",
    }
    assert wall is None or f"it runs {ratio[wall]} the reference" in words


def test_a_closure_without_a_twin_is_not_judged(make: Any, tmp_path: Path, no_page: None) -> None:
    learned = Candidate(make("learned", closure="c.h5"), training_cost_s=10.0)
    words = " ".join(compare(make("fine"), [learned], tmp_path).sentences)
    assert (
        "It is not known whether the closure improves learned" in words
        and "not known whether this time is regained" in words
    )
    assert "is regained after" not in words and "is not regained" not in words


def test_run_time_is_without_compiling(make: Any, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    """Two runs of one speed, one compiled and one from the cache: the same run time in row, files, figure and words."""
    cold, cached = make("cold", wall=5.8, factor=1.2), make("cached", wall=5.8, factor=1.2)
    cold.summary |= {"wall_time_s": 5.8 + 43.0, "stages_s": {"compile": 43.0}}
    result = compare(make("fine", wall=5.8), [cold, cached], tmp_path)
    assert [row.run_time_s for row in result.rows] == pytest.approx([5.8] * 3)
    assert [row.compile_time_s for row in result.rows] == [3.0, 43.0, 3.0]
    rows = read_csv(tmp_path / "comparison.csv")
    assert [float(row["run_time_s"]) for row in rows] == pytest.approx([5.8] * 3)
    assert [row["compile_time_s"] for row in rows] == ["3.0", "43.0", "3.0"]
    assert float(rows[1]["wall_time_s"]) == pytest.approx(48.8)
    words = " ".join(result.sentences)
    assert words.count("it runs as fast as the reference") == 2 and "faster than" not in words
    page = (tmp_path / "report.html").read_text()
    assert "compile time" in page and page.count("5.8 s</td><td>43 s</td><td>1.00</td>") == 1
    untold = make("untold")
    untold.summary |= {"stages_s": {}}
    request.getfixturevalue("no_page")
    result = compare(make("fine"), [untold], tmp_path)
    assert math.isnan(result.rows[1].run_time_s) and "untold" in " ".join(result.warnings)


def test_packs_give_means_and_their_range(make: Any, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    """Errors 0.1, 0.2, 0.3 over the packs: mean 0.2, noise half of the range, a point for each in the figure."""
    packs = [make("a1", factor=1.2, wall=5.0), make("a2", factor=1.3, wall=6.0), make("a3", valid=False)]
    runs = [Candidate(make("a", factor=1.1, wall=4.0), packs=packs), make("b", factor=1.25, wall=9.0)]
    result = compare(make("fine", wall=20.0), runs, tmp_path)
    row = result.rows[1]
    assert row.mean_error == pytest.approx(0.2) and row.errors["height"] == pytest.approx(0.2)
    assert row.pack_errors == pytest.approx([0.1, 0.2, 0.3]) and row.run_time_s == pytest.approx(5.0)
    assert result.error_noise == pytest.approx(0.1) and result.time_noise == pytest.approx(0.2)
    words = " ".join(result.sentences)
    assert "10-30 % over 3 packs" in words and "differ by 10 % or less count as equal" in words
    assert "3 of 4 packs are counted" in " ".join(result.warnings)
    assert result.front == [row]
    record = read_csv(tmp_path / "comparison.csv")[1]
    assert record["packs"] == "3" and float(record["mean_error_highest"]) == pytest.approx(0.3)
    page = (tmp_path / "report.html").read_text()
    assert "10-30 %" in page and page.count("one pack") == 1
    noise = [make("jitter", factor=1.02, wall=19.0)]
    request.getfixturevalue("no_page")
    result = compare(make("fine", wall=20.0), runs, tmp_path, noise=noise)
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(terminal_table(result))
    shown = console.export_text()
    assert all(word in shown for word in ("10-30 %", "run-off", "height", "compile", "noise")) and "…" not in shown


def test_pareto_front_of_runs(make: Any, tmp_path: Path, no_page: None) -> None:
    points = {
        "cheap": (1.0, 1.5),
        "beaten": (3.0, 1.6),
        "middle": (3.0, 1.2),
        "best": (9.0, 1.01),
        "untimed": (None, 1.0),
    }
    runs = [make(name, wall=wall, factor=factor) for name, (wall, factor) in points.items()]
    result = compare(make("fine", wall=10.0), runs, tmp_path)
    assert [row.name for row in result.front] == ["cheap", "middle", "best"]
    assert "cheap, middle, best" in result.sentences[-1] and "untimed" in " ".join(result.warnings)
    assert "noise is not known" in result.sentences[-1]
    noise = [make("jitter", factor=1.25, wall=10.0)]  # best is not better than middle by more than this, cheap is worse
    result = compare(make("fine", wall=10.0), runs, tmp_path, noise=noise)
    assert [row.name for row in result.front] == ["cheap", "middle"]
    assert "by more than the noise" in result.sentences[-1]


def test_what_makes_runs_unlike_is_said(make: Any, tmp_path: Path, no_page: None) -> None:
    other = make("other", size=(6.0, 2.0), count=100, device="NVIDIA H200")
    words = " ".join(compare(make("fine"), [other], tmp_path).warnings)
    assert "different size" in words and "100, 200" in words and "different machines" in words
    zero = make("fine")
    zero.history["drag_force_mean"][:] = 0.0
    result = compare(zero, [make("b")], tmp_path)
    assert result.rows[1].metrics_counted == 8 and "zero in mean drag force" in " ".join(result.warnings)
    unsound = compare(make("fine", valid=False), [make("b")], tmp_path)
    assert "do not trust any error" in " ".join(unsound.warnings)
    assert "the noise is not known" in " ".join(
        compare(make("a"), [make("b")], tmp_path, noise=[make("n", valid=False)]).warnings
    )


def test_until_cuts_all_runs(make: Any, tmp_path: Path, no_page: None) -> None:
    run = make("late")
    run.history["height"][11:] *= 50.0
    result = compare(make("fine"), [run, make("short", end=1.0, outputs=11)], tmp_path, until=1.0)
    assert result.rows[1].errors["height"] == 0.0 and result.rows[1].end_time == 1.0
    assert result.rows[2].ranked and "comparison ends at 1 s" in " ".join(result.warnings)


def test_mean_pressure_of_a_box_without_outlet_is_not_compared(make: Any, tmp_path: Path, no_page: None) -> None:
    """It is zero by convention, and the rounding of one run is no reference for that of another."""
    closed = {side: {"kind": "no_slip"} for side in ("left", "right", "bottom", "top")}
    for boundary, counted in ((closed, 8), (closed | {"right": {"kind": "outlet"}}, 9)):
        fine, run = make("fine"), make("run", factor=1.1)
        for one in (fine, run):
            one.scene["boundary"] = boundary
            one.history["fluid_pressure_mean"] = 1e-7 * np.cos(np.arange(21) ** 2 * one.history["height"][0])
        row = compare(fine, [run], tmp_path).rows[1]
        assert row.metrics_counted == counted
        assert math.isnan(row.errors["fluid_pressure_mean"]) == (counted == 8)
        assert (row.mean_error == pytest.approx(0.1)) == (counted == 8)


def test_names(make: Any, tmp_path: Path, no_page: None) -> None:
    def named(*given: tuple[str, str]) -> list[str]:
        first, *others = [Candidate(make(path), name) for path, name in given]
        return [row.name for row in compare(first, others, tmp_path).rows]

    assert named(("fine", ""), ("coarse", "")) == ["fine", "coarse"]
    assert named(("x/run", ""), ("y/run", "")) == ["x/run", "y/run"]
    assert len(set(named(*[("x/run", "")] * 3))) == 3
    assert named(("a", ""), ("b", "B")) == ["a", "B"] and named(("a", "A"), ("b", "B")) == ["A", "B"]
    assert named(("a", ""), ("b", "a")) == ["runs/a", "a"]
    with pytest.raises(InputError, match="names"):
        named(("a", "same"), ("b", "same"))


def test_wrong_input_is_refused(make: Any, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="at least one"):
        compare(make("a"), [], tmp_path)
    page = Page(parity={"p": {"predicted": np.ones((3, 2)), "target": np.ones((4, 2))}})
    with pytest.raises(InputError, match="parity"):
        compare(make("a"), [make("b")], tmp_path, page=page)
    with pytest.raises(InputError, match=r"^reference = '.*none': has no output that can be read yet"):
        compare(make("none", outputs=0), [make("b")], tmp_path)
    with pytest.raises(InputError, match="has no output until -1 s"):
        compare(make("a"), [make("b")], tmp_path, until=-1.0)
    assert not list(tmp_path.iterdir())


def test_a_single_run_has_no_front(make: Any, tmp_path: Path, no_page: None) -> None:
    """Nothing is chosen among one run: no star, no sentence. Of two the mark is said in plain words."""
    shown = []
    for runs in ([make("a")], [make("a"), make("b", factor=1.1)]):
        result = compare(make("fine"), runs, tmp_path)
        console = Console(width=80, record=True, file=io.StringIO())
        console.print(terminal_table(result))
        shown.append(console.export_text() + result.sentences[-1])
    assert "*" not in shown[0] and "Pareto" not in shown[0]
    assert "ok *" in shown[1] and shown[1].count("no other run is both faster and more accurate") == 2


def test_tolerant_reading() -> None:
    assert number({"value": 1e-4, "limit": 2e-4}) == 1e-4 and number(3) == 3.0
    assert math.isnan(number(None)) and math.isnan(number("auto")) and math.isnan(number(True))
    assert text({"mass": 1e-7, "momentum": None}) == "mass 1e-07, momentum not recorded" and text({}) == "not recorded"
    changed = scene_differences({"a": {"b": 1, "c": (1, 2)}, "d": 2}, {"a": {"b": 3, "c": [1, 2]}, "e": 4})
    assert changed == {"a.b": (1, 3), "d": (2, None), "e": (None, 4)}


def test_imports_no_jax() -> None:
    for path in [*Path(jaxdem.report.__file__).parent.glob("*.py"), Path(jaxdem.metrics.__file__)]:
        for node in ast.walk(ast.parse(path.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                names += [f"{node.module}.{alias.name}" for alias in node.names]
            assert not {name.split(".")[0] for name in names} & {
                "jax",
                "jaxlib",
                "flax",
                "optax",
                "jax_md",
            }, path
            ours = {name for name in names if name.startswith("jaxdem")}
            assert all(
                name.startswith(
                    ("jaxdem.report", "jaxdem.metrics", "jaxdem.errors", "jaxdem.files", "jaxdem.io", "jaxdem.solids")
                )
                for name in ours
            ), path
