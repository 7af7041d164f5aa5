"""Which planes a sphere touches at once, against points all over the box."""

import numpy as np
import pytest

from jaxdem.solids.touched_planes import Planes, planes_at_once, planes_beside


def random_planes(dimension, seed):
    """A box, and four planes through it, as a sphere of radius 0.1 sees them that overlaps by up to 0.05."""
    rng = np.random.default_rng(seed)
    ways = rng.normal(size=(4, dimension))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    through = 0.5 - rng.uniform(0.15, 0.35, (4, 1)) * ways  # the middle is in front of all
    normal = np.concatenate([np.eye(dimension), -np.eye(dimension), ways])
    offset = np.concatenate([np.zeros(dimension), -np.ones(dimension), np.sum(ways * through, axis=1)])
    return Planes(
        normal, offset, np.full(len(offset), 0.05), np.full(len(offset), 0.1), np.ones(len(offset), bool), 1e-9
    )


def within(one, sets):
    """Whether a set is part of one of others."""
    return any((one <= other).all() for other in sets)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("seed", range(4))
def test_planes_that_are_touched_at_once(dimension, seed):
    """All that any of 100,000 points touch."""
    planes = random_planes(dimension, seed)
    x = np.random.default_rng(seed).random((100_000, dimension))
    allowed, touched = planes.touched(planes.distances(x))
    seen, found = np.unique(touched[allowed], axis=0), planes_at_once(planes)
    assert len(seen) > 3 and all(within(one, found) for one in seen)


@pytest.mark.parametrize(("offset", "number"), [(-0.03, 2), (-0.025, 3), (0.09, 3), (0.095, 2)])
def test_a_plane_across_a_corner_is_touched_with_both_sides_or_one(offset, number):
    """Distances x, y and (x + y)/sqrt(2) - o between 0.05 and 0.1: sqrt(2) 0.05 - 0.1 <= o <= sqrt(2) 0.1 - 0.05."""
    normal = np.array([[1.0, 0.0], [0.0, 1.0], [0.5**0.5, 0.5**0.5], [-1.0, 0.0], [0.0, -1.0]])
    low, high = np.full(5, 0.05), np.full(5, 0.1)
    found = planes_at_once(Planes(normal, np.array([0.0, 0.0, offset, -1.0, -1.0]), low, high, np.ones(5, bool), 1e-9))
    assert found[:, :3].sum(axis=1).max() == number


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("seed", range(4))
def test_planes_beside_a_piece_of_a_mesh(dimension, seed):
    """The same of centres on a segment or triangle; of one that is nowhere near a plane there are none."""
    planes, rng = random_planes(dimension, seed), np.random.default_rng(seed)
    corners = rng.random((20, dimension, dimension))
    weights = rng.dirichlet(np.ones(dimension), 20_000)
    piece, found = planes_beside(planes, corners)
    some = 0
    for k, own in enumerate(corners):
        allowed, touched = planes.touched(planes.distances(weights @ own))
        seen = np.unique(touched[allowed & touched.any(axis=1)], axis=0)
        assert all(within(one, found[piece == k]) for one in seen)
        some += len(seen)
    assert some > 10
    far = planes._replace(offset=planes.offset - 2.0)
    assert len(planes_beside(far, corners)[0]) == 0
