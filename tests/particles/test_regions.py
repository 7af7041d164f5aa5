"""Regions: inside, signed distance, volume and bounds against own formulas and against counting points at random."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from jaxdem.errors import InputError
from jaxdem.scene.domain import Box
from jaxdem.scene.messages import as_input_error
from jaxdem.scene.regions import Region
from jaxdem.setup.regions import region_space, require_in_box

HOLLOW = [[0.1, 0.1], [0.9, 0.1], [0.9, 0.9], [0.5, 0.35], [0.1, 0.9]]  # not convex
SHAPES = {
    "box 2-D": {"shape": "box", "start": [0.1, 0.2], "stop": [0.7, 0.5]},
    "box 3-D": {"shape": "box", "start": [0.1, 0.2, 0.3], "stop": [0.7, 0.5, 0.9]},
    "disc": {"shape": "sphere", "center": [0.5, 0.4], "radius": 0.3},
    "sphere": {"shape": "sphere", "center": [0.5, 0.4, 0.5], "radius": 0.3},
    "polygon 2-D": {"shape": "polygon", "vertices": HOLLOW},
    "polygon 3-D": {"shape": "polygon", "vertices": HOLLOW, "from": 0.2, "to": 0.7},
    "cylinder up": {"shape": "cylinder", "base": [0.5, 0.5, 0.1], "axis": [0, 0, 2], "radius": 0.3, "length": 0.6},
    "cylinder down": {"shape": "cylinder", "base": [0.5, 0.5, 0.7], "axis": [0, 0, -1], "radius": 0.3, "length": 0.6},
    "cylinder": {"shape": "cylinder", "base": [0.3, 0.3, 0.3], "axis": [1, 2, 1], "radius": 0.2, "length": 0.5},
}
VOLUMES = {
    "box 2-D": 0.18, "box 3-D": 0.108, "disc": np.pi * 0.09, "sphere": 4 / 3 * np.pi * 0.027,
    "polygon 2-D": 0.64 - 0.5 * 0.8 * 0.55, "polygon 3-D": 0.5 * (0.64 - 0.5 * 0.8 * 0.55),
    "cylinder up": np.pi * 0.09 * 0.6, "cylinder down": np.pi * 0.09 * 0.6, "cylinder": np.pi * 0.04 * 0.5,
}  # fmt: skip


def space(name, periodic=None):
    given = SHAPES[name]
    size = (1.0,) * (2 if name in ("box 2-D", "disc", "polygon 2-D") else 3)
    return region_space("region", Region.model_validate(given), Box(size, periodic or (False,) * len(size)))


def boundary(found, count=4000):
    """Points on the boundary: where lines between random points inside and outside cross it, by bisection."""
    generator = np.random.default_rng(1)
    points = generator.uniform(-0.2, 1.2, (40 * count, found.dimension))
    inside = found.inside(points)
    a, b = points[inside], points[~inside]
    count = min(len(a), len(b), count)
    a, b = a[:count], b[:count]
    for _ in range(50):
        middle = 0.5 * (a + b)
        within = found.inside(middle)[:, None]
        a, b = np.where(within, middle, a), np.where(within, b, middle)
    return a


@pytest.mark.parametrize("name", SHAPES)
def test_volume_and_bounds(name):
    """The volume in closed form and by the part of 40,000 points inside, within 4 deviations; bounds are touched."""
    found = space(name)
    np.testing.assert_allclose(found.volume, VOLUMES[name], rtol=1e-12)
    low, high = np.asarray(found.bounds)
    points = np.random.default_rng(0).uniform(low, high, (40_000, found.dimension))
    part, whole = found.inside(points).mean(), np.prod(high - low)
    exact = VOLUMES[name] / whole
    assert abs(part - exact) < 4.0 * np.sqrt(max(exact * (1.0 - exact), 1e-6) / 40_000)
    edge = boundary(found)
    np.testing.assert_allclose(edge.min(axis=0), low, atol=0.05)
    np.testing.assert_allclose(edge.max(axis=0), high, atol=0.05)
    assert (edge >= low - 1e-9).all() and (edge <= high + 1e-9).all()


@pytest.mark.parametrize("name", SHAPES)
def test_the_signed_distance_is_that_to_the_nearest_point_of_the_boundary(name):
    """Against the nearest of 4,000 points of the boundary: never farther, and as near as these lie densely."""
    found, edge = space(name), boundary(space(name))
    points = np.random.default_rng(2).uniform(-0.2, 1.2, (300, found.dimension))
    nearest = np.linalg.norm(points[:, None] - edge[None], axis=2).min(axis=1)
    distance = found.signed_distance(points)
    assert (np.abs(distance) <= nearest + 1e-9).all()
    assert np.abs(np.abs(distance) - nearest).max() < (0.03 if found.dimension == 2 else 0.12)
    np.testing.assert_array_equal(distance <= 1e-12, found.inside(points))
    assert (found.inside(points, 0.05) == (distance <= -0.05 + 1e-12)).all()


@pytest.mark.parametrize("name", SHAPES)
def test_points_are_brought_inside(name):
    """To where a particle lies with its whole radius inside; those that do already do not move."""
    found = space(name)
    points = np.random.default_rng(3).uniform(0.0, 1.0, (500, found.dimension))
    kept = found.kept(points, 0.04)
    for _ in range(20 if "polygon" in name else 0):  # in a narrow corner it takes several times
        kept = found.kept(kept, 0.04)
    assert found.inside(kept, 0.04).all()
    there = found.inside(points, 0.04 * (1 + 1e-6))
    np.testing.assert_allclose(kept[there], points[there], atol=1e-15)
    if name not in ("polygon 2-D", "polygon 3-D"):  # the nearest such place, of shapes that are convex
        moved = np.linalg.norm(kept - points, axis=1)
        np.testing.assert_allclose(moved.min(), 0.0, atol=1e-15)
        other = found.kept(points + 1e-3, 0.04)
        assert (moved <= np.linalg.norm(other - points, axis=1) + 1e-12).all()


def test_a_region_that_spans_a_periodic_axis_has_no_boundary_there():
    """It is inside at the seam, points outside come in at the other end, and a wall stays what it is."""
    cases = (
        ({"shape": "box", "start": [0.0, 0.0, 0.1], "stop": [1.0, 1.0, 0.5]}, (True, False, False)),
        ({"shape": "polygon", "vertices": HOLLOW}, (False, True, False)),
        ({"shape": "cylinder", "base": [1.0, 0.5, 0.5], "axis": [-3, 0, 0], "radius": 0.3, "length": 1.0}, (True,) * 3),
    )
    for given, periodic in cases:
        box = Box((1.0, 1.0, 1.0), periodic)
        found = region_space("region", Region.model_validate(given), box)
        axis = found.wraps.index(True)
        assert sum(found.wraps) == 1
        point = np.array([[0.5, 0.5, 0.5] if given["shape"] == "cylinder" else [0.3, 0.5, 0.3]])
        point[0, axis] = 1.0 - 1e-6
        assert found.inside(point, 0.1).all()
        point[0, axis] = 1.25
        np.testing.assert_allclose(found.kept(point, 0.1)[0, axis], 0.25)
        closed = region_space("region", Region.model_validate(given), Box(box.size, (False,) * 3))
        point[0, axis] = 1.0 - 1e-6
        assert not any(closed.wraps) and not closed.inside(point, 0.1).any()


@pytest.mark.parametrize(
    ("given", "size", "key", "words"),
    [
        (SHAPES["cylinder"], (1.0, 1.0), "region.base", "numbers"),
        (SHAPES["sphere"] | {"center": [3.0, 0.5, 0.5]}, (1.0,) * 3, "region", "wholly outside"),
        (SHAPES["polygon 2-D"] | {"from": 0.1}, (1.0, 1.0), "region.from", "3-D"),
        (SHAPES["polygon 3-D"] | {"to": 0.1}, (1.0,) * 3, "region.to", "above from"),
        ({"shape": "polygon", "vertices": [[0, 0], [1, 1], [1, 0], [0, 1]]}, (1.0, 1.0), "region.vertices", "edges"),
        ({"shape": "polygon", "vertices": [[0, 0], [1, 1]]}, (1.0, 1.0), "region.vertices", "three corners"),
        (SHAPES["box 2-D"] | {"stop": [0.05, 0.5]}, (1.0, 1.0), "region.stop", "above start"),
        (SHAPES["disc"] | {"vertices": HOLLOW}, (1.0, 1.0), "region.vertices", "remove this key"),
        ({"shape": "sphere", "radius": 0.1}, (1.0, 1.0), "region.center", "add this key"),
        (SHAPES["cylinder"] | {"axis": [0, 0, 0]}, (1.0,) * 3, "region.axis", "not be zero"),
    ],
)
def test_a_region_that_cannot_be_is_refused(given, size, key, words):
    with pytest.raises(InputError) as caught:
        try:
            region = Region.model_validate(given, context={"dimension": len(size)})
        except ValidationError as error:
            found = as_input_error(error, given)
            raise InputError(f"region.{found.key}", found.value, found.limit, found.remedy) from None
        region_space("region", region, Box(size, (False,) * len(size)))
    assert caught.value.key == key and words in str(caught.value).replace("Add", "add").replace("Remove", "remove")


def test_a_region_that_leaves_the_box_is_named():
    found = region_space(
        "region", Region.model_validate(SHAPES["disc"] | {"radius": 0.45}), Box((1.0,) * 2, (False,) * 2)
    )
    with pytest.raises(InputError, match="reaches from"):
        require_in_box("region", found, Box((1.0, 1.0), (False, False)))
