"""The search within regions about an axis, against all distances."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.particles.cells import CellGrid
from jaxdem.particles.wide_search import Region, neighbors_in_regions
from jaxdem.setup.surroundings import _volume

BOX, EMPTY, COUNT, LOOKING = (7.0, 4.0, 5.0), (900.0, 900.0, 900.0), 230, 200
"""Box that the particles fill, and one that is nearly empty; how many there are, and how many of them look."""
REGIONS = (Region(1.9, 0.7), Region(1.3, 1.3))


def cloud(seed=1):
    """Places and unit vectors, some of the places outside of the box."""
    generator = np.random.default_rng(seed)
    axis = generator.normal(size=(LOOKING, 3))
    places = generator.uniform(-0.3, 1.3, (COUNT, 3)) * BOX
    return places, axis / np.linalg.norm(axis, axis=1)[:, None]


def in_regions(places, axis, box, periodic, active):
    """(L, N) bool, by all distances."""
    apart = places[None] - places[:LOOKING, None]
    apart -= np.where(periodic, box * np.round(apart / box), 0.0)
    along = np.einsum("ijk,ik->ij", apart, axis) ** 2
    across = np.sum(apart**2, axis=2) - along
    found = np.any([along / one.along**2 + across / one.across**2 < 1 for one in REGIONS], axis=0)
    found &= active[None] & active[:LOOKING, None]
    np.fill_diagonal(found, False)
    return found


def moved_to_the_same_columns(grid, places):
    """The first particles beyond the first side go to a far cell that shares their column. The cells around the two
    share theirs, too, but for those across a periodic side."""
    j, k = (index.ravel() for index in np.indices((400, 400)))
    nothing = np.zeros_like(j)
    cells = (nothing, j, k)
    i = np.mod(grid.flat((nothing, nothing, nothing)) - grid.flat(cells), grid.columns)
    one = np.flatnonzero((i > 20) & (i < 400) & (j > 20) & (k > 20))[0]
    far = np.array([i[one], j[one], k[one]]) * np.asarray(grid.box) / grid.shape
    moved = places + ((np.arange(COUNT) < COUNT // 2) & (places[:, 0] < 20.0))[:, None] * far
    homes = [np.asarray(grid.flat(grid.cells(tuple(jnp.asarray(p).T)))) for p in (places, moved)]
    np.testing.assert_array_equal(*homes)
    return moved


@pytest.mark.parametrize(
    ("box", "periodic"), [(BOX, (True, True, True)), (BOX, (False, True, False)), (EMPTY, (True, False, True))]
)
def test_all_in_the_regions_are_found(box, periodic):
    """Across periodic sides and beyond walls, and where far cells share columns. The last rows are seen and do not
    look; rows without a particle are not seen."""
    places, axis = cloud()
    places = (
        np.mod(places + [0.0, 100.0, 100.0], EMPTY) if box == EMPTY else np.where(periodic, np.mod(places, box), places)
    )
    active = np.random.default_rng(2).random(COUNT) < 0.8
    grid = CellGrid(box, periodic, 1.9, COUNT)
    assert grid.shares == (box == EMPTY)
    places = moved_to_the_same_columns(grid, places) if grid.shares else places
    search = jax.jit(lambda p, e, there: neighbors_in_regions(grid, tuple(p.T), tuple(e.T), REGIONS, 60, 200, there))
    others, full = (np.asarray(part) for part in search(places, axis, active))
    assert not full.any()
    expected = in_regions(places, axis, np.asarray(box), np.asarray(periodic), active)
    assert expected.sum(axis=1).max() > 5
    for i, row in enumerate(others):
        listed = row[row != i]
        assert len(set(listed)) == len(listed)
        assert set(listed) == set(np.flatnonzero(expected[i]))


def test_who_has_no_room_is_told():
    """Of those with more neighbours than slots, and those beside a cell with more particles than room."""
    places, axis = cloud()
    places, periodic = np.mod(places, BOX), (True,) * 3
    expected = in_regions(places, axis, np.asarray(BOX), np.asarray(periodic), np.ones(COUNT, bool)).sum(axis=1)
    grid = CellGrid(BOX, periodic, 1.9, COUNT)
    slots = int(np.median(expected))

    @jax.jit
    def search(p, e):
        vectors = tuple(p.T), tuple(e.T)
        few = neighbors_in_regions(grid, *vectors, REGIONS, slots, 200)
        return few[1], neighbors_in_regions(grid, *vectors, REGIONS, 60, 10)[1]

    few, crowded = (np.asarray(part) for part in search(places, axis))
    np.testing.assert_array_equal(few, expected > slots)
    home = np.asarray(grid.flat(grid.cells(tuple(jnp.asarray(places).T))))
    held = np.bincount(home, minlength=grid.columns)
    around = np.asarray(grid.around(grid.cells(tuple(jnp.asarray(places).T))))
    np.testing.assert_array_equal(crowded, (held[around] > 10).any(axis=0)[:LOOKING])
    assert crowded.any()


def test_the_volume_of_regions_that_overlap():
    """A ball, an ellipsoid, and a ball with a needle whose ends are out of it."""
    assert _volume(((2.0, 2.0),)) == pytest.approx(4 / 3 * math.pi * 8.0, rel=1e-5)
    assert _volume(((3.0, 1.0),)) == pytest.approx(4 / 3 * math.pi * 3.0, rel=1e-5)
    points = np.random.default_rng(0).uniform(-3.0, 3.0, (400_000, 3))
    along, across = points[:, 0] ** 2, points[:, 1] ** 2 + points[:, 2] ** 2
    inside = (along + across < 4.0) | (along / 9.0 + across < 1.0)
    assert _volume(((3.0, 1.0), (2.0, 2.0))) == pytest.approx(216.0 * inside.mean(), rel=0.01)
