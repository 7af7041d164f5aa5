"""Deposit and interpolation: adjoint, volume exact everywhere, even for even particles, smooth along a path."""

import itertools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.coupling import kernel
from jaxdem.coupling.interpolation import deposit, deposit_on_faces, interpolate, interpolate_faces
from jaxdem.coupling.kernel import KernelWidth, kernel_weights
from jaxdem.coupling.void_fraction import solid_fraction
from jaxdem.fluid.grid import Grid, cell_average, face_total, share_to_faces

# Sums of some hundred terms of size one, in float64: a few hundred times 1e-16.
ROUND_OFF = 1e-13


def box(cells=(6, 5), periodic=(False, False), size=None):
    size = tuple(0.1 * n for n in cells) if size is None else size
    return Grid(cells, size, 0.04, periodic)


def places(grid, count=20, seed=0):
    """Random positions, and all corners, side and face centres, where rounding and mirroring bite."""
    inside = np.random.default_rng(seed).uniform(0.0, grid.size, (count, grid.dimension))
    special = [(0.0, h, 0.5 * length, length) for length, h in zip(grid.size, grid.spacing, strict=True)]
    return np.concatenate((inside, np.array(list(itertools.product(*special)))))


GRIDS = {
    "walls": box(),
    "periodic": box(periodic=(True, True)),
    "one cell thick": box((7, 1), (True, False)),
    "3-D": box((5, 4, 6), (True, False, False)),
}


@pytest.fixture(scope="module", params=GRIDS, ids=str)
def case(request):
    """Grid, positions, weights, and the face exchange both ways, from one compilation."""
    grid = GRIDS[request.param]
    half = tuple(1.3 * h for h in grid.spacing)
    position = places(grid)
    random = np.random.default_rng(1)
    faces = tuple(random.normal(size=grid.face_shape(a)) for a in range(grid.dimension))
    for axis, f in enumerate(faces):
        if grid.periodic[axis]:  # the first and the last face are one
            np.moveaxis(f, axis, 0)[-1] = np.moveaxis(f, axis, 0)[0]
    force = random.normal(size=position.shape)

    @jax.jit
    def compute(position, faces, force):
        weights = kernel_weights(grid, half, position)
        return (
            weights,
            deposit_on_faces(grid, weights, force),
            interpolate_faces(weights, faces),
            deposit(grid, weights, force[:, 0]),
            interpolate(weights, cell_average(faces)),
            share_to_faces(grid, cell_average(faces)),
        )

    return grid, position, faces, force, jax.tree.map(np.asarray, compute(position, faces, force))


def inner_product(grid, a, b):
    """Sum over all faces of a b, periodic doubles counted once."""
    return sum(float(x) for x in face_total(grid, tuple(x * y for x, y in zip(a, b, strict=True))))


def test_deposit_and_interpolation_are_adjoint(case):
    grid, _, faces, force, (_, on_faces, at_particles, *_) = case
    assert inner_product(grid, on_faces, faces) == pytest.approx(np.sum(force * at_particles), abs=ROUND_OFF * 100)


def test_deposited_force_has_the_total_of_the_particles(case):
    grid, _, _, force, (_, on_faces, *_) = case
    np.testing.assert_allclose(face_total(grid, on_faces), force.sum(axis=0), atol=ROUND_OFF)


def test_weights_add_up_to_one_and_lie_in_the_box(case):
    grid, _, _, _, (weights, *_) = case
    np.testing.assert_allclose(weights.weight.sum(axis=1), 1.0, atol=4e-16)
    assert weights.weight.min() >= 0.0
    assert weights.index.min() >= 0 and weights.index.max() < math.prod(grid.cells)


def test_deposit_keeps_the_total(case):
    _, _, _, force, (_, _, _, on_cells, *_) = case
    assert on_cells.sum() == pytest.approx(force[:, 0].sum(), abs=ROUND_OFF)


@pytest.mark.parametrize("ratio", [0.5, 1.0, 1.7, 2.0, 3.3, 16.0])
def test_volume_is_exact_whatever_the_cell_over_the_diameter(ratio):
    diameter = 0.02
    h = ratio * diameter
    grid = Grid((9, 8), (9 * h, 8 * h), h, (True, False))
    position = places(grid, 30)
    half = KernelWidth(1.5, 1.0).half_widths(grid, diameter)
    solids = jax.jit(lambda x: solid_fraction(grid, kernel_weights(grid, half, x), jnp.asarray(4.2e-6)))(position)
    assert float(jnp.sum(solids)) * grid.cell_volume == pytest.approx(4.2e-6 * len(position), rel=ROUND_OFF)
    assert float(jnp.min(solids)) >= 0.0


def path_profile(cells_of_half_width, steps=401):
    """A particle that crosses four cells: what one cell on the way holds of it, and what it sees of itself."""
    grid = box((12, 12), (True, True))
    half = tuple(cells_of_half_width * h for h in grid.spacing)
    x = np.linspace(0.3, 0.7, steps)
    path = np.stack((x, 0.55 + 0.3 * (x - 0.3)), axis=1)

    @jax.jit
    def seen(path):
        def one(point):
            weights = kernel_weights(grid, half, point[None])
            content = deposit(grid, weights, jnp.ones(1))
            return content[5, 6], interpolate(weights, (content,))[0, 0]

        return jax.vmap(one)(path)

    held, own = seen(path)
    return np.asarray(held), np.asarray(own / own.mean())


def test_void_fraction_is_smooth_along_a_path():
    """The kernel's integral is once continuously differentiable: the steps of a path are of first order small,
    and the steps' changes of second order, also where a cell border is crossed; a jump would be of order one."""
    coarse, fine = path_profile(1.0, 401)[0], path_profile(1.0, 801)[0]
    assert np.ptp(coarse) > 0.3  # the path leads through the cell
    step = [np.abs(np.diff(p)).max() for p in (coarse, fine)]
    bend = [np.abs(np.diff(p, 2)).max() for p in (coarse, fine)]
    assert step[0] / step[1] == pytest.approx(2.0, rel=0.05)
    # The second derivative is bounded (but jumps), so that halving the step quarters the bend, nearly.
    assert bend[0] / bend[1] > 3.0


def test_wider_kernel_makes_less_force_noise():
    """What a particle sees of itself varies with its place in the cell; a wide kernel forgets the mesh."""
    noise = [np.ptp(path_profile(w, 201)[1]) for w in (0.5, 1.0, 2.0)]
    assert noise[0] > 2.0 * noise[1] > 8.0 * noise[2]
    # In 2-D the noise at two cells is 3.4 %; a law with drag ~ s^1 then jitters by that much and no more.
    assert noise[2] < 0.05


def test_nearest_cell_weights_would_fail_the_smoothness(monkeypatch):
    """Negative control: an all-or-nothing weight jumps."""
    monkeypatch.setattr(kernel, "_cumulative_triangle", lambda x: jnp.where(x < 0, 0.0, 1.0))
    coarse, fine = path_profile(1.0, 401)[0], path_profile(1.0, 801)[0]
    assert np.abs(np.diff(coarse)).max() / np.abs(np.diff(fine)).max() < 1.1


@pytest.mark.parametrize("ratio", [0.5, 1.0, 2.0, 3.25, 16.0])
def test_even_particles_give_an_even_solid_fraction(ratio):
    """Spread at a spacing that divides the cell (or, the kernel, at ratios under one), walls included.

    With whole numbers of particles per cell, every cell sees the same arrangement, except for the mirror at
    the walls, which continues the lattice: even to round-off. At ratio 1 the kernel ends exactly on cell sides,
    where indices and weights, compiled apart, once rounded differently.
    """
    diameter = 0.02
    per_cell = max(1, math.floor(ratio))
    h = ratio * diameter
    cells = (6, 6)
    grid = Grid(cells, (6 * h, 6 * h), h, (False, True))
    spacing = h / per_cell
    line = (np.arange(6 * per_cell) + 0.5) * spacing
    position = np.stack([a.ravel() for a in np.meshgrid(line, line, indexing="ij")], axis=1)
    half = KernelWidth(1.5, 1.0).half_widths(grid, diameter)
    solids = jax.jit(lambda x: solid_fraction(grid, kernel_weights(grid, half, x), jnp.asarray(1e-6)))(position)
    mean = 1e-6 * len(position) / (36 * grid.cell_volume)
    np.testing.assert_allclose(np.asarray(solids), mean, rtol=ROUND_OFF)


def test_random_particles_far_apart_stay_where_they_are():
    """A particle's volume lands within its half-width and a cell, mean place kept inside the box."""
    grid = box((12, 12))
    half = (0.13, 0.13)
    point = np.array([[0.6, 0.71]])
    solids = np.asarray(jax.jit(lambda x: deposit(grid, kernel_weights(grid, half, x), jnp.ones(1)))(point))
    centres = (np.arange(12) + 0.5) * 0.1
    reached = np.argwhere(solids > 0)
    for axis in range(2):
        assert np.abs(centres[reached[:, axis]] - point[0, axis]).max() <= half[axis] + 0.05 + 1e-12
