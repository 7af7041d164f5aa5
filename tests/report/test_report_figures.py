"""What the still figures draw: true radii, the right plane, one colour scale, one colour a run, honest axes."""

from __future__ import annotations

import itertools
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import EllipseCollection
from matplotlib.image import imread

from jaxdem.errors import InputError
from jaxdem.report import chart, compare, figures, parity, pictures, snapshots, style
from jaxdem.report.comparison import Candidate, Comparison, build


def compared(*runs: Any) -> Comparison:
    first, *others = map(Candidate, runs)
    return build(first, others)


@pytest.fixture
def saved(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The figures that would be written."""
    kept: list[Any] = []
    monkeypatch.setattr(style, "save", lambda figure, path, **_: kept.append(figure))
    return kept


def test_colours_are_the_same_everywhere_and_differ() -> None:
    looks = style.styles(25)
    assert looks[0].color == style.REFERENCE
    assert len({(look.color, look.dash, look.marker) for look in looks}) == 25
    assert {look.dash for look in looks} <= style.DASHES.keys() and {
        look.marker for look in looks
    } <= style.MARKERS.keys()


def test_snapshot_times_are_outputs_of_the_reference() -> None:
    assert snapshots.snapshot_times(np.linspace(0, 3, 31)) == pytest.approx([0.0, 1.0, 2.0, 3.0])
    assert snapshots.snapshot_times(np.array([0.0, 1.0])) == [0.0, 1.0]
    assert snapshots.snapshot_times(np.array([])) == []


def test_nearest_frame_or_none(make: Any) -> None:
    run = make(end=1.0, outputs=11)
    index = pictures.nearest(run, 0.52, 2.0)
    assert index == 5 and pictures.take(run, index).time == pytest.approx(0.5)
    assert pictures.nearest(run, 1.2, 2.0) is None
    run.times = np.array([])
    assert pictures.nearest(run, 0.0, 2.0) is None


def test_planes(make: Any) -> None:
    flat, deep = make(), make(cells=(10, 4, 6), size=(2.0, 0.5, 1.0))
    two, three = pictures.take(flat, 0), pictures.take(deep, 0)
    assert np.array_equal(two.centres, flat.particles(0)["position"][:, :2])
    assert two.speed is not None and two.speed.shape == (75, 12)
    assert three.speed is not None and three.speed.shape == (10, 6)
    position, drag = deep.particles(0)["position"], deep.particles(0)["drag_force"]
    order = np.argsort(-position[:, 1])
    assert np.allclose(three.centres, position[order][:, [0, 2]])
    assert np.allclose(three.values["drag"], drag[order, 0])
    assert pictures.view(flat, two) == "" and "averaged over the depth" in pictures.view(deep, three)


def test_discs_have_their_true_radius_on_equal_axes(make: Any, saved: list[Any]) -> None:
    runs = make("a", radius=0.03), make("b", cells=(38, 6)), make("short", end=0.5, outputs=6)
    snapshots.snapshots_figure(compared(*runs), Path("x.png"))
    figure = saved[0]
    figure.canvas.draw()
    shown = [axis for axis in figure.axes if axis.get_visible() and axis.get_title(loc="left")]
    assert len(shown) == 12
    for axis in shown:
        discs = [item for item in axis.collections if isinstance(item, EllipseCollection)]
        if "short" in axis.get_title(loc="left") and "t = 0 s" not in axis.get_title(loc="left"):
            assert not discs and any("ended at t = 0.5" in text.get_text() for text in axis.texts)
            continue
        pixels = np.diff(axis.transData.transform([(0.0, 0.0), (1.0, 1.0)]), axis=0)[0]
        assert pixels[0] == pytest.approx(pixels[1], rel=1e-6)
        radius = 0.03 if axis.get_title(loc="left").strip().startswith("a ") else 0.01
        assert discs[0].get_widths() == pytest.approx(2 * radius)
        # The two transforms that the collection is drawn with take a unit circle to the radius in pixels.
        in_pixels = np.asarray(discs[0].get_transforms())[0, 0, 0] * discs[0].get_transform().get_matrix()[0, 0]
        assert in_pixels == pytest.approx(radius * pixels[0], rel=1e-6)
    scales = {image.get_clim() for axis in shown for image in axis.images}
    assert len(scales) == 1 and scales.pop()[0] == 0.0


def test_scales_are_the_reference_s(make: Any, saved: list[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the fluid and of the grains, the same in all panels, with their units, also beside a run that blew up."""
    bad = make("bad")
    fluid = bad.fluid
    monkeypatch.setattr(bad, "fluid", lambda i: {"velocity": fluid(i)["velocity"] * 1e6}, raising=False)
    fine = make("a")
    snapshots.snapshots_figure(compared(fine, bad), Path("x.png"))
    panels = [axis for axis in saved[0].axes if axis.get_title(loc="left")]
    tops = {image.get_clim()[1] for axis in panels for image in axis.images}
    assert len(tops) == 1 and max(tops) == pytest.approx(3.0, rel=0.05)
    discs = [item for axis in panels for item in axis.collections if isinstance(item, EllipseCollection)]
    assert len(discs) == len(panels) == 8 and len({one.get_clim() for one in discs}) == 1
    speeds = np.linalg.norm(fine.particles(0)["velocity"], axis=1)
    assert np.allclose(discs[0].get_array(), speeds) and np.ptp(discs[0].get_array()) > 0.0
    bars = {axis.get_xlabel() for axis in saved[0].axes if axis not in panels}
    assert bars == {"fluid speed [m/s]", "particle speed [m/s]"}


def test_a_film_s_scale_is_not_that_of_rest(make: Any) -> None:
    """Nothing moves at first: the scale is that of the later outputs, however small."""
    still, moving = pictures.take(make(), 0), pictures.take(make(), 0)
    assert still.speed is not None and moving.speed is not None
    still.speed[:] = 0.0
    moving.speed[:] = 1e-3
    assert pictures.scale_tops([still, moving])["fluid"] == pytest.approx(1e-3)
    assert "fluid" not in pictures.common_tops([[still, None]])
    assert pictures.common_tops([[still], [moving]])["fluid"] == pytest.approx(1e-3)


def test_sound_runs_choose_the_axis(make: Any) -> None:
    bad = make("bad", valid=False)
    bad.history["runoff"][-1] = 1e6
    panels = {panel.y_label: panel for panel in figures.metrics_panels(compared(make("a"), make("b"), bad).every)}
    runoff, height = panels["run-off [m]"], panels["height [m]"]
    assert runoff.y_limits is not None and runoff.y_limits[1] < 5.0 and "leaves this panel" in runoff.note
    assert height.y_limits is None and not height.note


def test_columns_of_parts_are_drawn_beside_the_metrics(make: Any) -> None:
    run = make("warm")
    count = len(run.history["time"])
    run.history |= {
        "fluid_temperature_mean": np.linspace(300.0, 301.0, count),
        "present": np.arange(count, dtype=float),
    }
    run.history |= {"pressure_gradient_x": np.full(count, -5.0), "pressure_gradient_z": np.full(count, np.nan)}
    rows = compared(run, make("plain")).every
    labels = [panel.y_label for panel in figures.metrics_panels(rows)]
    assert labels[-2:] == ["fluid temperature mean [K]", "present [-]"] and len(labels) == 11
    assert len(figures.metrics_panels(compared(make("plain"), make("other")).every)) == 9
    assert np.isfinite(rows[1].mean_error), "they are no metrics"
    other = make("other")
    other.history |= {"pressure_gradient_x": np.full(count, -6.0)}
    labels = [panel.y_label for panel in figures.metrics_panels(compared(run, other).every)]
    assert "pressure gradient x [Pa/m]" in labels, "given, and not the same in both"


def test_digits_of_what_is_steady_do_not_fill_a_panel() -> None:
    steady, moving = np.array([0.06, np.nan, 0.06 + 2.7e-6]), np.array([0.06, 0.07])
    low, high = figures.steady_limits([steady])
    assert low < 0.06 - 5e-5 and high > 0.06 + 5e-5 and high - low == pytest.approx(figures.STEADY * 0.06, rel=1e-3)
    assert figures.steady_limits([steady, moving]) is None and figures.steady_limits([np.zeros(3)]) is None


def test_metrics_without_meaning_are_left_out_and_named(make: Any, saved: list[Any], tmp_path: Path) -> None:
    """In file, page and error: the mean pressure of a closed box, the front and the top of a periodic one."""
    closed, periodic = make("closed"), make("periodic")
    walls = {side: {"kind": "no_slip"} for side in ("left", "right", "bottom", "top")}
    closed.scene["boundary"] = walls
    periodic.scene["boundary"] = {side: {"kind": "periodic"} for side in walls}
    for run, number, words in ((closed, 8, ["zero by convention"]), (periodic, 6, ["zero by", "along x", "vertical"])):
        rows = compared(run, run).every
        panels, note = figures.metrics_panels(rows), figures.left_out(rows)
        assert len(panels) == number and all(word in note for word in words) and all(one.series for one in panels)
        assert sum(np.isfinite(list(rows[1].errors.values()))) == number
        saved.clear()
        comparison = compare(run, [Candidate(run, "copy")], tmp_path)
        assert note in comparison.warnings and note in {figure.get_suptitle() for figure in saved}
        page = comparison.files["html"].read_text(encoding="utf-8")
        assert note in page and f"<li>{note}</li>" not in page, "it is no warning"
    assert not figures.left_out(compared(make("open"), make("open")).every)
    assert len(figures.metrics_panels(compared(*[make("dry", cells=None)] * 2).every)) == 5


def test_several_plain_numbers_on_every_logarithmic_axis() -> None:
    """However near the values are to each other, and both ends of the axis are beyond them."""
    for first, ratio in itertools.product(np.geomspace(0.0101, 9.99, 40), [1.0001, *np.geomspace(1.0, 1e7, 60)]):
        low, high = chart.log_limits([first, first * ratio])
        assert low < 0.9 * first and high > 1.1 * first * ratio
        ticks = chart.log_ticks(low, high)
        assert 3 <= len(ticks) <= 12 and all(low <= tick <= high for tick in ticks), (first, ratio)
        assert all(len(f"{tick:g}") <= 6 for tick in ticks), (first, ratio)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("factor", [1.0, 1.01])
def test_runs_of_one_run_time_are_drawn(make: Any, saved: list[Any], factor: float) -> None:
    """A copy of the reference has the error zero: file and page have the same limits, which hold all points."""
    wall = 0.14141701702890233
    panel = figures.error_panel(compared(make("fine", wall=wall), make("copy", wall=wall, factor=factor)))
    chart.write_png([panel], Path("x.png"))
    saved[0].canvas.draw()
    axis = saved[0].axes[0]
    x, y = panel.x_limits, panel.y_limits
    assert x == axis.get_xlim() == pytest.approx(chart.log_limits([wall])) and y == axis.get_ylim()
    layout = json.loads(re.search(r"\],\s*(\{.*?\}),\s*\{\"responsive", chart.to_html([panel], "e"), re.S)[1])
    assert np.allclose(10.0 ** np.array(layout["xaxis"]["range"]), x)
    assert layout["yaxis"]["automargin"] and "tickvals" not in layout["xaxis"], "plotly chooses ticks after a zoom"


def test_r_squared() -> None:
    target = np.array([[0.0, 10.0], [2.0, 12.0]])
    assert parity.r_squared(target, target) == 1.0
    assert parity.r_squared(target, np.broadcast_to(target.mean(0), (2, 2))) == 0.0
    assert parity.r_squared(target, target[::-1]) == pytest.approx(-3.0)
    assert np.isnan(parity.r_squared(np.ones((3, 2)), np.ones((3, 2))))


def test_parity_refuses_unlike_shapes() -> None:
    target = np.ones((3, 2))
    parity.check_parity({"a": {"target": target, "predicted": target}})
    with pytest.raises(InputError, match=r"parity\['a'\].predicted"):
        parity.check_parity({"a": {"target": target, "predicted": np.ones((3, 3))}})
    with pytest.raises(InputError, match="predicted"):
        parity.check_parity({"a": {"target": target}})


def test_hard_cases_draw(make: Any, tmp_path: Path) -> None:
    """Error zero, no run time, no particles, no frames, a box of height above length, in 3-D."""
    same = make("same", size=(0.5, 0.5, 2.0), cells=(4, 4, 8), wall=1.0)
    empty = make("empty", size=(0.5, 0.5, 2.0), cells=(4, 4, 8), count=0, wall=None)
    unstarted = make("unstarted", size=(0.5, 0.5, 2.0), cells=(4, 4, 8), outputs=0)
    reference = make("fine", size=(0.5, 0.5, 2.0), cells=(8, 8, 16), wall=3.0)
    result = compare(reference, [same, empty, unstarted], tmp_path)
    assert result.rows[1].mean_error == 0.0 and not result.rows[3].ranked
    for name in ("snapshots.png", "error_vs_time.png", "metrics.png"):
        pixels = imread(tmp_path / name)
        assert max(pixels.shape) <= style.MAX_PIXELS + 1 and np.ptp(pixels) > 0.5
