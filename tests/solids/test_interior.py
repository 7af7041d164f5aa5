"""The inside of closed meshes as regions: volume and distance in closed form, points brought inside, what is refused.

Files hold coordinates in float32, hence the tolerances of 1e-6."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

import jaxdem
from jaxdem.errors import InputError
from jaxdem.particles import regions
from jaxdem.report.walls import openings
from jaxdem.scene.domain import Box
from jaxdem.scene.regions import Region
from jaxdem.setup import inlet_regions
from jaxdem.setup.inlet_regions import inlet_region
from jaxdem.setup.regions import region_space
from tests.cases.surfaces import saved

BOX = Box((1.0, 1.0, 1.0), (False, False, False))
BRICK = ([0.2, 0.3, 0.1], [0.8, 0.7, 0.6])
TURN = [20.0, -35.0, 50.0]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A brick, a pyramid with its tip up, an L that is not convex, and a tube without ends."""
    folder = tmp_path_factory.mktemp("meshes")
    low, high = np.asarray(BRICK)
    brick = trimesh.creation.box(high - low)
    brick.apply_translation(0.5 * (low + high))
    corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 1.0]]
    pyramid = trimesh.Trimesh(corners, [[0, 2, 1], [0, 3, 2], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    ring = [[0.1, 0.1], [0.9, 0.1], [0.9, 0.4], [0.4, 0.4], [0.4, 0.9], [0.1, 0.9]]
    points = np.concatenate([np.insert(np.asarray(ring), 1, y, axis=1) for y in (0.2, 0.8)])
    ends = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]
    sides = [cell for k in range(6) for cell in ([k, (k + 1) % 6 + 6, (k + 1) % 6], [k, k + 6, (k + 1) % 6 + 6])]
    ell = trimesh.Trimesh(points, [*ends, *(np.asarray(ends) + 6)[:, ::-1].tolist(), *sides], process=False)
    meshes = {"brick": brick, "pyramid": pyramid, "ell": ell}
    found = {name: saved(mesh, folder / f"{name}.ply") for name, mesh in meshes.items()}
    brick.faces = brick.faces[:-1]
    return found | {"open": saved(brick, folder / "open.ply")}


def space(file, depth=0.1, **keys):
    given = {"shape": "mesh", "file": file} | keys
    return region_space("region", Region.model_validate(given, context={"dimension": 3}), BOX, depth)


def test_volumes_of_whole_meshes_and_of_parts_of_them(files):
    """Closed forms: a brick, its part in a box, a pyramid below a level, a turned brick that is scaled."""
    np.testing.assert_allclose(space(files["brick"]).volume, 0.6 * 0.4 * 0.5, rtol=1e-6)
    part = space(files["brick"], start=[0.0, 0.4, 0.0], stop=[0.5, 1.0, 0.35])
    np.testing.assert_allclose(part.volume, 0.3 * 0.3 * 0.25, rtol=1e-6)
    np.testing.assert_allclose(part.bounds, ([0.2, 0.4, 0.1], [0.5, 0.7, 0.35]), rtol=1e-6)
    frustum = space(files["pyramid"], stop=[1.0, 1.0, 0.4])
    np.testing.assert_allclose(frustum.volume, (1.0 - 0.6**3) / 3.0, rtol=1e-6)
    turned = space(files["brick"], scale=0.5, rotate=TURN, translate=[0.4, 0.4, 0.4])
    np.testing.assert_allclose(turned.volume, 0.6 * 0.4 * 0.5 / 8.0, rtol=1e-6)
    np.testing.assert_allclose(space(files["ell"]).volume, 0.6 * (0.8 * 0.3 + 0.3 * 0.5), rtol=1e-6)


@pytest.mark.parametrize("name", ["brick", "ell"])
def test_the_distance_is_that_of_the_same_shape_with_a_formula(files, name):
    """Against the region of a box and that of a polygon: inside to the depth, and which points are outside."""
    vertices = [[0.1, 0.1], [0.9, 0.1], [0.9, 0.4], [0.4, 0.4], [0.4, 0.9], [0.1, 0.9]]
    exact = regions.box(*BRICK) if name == "brick" else regions.polygon(vertices, (0.2, 0.8))
    found = space(files[name])
    points = np.random.default_rng(1).uniform(0.0, 1.0, (2000, 3))
    distance, expected = found.signed_distance(points), exact.signed_distance(points)
    near = (expected < 0.0) & (expected > -0.1)
    assert near.sum() > 150
    np.testing.assert_allclose(distance[near], expected[near], atol=1e-7)
    np.testing.assert_array_equal(distance < 0.0, expected < 0.0)
    deep = expected <= -0.1
    assert (distance[deep] <= -0.1).all() and (distance[deep] >= expected[deep] - 1e-7).all()
    for margin in (0.0, 0.03, 0.1):
        np.testing.assert_array_equal(found.inside(points, margin), exact.inside(points, margin))
    kept = found.kept(points, 0.04)
    for _ in range(4):
        kept = found.kept(kept, 0.04)
    assert exact.inside(kept, 0.04 - 1e-7).all()
    there = exact.inside(points, 0.04 * (1 + 1e-6))
    np.testing.assert_array_equal(kept[there], points[there])


def test_a_turned_mesh_is_where_the_same_points_are(files):
    """Inside of the turned brick are the turned points of the brick."""
    turned, plain = (space(files["brick"], translate=[0.0, 0.0, 0.0], **keys) for keys in ({}, {}))
    turn = trimesh.transformations.euler_matrix(*np.radians(TURN), axes="sxyz")[:3, :3]
    shift = np.array([0.5, 0.5, 0.5]) - turn @ [0.5, 0.5, 0.35]
    turned = space(files["brick"], rotate=TURN, translate=shift.tolist())
    points = np.random.default_rng(2).uniform(0.0, 1.0, (2000, 3))
    expected = plain.inside((points - shift) @ turn, 0.02)
    np.testing.assert_array_equal(turned.inside(points, 0.02), expected)


def scene(file, pack, **particles):
    return jaxdem.load_scene(
        {
            "seed": 3,
            "domain": {"size": [1.0, 1.0, 1.0]},
            "particles": {"radius": 0.04, "density": 2500.0,
                          "pack": {**pack, "region": {"shape": "mesh", "file": file}}} | particles,
            "contact": {"young_modulus": 1e6, "speed": 1.0},
            "time": {"end": 0.01, "output_interval": 0.01},
        }
    )  # fmt: skip


@pytest.mark.parametrize("kind", ["lattice", "random", "grown"])
def test_a_pack_fills_a_mesh(files, kind):
    """Every particle lies in it with its whole radius, none overlaps another, and the solid fraction is what was asked
    for. Without the margin of a radius some would reach out."""
    asked = {} if kind == "lattice" else {"solid_fraction": 0.25}
    given = scene(files["ell"], {"kind": kind} | asked)
    exact = regions.polygon([[0.1, 0.1], [0.9, 0.1], [0.9, 0.4], [0.4, 0.4], [0.4, 0.9], [0.1, 0.9]], (0.2, 0.8))
    simulation, parameters = jaxdem.build(given)
    position = np.asarray(jaxdem.initial_state(given, simulation, parameters)[0].particles.position)
    assert len(position) > 150 and exact.inside(position, 0.04 * (1.0 - 1e-5)).all()
    assert not exact.inside(position, 0.045).all()
    if asked:
        assert len(position) == round(0.25 * exact.volume / (4.0 / 3.0 * np.pi * 0.04**3))
    apart = np.linalg.norm(position[:, None] - position[None], axis=2) + np.eye(len(position))
    assert apart.min() > 0.08 * (1.0 - 1e-5)


def test_an_inlet_in_a_mesh(files, monkeypatch):
    """Places are inside with the whole radius and everywhere: as many in either arm of the L as its volume says."""
    monkeypatch.setattr(inlet_regions, "CUBES", 3000)
    found = inlet_region("particles.inlet.0", Region.model_validate({"shape": "mesh", "file": files["ell"]}), BOX, 0.03)
    drawn = np.random.default_rng(4).uniform(size=(20_000, 3)).astype(np.float32)
    places, inside = found.places(drawn, np.float32(0.03))
    places = np.asarray(places, float)
    exact = regions.polygon([[0.1, 0.1], [0.9, 0.1], [0.9, 0.4], [0.4, 0.4], [0.4, 0.9], [0.1, 0.9]], (0.2, 0.8))
    assert np.asarray(inside).all() and exact.inside(places, 0.03 - 1e-6).all()
    margin = 0.03 + 0.04  # and about a cube
    expected = (0.5 - margin) / (0.8 - 2.0 * margin + 0.5)  # arms of one width
    assert abs((places[:, 0] > 0.4).mean() - expected) < 0.03
    hist = np.histogram(places[:, 1], bins=8, range=(0.3, 0.7))[0]
    assert hist.min() > 0.9 * hist.mean()
    with pytest.raises(InputError, match="no room for a particle of radius 0.2"):
        inlet_region("particles.inlet.0", Region.model_validate({"shape": "mesh", "file": files["ell"]}), BOX, 0.2)


def test_the_picture_has_the_box_round_an_inlet_in_a_mesh(files):
    tables = {"particles": {"inlet": [{"region": {"shape": "mesh", "file": files["brick"], "stop": [1.0, 1.0, 0.5]}}]}}
    (found,) = (one for one in openings(tables, (1.0, 1.0, 1.0)) if one.kind == "inlet")
    np.testing.assert_allclose((found.start, found.stop), ((0.2, 0.1), (0.8, 0.5)), atol=1e-6)
    tables["particles"]["inlet"][0]["region"]["file"] += ".gone"
    assert not [one for one in openings(tables, (1.0, 1.0, 1.0)) if one.kind == "inlet"]


@pytest.mark.parametrize(
    ("name", "keys", "key", "words"),
    [
        ("open", {}, "region.file", "is open: 3 edges"),
        ("brick", {"scale": 1000.0}, "region", "all lengths are in m"),
        ("brick", {"start": [0.9, 0.9, 0.9], "stop": [1.0, 1.0, 1.0]}, "region.file", "start ... stop"),
        ("missing.stl", {}, "region.file", "cannot be read"),
        ("drawing.svg", {}, "region.file", "ends in .stl, .obj, .ply"),
    ],
)
def test_a_mesh_without_an_inside_is_refused(files, name, keys, key, words):
    with pytest.raises(InputError) as caught:
        space(files.get(name, name), **keys)
    assert caught.value.key == key and words in str(caught.value)
    with pytest.raises(InputError, match="3-D scenes only"):
        region_space(
            "region", Region.model_validate({"shape": "mesh", "file": files["brick"]}), Box((1.0, 1.0), (False,) * 2)
        )


def test_bodies_that_cross_are_refused(files, tmp_path):
    """Their volume would count twice what both have."""
    one, other = (trimesh.creation.box([0.4, 0.4, 0.4]) for _ in range(2))
    one.apply_translation([0.4, 0.5, 0.5])
    other.apply_translation([0.55, 0.52, 0.53])
    apart = other.copy()
    apart.apply_translation([0.3, 0.0, 0.0])
    crossing = saved(trimesh.util.concatenate([one, other]), tmp_path / "crossing.ply")
    with pytest.raises(InputError, match="cross each other"):
        space(crossing)
    separate = saved(trimesh.util.concatenate([one, apart]), tmp_path / "separate.ply")
    np.testing.assert_allclose(space(separate).volume, 2.0 * 0.4**3, rtol=1e-6)
