"""Diffusion of the void fraction between surfaces: as in a box that ends there, conservative, even, and closed walls
are tight. On the host: nothing is compiled."""

import math

import numpy as np
import pytest
from scipy.linalg import expm

from jaxdem.coupling.cut_diffusion import cut_diffusion, exponential_series
from jaxdem.coupling.deposition import Diffusion, gaussian_matrix
from jaxdem.coupling.interpolation import deposit, interpolate
from jaxdem.coupling.open_cells import weights_beside
from jaxdem.fluid.grid import Grid
from jaxdem.setup.cut_cells import FluidSurface, cut_cells_of

ROUND_OFF = 1e-12
NORMAL = np.array([-0.6, 0.8])


def tilted(grid):
    """A plane, and a cylinder with the fluid round it."""
    plane = FluidSurface(lambda x: (x - np.array([0.0, 0.02])) @ NORMAL)
    cylinder = FluidSurface(lambda x: np.hypot(x[..., 0] - 0.05, x[..., 1] - 0.13) - 0.031)
    return cut_cells_of(grid, [plane, cylinder])[0]


@pytest.mark.parametrize("periodic", [False, True])
def test_a_wall_on_a_grid_line_is_a_side_of_the_box(periodic):
    grid = Grid((9, 12), (0.09, 0.24), 1.0, (periodic, False))
    cut, _ = cut_cells_of(grid, [FluidSurface(lambda x: x[..., 1] - 0.08)])
    deviation = (0.021, 0.033)
    amount = np.random.default_rng(0).random((9, 12)) * (np.arange(12) >= 4)
    found = cut_diffusion(grid, cut, deviation).of_amounts(amount)
    expected = gaussian_matrix(9, 0.01, deviation[0], periodic) @ amount[:, 4:]
    expected = expected @ gaussian_matrix(8, 0.02, deviation[1], False)
    assert found[:, 4:] == pytest.approx(expected, abs=ROUND_OFF)
    assert not found[:, :4].any()


def test_it_is_the_exponential_of_the_equation():
    grid = Grid((8, 8), (0.16, 0.16), 1.0, (False, False))
    cut, deviation = tilted(grid), 0.025
    smoothing = cut_diffusion(grid, cut, (deviation, deviation))
    count, number = 64, np.arange(64).reshape(8, 8)
    rate = np.zeros((count, count))
    v = np.asarray(cut.open_cells)
    for axis, a in enumerate(cut.open_faces):
        for cell in np.argwhere(v > 0.0):
            other = cell + (np.arange(2) == axis)
            if other[axis] == 8:
                continue
            one, two = number[tuple(cell)], number[tuple(other)]
            through = min(a[tuple(other)], v[tuple(cell)], v[tuple(other)]) / 0.02**2
            for here, there in ((one, two), (two, one)):
                rate[here, here] -= through / max(v.flat[here], 1e-300)
                rate[here, there] += through / max(v.flat[here], 1e-300) if v.flat[here] > 0.0 else 0.0
    field = np.random.default_rng(1).random((8, 8))
    exact = (expm(0.5 * deviation**2 * rate) @ field.ravel()).reshape(8, 8)
    assert smoothing.of_fields(field) == pytest.approx(exact, abs=1e-11)


def test_amounts_are_kept_even_stays_even_and_the_exchange_is_adjoint():
    grid = Grid((16, 16), (0.16, 0.16), 1.0, (False, False))
    cut = tilted(grid)
    cut = cut._replace(deposit_weights=cut.open_cells)
    deposition = Diffusion((0.04, 0.04))
    random = np.random.default_rng(2)
    position = random.uniform(0.0, 0.16, (60, 2))
    weights = weights_beside(deposition, grid, deposition.weights(grid, position, np.asarray(0.003)), cut)
    volume, field = random.random(60), random.standard_normal((16, 16))
    reached = np.asarray(weights.weight).sum(axis=1) > 0.0
    spread = deposit(grid, weights, volume)
    assert spread.sum() == pytest.approx(volume[reached].sum(), rel=ROUND_OFF)
    at_particles = np.asarray(interpolate(weights, (field,)))[:, 0]
    assert volume @ at_particles == pytest.approx(np.sum(spread * field), rel=ROUND_OFF)
    even = weights.smoothing.of_amounts(np.asarray(cut.open_cells))
    assert even == pytest.approx(np.asarray(cut.open_cells), abs=ROUND_OFF)
    assert spread.min() > -ROUND_OFF


def test_nothing_passes_through_a_wall_of_closed_faces():
    grid = Grid((12, 4), (0.12, 0.04), 1.0, (False, False))
    wall = FluidSurface(lambda x: np.abs(x[..., 0] - 0.05) - 0.01)
    cut, _ = cut_cells_of(grid, [wall])
    amount = np.zeros((12, 4))
    amount[3] = 1.0
    found = cut_diffusion(grid, cut, (0.03, 0.03)).of_amounts(amount)
    assert found[:4].sum() == pytest.approx(4.0, rel=ROUND_OFF) and np.abs(found[4:]).max() < ROUND_OFF
    # Negative control: in the box without the wall more than a tenth goes there.
    assert (gaussian_matrix(12, 0.01, 0.03, False) @ amount)[6:].sum() > 0.4


@pytest.mark.parametrize(("bound", "dtype"), [(0.1, np.float64), (8.0, np.float64), (200.0, np.float32)])
def test_the_series_is_the_exponential(bound, dtype):
    x = np.linspace(-1.0, 1.0, 41)
    found = np.polynomial.chebyshev.chebval(x, exponential_series(bound, np.dtype(dtype)).astype(float))
    assert found == pytest.approx(np.exp(-0.5 * bound * (1.0 - x)), abs=50 * float(np.finfo(dtype).eps))
    assert len(exponential_series(bound, np.dtype(dtype))) < 2.0 * math.sqrt(20.0 * bound) + 25
