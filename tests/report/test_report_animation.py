"""Pictures and films of one run, and the animations of the page: what is drawn is what the run has."""

from __future__ import annotations

import base64
import json
import re
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.animation import FFMpegWriter
from matplotlib.image import imread
from PIL import Image

from jaxdem.errors import InputError
from jaxdem.report import animation, drawing, single
from jaxdem.report.comparison import Candidate, build, row_of_one
from jaxdem.report.figures import metrics_panels
from jaxdem.report.player import player


def test_a_plot_has_both_pictures(make: Any, tmp_path: Path) -> None:
    """Two files in a folder, one file where a file is named; the metrics that the run does not have are left out."""
    run = make("one", outputs=5)
    files = single.plot_run(run, tmp_path / "plots", time=1.1)
    assert [file.name for file in files] == ["metrics.png", "snapshot.png"]
    assert run.calls[-1] == 2, "the output nearest to the time"
    grains = make("grains", cells=None, size=(0.5, 0.5, 2.0))
    (both,) = single.plot_run(grains, tmp_path / "new" / "both.png")
    assert len(metrics_panels([row_of_one(grains)])) == 5 and grains.calls[-1] == 20
    for file in (*files, both):
        assert np.ptp(imread(file)) > 0.5


@pytest.mark.parametrize("cells", [(75, 12), None])
def test_a_snapshot_has_no_empty_band_above(make: Any, tmp_path: Path, cells: Any) -> None:
    """With one colour bar and with two: at most 0.6 inch above the title."""
    run = make("run", cells=cells, size=(2.0, 2.0))
    single.plot_run(run, tmp_path)
    white = imread(tmp_path / "snapshot.png")[..., :3].min(axis=(1, 2)) > 0.99
    height = single.frame_size(run)[1]
    assert np.argmin(white) / len(white) * height < 0.6


def test_what_cannot_be_plotted_is_refused(make: Any, tmp_path: Path) -> None:
    run = make("one", cells=None, outputs=3)
    for options, words in (
        ({"time": 2.8}, "--time"),
        ({"time": float("nan")}, "--time"),
        ({"color": "drag"}, "has no particles or no fluid"),
    ):
        with pytest.raises(InputError, match=words):
            single.plot_run(run, tmp_path / "plots", **options)
    with pytest.raises(InputError, match=r"\.svg"):
        single.plot_run(run, tmp_path / "a.jpg")
    with pytest.raises(InputError, match="no output"):
        single.plot_run(make("none", outputs=0), tmp_path / "plots")
    assert not list(tmp_path.iterdir())


def test_a_film_has_every_output_and_one_scale(make: Any, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setattr(animation, "DPI", 30)
    scales, reports = [], []
    draw = drawing.draw
    monkeypatch.setattr(
        drawing, "draw", lambda *given: (scales.append((given[4]["fluid"], given[4][given[5]])), draw(*given))
    )
    run = make("film", outputs=4, count=20)
    path = tmp_path / "new" / "film.gif"
    number = animation.animate(run, path, color="drag", fps=5.0, progress=lambda *done: reports.append(done))
    with Image.open(path) as film:
        assert number == film.n_frames == 4 and film.info["duration"] == 200 and film.info["loop"] == 0
    assert len(set(scales)) == 1 and scales[0][1] == pytest.approx(np.percentile(1e-3 * np.arange(20), 99.5))
    assert reports[-1] == (8, 8)
    monkeypatch.setattr(animation, "MAX_GIF_FRAMES", 2)
    assert animation.animate(run, path) == 2


def test_films_that_cannot_be_made_are_refused(make: Any, tmp_path: Path, monkeypatch: Any) -> None:
    run = make("film")
    monkeypatch.setattr(FFMpegWriter, "isAvailable", classmethod(lambda cls: False))
    for name, options, words in (
        ("a.mp4", {}, "ffmpeg"),
        ("a.avi", {}, ".gif or .mp4"),
        ("a.gif", {"fps": 0.0}, "--fps"),
        ("a.gif", {"fps": 51.0}, "0.01 ... 50"),
        ("a.gif", {"color": "heat"}, "velocity, drag"),
    ):
        with pytest.raises(InputError, match=words):
            animation.animate(run, tmp_path / name, **options)
    assert not list(tmp_path.iterdir())


def played(runs: list[Any], **options: Any) -> Any:
    """The page's fragment, and its data."""
    first, *others = map(Candidate, runs)
    result = player(build(first, others or [first]).rows, **options)
    if result is None:
        return None, None
    text = re.search(r'id="player-data">(.*?)</script>', result)
    assert text is not None
    return result, json.loads(text.group(1))


def test_the_page_holds_the_data_of_all_runs(make: Any) -> None:
    """Frames decoded as the script does it: places to a pixel in 65535, speeds to a 255th; None where there is none."""
    runs = [
        make("fine", outputs=5, count=30),
        make("a</script>", end=1.0, outputs=3, count=30, cells=(40, 6)),
    ]
    result, data = played(runs)
    assert data["times"] == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert [frame is None for frame in data["runs"][1]["frames"]] == [False] * 3 + [True] * 2
    assert result.count("</script>") == 2 and result.count("<canvas") == 2
    for run, stored, i in ((runs[0], data["runs"][0], 4), (runs[1], data["runs"][1], 2)):
        raw = zlib.decompress(base64.b64decode(stored["frames"][i]))
        count, nx, nz = np.frombuffer(raw, "<u4", 3)
        cells = run.scene["fluid"]["cells"]
        assert (count, nx, nz) == (30, *cells) and len(raw) == 12 + 7 * 30 + nx * nz
        planes = np.frombuffer(raw, np.uint8, 7 * 30, 12).reshape(7, 30).astype(float)
        particles = run.particles(i)
        assert stored["box"] == [12.0, 2.0]
        x, height = (planes[0] + 256 * planes[1]) / 65535 * 12, (planes[2] + 256 * planes[3]) / 65535 * 2
        np.testing.assert_allclose(x, particles["position"][:, 0], atol=12 / 65535)
        np.testing.assert_allclose(height, particles["position"][:, 1], atol=2 / 65535)
        assert set(planes[4]) == {255.0} and stored["radius"] == 0.01
        drag = np.minimum(particles["drag_force"][:, 0], data["tops"]["drag"])
        np.testing.assert_allclose(planes[6] / 255 * data["tops"]["drag"], drag, atol=data["tops"]["drag"] / 500)
        speed = np.frombuffer(raw, np.uint8, nx * nz, 12 + 210).reshape(nz, nx).T / 255 * data["tops"]["fluid"]
        given = np.minimum(np.linalg.norm(run.fluid(i)["velocity"], axis=-1), data["tops"]["fluid"])
        np.testing.assert_allclose(speed, given, atol=data["tops"]["fluid"] / 500)


def test_outputs_are_left_out_until_the_page_is_small(make: Any) -> None:
    runs = [make("fine", outputs=21), make("coarse", outputs=21)]
    whole, data = played(runs)
    size = sum(len(frame) for run in data["runs"] for frame in run["frames"])
    less, fewer = played(runs, max_bytes=size // 3)
    kept = sum(len(frame) for run in fewer["runs"] for frame in run["frames"])
    assert kept <= size // 3 and 2 <= len(fewer["times"]) < 8 and fewer["times"][0] == 0.0
    assert "of 21 outputs" in less and "of 21" not in whole
    assert played(runs, max_bytes=size // 100)[0] is None
    assert played([make("one", outputs=1), make("two", outputs=1)])[0] is None


def test_grains_alone_are_played_too(make: Any) -> None:
    result, data = played([make("a", cells=None, outputs=3), make("b", cells=None, outputs=3)])
    assert "fluid" not in data["tops"] and 'data-scale="fluid"' not in result
    assert "drag" not in re.findall(r'<option value="(\w+)"', result)
