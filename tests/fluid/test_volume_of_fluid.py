"""Transport of a surface: bounds and volume to rounding, shapes that come back, beds, sides of the box, gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.fluid.grid import Grid, divergence
from jaxdem.fluid.volume_of_fluid import (
    SURFACE_COURANT,
    Carrier,
    _Sweep,
    advance_fraction,
    surface_courant,
    surface_normal,
)
from tests.cases.fractions import disc, sphere
from tests.cases.tiers import COMBINATION, tiered


def stream_flux(cells, potential, spacing):
    """Fluxes of a stream function at the corners: free of divergence to rounding."""
    return (
        jnp.asarray((potential[:, 1:] - potential[:, :-1]) / spacing[1]),
        jnp.asarray(-(potential[1:] - potential[:-1]) / spacing[0]),
    )


def random_stream(cells, size, seed, periodic):
    """A rough stream, with no flow through sides that are not periodic."""
    rng = np.random.default_rng(seed)
    potential = rng.normal(size=tuple(n + 1 for n in cells))
    for axis in range(2):
        ends = [slice(None)] * 2
        ends[axis] = [0, -1]
        potential[tuple(ends)] = potential.take([0, 0], axis) if periodic[axis] else 0.0
    return stream_flux(cells, potential, tuple(s / n for s, n in zip(size, cells, strict=True)))


def repeated(grid, fraction, flux, step, count, **more):
    """Many steps in one program."""

    def body(k, c):
        return advance_fraction(grid, c, Carrier(flux, **more), step, k).fraction

    return jax.jit(lambda c: jax.lax.fori_loop(0, count, body, c))(jnp.asarray(fraction))


@pytest.mark.parametrize("periodic", ((False, False), (True, True)))
def test_volume_is_kept_and_bounds_hold_without_clipping(periodic):
    """In a rough stream at the limit of the Courant number, which mixes the fluids up within some steps."""
    grid = Grid((12, 10), (1.2, 1.0), 1.0, periodic)
    flux = random_stream(grid.cells, grid.size, 1, periodic)
    step = SURFACE_COURANT / float(surface_courant(grid, flux, 1.0))
    first = disc(grid.cells, grid.size, (0.6, 0.5), 0.3)
    later = np.asarray(repeated(grid, first, flux, step, 2000))
    assert abs(later.sum() / first.sum() - 1.0) < 1e-13
    assert later.min() > -1e-13 and later.max() < 1.0 + 1e-13
    assert later.min() < 0.01 and np.abs(later - first).max() > 0.3


def test_without_the_dilation_fractions_leave_their_bounds():
    grid = Grid((12, 10), (1.2, 1.0), 1.0, (True, True))
    flux = random_stream(grid.cells, grid.size, 1, grid.periodic)
    step = SURFACE_COURANT / float(surface_courant(grid, flux, 1.0))
    first = jnp.asarray(disc(grid.cells, grid.size, (0.6, 0.5), 0.3))
    both = first, jnp.zeros_like(first)
    without = _Sweep(grid, 1.0, jnp.zeros_like(first), None)
    for axis in range(2):
        both, _ = without(both, flux[axis], step, axis, axis == 1)
    assert float(both[0].max()) > 1.1


@pytest.mark.parametrize("tilt", ((1.0, 0.0), (0.0, -1.0), (1.0, 1.0), (-2.0, 1.0), (0.3, -1.0)))
def test_straight_surface_has_its_normal(tilt):
    """Exact where the columns see the whole surface; in units of the cells' sides."""
    grid = Grid((24, 24), (2.4, 1.2), 1.0, (False, False))
    x = (np.arange(24 * 50) + 0.5) / 50
    inside = (tilt[0] * (x[:, None] - 12.1) + tilt[1] * (x[None] - 12.3) < 0.0).astype(float)
    fraction = jnp.asarray(inside.reshape(24, 50, 24, 50).mean(axis=(1, 3)))
    normal = surface_normal(grid, fraction)
    expected = np.array(tilt) / np.abs(tilt).sum()
    cut = np.asarray((fraction > 1e-9) & (fraction < 1.0 - 1e-9))[4:-4, 4:-4]
    assert cut.sum() > 10
    found = np.stack([np.asarray(m)[4:-4, 4:-4][cut] for m in normal], axis=-1)
    np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), atol=0.03)


@pytest.mark.parametrize(
    "cells, size", tiered((((16, 32), (1.0, 1.0)), ((32, 16), (1.0, 1.0))), first=[((16, 32), (1.0, 1.0))])
)
def test_disc_comes_back_after_one_turn_of_a_periodic_box(cells, size):
    """Diagonal translation, 1 period. Error of the shape: volume that stands elsewhere over that of the disc."""
    grid = Grid(cells, size, 1.0, (True, True))
    flux = tuple(jnp.ones(grid.face_shape(axis)) for axis in range(2))
    first = disc(cells, size, (0.5, 0.5), 0.25)
    steps = 4 * max(cells)
    later = np.asarray(repeated(grid, first, flux, 1.0 / steps, steps))
    assert np.abs(later - first).sum() / first.sum() < 0.04


@COMBINATION
def test_sphere_comes_back_in_3d():
    cells = (12, 12, 12)
    grid = Grid(cells, (1.0, 1.0, 1.0), 1.0, (True, True, True))
    flux = tuple(speed * jnp.ones(grid.face_shape(axis)) for axis, speed in enumerate((1.0, -1.0, 0.5)))
    first = sphere(cells, grid.size, (0.5, 0.5, 0.5), 0.3)
    later = np.asarray(repeated(grid, first, flux, 1.0 / 60.0, 120))
    assert abs(later.sum() / first.sum() - 1.0) < 1e-13
    assert later.min() > -1e-14 and later.max() < 1.0 + 1e-14
    assert np.abs(later - first).sum() / first.sum() < 0.12


def test_order_of_the_sweeps_as_a_number_and_as_an_array():
    grid = Grid((8, 6), (0.8, 0.6), 1.0, (False, True))
    flux = random_stream(grid.cells, grid.size, 3, grid.periodic)
    step = 0.4 / float(surface_courant(grid, flux, 1.0))
    first = jnp.asarray(disc(grid.cells, grid.size, (0.4, 0.3), 0.2))
    traced = jax.jit(lambda k: advance_fraction(grid, first, Carrier(flux), step, k))
    found = []
    for k in (0, 1):
        fixed = jax.jit(lambda k=k: advance_fraction(grid, first, Carrier(flux), step, k))()
        found.append(np.asarray(fixed.fraction))
        np.testing.assert_allclose(traced(jnp.asarray(k)).fraction, fixed.fraction, atol=1e-15)
        change = first - step * divergence(grid, fixed.liquid_flux)
        np.testing.assert_allclose(fixed.fraction, change, atol=1e-15)
    assert np.abs(found[0] - found[1]).max() > 1e-3


def test_among_grains_that_move():
    """The void fraction changes as the flux says: pure fluids stay pure, bounds hold, the liquid keeps its volume."""
    grid = Grid((12, 10), (1.2, 1.0), 1.0, (True, False))
    rng = np.random.default_rng(5)
    before = jnp.asarray(0.4 + 0.5 * rng.random(grid.cells))
    flux = list(random_stream(grid.cells, grid.size, 6, grid.periodic))
    squeeze = rng.normal(size=grid.face_shape(1)) * 0.3
    squeeze[:, [0, -1]] = 0.0
    flux[1] = flux[1] + squeeze
    step = 0.3 * SURFACE_COURANT / float(surface_courant(grid, tuple(flux), 1.0, before))
    after = before - step * divergence(grid, tuple(flux))
    first = jnp.asarray(disc(grid.cells, grid.size, (0.6, 0.5), 0.3))
    step_of = jax.jit(lambda c: advance_fraction(grid, c, Carrier(tuple(flux), before, after), step, 1).fraction)
    later = step_of(first)
    assert abs(float(jnp.sum(later * after) / jnp.sum(first * before)) - 1.0) < 1e-14
    assert float(later.min()) > -1e-14 and float(later.max()) < 1.0 + 1e-14
    for pure in (0.0, 1.0):
        np.testing.assert_allclose(step_of(jnp.full(grid.cells, pure)), pure, atol=1e-14)


def test_what_comes_in_through_a_side_is_of_its_phase():
    grid = Grid((8, 4), (0.8, 0.4), 1.0, (False, True))
    flux = (jnp.ones(grid.face_shape(0)), jnp.zeros(grid.face_shape(1)))
    lower = jnp.asarray([[1.0, 0.0, 1.0, 0.0]])
    more = {"inflow": (lower, None, None, None)}
    later = np.asarray(repeated(grid, np.zeros(grid.cells), flux, 0.04, 10, **more))
    np.testing.assert_allclose(later[:, [1, 3]], 0.0, atol=1e-14)
    np.testing.assert_allclose(later[:4, [0, 2]], 1.0, atol=1e-12)
    np.testing.assert_allclose(later[4:, [0, 2]], 0.0, atol=1e-12)


@pytest.mark.parametrize("dtype", tiered([jnp.float32, jnp.float64], first=[jnp.float32]))
def test_slopes_are_finite_and_those_of_the_flow(dtype):
    """Over full, empty and cut cells and faces at rest: the liquid's place by its speed, against differences."""
    grid = Grid((8, 8), (0.8, 0.8), 1.0, (True, True))
    first = jnp.asarray(disc(grid.cells, grid.size, (0.4, 0.4), 0.2), dtype)
    place = jnp.linspace(-1.0, 1.0, 8, dtype=dtype)[None, :]

    @jax.jit
    def moment(first, speed):
        flux = (jnp.zeros((9, 8), dtype), speed * jnp.ones((8, 9), dtype))
        step = jnp.asarray(0.02, dtype)

        def advance(c, _):
            return advance_fraction(grid, c, Carrier(flux), step, 0).fraction, None

        return jnp.sum(place * jax.lax.scan(advance, first, None, 3)[0])

    speed = jnp.asarray(1.0, dtype)
    slopes = jax.jit(jax.grad(moment, (0, 1)))(first, speed)
    assert slopes[0].dtype == dtype and np.isfinite(slopes[0]).all()
    step = 1e-2 if dtype == jnp.float32 else 1e-5
    difference = (moment(first, speed + step) - moment(first, speed - step)) / (2.0 * step)
    np.testing.assert_allclose(slopes[1], difference, rtol=1e-2 if dtype == jnp.float32 else 1e-7)


def test_slopes_of_the_normal_are_finite_beside_a_trace_of_liquid():
    """A region that just touches a cell leaves 1e-29 in it, whose square is no number in single precision."""
    grid = Grid((4, 4), (0.4, 0.4), 1.0, (False, False))
    trace = jnp.zeros((4, 4), jnp.float32).at[3, 3].set(1e-29)
    slopes = jax.jit(jax.grad(lambda c: jnp.sum(surface_normal(grid, c)[0][:2])))(trace)
    assert np.isfinite(slopes).all()
    slopes = jax.jit(jax.grad(lambda c: jnp.sum(surface_normal(grid, c)[0][0])))(trace.at[0, 0].set(0.5))
    assert np.isfinite(slopes).all() and np.abs(slopes).max() > 0.0
