"""Heat that two fluids carry by the flux of their surface: what is kept, bounds, sides, slopes, and what fails."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.fluid.carried_heat import CarriedHeat, HeatOfPhases, carried_heat
from jaxdem.fluid.grid import Grid, divergence, face_average
from jaxdem.fluid.volume_of_fluid import Carrier, advance_fraction
from jaxdem.particles.regions import ball
from jaxdem.setup.surface import cells_within
from tests.cases.heat_in_two_fluids import WATER_AND_AIR, WarmFluids, temperature
from tests.cases.tiers import COMBINATION
from tests.cases.two_fluids import ROUGH_STEP as STEP
from tests.cases.two_fluids import solenoidal


def numbers(capacity=WATER_AND_AIR, inflow=(None,) * 4):
    return HeatOfPhases(tuple(map(jnp.asarray, capacity)), None, jnp.asarray(300.0), inflow)


def stepped(grid, given, fraction, warm, flux, gaps=None, order=0, faces=None):
    """Liquid fraction and heat after a step; `faces` gives Phi otherwise, by the fraction of the start."""
    gaps = gaps or (jnp.ones(grid.cells),) * 2
    moved = advance_fraction(grid, fraction, Carrier(flux, *gaps), jnp.asarray(STEP), order)
    phi = given.carrier(flux, moved.liquid_flux) if faces is None else faces(given, fraction, flux)
    contents = given.content(fraction, gaps[0]), given.content(moved.fraction, gaps[1])
    heat = CarriedHeat(warm, jnp.zeros(2 * grid.dimension))
    return moved.fraction, carried_heat(grid, given, heat, phi, contents, jnp.asarray(STEP), jnp.asarray(order))


def by_volume(given, fraction, flux):
    """The flux of both fluids times the mean capacity of two cells: not what has moved the surface."""
    return tuple(f * c for f, c in zip(flux, face_average_of(given, fraction, flux), strict=True))


def face_average_of(given, fraction, flux):
    grid = Grid(fraction.shape, (1.0,) * fraction.ndim, 1.0, (True,) * fraction.ndim)
    return face_average(grid, given.content(fraction, 1.0))


@pytest.mark.parametrize("cells", [(10, 8), pytest.param((6, 6, 6), marks=COMBINATION)])
def test_heat_is_kept_within_bounds_among_grains_that_move(cells):
    """Heat to rounding and no new extrema at any corner of the surface; with another flux there are new ones."""
    grid = Grid(cells, (1.0,) * len(cells), 1.0, (True,) * len(cells))
    rng = np.random.default_rng(2)
    fraction = jnp.asarray(cells_within(ball((0.5,) * len(cells), 0.33), grid))
    warm, flux = jnp.asarray(rng.uniform(300.0, 400.0, cells)), solenoidal(grid)
    before = jnp.asarray(rng.uniform(0.6, 1.0, cells))
    gentle = tuple(0.3 * f * g for f, g in zip(flux, face_average(grid, before), strict=True))
    moving = gentle, (before, before - STEP * divergence(grid, gentle))
    step = jax.jit(stepped, static_argnums=(0, 6, 7))
    for given, gaps in ((flux, (jnp.ones(cells),) * 2), moving):
        after, heat = step(grid, numbers(), fraction, warm, given, gaps, 1, None)
        first, last = (numbers().content(c, g) for c, g in ((fraction, gaps[0]), (after, gaps[1])))
        kept = float(jnp.sum(last * heat.temperature) / jnp.sum(first * warm))
        assert kept == pytest.approx(1.0, abs=1e-14)
        assert float(warm.min()) - 1e-9 < float(heat.temperature.min())
        assert float(heat.temperature.max()) < float(warm.max()) + 1e-9
    _, wrong = step(grid, numbers(), fraction, warm, flux, None, 1, by_volume)
    assert float(wrong.temperature.max()) > float(warm.max()) + 10.0


def test_what_comes_in_has_the_temperature_of_its_side_and_is_counted():
    grid = Grid((8, 4), (0.8, 0.4), 1.0, (False, True))
    flux = (jnp.full((9, 4), 3.0), jnp.zeros((8, 5)))
    fraction = jnp.asarray(np.repeat([[1.0], [0.5], [0.0], [0.0]], 2, axis=0) * np.ones(4))
    warm = jnp.full((8, 4), 320.0)
    given = numbers(inflow=(jnp.asarray(350.0), None, None, None))
    after, heat = jax.jit(stepped, static_argnums=0)(grid, given, fraction, warm, flux)
    volume = grid.cell_volume
    change = volume * float(jnp.sum(given.content(after, 1.0) * heat.temperature - given.content(fraction, 1.0) * warm))
    section = 3.0 * STEP * 0.4
    expected = [section * WATER_AND_AIR[0] * 350.0, -section * WATER_AND_AIR[1] * 320.0, 0.0, 0.0]
    np.testing.assert_allclose(heat.through_sides, expected, rtol=1e-13)
    assert float(jnp.sum(heat.through_sides)) == pytest.approx(change, rel=1e-12)
    np.testing.assert_allclose(heat.temperature[0], 320.0 + 0.3 * 30.0, rtol=1e-12)


def test_slopes_go_through_the_transport():
    """By the capacity of the liquid, against central differences."""
    grid = Grid((10, 8), (1.0, 1.0), 1.0, (True, True))
    fraction = jnp.asarray(cells_within(ball((0.5, 0.5), 0.33), grid))
    warm, flux = jnp.asarray(np.random.default_rng(3).uniform(300.0, 400.0, (10, 8))), solenoidal(grid)

    def squares(capacity):
        given = HeatOfPhases((capacity, jnp.asarray(1.2e3)), None, jnp.asarray(0.0), (None,) * 4)
        return jnp.sum(stepped(grid, given, fraction, warm, flux)[1].temperature ** 2)

    at = jnp.asarray(5e3)
    slope, ends = jax.jit(jax.grad(squares))(at), [float(jax.jit(squares)(at + d)) for d in (10.0, -10.0)]
    assert float(slope) == pytest.approx((ends[0] - ends[1]) / 20.0, rel=1e-4)


def test_heat_carried_as_a_dye_is_not_kept():
    """The flux of the volume alone carries a temperature as it does a dye: the heat of both fluids then changes."""
    fluids = WarmFluids()
    fraction = fluids.drop
    rng = np.random.default_rng(4)
    start = fluids.stirred(fraction, rng.uniform(300.0, 400.0, fluids.box.grid.cells), 0.5)
    dye = WarmFluids(capacity=(1.0, 1.0))
    dye.box = fluids.box  # its program is compiled already
    found = fluids.march(start, 60, 1.0 / 128.0)
    assert fluids.heat(found) / fluids.heat(start) == pytest.approx(1.0, abs=1e-12)
    assert abs(fluids.heat(dye.march(start, 60, 1.0 / 128.0)) / fluids.heat(start) - 1.0) > 1e-4


def test_warm_fluids_are_lighter_each_by_its_own_expansion():
    """At rest and 10 K above the reference, the reduced pressure rises with height by rho beta dT g in the liquid, in
    the second fluid by that and (rho_1 - rho_2) g."""
    fluids = WarmFluids(("free_slip",) * 4, 8, gravity=9.81, expansion=(0.2, 4e-3))
    start = fluids.warm(fluids.box.state(fluids.box.below(0.5)), 310.0)
    found = fluids.march(start, 1, 1e-3)
    slope = np.diff(np.asarray(found.pressure)[0]) / fluids.box.grid.spacing[1]
    np.testing.assert_allclose(slope[:3], 0.2 * 10.0 * 9.81, rtol=1e-7)
    np.testing.assert_allclose(slope[4:], (999.0 + 4e-3 * 10.0) * 9.81, rtol=1e-9)
    assert max(float(jnp.abs(u).max()) for u in found.face_velocity) < 1e-10
    np.testing.assert_allclose(temperature(found), 310.0, rtol=1e-15)
