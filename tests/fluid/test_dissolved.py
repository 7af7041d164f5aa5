"""What is dissolved in one of two fluids: kept in it by the flux of its surface, and by the faces that it wets."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.fluid.carried_heat import mixed_flux
from jaxdem.fluid.dissolved import (
    PART,
    CarriedScalar,
    Dissolved,
    carried_dissolved,
    least_volume,
    open_to_diffusion,
    volume_of,
)
from jaxdem.fluid.grid import Grid, divergence, face_average
from jaxdem.fluid.phase_transport import Held, Transport
from jaxdem.fluid.scalar_transport import ScalarField
from jaxdem.fluid.volume_of_fluid import Carrier, advance_fraction
from jaxdem.fluid.wetted_faces import wetted_faces
from jaxdem.particles.regions import ball
from jaxdem.setup.surface import cells_within
from tests.cases.scalars_in_two_fluids import PHASES, Diffusing
from tests.cases.tiers import COMBINATION
from tests.cases.two_fluids import ROUGH_STEP, TwoFluids, solenoidal

STEP, ORDER = jnp.asarray(ROUGH_STEP), jnp.asarray(1)


def box(cells):
    return Grid(cells, (1.0,) * len(cells), 1.0, (True,) * len(cells))


def stepped(grid, fraction, values, flux, gaps, inflow=None, order=ORDER):
    """Liquid fraction and a scalar in each of `PHASES` after a step, from a field of each."""
    sides = (None,) * (2 * grid.dimension) if inflow is None else inflow
    numbers = tuple(Dissolved(PART[phase], sides) for phase in PHASES)
    moved = advance_fraction(grid, fraction, Carrier(flux, *gaps), STEP, order)
    scalars = tuple(CarriedScalar(value, jnp.zeros(2 * grid.dimension)) for value in values)
    contents = (fraction, gaps[0]), (moved.fraction, gaps[1])
    return moved, carried_dissolved(grid, numbers, scalars, (flux, moved.liquid_flux), contents, STEP, order)


@pytest.mark.parametrize("cells", [(10, 8), pytest.param((6, 6, 6), marks=COMBINATION)])
def test_it_is_kept_within_bounds_among_grains_that_move(cells):
    """In a rough stream at the limit: content to rounding, no new extrema, a uniform one as it was to the last digit;
    also where cells run dry or are wetted."""
    grid, rng = box(cells), np.random.default_rng(2)
    fraction = jnp.asarray(cells_within(ball((0.5,) * len(cells), 0.33), grid))
    values, flux = (jnp.asarray(rng.uniform(1.0, 2.0, cells)),) * 3, solenoidal(grid)
    before, ones = jnp.asarray(rng.uniform(0.6, 1.0, cells)), (jnp.ones(cells),) * 2
    gentle = tuple(0.3 * f * g for f, g in zip(flux, face_average(grid, before), strict=True))
    moving = gentle, (before, before - ROUGH_STEP * divergence(grid, gentle))
    step = jax.jit(stepped, static_argnums=0)
    for steps, given, gaps in ((12, flux, ones), (1, *moving)):
        wet, found, even = fraction, values, (jnp.full(cells, 0.3),) * 3
        for k in range(steps):
            moved, even = step(grid, wet, even, given, gaps, None, jnp.asarray(k))
            _, found = step(grid, wet, found, given, gaps, None, jnp.asarray(k))
            wet, found, even = moved.fraction, *(tuple(s.value for s in both) for both in (found, even))
        for phase, first, last, uniform in zip(PHASES, values, found, even, strict=True):
            start, end = (volume_of(phase, c, g) for c, g in ((fraction, gaps[0]), (wet, gaps[1])))
            assert float(jnp.sum(end * last) / jnp.sum(start * first)) == pytest.approx(1.0, abs=1e-14)
            assert float(last.min()) > 1.0 - 1e-9 and float(last.max()) < 2.0 + 1e-9
            np.testing.assert_array_equal(uniform, 0.3)
        if steps > 1:
            assert float(jnp.max(wet[fraction == 0.0])) > 0.1, "cells are wetted"
            assert float(jnp.min(wet[fraction == 1.0])) < 0.9, "and run dry"


def test_the_flux_of_the_whole_face_does_not_keep_it_in_its_fluid():
    """With the flux of both fluids times the mean liquid fraction of two cells in place of the liquid's own, a uniform
    concentration does not stay so."""
    grid = box((10, 8))
    fraction, flux = jnp.asarray(cells_within(ball((0.5, 0.5), 0.33), grid)), solenoidal(grid)
    moved = advance_fraction(grid, fraction, Carrier(flux), STEP, ORDER)
    least = least_volume(fraction)

    def spread(carrier):
        held = Transport(grid, carrier, (None,) * 4, STEP, ORDER, least).carried(
            Held(0.3 * fraction, fraction, jnp.zeros(4))
        )
        wet = np.asarray(moved.fraction) > 0.1
        return float(np.abs(np.asarray(held.content / moved.fraction) - 0.3)[wet].max())

    own = mixed_flux(PART["liquid"], flux, moved.liquid_flux)
    whole = tuple(f * c for f, c in zip(flux, face_average(grid, fraction), strict=True))
    assert spread(own) < 1e-14
    assert spread(whole) > 0.01


def test_what_comes_in_has_the_value_of_its_side_and_is_counted():
    """Both fluids come in through one side and leave through the other, each with what is dissolved in it."""
    grid = Grid((8, 4), (0.8, 0.4), 1.0, (False, True))
    flux = jnp.full((9, 4), 3.0), jnp.zeros((8, 5))
    fraction = jnp.broadcast_to(jnp.asarray([1.0, 1.0, 0.25, 0.0]), (8, 4))
    values, ones = jnp.full((8, 4), 2.0), (jnp.ones((8, 4)),) * 2
    side = jnp.asarray(5.0), None, None, None
    moved, found = jax.jit(stepped, static_argnums=0)(grid, fraction, (values,) * 3, flux, ones, side)
    for phase, scalar in zip(PHASES, found, strict=True):
        first, last = (volume_of(phase, c, 1.0) for c in (fraction, moved.fraction))
        change = grid.cell_volume * float(jnp.sum(last * scalar.value - first * 2.0))
        section = 3.0 * ROUGH_STEP * 0.1 * {"liquid": 2.25, "second": 1.75, "both": 4.0}[phase]
        np.testing.assert_allclose(scalar.through_sides, [5.0 * section, -2.0 * section, 0.0, 0.0], rtol=1e-13)
        assert change == pytest.approx(3.0 * section, rel=1e-12)
        wet = np.asarray(first[0]) > 0.0
        np.testing.assert_allclose(np.asarray(scalar.value)[0, wet], 2.0 + 0.3 * 3.0, rtol=1e-12)


@pytest.mark.parametrize("second", [False, True])
def test_faces_are_wetted_as_far_as_the_planes_reach(second):
    """A level within a layer of cells, and one at 45 degrees, whose planes are exact."""
    grid = Grid((4, 4), (4.0, 4.0), 1.0, (False, False))
    level = jnp.broadcast_to(jnp.asarray([1.0, 0.3, 0.0, 0.0]), (4, 4))
    along_x, along_z = wetted_faces(grid, level, second)
    expected = np.broadcast_to([1.0, 0.3, 0.0, 0.0], (5, 4)), np.broadcast_to([1.0, 1.0, 0.0, 0.0, 0.0], (4, 5))
    if second:
        expected = 1.0 - expected[0], np.broadcast_to([0.0, 0.0, 1.0, 1.0, 1.0], (4, 5))
    np.testing.assert_allclose(along_x, expected[0], atol=1e-7)
    np.testing.assert_allclose(along_z, expected[1], atol=1e-7)
    i, j = np.mgrid[0:4, 0:4]
    oblique = jnp.asarray(np.select([i + j < 3, i + j == 3], [1.0, 0.5], 0.0))
    along_x, _ = wetted_faces(grid, oblique, second)
    k, z = np.mgrid[0:5, 0:4]
    np.testing.assert_allclose(along_x, (k + z > 3) if second else (k + z <= 3), atol=1e-6)


def test_no_face_of_an_empty_cell_is_open_and_no_cell_passes_more_than_it_holds():
    """At any surface: an explicit step of D t sum(1/h^2) = 0.2 makes no new extrema, however little a cell holds."""
    grid, rng = box((10, 8)), np.random.default_rng(3)
    fraction = jnp.asarray(rng.choice([0.0, 1e-12, 1e-6, 0.01, 0.4, 0.99, 1.0], (10, 8)))
    for phase in PHASES:
        faces, volume = open_to_diffusion(grid, phase, fraction, 1.0)
        empty = np.asarray(volume_of(phase, fraction, 1.0)) < 1e-8
        leaves = np.zeros((10, 8))
        for axis, w in enumerate(faces):
            assert float(w.min()) >= 0.0 and float(w.max()) <= 1.0
            near = np.asarray(w)
            leaves += near.take(range(grid.cells[axis]), axis) + near.take(range(1, grid.cells[axis] + 1), axis)
        assert np.all(leaves[empty] == 0.0)
        assert np.all(0.1 * leaves / np.asarray(volume) <= 0.8 + 1e-12)


def test_slopes_go_through_the_transport_and_the_surface():
    """Of the content of one half of the box by the value of the scalar and by the size of the drop, against central
    differences."""
    grid = box((10, 8))
    flux, values = solenoidal(grid), jnp.asarray(np.random.default_rng(3).uniform(1.0, 2.0, (10, 8)))
    drop = jnp.asarray(cells_within(ball((0.5, 0.5), 0.33), grid))

    def squares(factor, more):
        cells = jnp.where(drop > 0.9, drop, more * drop)
        moved, found = stepped(grid, cells, (factor * values,) * 3, flux, (jnp.ones((10, 8)),) * 2)
        content = volume_of("liquid", moved.fraction, 1.0) * found[0].value
        return jnp.sum(content[:5] ** 2)

    value, slope = jax.jit(squares), jax.jit(jax.grad(squares, (0, 1)))
    found, d = slope(1.0, 0.9), 1e-5
    expected = [value(1.0 + d, 0.9) - value(1.0 - d, 0.9), value(1.0, 0.9 + d) - value(1.0, 0.9 - d)]
    np.testing.assert_allclose(found, np.asarray(expected) / (2.0 * d), rtol=1e-6)
    assert abs(float(found[1])) > 0.1


def test_slopes_go_through_diffusion_in_one_fluid():
    """Of what comes out of a floor under water, by the concentration there and by the diffusivity."""
    box = TwoFluids((2, 8), (0.25, 1.0), ("periodic", "periodic", "no_slip", "free_slip"))
    still = Diffusing(box, np.asarray(box.below(0.55)), "liquid", ("closed", "closed", "value", "closed"))
    field = ScalarField("salt", still.kinds, True, 8, phase="liquid")
    start = CarriedScalar(jnp.zeros((2, 8)), jnp.zeros(4))

    def passed(given):
        own = still.phases.parameters.fields[0]._replace(value=jnp.zeros(4).at[2].set(given[0]), diffusivity=given[1])
        phases = still.phases._replace(parameters=still.phases.parameters._replace(fields=(own,)))
        return phases.diffused(field, 0, start, jnp.asarray(0.01), True)[1][2]

    value, at = jax.jit(passed), jnp.asarray([2.0, 1.0])
    expected = [(value(at + d) - value(at - d)) / 2e-5 for d in 1e-5 * jnp.eye(2)]
    np.testing.assert_allclose(jax.jit(jax.grad(passed))(at), expected, rtol=1e-7)
    assert min(map(float, expected)) > 1e-3
