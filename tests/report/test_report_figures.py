"""What the still figures draw: true radii, the right plane, one colour scale, one colour a run, honest axes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import EllipseCollection
from matplotlib.image import imread

from jaxdem.errors import InputError
from jaxdem.report import compare, figures, pictures, snapshots, style
from jaxdem.report.comparison import Entry, build
from jaxdem.report.runs import history_until


def entries_of(*runs: Any) -> list[Entry]:
    roles = ["reference"] + ["run"] * (len(runs) - 1)
    return [Entry(run.path.name, role, run, history_until(run, None)) for run, role in zip(runs, roles, strict=True)]


def drawn(monkeypatch: pytest.MonkeyPatch, *runs: Any) -> Any:
    """The figure that snapshots.png is made of."""
    kept: list[Any] = []
    monkeypatch.setattr(style, "save", lambda figure, path, **_: kept.append(figure))
    entries = entries_of(*runs)
    result = build(entries[0], entries[1:], [], {}, None)
    snapshots.snapshots_figure(entries, result, style.styles([e.name for e in entries]), Path("x.png"))
    return kept[0]


def test_colours_are_the_same_everywhere_and_differ() -> None:
    names = [f"run {i}" for i in range(25)]
    looks = style.styles(names)
    assert looks["run 0"].color == style.REFERENCE
    assert len({(look.color, look.plotly_dash, look.marker) for look in looks.values()}) == 25


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
    assert two.centres is not None and three.centres is not None
    assert np.array_equal(two.centres, flat.particles(0)["position"][:, :2])
    assert two.speed is not None and two.speed.shape == (75, 12)
    assert three.speed is not None and three.speed.shape == (10, 6)
    position, drag = deep.particles(0)["position"], deep.particles(0)["drag_force"]
    order = np.argsort(-position[:, 1])
    assert np.allclose(three.centres, position[order][:, [0, 2]])
    assert np.allclose(three.values["drag"], drag[order, 0])
    assert pictures.view(flat, two) == "" and "averaged over the depth" in pictures.view(deep, three)


def test_discs_have_their_true_radius_on_equal_axes(make: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    figure = drawn(monkeypatch, make("a", radius=0.03), make("b", cells=(38, 6)), make("short", end=0.5, outputs=6))
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


def test_scale_ignores_a_run_that_blew_up(make: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    bad = make("bad")
    fluid = bad.fluid
    monkeypatch.setattr(bad, "fluid", lambda i: {"velocity": fluid(i)["velocity"] * 1e6}, raising=False)
    figure = drawn(monkeypatch, make("a"), bad)
    tops = {image.get_clim()[1] for axis in figure.axes for image in axis.images}
    assert max(tops) == pytest.approx(3.0, rel=0.05)


def test_sound_runs_choose_the_axis(make: Any) -> None:
    bad = make("bad", valid=False)
    bad.history["runoff"][-1] = 1e6
    entries = entries_of(make("a"), make("b", factor=1.1), bad)
    rows = {row.name: row for row in build(entries[0], entries[1:], [], {}, None).rows}
    limits = figures.sound_limits(entries, "runoff", rows)
    assert limits is not None and limits[1] < 5.0
    assert figures.sound_limits(entries, "height", rows) is None


@pytest.mark.filterwarnings("error")
def test_a_copy_of_the_reference_is_drawn(make: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """One run time on a logarithmic axis: at this one matplotlib's limits, apart by rounding, have no width."""
    kept: list[Any] = []
    monkeypatch.setattr(style, "save", lambda figure, path, **_: kept.append(figure))
    wall = 0.14141701702890233
    entries = entries_of(make("fine", wall=wall), make("copy", wall=wall))
    result = build(entries[0], entries[1:], [], {}, None)
    figures.error_figure(result, style.styles(["fine", "copy"]), Path("x.png"))
    kept[0].canvas.draw()
    low, high = kept[0].axes[0].get_xlim()
    assert 0.01 < low < 0.9 * wall and 1.1 * wall < high < 2.0


def test_r_squared() -> None:
    target = np.array([[0.0, 10.0], [2.0, 12.0]])
    assert figures.r_squared(target, target) == 1.0
    assert figures.r_squared(target, np.broadcast_to(target.mean(0), (2, 2))) == 0.0
    assert figures.r_squared(target, target[::-1]) == pytest.approx(-3.0)
    assert np.isnan(figures.r_squared(np.ones((3, 2)), np.ones((3, 2))))


def test_parity_refuses_unlike_shapes() -> None:
    target = np.ones((3, 2))
    figures.check_parity({"a": {"target": target, "predicted": target}})
    with pytest.raises(InputError, match=r"parity\['a'\].predicted"):
        figures.check_parity({"a": {"target": target, "predicted": np.ones((3, 3))}})
    with pytest.raises(InputError, match="predicted"):
        figures.check_parity({"a": {"target": target}})


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
