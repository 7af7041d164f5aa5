"""A scalar that the fluid carries: closed forms, order, what is kept, and what passes the sides."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.coupling.kernel import kernel_weights
from jaxdem.fluid.boundary import Boundary, Side
from jaxdem.fluid.grid import Grid, divergence
from jaxdem.fluid.scalar_transport import ScalarField, ScalarNumbers, ScalarTransport, Stream
from jaxdem.scalars.exchange import exchanged
from jaxdem.scalars.nusselt import Gunn, RanzMarshall


def boundary(kinds):
    return Boundary(tuple(Side(k // 2, bool(k % 2), kind) for k, kind in enumerate(kinds)))


def transport(grid, kinds, sides, flux, before=1.0, after=1.0, diffusivity=0.0, value=(0.0,) * 4, into=(0.0,) * 4):
    numbers = ScalarNumbers(jnp.asarray(diffusivity), jnp.asarray(value), jnp.asarray(into))
    field = ScalarField("dye", sides, diffusivity > 0.0)
    return ScalarTransport(grid, boundary(kinds), field, numbers, Stream(flux, before, after, (1.0, 1.0)))


def uniform(grid, speed):
    return tuple(jnp.full(grid.face_shape(axis), s) for axis, s in enumerate(speed))


CLOSED, WRAPS = ("closed",) * 4, ("periodic",) * 4


@pytest.mark.parametrize("diffusivity", [0.0, 2e-3])
def test_a_wave_is_carried_with_second_order(diffusivity):
    """c = sin(2 pi (x - U t)) exp(-4 pi^2 D t), by its mean error; a limiter flattens the two extrema."""
    errors = []
    for cells in (32, 64, 128):
        grid = Grid((cells, 1), (1.0, 1.0 / cells), 1.0, (True, True))
        x = (np.arange(cells) + 0.5) / cells
        carried = transport(grid, WRAPS, CLOSED, uniform(grid, (1.0, 0.0)), diffusivity=diffusivity)
        steps = 4 * cells
        value, _ = jax.jit(lambda v, c=carried, n=steps: c.advance(v, 0.5, jnp.asarray(n), False))(
            jnp.asarray(np.sin(2 * np.pi * x))[:, None]
        )
        # Means over cells: sin(h/2)/(h/2) of those in their middles, which cancels in the comparison.
        exact = np.sin(2 * np.pi * (x - 0.5)) * np.exp(-4 * np.pi**2 * diffusivity * 0.5)
        errors.append(np.mean(np.abs(np.asarray(value)[:, 0] - exact)))
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert orders[-1] > 1.8, (errors, orders)


def test_a_uniform_scalar_stays_and_the_sum_is_kept_while_grains_move():
    """Void fraction and flux obey continuity: g c of c = 1 changes as g does; of any c the sum is kept to rounding."""
    grid = Grid((8, 6), (0.8, 0.6), 1.0, (True, True))
    rng = np.random.default_rng(1)
    potential = rng.normal(size=(8, 6))
    flux = tuple(
        np.concatenate([f, np.take(f, [0], axis)], axis)
        for axis, f in enumerate([0.1 * rng.normal(size=(8, 6)), 0.1 * (potential - np.roll(potential, 1, 1))])
    )
    flux = tuple(map(jnp.asarray, flux))
    duration, before = 0.05, jnp.asarray(0.4 + 0.2 * rng.random((8, 6)))
    after = before - duration * divergence(grid, flux)
    carried = transport(grid, WRAPS, CLOSED, flux, before, after)
    value, _ = carried.advance(jnp.ones((8, 6)), duration, jnp.asarray(2), False)
    np.testing.assert_allclose(value, 1.0, rtol=1e-14)
    rough = jnp.asarray(rng.random((8, 6)))
    value, _ = carried.advance(rough, duration, jnp.asarray(2), False)
    assert float(jnp.sum(after * value)) == pytest.approx(float(jnp.sum(before * rough)), rel=1e-14)
    assert float(value.min()) > float(rough.min()) - 1e-12 and float(value.max()) < float(rough.max()) + 1e-12
    # Negative control: a flux that does not obey continuity does not keep it uniform.
    wrong = transport(grid, WRAPS, CLOSED, flux, before, before)
    assert float(jnp.max(jnp.abs(wrong.advance(jnp.ones((8, 6)), duration, jnp.asarray(2), False)[0] - 1.0))) > 1e-3


def test_between_two_plates_it_is_linear_and_the_flux_passes():
    """c = 1 at one wall; through the other a given flux leaves: c = 1 - q x / D, and so much passes both."""
    grid, diffusivity, out = Grid((10, 1), (1.0, 0.1), 1.0, (False, True)), 0.5, 0.3
    kinds = ("no_slip", "no_slip", "periodic", "periodic")
    carried = transport(
        grid, kinds, ("value", "flux", "closed", "closed"), uniform(grid, (0.0, 0.0)),
        diffusivity=diffusivity, value=(1.0, 0.0, 0.0, 0.0), into=(0.0, -out, 0.0, 0.0),
    )  # fmt: skip
    value, passed = carried.advance(jnp.ones((10, 1)), 20.0, jnp.asarray(20_000), False)
    x = (np.arange(10) + 0.5) / 10
    np.testing.assert_allclose(np.asarray(value)[:, 0], 1.0 - out * x / diffusivity, rtol=1e-9)
    gained = float(jnp.sum(value - 1.0)) * grid.cell_volume
    assert float(jnp.sum(passed)) == pytest.approx(gained, rel=1e-9)
    assert float(passed[1]) == pytest.approx(-out * 0.1 * 20.0)


def test_what_comes_in_has_the_value_of_the_inlet():
    """A front that moves with the stream; what is in the box is what has come in less what has left."""
    grid = Grid((20, 1), (1.0, 0.05), 1.0, (False, True))
    kinds = ("inlet", "outlet", "periodic", "periodic")
    carried = transport(
        grid, kinds, ("value", "closed", "closed", "closed"), uniform(grid, (0.4, 0.0)), value=(2.0, 0.0, 0.0, 0.0)
    )
    value, passed = carried.advance(jnp.zeros((20, 1)), 1.0, jnp.asarray(40), False)
    assert float(passed[0]) == pytest.approx(2.0 * 0.4 * 0.05)
    assert float(jnp.sum(value)) * grid.cell_volume == pytest.approx(float(jnp.sum(passed)), rel=1e-13)
    profile = np.asarray(value)[:, 0]
    assert np.all(np.diff(profile) <= 0.0) and profile.min() >= 0.0 and profile.max() <= 2.0
    assert np.sum((profile > 0.2) & (profile < 1.8)) <= 5  # the front is a few cells wide


def test_exchange_keeps_heat_and_does_not_overshoot():
    """Stiff: a grain with a thousand times the heat of the gas, and a time step of a thousand of the gas's times."""
    grid = Grid((6, 6), (0.6, 0.6), 1.0, (True, True))
    rng = np.random.default_rng(2)
    position = jnp.asarray(0.6 * rng.random((20, 2)))
    weights = kernel_weights(grid, (0.12, 0.12), position)
    fluid, grains = jnp.full((6, 6), 300.0), jnp.asarray(300.0 + 100.0 * rng.random(20))
    of_cells, of_grains = jnp.full((6, 6), 1e-3), jnp.asarray(1.0 + rng.random(20))
    conductance = jnp.asarray(rng.random(20))
    warm, cooled = exchanged(grid, weights, fluid, grains, conductance, (of_cells, of_grains), jnp.asarray(0.5))
    gained = float(jnp.sum(of_cells * (warm - fluid)))
    assert gained == pytest.approx(float(jnp.sum(of_grains * (grains - cooled))), rel=1e-12)
    assert gained > 0.0
    assert float(warm.min()) >= 300.0 and float(warm.max()) <= float(grains.max())
    assert float(cooled.min()) >= 300.0


def test_nusselt_numbers_by_hand():
    """Sphere of 3.6 mm in air of 6 m/s: Re 1384, Pr 0.7165, Nu 21.974; Gunn's number in a bed and of a sphere alone."""
    reynolds, prandtl = jnp.asarray(1.1854 * 6.0 * 0.0036 / 1.85e-5), jnp.asarray(1007.0 * 1.85e-5 / 0.026)
    assert float(reynolds) == pytest.approx(1384.0, rel=1e-3)
    assert float(RanzMarshall()(reynolds, prandtl, jnp.ones(()))) == pytest.approx(21.974, rel=1e-4)
    # Gunn at g = 0.4, Re = 100, Pr = 1: 3.8 (1 + 0.7 x 2.5119) + 0.562 x 25.119; at g = 1, Re = 0: 2.
    bed = Gunn()(jnp.asarray(100.0), jnp.asarray(1.0), jnp.asarray(0.4))
    assert float(bed) == pytest.approx(3.8 * 2.75832 + 0.562 * 25.1189, rel=1e-5)
    assert float(Gunn()(jnp.asarray(0.0), jnp.asarray(0.7), jnp.asarray(1.0))) == pytest.approx(2.0)
    slope = jax.grad(lambda re: RanzMarshall()(re, prandtl, 1.0))(jnp.asarray(0.0))
    assert np.isfinite(float(slope))
