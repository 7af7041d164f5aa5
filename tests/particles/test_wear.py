"""Wear of meshes by sliding (Archard) and by impacts (Finnie), against their closed forms."""

from __future__ import annotations

import copy
import json
import shutil

import h5py
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.check.mesh_rows import mesh_cautions
from jaxdem.errors import InputError
from jaxdem.io.vtkhdf import ROOT
from jaxdem.io.wall_file import WALLS
from jaxdem.particles.wear import WornMesh
from jaxdem.setup.builder import build_case
from jaxdem.solids.features import features_of
from jaxdem.solids.owners import owners
from jaxdem.solids.surface_mesh import SurfaceMesh
from tests.cases.surfaces import grains_scene, plane_mesh, saved

RADIUS, HEIGHT, GRAVITY = 0.02, 0.3, 9.81
MASS = 2500.0 * 4.0 / 3.0 * np.pi * RADIUS**3
ARCHARD = {"model": "archard", "coefficient": 1e-4, "hardness": 2e9}
FINNIE = {"model": "finnie", "coefficient": 0.5, "flow_stress": 3e8}
SPEED, ANGLES = 0.6, np.radians([12.0, 55.0])
"""Of the grains that arrive, below and above tan a = K/6 = 1/3."""


@pytest.fixture(scope="module")
def worn(tmp_path_factory):
    """A run: a grain slides without friction on the first mesh at 0.5 m/s; two hit the second at the two angles."""
    folder = tmp_path_factory.mktemp("wear")
    file = saved(plane_mesh(4, 0.0, 0.48, warp=0.2), folder / "plane.ply")
    stiff = (4.0 / 3.0) * 1e7 / (2.0 * (1.0 - 0.3**2)) * np.sqrt(RADIUS)
    rest = HEIGHT + RADIUS - (MASS * GRAVITY / stiff) ** (2.0 / 3.0)
    position = [[0.1, 0.21, rest], [0.6, 0.1, HEIGHT + RADIUS + 1e-6], [0.6, 0.4, HEIGHT + RADIUS + 1e-6]]
    arrive = [[SPEED * np.cos(a), 0.0, -SPEED * np.sin(a)] for a in ANGLES]
    walls = [
        {"kind": "mesh", "file": file, "translate": [0.0, 0.0, HEIGHT], "wear": ARCHARD, "name": "chute"},
        {"kind": "mesh", "file": file, "translate": [0.52, 0.0, HEIGHT], "wear": FINNIE},
        {"kind": "plane", "point": [0.5, 0.5, 0.1], "normal": [0.0, 0.0, 1.0]},
    ]
    tables = grains_scene(
        walls, position, [[0.5, 0.0, 0.0], *arrive],
        contact={"friction": 0.0, "restitution": 0.9}, time={"end": 0.02, "output_interval": 0.01},
    )  # fmt: skip
    run = jaxdem.simulate(jaxdem.load_scene(tables), folder / "run")
    with h5py.File(run.path / WALLS) as file:
        data = file[ROOT]["CellData"]
        cells = {name: data[name][...] for name in ("wall", "wear_volume", "wear_depth")}
        units = {name: data[name].attrs["units"] for name in ("wear_volume", "wear_depth")}
        mesh = SurfaceMesh(file["points"][...], file[ROOT]["Polygons/Connectivity"][...].reshape(-1, 3))
    return run, cells, units, mesh


def under(mesh, point):
    """The cell over or under a point (x, y)."""
    corners = mesh.corners[..., :2] - np.asarray(point)
    ways = [(corners[:, k], corners[:, (k + 1) % 3]) for k in range(3)]
    turn = [a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] for a, b in ways]
    return int(np.flatnonzero((np.min(turn, axis=0) > 0.0) | (np.max(turn, axis=0) < 0.0))[0])


def test_sliding_takes_k_times_load_times_distance_over_hardness(worn):
    _, cells, _, mesh = worn
    own = cells["wall"] == 0
    volume = ARCHARD["coefficient"] * MASS * GRAVITY * 0.5 * 0.02 / ARCHARD["hardness"]
    assert cells["wear_volume"][own].sum() == pytest.approx(volume, rel=1e-3, abs=0.0)
    along = {under(mesh, (x, 0.21)) for x in np.linspace(0.1, 0.11, 50)}
    assert set(np.flatnonzero(own & (cells["wear_volume"] > 0.0))) == along


def test_an_impact_takes_what_finnie_says(worn):
    """Once, for all steps of the contact; a second bounce would come after the end of the run."""
    _, cells, _, mesh = worn
    for angle, y in zip(ANGLES, (0.1, 0.4), strict=True):
        shallow = np.tan(angle) <= 2.0 / 6.0
        cut = np.sin(2.0 * angle) - 3.0 * np.sin(angle) ** 2 if shallow else np.cos(angle) ** 2 / 3.0
        volume = 0.5 * MASS * SPEED**2 / (FINNIE["flow_stress"] * 2.0 * 2.0) * cut
        assert cells["wear_volume"][under(mesh, (0.6, y))] == pytest.approx(volume, rel=1e-3, abs=0.0)
    assert (cells["wear_volume"][cells["wall"] == 1] > 0.0).sum() == 2


def test_wear_is_told(worn):
    """In the summary, in history.csv and in the file for ParaView."""
    run, cells, units, mesh = worn
    area = np.linalg.norm(mesh.area_vectors, axis=1)
    assert units == {"wear_volume": "m3", "wear_depth": "m"}
    np.testing.assert_allclose(cells["wear_depth"], cells["wear_volume"] / area, rtol=1e-9)
    told = json.loads((run.path / "summary.json").read_text())["wear"]
    assert [one["wall"] for one in told] == [0, 1] and told[0]["name"] == "chute"
    for number, one in enumerate(told):
        own = cells["wall"] == number
        assert one["volume"] == pytest.approx(cells["wear_volume"][own].sum(), rel=1e-12, abs=0.0)
        assert one["depth"] == pytest.approx(cells["wear_depth"][own].max(), rel=1e-12, abs=0.0)
        assert run.history[f"wall_{number}_wear"][-1] == pytest.approx(one["volume"], rel=1e-12, abs=0.0)
    assert run.history["wall_0_wear"][1] == pytest.approx(0.5 * told[0]["volume"], rel=1e-3, abs=0.0)


def _goes_on_by_triangles(onward, volume, folder):
    """A copy of its file is the same mesh; where the triangles are others, wear begins at zero, and it is said."""
    moved = copy.deepcopy(onward)
    moved["walls"][0]["file"] = str(shutil.copy(onward["walls"][0]["file"], folder / "copy.ply"))
    case = build_case(jaxdem.load_scene(moved))
    kept = case.initial_state()[0].particles.mesh_wear
    assert float(jnp.sum(kept[0].volume)) == pytest.approx(volume, rel=1e-6, abs=0.0)
    assert not list(mesh_cautions(case))
    moved["walls"][0]["translate"][2] -= 0.01
    case = build_case(jaxdem.load_scene(moved))
    kept = case.initial_state()[0].particles.mesh_wear
    assert float(jnp.sum(kept[0].volume)) == 0.0 < float(jnp.sum(kept[1].volume))
    (told,) = mesh_cautions(case)
    assert told.startswith("walls.0.wear begins at zero: the run ")


def test_what_is_worn_is_in_no_frame(worn, tmp_path):
    """A scene that goes on from the end has it; one that would begin from a frame is refused."""
    tables = {name: value for name, value in worn[0].scene.items() if name != "particles"}
    onward = tables | {"time": {"end": 0.04, "output_interval": 0.01}, "start": {"from": str(worn[0].path)}}
    scene = jaxdem.load_scene(onward)
    kept = jaxdem.initial_state(scene, *jaxdem.build(scene))[0].particles.mesh_wear
    told = json.loads((worn[0].path / "summary.json").read_text())["wear"]
    assert float(jnp.sum(kept[0].volume)) == pytest.approx(told[0]["volume"], rel=1e-6, abs=0.0)
    _goes_on_by_triangles(onward, told[0]["volume"], tmp_path)
    onward["start"]["time"] = 0.01
    with pytest.raises(InputError, match=r"start\.time.*wear"):
        jaxdem.build(jaxdem.load_scene(onward))


def test_small_wear_is_not_lost_in_single_precision():
    zero = jnp.zeros(1, jnp.float32)
    found = WornMesh(zero + 1.0, zero)
    for _ in range(100):
        found = found.with_more(zero + 1e-9)
    assert float(found.volume[0]) + float(found.volume_low[0]) - 1.0 == pytest.approx(1e-7, rel=1e-3, abs=0.0)


def test_edges_corners_and_images_belong_to_triangles_of_the_file():
    """Of a folded sheet in a box that is periodic along y: every part to a cell that has it."""
    points = np.array([[x, y, abs(x - 0.5)] for y in (0.0, 0.5, 1.0) for x in (0.0, 0.5, 1.0)])
    quads = [(k, k + 1, k + 4, k + 3) for k in (0, 1, 3, 4)]
    cells = np.array([corner for a, b, c, d in quads for corner in ((a, b, c), (a, c, d))])
    mesh, box, periodic = SurfaceMesh(points, cells), (1.0, 1.0, 1.0), (False, True, False)
    whole = mesh.repeated(box, periodic, 0.1)
    features = features_of(whole, True, 0.01)
    faces, edges, corners = owners(mesh, whole, features, box, periodic)
    assert len(faces) == len(whole.cells) > len(cells) and len(edges) and len(corners)

    def shifted(cell, place):
        """Whether a place is a corner of a cell or of one of its images."""
        away = mesh.corners[cell] - place
        away[:, 1] -= np.round(away[:, 1])
        return np.linalg.norm(away, axis=1).min() < 1e-9

    assert all(shifted(cell, place) for cell, place in zip(faces, features.faces.anchor, strict=True))
    assert all(shifted(cell, place) for cell, place in zip(corners, features.corners.anchor, strict=True))
    other = features.edges.anchor + features.edges.length[:, None] * features.edges.along
    for ends in (features.edges.anchor, other):
        assert all(shifted(cell, place) for cell, place in zip(edges, ends, strict=True))


def test_a_mesh_that_does_not_wear_has_no_such_term(tmp_path):
    file = saved(plane_mesh(1), tmp_path / "plane.ply")
    walls = [{"kind": "mesh", "file": file, "translate": [0.0, 0.0, HEIGHT]}]
    case = build_case(jaxdem.load_scene(grains_scene(walls, [[0.5, 0.5, 0.5], [0.2, 0.2, 0.5]])))
    state, neighbors = case.initial_state()
    assert not case.simulation.contact.model.wears and state.particles.mesh_wear == ()
    assert neighbors.meshes[0].faces.cell is None


@pytest.mark.parametrize(
    ("wear", "key", "word"),
    [
        ({"model": "archard", "coefficient": 1e-4}, "walls.0.wear.hardness", "is needed"),
        (ARCHARD | {"force_ratio": 2.0}, "walls.0.wear.force_ratio", "keys of wear"),
        (FINNIE | {"coefficient": 0.0}, "walls.0.wear.coefficient", "greater"),
        ({"model": "archard"}, "walls.0.wear.coefficient", "missing"),
    ],
)
def test_refusals(wear, key, word):
    walls = [{"kind": "mesh", "points": [[0.0, 0.1], [1.0, 0.1]], "wear": wear}]
    with pytest.raises(InputError) as caught:
        jaxdem.load_scene(grains_scene(walls, [[0.5, 0.5], [0.2, 0.5]], domain={"size": [1.0, 1.0]}))
    assert caught.value.key == key and word in str(caught.value)
    plane = {"kind": "plane", "point": [0.0, 0.1], "normal": [0.0, 1.0], "wear": ARCHARD}
    with pytest.raises(InputError, match="keys of a wall of kind plane"):
        jaxdem.load_scene(grains_scene([plane], [[0.5, 0.5], [0.2, 0.5]], domain={"size": [1.0, 1.0]}))
