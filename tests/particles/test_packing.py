"""Packs: no overlaps, inside their polygon, counts; and the overlap check against brute force."""

from __future__ import annotations

import numpy as np
import pytest

from jaxdem.particles import packing

TRIANGLE = np.array([[0.1, 0.1], [0.9, 0.1], [0.5, 0.7]])
HOLLOW = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.5, 0.3], [0.0, 1.0]])  # not convex
RADIUS = 0.02


def nearest(points):
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    return distance.min()


def edge_distance(points, vertices):
    """Signed distance to a convex polygon with corners counter-clockwise, by its half-planes: an own
    formula."""
    following = np.roll(vertices, -1, axis=0)
    edge = (following - vertices) / np.linalg.norm(following - vertices, axis=1)[:, None]
    inward = np.stack([-edge[:, 1], edge[:, 0]], 1)
    return np.einsum("pvd,vd->pv", points[:, None] - vertices[None], inward).min(axis=1)


@pytest.mark.parametrize("jitter", [0.0, 0.001])
def test_polygon_pack_of_a_triangle(jitter):
    """Discs stay a radius and the jitter inside, apart by the spacing, in rows; the jittered ones do not
    overlap."""
    spacing = 2 * RADIUS * 1.05 + 2 * jitter
    points = packing.polygon_pack(TRIANGLE, (1.0, 1.0), RADIUS, spacing, jitter)
    assert edge_distance(points, TRIANGLE).min() >= RADIUS + jitter - 1e-12
    np.testing.assert_allclose(nearest(points), spacing, rtol=1e-9)
    # As many as a hexagonal lattice has in the inner triangle, give or take half a row along its edges.
    inner = edge_distance(np.array([TRIANGLE.mean(axis=0)]), TRIANGLE)[0]
    sides = np.linalg.norm(TRIANGLE - np.roll(TRIANGLE, -1, axis=0), axis=1)
    area = 0.5 * 0.8 * 0.6
    assert inner > RADIUS
    expected = (area - sides.sum() * (RADIUS + jitter)) / (spacing**2 * np.sqrt(0.75))
    assert abs(len(points) - expected) < 0.5 * sides.sum() / spacing
    moved = packing.jittered(points, jitter, 3)
    assert np.linalg.norm(moved - points, axis=1).max() <= jitter + 1e-15
    assert nearest(moved) >= 2 * RADIUS
    np.testing.assert_array_equal(moved, packing.jittered(points, jitter, 3))
    assert (np.diff(points[:, 1]) >= -1e-12).all()  # from below


def test_inside_polygon_that_is_not_convex():
    """Against the union of the two triangles it consists of, by their half-planes; margin from true edges
    only."""
    points = np.random.default_rng(0).uniform(-0.1, 1.1, (4000, 2))
    left = np.array([HOLLOW[0], HOLLOW[3], HOLLOW[4]])
    middle = np.array([HOLLOW[0], HOLLOW[1], HOLLOW[3]])
    right = np.array([HOLLOW[1], HOLLOW[2], HOLLOW[3]])
    expected = np.max([edge_distance(points, part) for part in (left, middle, right)], axis=0) > 0
    np.testing.assert_array_equal(packing.inside_polygon(points, HOLLOW, 0.0), expected)
    deep = packing.inside_polygon(points, HOLLOW, 0.05)
    assert 0.5 * expected.sum() < deep.sum() < expected.sum()
    # Nothing within 0.05 of any edge: sampled.
    share = np.linspace(0, 1, 400)[:, None]
    for a, b in zip(HOLLOW, np.roll(HOLLOW, -1, axis=0), strict=True):
        line = a + share * (b - a)
        assert np.linalg.norm(points[deep][:, None] - line[None], axis=2).min() > 0.05 - 1e-9


def test_extruded_pack_has_no_overlaps():
    """3-D: layers across the depth, every sphere inside the box and the polygon; two layers in 0.09 m."""
    points = packing.polygon_pack(TRIANGLE, (1.0, 0.09, 1.0), RADIUS, 2 * RADIUS * 1.05, 0.0)
    assert len(np.unique(points[:, 1])) == 2
    assert nearest(points) >= 2 * RADIUS * 1.05 - 1e-9
    assert points[:, 1].min() >= RADIUS - 1e-12 and points[:, 1].max() <= 0.09 - RADIUS + 1e-12
    assert edge_distance(points[:, [0, 2]], TRIANGLE).min() >= RADIUS - 1e-12


@pytest.mark.parametrize(("stop", "counts"), [((0.5, 0.3), (12, 7)), ((0.2, 0.1, 0.3), (4, 2, 7))])
def test_lattice_pack(stop, counts):
    """floor((L - 2 r) / spacing) + 1 a side, on a grid, inside the box, lowest first."""
    spacing = 2 * RADIUS * 1.02
    assert counts == tuple(int((length - 2 * RADIUS) / spacing) + 1 for length in stop)
    points = packing.lattice_pack(np.zeros(len(stop)), np.array(stop), RADIUS, spacing, 0.0)
    assert len(points) == np.prod(counts)
    np.testing.assert_allclose(nearest(points), spacing, rtol=1e-12)
    assert points.min() >= RADIUS and (points <= np.array(stop) - RADIUS + 1e-12).all()
    assert (np.diff(points[:, -1]) >= 0).all()


def test_packs_that_hold_nothing_are_empty():
    """A polygon or box too small for one particle."""
    assert packing.polygon_pack(0.04 * TRIANGLE, (1.0, 1.0), RADIUS, 0.041, 0.0).shape == (0, 2)
    assert packing.lattice_pack(np.zeros(2), np.array([0.03, 1.0]), RADIUS, 0.041, 0.0).shape == (0, 2)


@pytest.mark.parametrize("periodic", [(False, False), (True, False), (True, True)])
@pytest.mark.parametrize("sizes", ["one", "several", "ratio 20"])
def test_deepest_overlap_against_brute_force(periodic, sizes):
    """The largest (r_i + r_j - distance) / (2 min r) over all pairs and images."""
    generator, box = np.random.default_rng(8), (1.0, 0.7)
    for count in (2, 30, 80):
        position = generator.uniform(0, 1, (count, 2)) * np.array(box)
        radius = np.full(count, 0.03) if sizes == "one" else generator.uniform(0.01, 0.05, count)
        if sizes == "ratio 20":
            radius = 0.1 * 20.0 ** -generator.uniform(0, 1, count)
        expected, pair = 0.0, (-1, -1)
        for i in range(count):
            for j in range(i + 1, count):
                d = position[i] - position[j]
                d = [
                    x - side * round(x / side) if p else x
                    for x, side, p in zip(d, box, periodic, strict=True)
                ]
                overlap = (radius[i] + radius[j] - np.hypot(*d)) / (2 * min(radius[i], radius[j]))
                if overlap > expected:
                    expected, pair = overlap, (i, j)
        worst, first, second = packing.deepest_overlap(position, radius, box, periodic)
        np.testing.assert_allclose(worst, expected, rtol=1e-9)
        assert tuple(sorted((first, second))) == pair
    assert packing.deepest_overlap(np.zeros((1, 2)), np.array([0.1]), box, periodic) == (0.0, -1, -1)


def closest(position, radius):
    """Least distance of two centres over the sum of their radii, by brute force."""
    distance = np.linalg.norm(position[:, None] - position[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    return (distance / (radius[:, None] + radius[None])).min()


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("sizes", ["one", "several", "ratio 20"])
def test_random_pack_has_no_overlaps(dimension, sizes):
    """1,500 particles at a solid fraction of 0.45 or 0.25: inside the box, apart by the spacing, by brute force."""
    generator, spacing, count = np.random.default_rng(2), 1.02, 1500
    radius = {
        "one": np.full(count, RADIUS),
        "several": generator.uniform(0.3, 1.0, count) * RADIUS,
        "ratio 20": np.where(np.arange(count) % 50 == 0, RADIUS, RADIUS / 20),
    }[sizes]
    start = np.array([0.3, -0.2, 1.0])[:dimension]
    unit = np.pi if dimension == 2 else 4 / 3 * np.pi
    side = (unit * ((spacing * radius) ** dimension).sum() / (0.45, 0.25)[dimension - 2]) ** (1 / dimension)
    stop = start + side * np.array([1.25, 0.8, 1.0])[:dimension]
    np.testing.assert_allclose(
        packing.random_solid_fraction(start, stop, radius, spacing), (0.45, 0.25)[dimension - 2], rtol=1e-12
    )
    position, placed = packing.random_pack(start, stop, radius, spacing, 3)
    assert position.shape == (count, dimension)
    assert placed.all()
    assert closest(position, radius) >= spacing
    assert (position - radius[:, None] >= start).all() and (position + radius[:, None] <= stop).all()
    again, _ = packing.random_pack(start, stop, radius, spacing, 3)
    np.testing.assert_array_equal(again, position)
    other, _ = packing.random_pack(start, stop, radius, spacing, 4)
    assert np.abs(other - position).max() > RADIUS


def test_random_pack_fills_the_box_evenly():
    """16 equal parts of the box hold the same share of 4,000 discs: within 4 of at most sqrt(250) each."""
    side = np.sqrt(4000 * np.pi * RADIUS**2 / 0.3)
    position, _ = packing.random_pack(np.zeros(2), np.full(2, side), np.full(4000, RADIUS), 1.0, 7)
    counts, _, _ = np.histogram2d(*position.T, bins=4, range=[[0, side]] * 2)
    assert np.abs(counts - 250).max() < 4 * np.sqrt(250)


def test_random_pack_gives_up_beyond_saturation(monkeypatch):
    """Twice the saturation of discs, asked of the function itself: it ends, short of 0.6, and none overlap."""
    monkeypatch.setattr(packing, "TRIES_PER_PARTICLE", 200)
    count = 200
    side = np.sqrt(count * np.pi * RADIUS**2 / (2 * packing.SATURATION[2]))
    radius = np.full(count, RADIUS)
    position, placed = packing.random_pack(np.zeros(2), np.full(2, side), radius, 1.0, 1)
    assert 0.4 < placed.sum() * np.pi * RADIUS**2 / side**2 < 0.6
    assert closest(position[placed], radius[placed]) >= 1.0
    # A particle larger than the box finds no room either.
    assert not packing.random_pack(np.zeros(2), np.full(2, 0.01), radius[:1], 1.0, 1)[1].any()
