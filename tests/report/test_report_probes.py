"""Figures and tables of the probes of runs."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from jaxdem.errors import InputError
from jaxdem.report import compare
from jaxdem.report.comparison import Candidate, build
from jaxdem.report.force_lines import force_lines
from jaxdem.report.probes import probe_differences, probe_panels
from jaxdem.report.single import plot_run
from tests.report.conftest import FakeProbes, make_run


def measured(name: str, factor: float = 1.0) -> Any:
    """A run with a probe of every kind; a wall's force falls from 4 N to 1 N times the factor."""
    run = make_run(name)
    time = np.array([0.5, 1.0, 1.5, 2.0])
    heights, gauges = np.array([0.5, 1.5]), np.tile([10.0, 30.0], 4)
    run.probes = FakeProbes(
        floor={"time": time, "force_x": 0.0 * time, "force_z": -factor * np.array([4.0, 3.0, 2.0, 1.0])},
        layers={
            "time": np.repeat(time, 2), "z": np.tile(heights, 4), "solid_fraction": factor * np.arange(8) / 16.0,
        },
        gauge={"time": np.repeat(time, 2), "fluid_pressure": factor * gauges},
        touch={"time": time, "overlap": time},
    )  # fmt: skip
    run.scene["probes"] = [
        {"name": "floor", "kind": "wall", "side": "bottom"}, {"name": "layers", "kind": "profile", "axis": "z"},
        {"name": "gauge", "kind": "point"}, {"name": "touch", "kind": "contacts"},
    ]  # fmt: skip
    return run


def test_panels_hold_series_over_time_profiles_and_points() -> None:
    rows = build(Candidate(measured("a")), [Candidate(measured("b", 2.0))]).every
    panels = {panel.y_label + "|" + panel.x_label: panel for panel in probe_panels(rows)}
    assert list(panels) == [
        "floor: force x [N]|time [s]", "floor: force z [N]|time [s]", "z [m]|layers: solid fraction [-]",
        "gauge: fluid pressure [Pa]|time [s]",
    ]  # fmt: skip
    force = panels["floor: force z [N]|time [s]"].series
    assert [one.label for one in force] == [row.label for row in rows]
    np.testing.assert_array_equal(force[1].y, [-8.0, -6.0, -4.0, -2.0])
    profile = panels["z [m]|layers: solid fraction [-]"].series[0]
    np.testing.assert_array_equal(profile.x, [6.0 / 16.0, 7.0 / 16.0])
    np.testing.assert_array_equal(profile.y, [0.5, 1.5])
    points = panels["gauge: fluid pressure [Pa]|time [s]"].series
    assert [one.place for one in points[:2]] == ["place 1 of 2", "place 2 of 2"]
    np.testing.assert_array_equal(points[1].y, [30.0] * 4)
    # Places of a run have different dashes, whose colour is the run's; of a run alone different colours.
    assert len({(one.color, one.line) for one in points}) == len(points) == 4
    assert len({one.color for one in points}) == 2
    (alone,) = [panel for panel in probe_panels(rows[:1]) if "gauge" in panel.y_label]
    assert len({one.color for one in alone.series}) == 2 and len({one.line for one in alone.series}) == 1


def test_the_power_of_a_wall_is_drawn_where_it_moves() -> None:
    run, time = measured("a"), np.array([0.5, 1.0])
    run.probes = FakeProbes(
        floor={"time": time, "force_z": -time, "power": 0.0 * time},
        drum={"time": time, "force_z": -time, "power": -time},
    )
    run.scene["probes"] = [{"name": name, "kind": "wall", "wall": 0} for name in ("floor", "drum")]
    labels = [panel.y_label for panel in probe_panels(build(Candidate(run), [Candidate(run)]).every[:1])]
    assert [label.split(" [")[0] for label in labels] == ["floor: force z", "drum: force z", "drum: power"]


def test_places_are_told_by_where_they_are() -> None:
    run = measured("a")
    where = {"x": np.tile([0.25, 0.5], 4), "z": np.full(8, 0.125)}
    run.probes = FakeProbes(
        gauge={"time": np.repeat([0.5, 1.0, 1.5, 2.0], 2), **where, "fluid_pressure": np.arange(8.0)}
    )
    (panel,) = probe_panels(build(Candidate(run), [Candidate(measured("b"))]).every[:1])
    assert [one.place for one in panel.series] == ["(0.25, 0.125) m", "(0.5, 0.125) m"]


def test_a_single_row_is_drawn_as_a_point() -> None:
    """A line through one point is not seen, nor through points between gaps."""
    run = measured("a")
    run.probes = FakeProbes(
        floor={"time": np.array([2.0]), "force_z": np.array([-4.0])},
        layers={"time": np.full(3, 2.0), "z": np.arange(3.0), "solid_fraction": np.array([0.1, np.nan, 0.3])},
        gauge={"time": np.array([1.0, 2.0]), "fluid_pressure": np.array([10.0, 20.0])},
    )
    series = [panel.series[0] for panel in probe_panels(build(Candidate(run), [Candidate(measured("b"))]).every)]
    assert [one.marker for one in series[:3]] == ["circle", "circle", ""]  # further panels are of the other run


def test_forces_are_lines_between_centres() -> None:
    """Of two grains and of one with a wall, of the list at the time of the frame alone."""
    radius, centres = np.array([0.1, 0.2, 0.1]), np.array([[0.5, 0.1], [0.78, 0.1], [0.05, 0.5]])
    overlap = np.array([0.02, 0.004])
    contact = np.array([[0.5 + 0.09, 0.1], [0.5, 0.002]])  # the middle of each overlap
    table = {
        "time": np.array([1.0, 2.0, 2.0]), "first": np.array([0.0, 0.0, 0.0]), "second": np.array([2.0, 1.0, -1.0]),
        "overlap": np.r_[0.01, overlap], "normal_force": np.array([9.0, 4.0, -1.0]),
        "position_x": np.r_[0.0, contact[:, 0]], "position_z": np.r_[0.0, contact[:, 1]],
        "normal_x": np.array([1.0, -1.0, 0.0]), "normal_z": np.array([0.0, 0.0, 1.0]),
    }  # fmt: skip
    run = SimpleNamespace(
        path=Path("a"), times=np.array([1.0, 2.0]), probes={"touch": table}, particles=lambda _: {"radius": radius},
        scene={"probes": [{"name": "touch", "kind": "contacts"}]},
    )  # fmt: skip
    lines = force_lines(run, 1)
    np.testing.assert_allclose(lines.ends[0], centres[:2], atol=1e-15)
    # The centre of the grain at the wall is its radius less the overlap above it; the line ends where they touch.
    np.testing.assert_allclose(lines.ends[1], [[0.5, 0.1], [0.5, 0.002]], atol=1e-15)
    np.testing.assert_array_equal(lines.force, [4.0, 0.0])  # a contact that pulls is thin
    run.scene["probes"] = []
    with pytest.raises(InputError, match="has no probe that lists contacts"):
        force_lines(run, 1)


def test_differences_are_those_of_the_means() -> None:
    rows = build(Candidate(measured("a")), [Candidate(measured("b", 2.0))]).every
    found = {f"{probe}/{column}": values for _, probe, column, *values in probe_differences(rows[0], rows[1:])}
    assert found["floor/force_z"] == [-5.0, -2.5] and found["gauge/fluid_pressure"] == [40.0, 20.0]


def test_page_and_files(tmp_path: Path) -> None:
    result = compare(measured("a"), [measured("b", 2.0)], tmp_path)
    page = result.files["html"].read_text(encoding="utf-8")
    assert result.files["probes"].name == "probes.png" and "probes-plot" in page
    row = re.search(r"<tr[^>]*><td[^>]*>b</td><td[^>]*>floor</td><td[^>]*>force_z</td>(.*?)</tr>", page)
    assert row and re.findall(r">([^<>]+)<", row[1]) == ["-5", "-2.5", "-100 %"]
    assert [file.name for file in plot_run(measured("a"), tmp_path)] == ["metrics.png", "snapshot.png", "probes.png"]


def test_runs_without_probes_have_no_such_figure(tmp_path: Path) -> None:
    assert "probes" not in compare(make_run("one"), [make_run("other")], tmp_path).files
