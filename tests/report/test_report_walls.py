"""Walls beside the box and openings of its sides in all pictures of runs: they are where the solver has them."""

from __future__ import annotations

import base64
import itertools
import json
import math
import re
import tomllib
import zlib
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure

from jaxdem import build as build_simulation
from jaxdem import load_scene
from jaxdem.particles.moving_walls import PistonState, placements
from jaxdem.particles.surfaces import surface_contacts
from jaxdem.report import animation, drawing, pictures, single, snapshots, walls
from jaxdem.report.comparison import Candidate, build
from jaxdem.report.player import player
from jaxdem.scene.walls import NEEDED
from jaxdem.setup.walls import surfaces_of

WALLS = {
    2: (
        {"kind": "plane", "point": [0.1, 0.3], "normal": [1.0, 3.0]},
        {"kind": "cylinder", "center": [0.6, 0.5], "radius": 0.1, "inside": False},
        {"kind": "cylinder", "center": [0.5, 0.4], "radius": 0.6},
        {"kind": "wedge", "apex": [0.5, 0.1], "directions": [[-1.0, 1.2], [2.0, 1.2]]},
    ),
    3: (
        {"kind": "plane", "point": [0.1, 0.0, 0.3], "normal": [1.0, 0.5, 3.0]},
        {"kind": "cylinder", "center": [0.6, 0.2, 0.0], "radius": 0.1, "axis": [0.0, 0.0, 2.0], "inside": False},
        {"kind": "cylinder", "center": [0.5, 0.1, 0.4], "radius": 0.6, "axis": [1.0, 2.0, 0.5]},
        {"kind": "wedge", "apex": [0.5, 0.0, 0.1], "directions": [[-1.0, 0.0, 1.2], [1.0, 0.0, 1.2]]},
    ),
}  # fmt: skip
SIZE = {2: (1.0, 0.8), 3: (1.0, 0.4, 0.8)}


def scene_with(dimension: int, *tables: dict[str, Any]) -> dict[str, Any]:
    """The tables of a checked scene, as a run's scene.toml has them."""
    given = {
        "domain": {"size": list(SIZE[dimension])},
        "particles": {"position": [[0.5] * dimension], "radius": 0.01, "density": 2500.0},
        "contact": {"young_modulus": 1e7},
        "walls": [dict(table) for table in tables],
        "time": {"end": 1.0, "output_interval": 0.5},
    }
    return tomllib.loads(load_scene(given).to_toml())


@pytest.mark.parametrize("dimension", [2, 3])
def test_walls_are_where_the_solver_has_them(dimension: int) -> None:
    """The distance of the picture is less the overlap of a point with the surfaces of the contact model. A mesh has no
    distance of its own in the scene: it is drawn from the triangles that the run keeps."""
    assert {table["kind"] for table in WALLS[dimension]} | {"mesh"} == set(NEEDED), "a kind of wall is not drawn"
    points = np.random.default_rng(0).uniform(0.0, 1.0, (20, dimension)) * SIZE[dimension]
    for table in WALLS[dimension]:
        scene = scene_with(dimension, table)
        found = walls._distance(scene["walls"], points)
        surfaces = surfaces_of(load_scene(scene).walls[0])
        overlap = [jax.vmap(lambda x, s=s: s.overlap(x, jnp.zeros(())))(jnp.asarray(points)) for s in surfaces]
        np.testing.assert_allclose(found, -np.max(overlap, axis=0), atol=1e-12)


def drawn(run: Any, index: int = 0) -> Any:
    axis = Figure(layout="constrained").subplots()
    size = run.scene["domain"]["size"]
    drawing.draw(axis, pictures.take(run, index), (size[0], size[-1]), (size[0], size[-1]), {}, "velocity")
    return axis


def outline(axis: Any) -> np.ndarray:
    """Points of the line that is drawn around what is solid (P, 2)."""
    (contour,) = [item for item in axis.collections if isinstance(item, ContourSet)]
    return np.concatenate([path.vertices for path in contour.get_paths()])


def walled(make: Any, dimension: int, *tables: dict[str, Any], **options: Any) -> Any:
    run = make("walled", size=SIZE[dimension], cells=None, outputs=3, count=20, **options)
    run.scene["walls"] = scene_with(dimension, *tables)["walls"]
    return run


def test_an_obstacle_is_drawn_as_a_disc(make: Any) -> None:
    """Outline at the radius, area pi R^2; drawn anew in a later frame, not twice."""
    run = walled(make, 2, WALLS[2][1])
    axis = drawn(run)
    distance = np.hypot(*(outline(axis) - [0.6, 0.5]).T)
    np.testing.assert_allclose(distance, 0.1, atol=1e-4)
    (image,) = axis.images
    share = np.asarray(image.get_array())
    assert image.get_extent() == [0.0, 1.0, 0.0, 0.8]
    assert share.mean() * 0.8 == pytest.approx(math.pi * 0.01, rel=2e-3)
    assert image.get_cmap()(0.0)[3] == 0.0 and image.get_cmap()(1.0)[3] > 0.5
    drawing.draw(axis, pictures.take(run, 1), (1.0, 0.8), (1.0, 0.8), {}, "velocity")
    assert len(axis.images) == 1 and len(outline(axis)) == len(distance)


def test_a_hopper_is_drawn_with_its_corner(make: Any) -> None:
    """Both planes of a wedge, which hides what lies beyond the other; area of the two triangles and the strip below."""
    axis = drawn(walled(make, 2, WALLS[2][3]))
    points = outline(axis)
    left, right = (0.1 + 1.2 * (0.5 - points[:, 0]), 0.1 + 0.6 * (points[:, 0] - 0.5))
    np.testing.assert_allclose(points[:, 1], np.maximum(left, right), atol=1e-3)
    share = np.asarray(axis.images[0].get_array())
    # Under 0.1 + 1.2 x up to x = 0.5, where 0.7 < 0.8 is reached at the side, and under 0.1 + 0.6 x.
    assert share.mean() * 0.8 == pytest.approx(0.1 + 0.5 * 0.5 * 0.6 + 0.5 * 0.5 * 0.3, rel=2e-3)


def test_in_3d_walls_are_averaged_over_the_depth(make: Any) -> None:
    """An upright cylinder in the middle of the depth: 2 sqrt(R^2 - x^2) of it, its outline at half depth two lines."""
    run = walled(make, 3, WALLS[3][1])
    axis = drawn(run)
    assert np.abs(outline(axis)[:, 0] - 0.6) == pytest.approx(0.1, abs=1e-3)
    share = np.asarray(axis.images[0].get_array())
    x = (np.arange(share.shape[1]) + 0.5) / share.shape[1] - 0.6
    chord = 2.0 * np.sqrt(np.maximum(0.01 - x**2, 0.0)) / 0.4
    np.testing.assert_allclose(share**2, np.broadcast_to(chord, share.shape), atol=0.05)
    assert "walls averaged over the depth" in pictures.view(run, pictures.take(run, 0))


def test_a_wall_across_the_view_has_no_outline(make: Any) -> None:
    """A plane parallel to the front, at a quarter of the depth: a quarter solid, free at half depth."""
    axis = drawn(walled(make, 3, {"kind": "plane", "point": [0.0, 0.1, 0.0], "normal": [0.0, 1.0, 0.0]}))
    assert not [item for item in axis.collections if isinstance(item, ContourSet)]
    np.testing.assert_allclose(np.asarray(axis.images[0].get_array()), 0.5, atol=0.05)


def test_openings_are_drawn_on_their_sides(make: Any) -> None:
    """Patches, whole sides, sides that grains leave through, the box that they appear in; not in front and back."""
    run = make("open", size=SIZE[3], cells=(4, 4, 4))
    run.scene["boundary"] = {
        "left": {"kind": "inlet", "from": [0.1, 0.2], "to": [0.3, 0.5]},
        "right": {"kind": "outlet"},
        "bottom": {"kind": "no_slip", "particles": "remove"},
        "top": {"kind": "outlet", "from": [0.4, 0.1], "to": [0.6, 0.2]},
        "front": {"kind": "inlet"},
    }
    run.scene["particles"]["inlet"] = [{"start": [0.7, 0.0, 0.6], "stop": [0.9, 0.4, 0.7]}]
    found = walls.openings(run.scene, SIZE[3])
    assert found == [
        (walls.INLET, (0.0, 0.2), (0.0, 0.5)),
        (walls.OUTLET, (1.0, 0.0), (1.0, 0.8)),
        (walls.OUTLET, (0.0, 0.0), (1.0, 0.0)),
        (walls.OUTLET, (0.4, 0.8), (0.6, 0.8)),
        (walls.INLET, (0.7, 0.6), (0.9, 0.7)),
    ]
    (lines,) = [item for item in drawn(run).collections if isinstance(item, LineCollection)]
    for opening, path in zip(found, lines.get_segments(), strict=True):
        assert path.min(axis=0).tolist() == list(opening.start) and path.max(axis=0).tolist() == list(opening.stop)
    figure = Figure(layout="constrained")
    drawing.add_legends(figure, [figure.subplots()], [pictures.take(run, 0)], {}, "velocity", 5.0)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["inlet", "outlet"]


def test_openings_of_walls_are_drawn_where_they_are(make: Any) -> None:
    """On a tube that turns by a quarter, so that its upper arc is then at the left; in 3-D at half depth, beside a
    region that does not reach there."""
    turning = [{"kind": "rotation", "rate": 0.5 * np.pi, "center": [0.5, 0.4]}]
    inlet = {"kind": "inlet", "region": {"shape": "sphere", "center": [0.5, 0.7], "radius": 0.1}}
    outlet = {"kind": "outlet", "region": {"shape": "box", "start": [0.0, 0.0], "stop": [0.5, 0.2]}}
    tube = {"kind": "cylinder", "center": [0.5, 0.4], "radius": 0.3, "opening": [inlet, outlet], "motion": turning}
    run = walled(make, 2)
    run.scene["walls"] = [tube]
    found = walls.solid(run.scene, SIZE[2], 1.0).openings
    assert [kind for kind, _ in found] == ["inlet", "outlet"]
    for _, line in found:
        np.testing.assert_allclose(np.hypot(*(line - [0.5, 0.4]).T), 0.3, atol=2e-3)
    line = found[0][1]
    assert line[:, 0].mean() == pytest.approx(0.2, abs=0.01) and np.ptp(line[:, 1]) == pytest.approx(0.2, abs=0.01)
    assert set(pictures.take(run, 0).kinds_of_openings) == {"inlet", "outlet"}
    (lines,) = [item for item in drawn(run).collections if isinstance(item, LineCollection)]
    upper = max(lines.get_segments(), key=lambda line: line[:, 1].max())
    assert upper[:, 1].min() == pytest.approx(0.7 - 0.1**2 / 0.6, abs=0.01)
    page = player(build(Candidate(run, "a"), [Candidate(run, "b")]).rows)
    assert page is not None and "pink lines are outlets" in page
    data = json.loads(re.search(r'id="player-data">(.*?)</script>', page)[1])["runs"][0]
    assert all(len(one["openings"]) >= 2 for one in data["walls"])
    jet = {
        "kind": "inlet",
        "region": {"shape": "cylinder", "base": [0.3, 0.2, -0.1], "axis": [0, 0, 1], "length": 0.4, "radius": 0.1},
    }
    aside = {"kind": "outlet", "region": {"shape": "box", "start": [0.0, 0.0, 0.0], "stop": [1.0, 0.1, 0.4]}}
    floor = {"kind": "plane", "point": [0.0, 0.0, 0.1], "normal": [0.0, 0.0, 1.0], "opening": [jet, aside]}
    ((kind, line),) = walls.solid({"walls": [floor]}, SIZE[3]).openings
    assert kind == "inlet" and np.allclose(line[:, 1], 0.1) and line[:, 0].min() == pytest.approx(0.2, abs=0.01)


def test_all_pictures_of_a_run_have_its_walls(make: Any, tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """plot, every frame of animate, every panel of the snapshots, and the page's animations."""
    calls: list[Any] = []
    draw = drawing._draw_walls
    monkeypatch.setattr(drawing, "_draw_walls", lambda *given: (calls.append(given), draw(*given)))
    run = walled(make, 2, *WALLS[2][1::2])
    run.scene["boundary"] = {"bottom": {"kind": "no_slip", "particles": "remove"}}
    single.plot_run(run, tmp_path / "plots")
    assert len(calls) == 1
    monkeypatch.setattr(animation, "DPI", 30)
    animation.animate(run, tmp_path / "film.gif")
    assert len(calls) == 1 + 1 + 3, "the first frame gives the layout too"
    result = build(Candidate(run, "a"), [Candidate(run, "b")])
    snapshots.snapshots_figure(result, tmp_path / "snapshots.png")
    assert len(calls) == 5 + 6
    page = player(result.rows)
    assert page is not None and "pink lines are outlets" in page
    data = json.loads(re.search(r'id="player-data">(.*?)</script>', page)[1])["runs"][1]
    (solid,) = data["walls"]
    nx, nz = solid["points"]
    share = np.frombuffer(zlib.decompress(base64.b64decode(solid["share"])), np.uint8).reshape(nz, nx)
    assert data["wall"] == [0, 0, 0]
    assert share[round(0.5 / 0.8 * nz), round(0.6 * nx)] == 255 and share[round(0.9 * nz), round(0.5 * nx)] == 0
    assert solid["over"] is False
    lines = zlib.decompress(base64.b64decode(solid["lines"]))
    number = int(np.frombuffer(lines, "<u4", 1)[0])
    points = np.frombuffer(lines, "<u2", offset=4 * (number + 1)).reshape(-1, 2) / 65535.0 * SIZE[2]
    assert len(points) == np.frombuffer(lines, "<u4", number, 4).sum()
    disc = np.hypot(*(points - [0.6, 0.5]).T)
    height = 0.1 + np.where(points[:, 0] < 0.5, 1.2 * (0.5 - points[:, 0]), 0.6 * (points[:, 0] - 0.5))
    on_disc = np.abs(disc - 0.1) < 2e-3
    np.testing.assert_allclose(points[~on_disc, 1], height[~on_disc], atol=2e-3)
    assert 0.1 < on_disc.mean() < 0.9
    assert data["openings"] == [{"color": pictures.OPENINGS["outlet"], "corners": [0.0, 0.0, 1.0, 0.0]}]


def test_a_wall_is_drawn_in_the_frames_in_which_it_is_there(make: Any) -> None:
    """A disc that vanishes at the second of three outputs, beside one that comes at the third; in the page as well."""
    other = WALLS[2][1] | {"center": [0.2, 0.4]}
    run = walled(make, 2, WALLS[2][1], other)
    times = [float(time) for time in run.times]
    run.scene["walls"][0]["end"], run.scene["walls"][1]["begin"] = times[1], times[2]
    for index, centre in ((0, 0.6), (1, None), (2, 0.2)):
        axis = drawn(run, index)
        if centre is None:
            assert not axis.images and pictures.take(run, index).walls is None
        else:
            assert outline(axis)[:, 0].mean() == pytest.approx(centre, abs=0.02)
    page = player(build(Candidate(run, "a"), [Candidate(run, "b")]).rows)
    assert page is not None
    data = json.loads(re.search(r'id="player-data">(.*?)</script>', page)[1])["runs"][0]
    assert data["wall"] == [0, -1, 1] and len(data["walls"]) == 2


MOTIONS = {
    2: ({"kind": "rotation", "rate": 0.7, "center": [0.4, 0.3]}, {"kind": "translation", "velocity": [0.1, -0.05]}),
    3: (
        {"kind": "oscillation", "amplitude": 0.1, "frequency": 0.3, "direction": [1.0, 0.0, 2.0]},
        {"kind": "rotation", "rate": -0.4, "center": [0.4, 0.2, 0.3], "axis": [1.0, 2.0, 0.0]},
    ),
}


@pytest.mark.parametrize("dimension", [2, 3])
def test_walls_that_move_are_drawn_where_the_solver_has_them(dimension):
    """Signed distances at points, of a wall with motions and of a piston."""
    time, way = 1.3, 0.07
    box = [1.0] * dimension
    direction = [0.6, *([0.0] * (dimension - 2)), 0.8]
    piston = {"direction": direction, "force": 1.0, "mass": 1e6}
    moving = [dict(wall) | {"motion": list(MOTIONS[dimension])} for wall in WALLS[dimension]]
    moving[0]["piston"] = piston
    tables = {
        "precision": "float64",
        "domain": {"size": box},
        "particles": {"radius": 0.01, "density": 2500.0, "position": []},
        "contact": {"young_modulus": 1e7, "speed": 0.1},
        "coupling": {"interval": 0.1},
        "walls": moving,
        "time": {"end": 1.3, "output_interval": 1.3},
    }
    simulation, parameters = build_simulation(load_scene(tables))
    history = {"time": np.array([0.0, 2.6]), "wall_0_displacement": np.array([0.0, 2.0 * way])}
    state = PistonState(jnp.asarray([way]), None, jnp.asarray([0.0]))
    motions = simulation.wall_motions(parameters, jnp.asarray(13))
    placed = placements(simulation.contact.model.motions, motions, jnp.zeros(()), state)
    points = np.random.default_rng(1).uniform(0.0, 1.0, (50, dimension))
    overlap, _ = surface_contacts(
        simulation.contact.model.surfaces, tuple(jnp.asarray(points.T)), (None,) * dimension, jnp.zeros(()), placed
    )
    found, number = np.asarray(overlap), 0
    for k, wall in enumerate(moving):
        drawn = wall | walls._place(wall, time, walls._displacement(history, k, time))
        for distance in walls._distances(drawn, points):
            np.testing.assert_allclose(distance, -found[number], atol=1e-12)
            number += 1
    assert number == len(found)
    assert not np.allclose(walls.solid(tables, box, time, history).share, walls.solid(tables, box, 0.0).share)


def test_a_drum_is_one_picture_for_all_its_angles():
    drum = {"kind": "cylinder", "center": [0.5, 0.5], "radius": 0.4, "motion": [{"kind": "rotation", "rate": 3.0}]}
    scene = {"walls": [drum]}
    assert walls.solid(scene, [1.0, 1.0], 0.2) is walls.solid(scene, [1.0, 1.0], 0.9)


def test_the_snapshots_of_tall_boxes_are_no_taller_than_a_page() -> None:
    """One run of a riser of 0.1 m by 6 m: panels of its own shape would be 130 inches high."""
    for size, runs in itertools.product(((0.1, 6.0), (0.4, 1.0)), (1, 3)):
        figure, panels, _ = snapshots._panels(size, runs, 4)
        width, height = figure.get_size_inches()
        assert len({id(axis) for line in panels for axis in line}) == 4 * runs
        assert height <= runs * (snapshots.TALLEST + 0.1) + 2.3 and width == pytest.approx(4 * 2.4 + 0.9)
