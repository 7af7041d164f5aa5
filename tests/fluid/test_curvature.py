"""Curvature of circles and spheres against 1/R and 2/R, planes against zero, and the balance of its force."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.fluid.curvature import curvature, near_surface, surface_tension_gradient
from jaxdem.fluid.grid import Grid
from tests.cases.fractions import disc, sphere


def worst(grid, fraction, expected):
    """Largest error of the curvature in the cells that the surface cuts, over the curvature."""
    found = np.asarray(jax.jit(lambda c: curvature(grid, c))(jnp.asarray(fraction)))
    cut = (fraction > 1e-6) & (fraction < 1.0 - 1e-6)
    assert cut.any()
    return np.abs(found[cut] / expected - 1.0).max()


@pytest.mark.parametrize("gas", (False, True))
def test_circle_is_of_second_order(gas):
    """Places at random, cells of unequal sides; a bubble has the curvature of the drop with the other sign."""
    rng = np.random.default_rng(2)
    centres = 0.5 + 0.05 * rng.random((3, 2))
    errors = []
    for n in (24, 48):
        cells = (n, n + n // 4)
        grid = Grid(cells, (1.0, 1.0), 1.0, (True, False))
        drops = [disc(cells, grid.size, centre, 0.3) for centre in centres]
        fields = [(1.0 - f, -1.0 / 0.3) if gas else (f, 1.0 / 0.3) for f in drops]
        errors.append(max(worst(grid, *field) for field in fields))
    assert errors[1] < 0.012 and errors[0] / errors[1] > 3.0


def test_sphere_is_of_second_order():
    """In the mean square; its corners have no columns from full to empty, and the mean of the neighbours there."""
    errors = []
    for n in (12, 24):
        grid = Grid((n, n, n), (1.0, 1.0, 1.0), 1.0, (False, True, False))
        ball = sphere(grid.cells, grid.size, (0.49, 0.51, 0.52), 0.35, points=120)
        error = np.asarray(jax.jit(lambda c, grid=grid: curvature(grid, c))(jnp.asarray(ball))) * 0.35 / 2.0 - 1.0
        errors.append(np.sqrt(np.mean(error[(ball > 1e-6) & (ball < 1.0 - 1e-6)] ** 2)))
    assert errors[1] < 0.01 and errors[0] / errors[1] > 3.0


def test_half_a_circle_on_a_wall():
    """At a right angle to the wall, which mirrors it."""
    grid = Grid((40, 20), (1.0, 0.5), 1.0, (False, False))
    whole = disc((40, 40), (1.0, 1.0), (0.5, 0.5), 0.3)
    assert worst(grid, whole[:, 20:], 1.0 / 0.3) < 0.02


def test_drop_of_two_cells_has_a_curvature_of_its_size():
    """Where no column is full at one end the fall-back gives the order of magnitude."""
    grid = Grid((16, 16), (1.0, 1.0), 1.0, (True, True))
    radius = 1.2 / 16
    drop = disc(grid.cells, grid.size, (0.5, 0.5), radius)
    assert drop.max() < 1.0
    found = radius * np.asarray(jax.jit(lambda c: curvature(grid, c))(jnp.asarray(drop)))[drop > 0.0]
    assert found.min() > 0.5 and found.max() < 2.5


def test_force_is_a_gradient_for_a_given_curvature_and_adds_up_to_nothing():
    """On every face it is sigma kappa of the circle times the difference of the fractions; over a drop it sums to
    zero up to the error of the curvature."""
    grid = Grid((32, 32), (1.0, 1.0), 1.0, (True, True))
    drop = jnp.asarray(disc(grid.cells, grid.size, (0.52, 0.47), 0.3))
    force = jax.jit(lambda c: surface_tension_gradient(grid, c, 0.07))(drop)
    slope = 32.0 * (drop - jnp.roll(drop, 1, 0))
    found = np.asarray(force[0][:-1])
    there = np.abs(slope) > 1e-3
    np.testing.assert_allclose((found / (0.07 * slope))[there], 1.0 / 0.3, rtol=0.02)
    assert abs(found.sum()) < 1e-3 * np.abs(found).sum()
    np.testing.assert_array_equal(force[0][0], force[0][-1])


def test_surface_along_faces_is_seen():
    """A layer that ends between two cells has no cell that is cut; its curvature is still known, and it is zero."""
    grid = Grid((8, 8), (1.0, 1.0), 1.0, (True, False))
    layer = jnp.zeros((8, 8)).at[:, :4].set(1.0)
    near = np.asarray(near_surface(grid, layer))
    assert near[:, 3:5].all() and near.sum() == 16
    np.testing.assert_allclose(curvature(grid, layer), 0.0, atol=1e-13)


def test_slopes_are_finite():
    grid = Grid((12, 12), (1.0, 1.0), 1.0, (True, False))
    drop = jnp.asarray(disc(grid.cells, grid.size, (0.5, 0.5), 0.3), jnp.float32)
    slope = jax.jit(jax.grad(lambda c: jnp.sum(curvature(grid, c) ** 2)))(drop)
    assert slope.dtype == jnp.float32 and np.isfinite(slope).all()
