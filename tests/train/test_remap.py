"""Conservative remapping between grids whose ratio is not a whole number, against sums over the fine grid."""

import numpy as np
import pytest

from jaxdem.fluid.grid import Grid, divergence
from jaxdem.fluid.remap import coarsened, remap_cells, remap_flux


def grid_of(cells):
    size = (3.0, 0.5, 2.0)[: len(cells)]
    return Grid(cells, size, 0.04, (False,) * len(cells))


@pytest.mark.parametrize(
    ("cells", "factor", "expected"),
    [((300, 50), 2, (150, 25)), ((300, 50), 4, (75, 12)), ((300, 50), 8, (38, 6)), ((5, 3, 4), 8, (1, 1, 1))],
)
def test_coarse_grids_are_those_of_the_study(cells, factor, expected):
    """300 x 50 gives 150 x 25, 75 x 12 and 38 x 6 (study.md)."""
    assert coarsened(grid_of(cells), factor).cells == expected


@pytest.mark.parametrize(("fine", "coarse"), [((30, 10), (8, 3)), ((12, 7, 5), (5, 2, 5))])
def test_volume_integral_is_kept(fine, coarse):
    """The sum over cells times the cell volume does not change."""
    field = np.random.default_rng(0).normal(size=fine)
    a, b = grid_of(fine), grid_of(coarse)
    remapped = remap_cells(a, b, field)
    assert remapped.shape == coarse
    np.testing.assert_allclose(remapped.sum() * b.cell_volume, field.sum() * a.cell_volume, rtol=1e-12)


@pytest.mark.parametrize(("fine", "coarse"), [((30, 10), (8, 3)), ((12, 7, 5), (5, 2, 5))])
def test_divergence_of_the_coarse_flux_is_the_mean_of_the_fine(fine, coarse):
    """Exact for any ratio: what flows into a coarse cell is what flows into the fine cells under it."""
    generator = np.random.default_rng(1)
    a, b = grid_of(fine), grid_of(coarse)
    flux = tuple(generator.normal(size=a.face_shape(axis)) for axis in range(a.dimension))
    of_coarse = divergence(b, remap_flux(a, b, flux))
    mean_of_fine = remap_cells(a, b, np.asarray(divergence(a, flux)))
    np.testing.assert_allclose(of_coarse, mean_of_fine, atol=1e-10 * np.abs(mean_of_fine).max())


def test_same_grid_changes_nothing():
    """Remapping onto itself is the identity."""
    a = grid_of((6, 4))
    field = np.random.default_rng(2).normal(size=a.cells)
    np.testing.assert_allclose(remap_cells(a, a, field), field, rtol=1e-14)
