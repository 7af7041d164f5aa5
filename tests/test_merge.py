"""Grains merged into parcels where a scene begins from another run: what is kept, what is told, what is refused."""

from __future__ import annotations

import json

import jax
import numpy as np
import pytest

from jaxdem import InputError, load_scene
from jaxdem.particles.clusters import equal_clusters
from jaxdem.particles.packing import deepest_overlap, hexagonal_rows
from jaxdem.setup.merge import merged
from jaxdem.setup.start_point import StartPoint

RADIUS, DENSITY = 0.01, 2500.0
GRAIN = 4.0 / 3.0 * np.pi * RADIUS**3 * DENSITY


def scene_of(ratio, size, former=1.0, periodic=False, **tables):
    """A scene of parcels that begins from a run of grains, or of smaller parcels."""
    names = ("left", "right", "bottom", "top") + (("front", "back") if len(size) == 3 else ())
    sides = {"boundary": {name: {"kind": "periodic"} for name in names}} if periodic else {}
    particles = {"radius": RADIUS, "density": DENSITY, "position": [[0.1] * len(size)], "coarse_grain": former}
    particles |= {"material": "glass"} if "materials" in tables else {}
    later = {"precision": "float64", "domain": {"size": list(size)}, "time": {"end": 2.0, "output_interval": 1.0}}
    later |= sides | tables
    before = load_scene(later | {"particles": particles}).tables()
    later |= {"start": {"from": "grains"}, "particles": {"coarse_grain": ratio}}
    return load_scene(later, None, before), before


def begin(ratio, position, velocity, spin, size, former=1.0, radius=RADIUS, density=DENSITY, material=0, **more):
    """What a merge makes of these particles: arrays of the start, and its figures."""
    scene, before = scene_of(ratio, size, former, **more)
    rows = {"position": position, "velocity": velocity, "angular_velocity": spin}
    arrays = {f"state.particles.{name}": np.asarray(value, float) for name, value in rows.items()}
    arrays |= {"rows/radius": np.asarray(former * radius), "rows/density": np.asarray(density)}
    arrays |= {"rows/material": np.asarray(material, np.int32), "state.step": np.asarray(0)}
    attributes = {"time": "1", "interval": 0.1, "coarse_grain": former, "tables": json.dumps(before)}
    start, figures = merged(scene, StartPoint("grains", arrays, attributes))
    found = {name: start.arrays[f"state.particles.{name}"] for name in rows}
    return found | start.bodies._asdict(), figures


def agitated(dimension, count, size, seed=0):
    """Spheres at rest in no order, with velocities and spins."""
    generator, turning = np.random.default_rng(seed), 1 if dimension == 2 else 3
    position = generator.uniform(RADIUS, np.asarray(size) - RADIUS, (count, dimension))
    drift = np.arange(1.0, dimension + 1.0)
    return (
        position,
        drift + generator.normal(0.0, 0.5, (count, dimension)),
        generator.normal(0.0, 9.0, (count, turning)),
    )


def energy(mass, radius, velocity, spin):
    return 0.5 * np.sum(mass * np.sum(velocity**2, 1)) + 0.5 * np.sum(0.4 * mass * radius**2 * np.sum(spin**2, 1))


def turning(mass, radius, position, velocity, spin):
    """Angular momentum about the origin."""
    orbital = np.cross(position, velocity)
    return np.sum(mass[:, None] * orbital.reshape(spin.shape) + (0.4 * mass * radius**2)[:, None] * spin, axis=0)


@pytest.mark.parametrize(
    ("dimension", "former", "ratio", "count"), [(2, 1.0, 2.0, 400), (2, 2.0, 3.0, 403), (3, 1.0, 2.0, 501)]
)
def test_mass_and_momentum_are_those_of_the_particles(dimension, former, ratio, count):
    """To rounding, for whole and for broken numbers of particles in a parcel; of those left out nothing is taken."""
    size = (0.5 * former,) * dimension
    position, velocity, spin = agitated(dimension, count, size)
    per, number = (ratio / former) ** dimension, int(count / (ratio / former) ** dimension)
    parcels, figures = begin(ratio, position, velocity, spin, size, former)
    assert len(parcels["position"]) == figures["parcels"] == number
    np.testing.assert_array_equal(parcels["radius"], ratio * RADIUS)
    assert parcels["radius"].shape == (), "all of one size: one number"
    # Of the last particle that is taken a part may be left.
    kept = np.zeros(count)
    order = np.argsort(position[:, -1])
    kept[order] = np.clip(number * per - np.arange(count), 0.0, 1.0)
    grain, parcel = former**dimension * GRAIN * kept, np.full(number, ratio**dimension * GRAIN)
    assert parcel.sum() == pytest.approx(grain.sum(), rel=1e-12)
    np.testing.assert_allclose(parcel @ parcels["velocity"], grain @ velocity, rtol=1e-12)
    lost = former**dimension * GRAIN * (count - number * per)
    assert figures["left_out_mass"] == pytest.approx(lost, rel=1e-9, abs=1e-15)
    assert figures["left_out_particles"] == pytest.approx(count - number * per, abs=1e-6)
    # What is told of the energy is what a reader of both states finds, and it is a loss.
    before = energy(grain, former * RADIUS, velocity, spin)
    after = energy(parcel, ratio * RADIUS, parcels["velocity"], parcels["angular_velocity"])
    assert figures["energy_before"] == pytest.approx(before, rel=1e-9)
    assert figures["energy_after"] == pytest.approx(after, rel=1e-9)
    moving = 0.5 * grain @ np.sum(velocity**2, axis=1)
    translation = 0.5 * parcel @ np.sum(parcels["velocity"] ** 2, axis=1)
    assert 0.0 < translation < moving and after < before
    centre = grain @ position / grain.sum() + figures["centre_moved"]
    np.testing.assert_allclose(parcels["position"].mean(axis=0), centre, rtol=1e-9)
    overlap = deepest_overlap(parcels["position"], np.full(number, ratio * RADIUS), size, (False,) * dimension)[0]
    assert overlap == figures["largest_overlap"] == 0.0
    assert (np.abs(parcels["position"] - 0.25 * former) <= 0.25 * former - ratio * RADIUS + 1e-9).all()


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_pack_that_turns_goes_on_turning(dimension):
    """Touching grains that turn about each other as one body: a parcel of them has their angular momentum or, where
    that would cost more energy than they have, their angular velocity. Far ones have no more than that."""
    corners = np.stack(np.meshgrid(*[[-1.0, 1.0]] * dimension, indexing="ij"), axis=-1).reshape(-1, dimension)
    rate = np.array([7.0]) if dimension == 2 else np.array([3.0, -2.0, 6.0])
    for distance in (0.8, 1.0, 20.0):
        away = distance * RADIUS * corners
        around = np.cross(rate, away) if dimension == 3 else rate * np.stack([-away[:, 1], away[:, 0]], axis=1)
        velocity, spin = 0.3 + around, np.tile(rate, (len(away), 1))
        parcels, figures = begin(2.0, 0.5 + away, velocity, spin, (1.0,) * dimension)
        own = 0.4 * 2**dimension * (2.0 * RADIUS) ** 2
        inertia = len(away) * ((2.0 if dimension == 3 else 2.0) * (distance * RADIUS) ** 2 + 0.4 * RADIUS**2)
        expected = rate * (inertia / own if inertia <= own else 1.0)
        np.testing.assert_allclose(parcels["angular_velocity"], [expected], rtol=1e-12)
        np.testing.assert_allclose(parcels["velocity"], [[0.3] * dimension], rtol=1e-12)
        assert figures["energy_after"] <= figures["energy_before"] * (1.0 + 1e-12)
        told = np.asarray(figures["angular_momentum_after"])
        np.testing.assert_allclose(told, own * GRAIN * expected, rtol=1e-9)
        np.testing.assert_allclose(figures["angular_momentum_before"], inertia * GRAIN * rate, rtol=1e-9)


def test_a_dense_pack_of_grains_is_a_dense_pack_of_parcels():
    """A hexagonal pack of solid fraction 0.87: discs in no order fill at most 0.84 to 0.85, and ordered ones more."""
    position = hexagonal_rows(np.full(2, RADIUS), np.array([0.6, 0.5]) - RADIUS, 2.04 * RADIUS)
    count = len(position)
    parcels, figures = begin(2.0, position, np.zeros((count, 2)), np.zeros((count, 1)), (1.0, 1.0))
    before, after = (
        np.prod(np.percentile(centre, 99.5, axis=0) + radius)
        for centre, radius in ((position, RADIUS), (parcels["position"], 2.0 * RADIUS))
    )
    assert 1.0 < after / before < 1.13
    assert figures["mean_move"] < 0.75 * 2.0 * RADIUS
    # None was far from the grains that it is of.
    assert figures["largest_move"] < 3.0 * 2.0 * RADIUS
    assert figures["energy_before"] == figures["energy_after"] == 0.0


def test_sizes_and_materials_are_not_mixed():
    """Of two materials and of sizes more than a tenth apart there are own parcels; mass by material is kept."""
    position, velocity, spin = agitated(2, 300, (1.0, 1.0))
    generator = np.random.default_rng(1)
    material = generator.integers(0, 2, 300)
    radius = np.where(generator.uniform(size=300) < 0.5, 0.006, 0.01) * generator.uniform(1.0, 1.05, 300)
    density = np.where(material == 1, 1000.0, DENSITY)
    names = {"materials": [{"name": "glass"}, {"name": "clay"}]}
    found, figures = begin(
        2.0, position, velocity, spin, (1.0, 1.0), radius=radius, density=density, material=material, **names
    )
    mass = 4.0 / 3.0 * np.pi * radius**3 * density
    parcel = 4.0 * 4.0 / 3.0 * np.pi * (found["radius"] / 2.0) ** 3 * found["density"]
    assert set(zip(found["material"], found["density"], strict=True)) == {(0, DENSITY), (1, 1000.0)}
    assert parcel.sum() + figures["left_out_mass"] == pytest.approx(mass.sum(), rel=1e-12)
    assert figures["left_out_particles"] < 2 * 4, "less than a parcel of every material"
    for one in (0, 1):
        assert mass[material == one].sum() - parcel[found["material"] == one].sum() < 4 * mass.max()
    sizes = found["radius"] / 2.0
    between = (sizes > 0.0064) & (sizes < 0.0099)
    assert between.sum() <= 2, "only what is left of a class goes to the next"


def test_periodic_boxes_are_merged_within_a_period():
    """Grains that stand outside of the box are those inside; parcels overlap none across its sides."""
    size = (0.4, 0.4)
    position, velocity, spin = agitated(2, 256, size)
    shifted = position + np.array([0.4, -0.8])
    ours, _ = begin(2.0, position, velocity, spin, size, periodic=True)
    theirs, figures = begin(2.0, shifted, velocity, spin, size, periodic=True)
    np.testing.assert_allclose(ours["velocity"], theirs["velocity"], rtol=1e-12)
    np.testing.assert_allclose(ours["position"], theirs["position"], atol=1e-6)
    assert figures["largest_overlap"] == 0.0
    assert deepest_overlap(ours["position"], np.full(64, 0.02), size, (True, True))[0] == 0.0


def test_clusters_are_compact_and_hold_equally_much():
    """Of a square of 8 x 8 points the four clusters are its quarters. Of a broken number of points in a cluster, parts
    add up to whole points, and to as much in every cluster."""
    grid = np.stack(np.meshgrid(np.arange(8.0), np.arange(8.0), indexing="ij"), axis=-1).reshape(-1, 2)
    members = equal_clusters(grid, np.ones(64), 4)
    np.testing.assert_array_equal(members.part, 1.0)
    quarters = 2 * (grid[members.particle, 0] >= 4) + (grid[members.particle, 1] >= 4)
    assert len(set(zip(quarters, members.cluster, strict=True))) == 4
    points = np.random.default_rng(0).uniform(size=(1000, 3))
    members = equal_clusters(points, np.ones(1000), 147)
    np.testing.assert_allclose(np.bincount(members.particle, members.part), 1.0, rtol=1e-12)
    np.testing.assert_allclose(np.bincount(members.cluster, members.part), 1000 / 147, rtol=1e-9)


def test_what_cannot_be_merged_is_named():
    rows = (np.full((3, 2), 0.5), np.zeros((3, 2)), np.zeros((3, 1)), (1.0, 1.0))
    with pytest.raises(InputError, match=r"particles\.coarse_grain = 2\.0: .*takes the place of 4 .*has 3 of 2500"):
        begin(2.0, *rows)
    with pytest.raises(InputError, match=r"particles\.coarse_grain = 2\.0: .*parcels of l = 3.*3 or more"):
        begin(2.0, *rows, former=3.0)
    with pytest.raises(InputError, match=r"particles\.coarse_grain.*greater than or equal to 1|coarse_grain = 0\.5"):
        begin(0.5, *rows)
    with pytest.raises(InputError, match=r"particles\.coarse_grain.*number"):
        begin("two", *rows)


@pytest.mark.parametrize("double", [True, False])
def test_parcels_are_moved_out_of_walls(double):
    """A cylinder and an inclined floor: grains touch them, and their parcels, twice as large, must not reach into
    them. A wall that comes later is not there yet."""
    floor = {"kind": "plane", "point": [0.0, 0.1], "normal": [0.3, 1.0]}
    walls = {"walls": [floor, {"kind": "cylinder", "center": [0.5, 0.5], "radius": 0.4, "inside": True}]}
    walls["walls"].append({"kind": "plane", "point": [0.0, 0.6], "normal": [0.0, 1.0], "begin": 1.5})
    unit = np.array([0.3, 1.0]) / np.hypot(0.3, 1.0)

    def room(position, radius):
        """Least distance from the first two walls, less the radius."""
        below = (position - [0.0, 0.1]) @ unit
        return min(below.min(), (0.4 - np.linalg.norm(position - 0.5, axis=1)).min()) - radius

    grid = hexagonal_rows(np.full(2, RADIUS), np.array([1.0, 0.45]), 2.05 * RADIUS)
    inside = (np.linalg.norm(grid - 0.5, axis=1) < 0.4 - RADIUS) & ((grid - [0.0, 0.1]) @ unit > RADIUS)
    grid = grid[inside]
    with jax.enable_x64(double):
        parcels, figures = begin(2.0, grid, np.zeros_like(grid), np.zeros((len(grid), 1)), (1.0, 1.0), **walls)
    assert room(grid, RADIUS) < 0.5 * RADIUS
    assert room(parcels["position"], 2.0 * RADIUS) > -1e-6 * RADIUS
    assert figures["largest_overlap"] == 0.0
