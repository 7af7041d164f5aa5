"""Packs: no overlaps, inside their polygon, counts; and the overlap check against brute force."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from jaxdem.particles import packing, random_packing, regions
from tests.cases.tiers import tiered

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
    np.testing.assert_array_equal(regions.polygon(HOLLOW, None).inside(points), expected)
    deep = regions.polygon(HOLLOW, None).inside(points, 0.05)
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
    points = packing.lattice_pack(regions.box(np.zeros(len(stop)), stop), RADIUS, spacing, 0.0)
    assert len(points) == np.prod(counts)
    np.testing.assert_allclose(nearest(points), spacing, rtol=1e-12)
    assert points.min() >= RADIUS and (points <= np.array(stop) - RADIUS + 1e-12).all()
    assert (np.diff(points[:, -1]) >= 0).all()


def test_packs_that_hold_nothing_are_empty():
    """A polygon or box too small for one particle."""
    assert packing.polygon_pack(0.04 * TRIANGLE, (1.0, 1.0), RADIUS, 0.041, 0.0).shape == (0, 2)
    assert packing.lattice_pack(regions.box((0.0, 0.0), (0.03, 1.0)), RADIUS, 0.041, 0.0).shape == (0, 2)


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
                d = [x - side * round(x / side) if p else x for x, side, p in zip(d, box, periodic, strict=True)]
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
        random_packing.random_solid_fraction(regions.box(start, stop), radius, spacing),
        (0.45, 0.25)[dimension - 2],
        rtol=1e-12,
    )
    position, placed = random_packing.random_pack(regions.box(start, stop), radius, spacing, 3)
    assert position.shape == (count, dimension)
    assert placed.all()
    assert closest(position, radius) >= spacing
    assert (position - radius[:, None] >= start).all() and (position + radius[:, None] <= stop).all()
    again, _ = random_packing.random_pack(regions.box(start, stop), radius, spacing, 3)
    np.testing.assert_array_equal(again, position)
    other, _ = random_packing.random_pack(regions.box(start, stop), radius, spacing, 4)
    assert np.abs(other - position).max() > RADIUS


def test_random_pack_fills_the_box_evenly():
    """16 equal parts of the box hold the same share of 4,000 discs: within 4 of at most sqrt(250) each."""
    side = np.sqrt(4000 * np.pi * RADIUS**2 / 0.3)
    position, _ = random_packing.random_pack(regions.box(np.zeros(2), np.full(2, side)), np.full(4000, RADIUS), 1.0, 7)
    counts, _, _ = np.histogram2d(*position.T, bins=4, range=[[0, side]] * 2)
    assert np.abs(counts - 250).max() < 4 * np.sqrt(250)


def dense(count, fraction, *width, spacing=1.01):
    """A box of this width in diameters that so many spheres or discs fill to a fraction, spacing included."""
    unit = np.pi if len(width) == 1 else 4 / 3 * np.pi
    across = 2 * RADIUS * np.asarray(width)
    height = count * unit * (spacing * RADIUS) ** (len(width) + 1) / fraction / np.prod(across)
    return np.zeros(len(width) + 1), np.array([*across, height]), np.full(count, RADIUS), spacing


def nearest_by_tree(position):
    return cKDTree(position).query(position, k=2)[0][:, 1].min()


NARROW = [(width, fraction) for fraction in (0.3, 0.33, random_packing.REACHABLE[3]) for width in (3, 13, 20)]


@pytest.mark.parametrize(("width", "fraction"), tiered(NARROW, first=[(3, 0.33), (13, random_packing.REACHABLE[3])]))
def test_what_the_limit_promises_fits_into_boxes_of_few_diameters(width, fraction):
    """5,000 spheres 13 and 20 diameters wide, 500 in 3 (up to 0.33): apart by the spacing, inside, the same by seed."""
    count = 5000 if width > 3 else 500
    if width == 3 and fraction > 0.33:
        pytest.skip("narrower than five diameters")
    start, stop, radius, spacing = dense(count, fraction, width, width)
    position, placed = random_packing.random_pack(regions.box(start, stop), radius, spacing, 0)
    assert placed.all()
    assert nearest_by_tree(position) >= 2 * RADIUS * spacing * (1 - 1e-12)
    assert (position - RADIUS >= start - 1e-15).all() and (position + RADIUS <= stop + 1e-15).all()
    np.testing.assert_array_equal(random_packing.random_pack(regions.box(start, stop), radius, spacing, 0)[0], position)


@pytest.mark.parametrize("width", [5, 13])
def test_discs_reach_their_limit(width):
    start, stop, radius, spacing = dense(400, random_packing.REACHABLE[2], width)
    position, placed = random_packing.random_pack(regions.box(start, stop), radius, spacing, 0)
    assert placed.all() and nearest_by_tree(position) >= 2 * RADIUS * spacing * (1 - 1e-12)


def test_a_pushed_pack_of_two_sizes_is_even_and_has_no_overlaps():
    """Ratio 3 at 0.5, by brute force; eight parts of the box hold the same solid to a tenth."""
    start, stop, _, spacing = dense(1000, 0.5, 10, 10)
    radius = np.where(np.arange(1000) % 2, RADIUS, RADIUS / 3)
    stop[2] *= (radius**3).sum() / (1000 * RADIUS**3)
    position, placed = random_packing.random_pack(regions.box(start, stop), radius, spacing, 5)
    assert placed.all() and closest(position, radius) >= spacing * (1 - 1e-12)
    parts, _ = np.histogramdd(position, bins=2, range=np.stack([start, stop], 1), weights=radius**3)
    np.testing.assert_allclose(parts / parts.mean(), 1.0, atol=0.1)


def test_random_pack_gives_up_beyond_jamming(monkeypatch):
    """Discs at 1.1 of their box, asked of the function itself: it ends, not all have room, and those that have do not
    overlap."""
    monkeypatch.setattr(random_packing, "MOST_PUSHES", 100)
    start, stop, radius, _ = dense(200, 1.1, 12, spacing=1.0)
    position, placed = random_packing.random_pack(regions.box(start, stop), radius, 1.0, 1)
    assert placed.sum() < 200
    assert placed.sum() < 2 or closest(position[placed], radius[placed]) >= 1.0
    # A particle larger than the box finds no room either.
    assert not random_packing.random_pack(regions.box(np.zeros(2), np.full(2, 0.01)), radius[:1], 1.0, 1)[1].any()
