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
from jaxdem.report import compare, terminal_table
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
        make("coarse", factor=1.2, wall=5.0),
        make("<b>odd</b></script>", factor=0.9, wall=8.0, closure="c.h5"),
    ]
    result = compare(
        make("fine", cells=(300, 50), wall=20.0), runs, tmp_path / "new" / "out", noise=noise, notes=["a <note>"],
        parity={"16 cm": dict(zip(("predicted", "target", "base"), arrays, strict=True))},
        training_cost={"coarse": 30.0}, names=["coarse", "<b>odd</b></script>"],
        sections=[PageSection("Mesh & drag", ["a < b"], [PageTable("T", ["what", "[%]"], [["<i>", "3"]], "said")])],
    )  # fmt: skip
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
    assert (
        rows[0]["cells"] == "300x50"
        and rows[1]["drag_law"] == "koch_hill"
        and rows[2]["closure_file"] == "c.h5"
    )
    assert [float(row["mean_error"]) for row in rows] == pytest.approx([0.0, 0.2, 0.1, 0.02])
    assert [float(row["error_over_noise"]) for row in rows] == pytest.approx([0.0, 10.0, 5.0, 1.0])
    assert float(rows[1]["error_runoff"]) == pytest.approx(0.2)
    assert float(rows[1]["runoff"]) == pytest.approx(1.2 * 2.2 * 3.0**-0.3)
    assert rows[1]["training_cost_s"] == "30.0" and result.noise_floor["height"] == pytest.approx(0.02)
    page = (out / "report.html").read_text()
    assert page.count('<script src="http') == 0 and page.count('<img alt="') == 2
    assert page.count("plotly.js v") == 1 and len(page) < 9_000_000
    assert "<b>odd" not in page and "odd</b></script>" not in page and "a &lt;note&gt;" in page
    for words in (
        "<h2>Mesh &amp; drag</h2>",
        "<li>a &lt; b</li>",
        "<h3>T</h3>",
        "&lt;i&gt;</td><td>3</td>",
        ">said<",
    ):
        assert words in page
    assert {path.name for path in result.files.values()} == {path.name for path in out.iterdir()}


def test_without_fluid_or_parity(make: Any, tmp_path: Path) -> None:
    """Contact mechanics alone: five metrics, no parity file, a page all the same."""
    result = compare(make("a", cells=None), [make("b", cells=None, factor=1.5)], tmp_path)
    row = result.rows[1]
    assert row.metrics_counted == 5 and row.mean_error == pytest.approx(0.5) and row.cells is None
    assert math.isnan(row.errors["fluid_pressure_mean"]) and math.isnan(row.error_over_noise)
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
    result = compare(make("fine"), [bad, short, killed, make("good", factor=1.1, wall=5.0)], tmp_path)
    failed, shorter, dead, good = result.rows[1:]
    assert [row.pareto for row in result.rows] == [False, False, False, False, True] and good.ranked
    assert "INVALID: CFL exceeded" in failed.status and failed.errors["runoff"] == pytest.approx(0.001)
    assert shorter.valid and not shorter.complete and "ended at 1 s of 2 s" in shorter.status
    assert dead.status.startswith("INVALID: no summary") and math.isnan(dead.wall_time_s)
    assert shorter.compared_until == 1.0 and good.compared_until == 2.0
    words = " ".join(result.warnings)
    assert "failed" in words and "short 0 to 1 s" in words and "last output" in words and "killed" in words
    page = (tmp_path / "report.html").read_text()
    assert "failed (INVALID)" in page and "short (incomplete)" in page and "Beware" in page
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(terminal_table(result))
    shown = console.export_text()
    assert "[s]" in shown and "[m]" in shown
    assert "INVALID" in shown and "incomplete" in shown and "CFL exceeded" in shown and "ok *" in shown


def test_a_closure_that_does_not_help_is_called_so(make: Any, tmp_path: Path, no_page: None) -> None:
    plain = make("plain", factor=1.2, wall=5.0)
    cost = {"learned": 1000.0}
    for factor, phrase in (
        (1.4, "does not help, it raises"),
        (1.05, "lowers the mean error"),
        (1.21, "no difference"),
    ):
        learned = make("learned", factor=factor, wall=6.0, closure="c.h5")
        noise = [make("jitter", factor=1.02)]
        result = compare(make("fine", wall=26.0), [plain, learned], tmp_path, noise=noise, training_cost=cost)
        words = " ".join(result.sentences)
        assert phrase in words and "better in" in words, words
        assert "earned back after 50 run(s)" in words
    alone = compare(make("fine"), [make("learned", closure="c.h5")], tmp_path)
    assert "cannot be said" in " ".join(alone.sentences)
    slow = compare(
        make("fine", wall=1.0), [make("learned", closure="c.h5", wall=2.0)], tmp_path, training_cost=cost
    )
    assert "never earned back" in " ".join(slow.sentences) and "2.0 times slower" in " ".join(slow.sentences)


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
    assert [row.name for row in result.rows if row.pareto] == ["cheap", "middle", "best"]
    assert "cheap, middle, best" in result.sentences[-1] and "untimed" in " ".join(result.warnings)


def test_what_makes_runs_unlike_is_said(make: Any, tmp_path: Path, no_page: None) -> None:
    other = make("other", size=(6.0, 2.0), count=100, device="NVIDIA H200")
    words = " ".join(compare(make("fine"), [other], tmp_path).warnings)
    assert "different size" in words and "100, 200" in words and "different machines" in words
    zero = make("fine")
    zero.history["drag_force_mean"][:] = 0.0
    result = compare(zero, [make("b")], tmp_path)
    assert result.rows[1].metrics_counted == 8 and "zero in mean drag force" in " ".join(result.warnings)
    unsound = compare(make("fine", valid=False), [make("b")], tmp_path)
    assert "no error below can be trusted" in " ".join(unsound.warnings)
    assert "no noise floor" in " ".join(
        compare(make("a"), [make("b")], tmp_path, noise=[make("n", valid=False)]).warnings
    )


def test_until_cuts_all_runs(make: Any, tmp_path: Path, no_page: None) -> None:
    run = make("late")
    run.history["height"][11:] *= 50.0
    result = compare(make("fine"), [run, make("short", end=1.0, outputs=11)], tmp_path, until=1.0)
    assert result.rows[1].errors["height"] == 0.0 and result.rows[1].end_time == 1.0
    assert result.rows[2].ranked and "after 1 s" in " ".join(result.warnings)


def test_mean_pressure_of_a_box_without_outlet_is_not_compared(
    make: Any, tmp_path: Path, no_page: None
) -> None:
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
    def named(*paths: str, **options: Any) -> list[str]:
        first, *others = [make(path) for path in paths]
        return [row.name for row in compare(first, others, tmp_path, **options).rows]

    assert named("fine", "coarse") == ["fine", "coarse"]
    assert named("x/run", "y/run") == ["x/run", "y/run"]
    assert len(set(named("x/run", "x/run", "x/run"))) == 3
    assert named("a", "b", names=["B"]) == ["a", "B"] and named("a", "b", names=["A", "B"]) == ["A", "B"]
    assert named("a", "b", names=["a"]) == ["reference", "a"]
    for names in (["x", "y", "z"], ["same", "same"]):
        with pytest.raises(InputError, match="names"):
            named("a", "b", names=names)


def test_wrong_input_is_refused(make: Any, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="at least one"):
        compare(make("a"), [], tmp_path)
    with pytest.raises(InputError, match="training_cost"):
        compare(make("a"), [make("b")], tmp_path, training_cost={"c": 1.0})
    with pytest.raises(InputError, match="parity"):
        compare(
            make("a"),
            [make("b")],
            tmp_path,
            parity={"p": {"predicted": np.ones((3, 2)), "target": np.ones((4, 2))}},
        )


def test_tolerant_reading() -> None:
    assert number({"value": 1e-4, "limit": 2e-4}) == 1e-4 and number(3) == 3.0
    assert math.isnan(number(None)) and math.isnan(number("auto")) and math.isnan(number(True))
    assert (
        text({"mass": 1e-7, "momentum": None}) == "mass 1e-07, momentum not recorded"
        and text({}) == "not recorded"
    )
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
                name.startswith(("jaxdem.report", "jaxdem.metrics", "jaxdem.errors", "jaxdem.io.durable"))
                for name in ours
            ), path
