"""Packs in regions: whole particles inside, solid fraction, sizes, several at once, dense ones by growth."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import stats

import jaxdem
from jaxdem.errors import InputError
from jaxdem.particles import growth, packing, regions
from jaxdem.particles.surfaces import Cylinder, Plane
from jaxdem.particles.walled import WalledRegion
from jaxdem.setup.contact_step import expected_speed
from jaxdem.setup.overlaps import check_initial_positions
from jaxdem.setup.particles import particle_setup

FLAT = {
    "box": {"shape": "box", "start": [0.01, 0.02], "stop": [0.09, 0.08]},
    "disc": {"shape": "sphere", "center": [0.05, 0.05], "radius": 0.04},
    "polygon": {"shape": "polygon", "vertices": [[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.05, 0.04], [0.0, 0.1]]},
}
SOLID = {
    "box": {"shape": "box", "start": [0.01, 0.02, 0.0], "stop": [0.05, 0.06, 0.05]},
    "sphere": {"shape": "sphere", "center": [0.05, 0.05, 0.05], "radius": 0.03},
    "cylinder": {"shape": "cylinder", "base": [0.03, 0.03, 0.03], "axis": [1, 1, 2], "radius": 0.02, "length": 0.05},
    "wedge": {"shape": "polygon", "vertices": [[0, 0], [0.06, 0], [0, 0.06]], "from": 0.03, "to": 0.07},
}
TABLE = {"kind": "table", "radii": [4e-4, 6e-4, 9e-4, 1.5e-3], "cumulative": [0.0, 0.3, 0.8, 1.0]}


def scene(pack, size=(0.1, 0.1), boundary=None, materials=(), **particles):
    given = {"radius": 1e-3, "density": 2500.0} | particles
    return jaxdem.load_scene(
        {
            "seed": 3,
            "domain": {"size": list(size)},
            "particles": {"pack": pack} | {name: value for name, value in given.items() if value is not None},
            "contact": {"young_modulus": 1e6, "speed": 1.0},
            "time": {"end": 0.02, "output_interval": 0.01},
        }
        | ({"boundary": boundary} if boundary else {})
        | ({"materials": list(materials)} if materials else {})
    )


def setup(pack, **other):
    found = particle_setup(scene(pack, **other))
    assert found is not None
    return found


def own_distance(region, x):
    """Depth of points below the boundary, by formulas of its own: half-planes, and distances to axes."""
    if region["shape"] == "box":
        return np.minimum(x - region["start"], np.asarray(region["stop"]) - x).min(axis=1)
    if region["shape"] == "sphere":
        return region["radius"] - np.linalg.norm(x - region["center"], axis=1)
    if region["shape"] == "cylinder":
        axis = np.asarray(region["axis"]) / np.linalg.norm(region["axis"])
        along = (x - region["base"]) @ axis
        across = np.linalg.norm(np.cross(x - region["base"], axis), axis=1)
        return np.minimum(region["radius"] - across, np.minimum(along, region["length"] - along))
    corners = np.asarray(region["vertices"], float)
    plane = x[:, [0, -1]]
    depth = np.full(len(x), np.inf)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        share = np.clip((plane - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)[:, None]
        depth = np.minimum(depth, np.linalg.norm(plane - a - share * (b - a), axis=1))
    if x.shape[1] == 3:
        depth = np.minimum(depth, np.minimum(x[:, 1] - region["from"], region["to"] - x[:, 1]))
    return depth


@pytest.mark.parametrize("kind", ["lattice", "random", "grown"])
@pytest.mark.parametrize(("name", "dimension"), [*((name, 2) for name in FLAT), *((name, 3) for name in SOLID)])
def test_every_particle_lies_in_the_region_with_its_whole_radius(kind, name, dimension):
    """By formulas of their own; none overlaps, and a solid fraction is reached within 1 %."""
    region = (FLAT if dimension == 2 else SOLID)[name]
    fraction = {"random": (0.4, 0.25), "grown": (0.65, 0.4)}.get(kind, (None, None))[dimension - 2]
    pack = {"kind": kind, "region": region} | ({"solid_fraction": fraction} if fraction else {})
    radius = {"radius": 1.5e-3 if dimension == 2 else 2e-3}
    found = setup(pack, size=(0.1,) * dimension, **radius)
    x, r = found.position, radius["radius"]
    assert len(x) > 40 and found.count == len(x)
    assert own_distance(region, x).min() >= r * (1.0 - 1e-9)
    assert packing.deepest_overlap(x, np.full(len(x), r), (0.1,) * dimension, (False,) * dimension)[0] <= 1e-9
    if fraction:
        solid = len(x) * regions.ball_size(dimension) * r**dimension
        volume = found.packs[0].space.volume
        assert abs(solid / volume / fraction - 1.0) < 0.01
        np.testing.assert_allclose(found.packs[0].solid_fraction, solid / volume, rtol=1e-12)
    if name == "box":  # the same by seed
        np.testing.assert_array_equal(setup(pack, size=(0.1,) * dimension, **radius).position, x)


@pytest.mark.parametrize(("dimension", "fraction", "count"), [(2, 0.82, 300), (3, 0.60, 300)])
def test_a_grown_pack_is_dense_and_crosses_periodic_sides(dimension, fraction, count):
    """Equal particles at 0.82 and 0.60; some reach over a periodic side, and none overlaps its images either."""
    radius = (fraction / regions.ball_size(dimension) / count) ** (1.0 / dimension) * 0.1
    pack = {"kind": "grown", "start": [0.0] * dimension, "stop": [0.1] * dimension, "solid_fraction": fraction}
    sides = {name: {"kind": "periodic"} for name in ("left", "bottom", "front")[: dimension if dimension == 2 else 3]}
    found = setup(pack, size=(0.1,) * dimension, boundary=sides, radius=radius)
    x = found.position
    assert abs(found.packs[0].solid_fraction / fraction - 1.0) < 0.01
    assert (x < radius).any() and (x >= 0.0).all() and (x < 0.1).all()
    worst = packing.deepest_overlap(x, np.full(len(x), radius), (0.1,) * dimension, (True,) * dimension)[0]
    assert worst <= 1e-9


def test_a_grown_pack_keeps_its_sizes():
    """Radii by the sieve curve, in a crowd: by volume within 1 %, and Kolmogorov and Smirnov find no bias of place."""
    pack = {"kind": "grown", "solid_fraction": 0.75, "region": FLAT["disc"]}
    found = setup(pack, radius=None, distribution=TABLE)
    radius, x = np.asarray(found.bodies.radius), found.position
    below = [(radius[radius <= size] ** 3).sum() / (radius**3).sum() for size in TABLE["radii"]]
    np.testing.assert_allclose(below, TABLE["cumulative"], atol=0.01)
    left = x[:, 0] < 0.05
    assert stats.ks_2samp(radius[left], radius[~left]).pvalue > 0.01
    assert abs(np.pi * (radius**2).sum() / found.packs[0].space.volume / 0.75 - 1.0) < 0.01
    assert packing.deepest_overlap(x, radius, (0.1, 0.1), (False, False))[0] <= 1e-9


def test_several_packs_have_particles_of_their_own():
    """Rows of one pack stand before those of the next, with radius, density and material of each."""
    materials = [{"name": "glass"}, {"name": "steel", "young_modulus": 2e6}]
    packs = [
        {"kind": "lattice", "start": [0.0, 0.0], "stop": [0.1, 0.02], "radius": 2e-3, "material": "steel"},
        {"kind": "random", "region": {"shape": "sphere", "center": [0.05, 0.06], "radius": 0.02}, "count": 50,
         "density": 1000.0},
    ]  # fmt: skip
    found = setup(packs, materials=materials, material="glass")
    first, second = (pack.count for pack in found.packs)
    assert second == 50 and found.count == first + 50 == len(found.position)
    for column, values in (("radius", (2e-3, 1e-3)), ("density", (2500.0, 1000.0)), ("material", (1, 0))):
        np.testing.assert_array_equal(getattr(found.bodies, column), np.repeat(values, (first, 50)))
    alone = setup(packs[0] | {}, materials=materials, material="glass")
    np.testing.assert_array_equal(alone.position, found.position[:first])
    as_list = setup([packs[0]], materials=materials, material="glass")
    np.testing.assert_array_equal(as_list.position, alone.position)
    check_initial_positions(found)
    again = jaxdem.load_scene(found.scene.tables())
    assert again == found.scene


def test_packs_have_velocities_of_their_own():
    """A pack without one is at rest; the speed that decides the contact step is that of the fastest, twice."""
    packs = [RANDOM | {"count": 3, "velocity": [0.0, -9.0]}, RANDOM | {"start": [0, 0.05], "stop": [0.1, 0.1]}]
    found = setup([packs[0], packs[1] | {"count": 2}])
    np.testing.assert_array_equal(found.given_velocity, [[0.0, -9.0]] * 3 + [[0.0, 0.0]] * 2)
    expecting = dataclasses.replace(found, contact=found.contact.model_copy(update={"speed": "auto"}))
    assert expected_speed(expecting, 0.0) == 18.0
    assert setup(packs[1], count=2).given_velocity is None


def test_one_table_and_a_count_mean_the_same_as_before():
    """`particles.count` and `count` of the pack are one number, and a table is written as a table."""
    pack = {"kind": "random", "start": [0.0, 0.0], "stop": [0.1, 0.1]}
    given, own = setup(pack, count=60), setup(pack | {"count": 60})
    np.testing.assert_array_equal(given.position, own.position)
    region = {"shape": "box", "start": [0.0, 0.0], "stop": [0.1, 0.1]}
    np.testing.assert_array_equal(setup({"kind": "random", "region": region, "count": 60}).position, given.position)
    assert given.scene.tables()["particles"]["pack"] == pack | {"spacing": 1.01}


BOX = {"start": [0.0, 0.0], "stop": [0.1, 0.05]}
RANDOM = {"kind": "random"} | BOX


@pytest.mark.parametrize(
    ("pack", "particles", "key", "words"),
    [
        ([RANDOM | {"count": 9}, {"kind": "lattice", "start": [0.0, 0.04], "stop": [0.1, 0.1]}], {},
         "particles.pack.1", "overlaps that of particles.pack.0"),
        ([RANDOM], {}, "particles.pack.0.count", "solid_fraction"),
        ([RANDOM | {"count": 9}], {"count": 9}, "particles.count", "several packs"),
        ([], {}, "particles.pack", "empty"),
        (RANDOM | {"count": 9}, {"count": 9}, "particles.count", "of a pack"),
        (RANDOM, {}, "particles.count", "random pack"),
        (RANDOM | {"count": 9, "solid_fraction": 0.1}, {}, "particles.pack.solid_fraction", "together"),
        (RANDOM | {"solid_fraction": 0.7}, {}, "particles.pack.solid_fraction", "grown"),
        (RANDOM | {"solid_fraction": 1e-5}, {}, "particles.pack.solid_fraction", "single particle"),
        (RANDOM | {"kind": "grown", "solid_fraction": 0.86}, {}, "particles.pack.solid_fraction", "limit is 84 %"),
        ({"kind": "lattice", "solid_fraction": 0.5} | BOX, {}, "particles.pack.solid_fraction", "spacing"),
        (RANDOM | {"count": 2, "stop": [0.1, 0.0019]}, {}, "particles.radius", "does not fit"),
        (RANDOM | {"count": 2, "stop": [0.1, 0.0019]}, {"radius": 5e-4, "coarse_grain": 2}, "particles.radius",
         "0.0005: a particle of radius 0.001 m does not fit"),
        ([RANDOM | {"count": 2, "radius": 0.03}], {}, "particles.pack.0.radius", "does not fit"),
        (RANDOM | {"count": 99, "stop": [0.1, 0.001]}, {"radius": None, "distribution": TABLE},
         "particles.distribution", "does not fit"),
        ({"kind": "random", "count": 2, "region": {"shape": "polygon", "vertices": [[0, 0], [0.01, 0], [0.02, 0]]}}, {},
         "particles.pack.region.vertices", "one line"),
        (RANDOM | {"region": FLAT["disc"]}, {"count": 9}, "particles.pack.start", "region"),
        ({"kind": "random"}, {"count": 9}, "particles.pack.start", "region"),
        (RANDOM | {"count": 9, "settling_time": 1.0}, {}, "particles.pack.settling_time", "no settling_time"),
        ({"kind": "random", "region": FLAT["disc"] | {"radius": 0.06}}, {"count": 9}, "particles.pack.region",
         "must lie in the box"),
        ([RANDOM | {"count": 2}], {"radius": (1e-3, 2e-3)}, "particles.radius", "per particle"),
        ([RANDOM | {"count": 2, "radius": 1e-3}, {"kind": "lattice", "start": [0, 0.06], "stop": [0.1, 0.1]}],
         {"radius": None}, "particles.radius", "missing"),
        (RANDOM | {"count": 2, "radius": 1e-3, "distribution": TABLE}, {}, "particles.pack.radius", "distribution"),
        ([RANDOM | {"count": 2, "kid": 1}], {}, "particles.pack.0.kid", "kind"),
        (RANDOM | {"velocity": [0.0, 1.0]}, {"count": 1, "velocity": [[0.0, 1.0]]}, "particles.velocity", "given by"),
        (RANDOM | {"kind": "settled", "velocity": [0.0, 1.0]}, {"count": 1}, "particles.pack.velocity", "no velocity"),
        (RANDOM | {"velocity": [0.0, 1.0, 0.0]}, {"count": 1}, "particles.pack.velocity", "2 numbers"),
        ({"kind": "polygon", "vertices": [[0, 0], [0.1, 0.1], [0.1, 0], [0, 0.1]]}, {}, "particles.pack.vertices",
         "two edges meet"),
    ],
)  # fmt: skip
def test_a_pack_that_cannot_be_is_refused(pack, particles, key, words):
    with pytest.raises(InputError) as caught:
        _ = setup(pack, **particles).bodies
    assert caught.value.key == key and words in str(caught.value) and caught.value.remedy


def test_a_solid_fraction_that_growth_does_not_reach_says_what_it_does(monkeypatch):
    """In a strip of two and a half diameters; what is said to be reached is reached."""
    monkeypatch.setattr(growth, "MOST_STEPS", 300)
    pack = {"kind": "grown", "start": [0.0, 0.0], "stop": [0.1, 0.005], "solid_fraction": 0.8}
    with pytest.raises(InputError, match="was reached") as caught:
        _ = setup(pack).position
    assert caught.value.key == "particles.pack.solid_fraction"
    reached = float(str(caught.value).split("; ")[1].split(" ")[0])
    assert 0.5 < reached < 0.8
    assert len(setup(pack | {"solid_fraction": 0.95 * reached}).position)


def test_packs_whose_particles_overlap_are_named():
    """Regions that touch in a corner only by less than what is sampled: the particles tell."""
    found = setup([RANDOM | {"count": 3}, {"kind": "lattice", "start": [0.0, 0.05], "stop": [0.1, 0.1]}])
    moved = found.packs[1].position.copy()
    moved[0] = found.packs[0].position[0]
    found.packs[1].__dict__["position"] = moved
    with pytest.raises(InputError, match=r"one is of particles\.pack\.0") as caught:
        check_initial_positions(found)
    assert caught.value.key == "particles.pack.1"


def test_particles_are_moved_out_of_walls():
    """A tube that leans in a box, cut by a plane: all are inside of both, and clear of each other."""
    tube = Cylinder((0.05, 0.05, 0.0), 0.04, (0.0, 0.3, 1.0), True)
    cut, peg = Plane((0.0, 0.0, 0.03), (0.0, 0.2, 1.0)), Cylinder((0.05, 0.06, 0.0), 0.01, (0.0, 0.0, 1.0), False)
    whole = regions.box((0.0,) * 3, (0.1,) * 3)
    space = WalledRegion(whole.parts, whole.bounds, surfaces=(tube, cut, peg))
    start = np.random.default_rng(2).uniform(0.0, 0.1, (120, 3))
    found, clear = growth.moved_apart(space, start, np.full(120, 0.003))
    assert clear and packing.deepest_overlap(found, np.full(120, 0.003), (0.1,) * 3, (False,) * 3)[0] < 1e-9
    axis = np.asarray(tube.axis) / np.linalg.norm(tube.axis)
    away = np.linalg.norm(np.cross(found - tube.center, axis), axis=1)
    height = (found - cut.point) @ np.asarray(cut.normal) / np.linalg.norm(cut.normal)
    assert away.max() <= 0.037 + 1e-9 and height.min() >= 0.003 - 1e-9
    assert np.hypot(*(found[:, :2] - [0.05, 0.06]).T).min() >= 0.013 - 1e-9
