"""Two fluids: rest and uniform streams to rounding, layers that shear, sides, what a wrong flux of mass does."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.fluid import carried_momentum, two_fluids
from jaxdem.fluid.grid import face_average
from jaxdem.fluid.second_fluid import mixture_density
from tests.cases.tiers import COMBINATION
from tests.cases.two_fluids import LIQUID, TwoFluids, largest

CLOSED = ("free_slip",) * 4
PERIODIC = ("periodic",) * 4


def drop(box, center, radius):
    """Liquid in a disc: cells half of which lie in it by their distance."""
    away = np.hypot(box.middles(0) - center[0], box.middles(1) - center[1])
    return np.clip((radius - away) / box.grid.spacing[0] + 0.5, 0.0, 1.0)


@pytest.fixture(scope="module")
def closed():
    return TwoFluids((8, 12), (0.8, 1.2), CLOSED)


@pytest.fixture(scope="module")
def periodic():
    return TwoFluids((12, 12), (1.0, 1.0), PERIODIC)


@pytest.mark.parametrize("ratio", [1.0, 30.0, 1000.0])
def test_layers_stay_at_rest(closed, ratio):
    """Also where the surface lies within cells: forces of 1e4 Pa/m balance, what is left is rounding."""
    start = closed.state(closed.below(0.53))
    properties = closed.properties(ratio)
    start = start._replace(pressure=closed.solver.resting_pressure(properties, start))
    found = closed.march(properties, start, 20, 0.005)
    assert bool(found.converged)
    assert largest(found.state.face_velocity) < 1e-12
    assert float(jnp.abs(found.state.liquid_fraction - start.liquid_fraction).max()) < 1e-13
    # The pressure itself rises downwards by the weight of what is above.
    middles = closed.middles(1)[0]
    pressure = np.asarray(found.state.pressure)[3] - LIQUID * 9.81 * middles
    above = pressure[10] - pressure[8]
    assert above == pytest.approx(-LIQUID / ratio * 9.81 * (middles[10] - middles[8]), rel=1e-6 * ratio)
    assert pressure[3] - pressure[1] == pytest.approx(-LIQUID * 9.81 * 0.2, rel=1e-9)


def test_a_drop_in_a_uniform_stream_does_not_feel_it(periodic):
    """Oblique, over the corner of a periodic box, heavier by a thousand: the stream stays uniform to rounding."""
    start = periodic.state(drop(periodic, (0.5, 0.5), 0.27), 1.0, 0.7)
    properties = periodic.properties(1000.0, gravity=(0.0, 0.0))
    steps, step = 72, 1.0 / 60.0
    found = periodic.march(properties, start, steps, step)
    assert bool(found.converged)
    for velocity, given in zip(found.state.face_velocity, (1.0, 0.7), strict=True):
        assert float(jnp.abs(velocity - given).max()) < 1e-11
    fraction = found.state.liquid_fraction
    assert float(jnp.sum(fraction)) == pytest.approx(float(jnp.sum(start.liquid_fraction)), rel=1e-13)
    assert float(fraction.min()) > -1e-12 and float(fraction.max()) < 1.0 + 1e-12
    # It has passed the corner: its centre of mass, on the circle that a periodic axis is.
    for axis, speed in enumerate((1.0, 0.7)):
        turn = np.exp(2j * np.pi * periodic.middles(axis))
        angle = np.angle(np.sum(np.asarray(fraction) * turn) / np.sum(np.asarray(start.liquid_fraction) * turn))
        moved = speed * steps * step
        assert (angle / (2.0 * np.pi) - moved + 0.5) % 1.0 - 0.5 == pytest.approx(0.0, abs=0.02)


def test_momentum_by_another_flux_than_that_of_mass_moves_a_uniform_stream(monkeypatch):
    """The flux of the volume times the density of the faces, in place of what has changed the densities."""
    periodic = TwoFluids((12, 12), (1.0, 1.0), PERIODIC)
    carried, properties = two_fluids.carried_momentum, periodic.properties(1000.0, gravity=(0.0, 0.0))
    start = periodic.state(drop(periodic, (0.5, 0.5), 0.27), 1.0, 0.7)
    density = face_average(periodic.grid, mixture_density(properties.second, properties.density, start.liquid_fraction))

    def by_volume(grid, sides, scheme, mass_flux, velocity, *rest):
        flux = tuple(rho * u for rho, u in zip(density, velocity, strict=True))
        return carried(grid, sides, scheme, flux, velocity, *rest)

    monkeypatch.setattr(two_fluids, "carried_momentum", by_volume)
    found = periodic.march(properties, start, 1, 1.0 / 60.0)
    assert largest(u - given for u, given in zip(found.state.face_velocity, (1.0, 0.7), strict=True)) > 0.1


def test_layers_that_shear_each_other_are_exact():
    """Couette flow of two viscosities: the stress is one, so the velocity has a kink at the surface."""
    box = TwoFluids((2, 10), (0.2, 1.0), ("periodic", "periodic", "no_slip", "moving_wall"))
    heights, mu = box.middles(1)[0], (LIQUID * 1e-2, LIQUID / 10.0 * 4e-2)
    stress = 1.0 / (0.4 / mu[0] + 0.6 / mu[1])
    exact = np.where(heights < 0.4, stress * heights / mu[0], 1.0 - stress * (1.0 - heights) / mu[1])
    start = box.state(box.below(0.4), np.broadcast_to(exact, (3, 10)), 0.0)
    properties = box.properties(10.0, (1e-2, 4e-2), (0.0, 0.0), velocity={3: (1.0, 0.0)})
    found = box.march(properties, start, 10, 0.02)
    assert float(jnp.abs(found.state.face_velocity[0] - exact[None]).max()) < 1e-12


def test_an_outlet_holds_its_level():
    """Liquid and gas beside an outlet that holds their level stay at rest; a lower level lets liquid out, a
    higher one lets it in, a thousand times as heavy as the gas that it meets."""
    box = TwoFluids((8, 8), (1.0, 1.0), ("free_slip", "outlet", "free_slip", "free_slip"))
    start = box.state(box.below(0.5))
    properties = box.properties(levels={1: 0.5})
    start = start._replace(pressure=box.solver.resting_pressure(properties, start))
    found = box.march(properties, start, 10, 0.005)
    assert bool(found.converged)
    assert largest(found.state.face_velocity) < 1e-11
    flowing = box.march(box.properties(levels={1: 0.25}), start, 10, 0.005).state
    balance = np.asarray(flowing.liquid_supplied)
    rising = box.march(box.properties(levels={1: 0.75}), start, 10, 0.005)
    assert bool(rising.converged) and float(rising.state.liquid_supplied[2]) > 1e-3
    assert balance[2] < -1e-3 and np.abs(np.delete(balance, [0, 2])).max() == 0.0
    volume = float(jnp.sum(flowing.liquid_fraction)) * box.grid.cell_volume
    assert volume == pytest.approx(balance.sum(), rel=1e-13)


def test_liquid_between_two_outlets_falls_and_gas_follows():
    """A layer over an open floor and under an open lid, with the second fluid at rest beyond both, falls with its
    weight less that of the gas over the mass of both; liquid leaves below, and gas alone comes in above."""
    box = TwoFluids((4, 8), (0.5, 1.0), ("periodic", "periodic", "outlet", "outlet"))
    start, properties, steps, step = box.state(box.below(0.5)), box.properties(10.0), 20, 1e-3
    found = box.march(properties, start, steps, step)
    assert bool(found.converged)
    height, speed, left = 0.5, 0.0, 0.0
    for _ in range(steps):
        height, left = height + step * speed, left - step * speed
        mass = 1000.0 * height + 100.0 * (1.0 - height)
        speed -= step * 9.81 * 900.0 * height / mass
    np.testing.assert_allclose(found.state.face_velocity[1], speed, rtol=2e-3)
    np.testing.assert_allclose(found.state.liquid_supplied[1:], [0.0, 0.0, -0.5 * left, 0.0], rtol=2e-3, atol=1e-14)


def test_liquid_comes_in_below_the_level_of_an_inlet():
    box = TwoFluids((6, 8), (0.6, 0.8), ("inlet", "outlet", "free_slip", "free_slip"))
    start = box.state(box.below(0.35), 0.2, 0.0)
    properties = box.properties(levels={0: 0.35, 1: 0.35}, velocity={0: (0.2, 0.0)}, gravity=(0.0, 0.0))
    found = box.march(properties, start, 20, 0.05).state
    assert float(jnp.abs(found.liquid_fraction - start.liquid_fraction).max()) < 1e-12
    assert np.asarray(found.liquid_supplied)[1:3] == pytest.approx([0.2 * 0.35, -0.2 * 0.35], rel=1e-10)


@COMBINATION
def test_a_drop_in_an_oblique_stream_in_three_dimensions():
    box = TwoFluids((6, 5, 7), (0.6, 0.5, 0.7), ("periodic",) * 6, tension=False)
    middles = [box.middles(axis) - 0.3 for axis in range(3)]
    away = np.sqrt(middles[0] ** 2 + (middles[1] + 0.05) ** 2 + (middles[2] - 0.05) ** 2)
    speeds = (0.5, -0.3, 0.7)
    start = box.state(np.clip((0.17 - away) / 0.1 + 0.5, 0.0, 1.0), *speeds)
    found = box.march(box.properties(1000.0, gravity=(0.0, 0.0, 0.0)), start, 12, 0.02)
    assert bool(found.converged)
    assert largest(u - v for u, v in zip(found.state.face_velocity, speeds, strict=True)) < 1e-11
    assert float(jnp.sum(found.state.liquid_fraction)) == pytest.approx(
        float(jnp.sum(start.liquid_fraction)), rel=1e-13
    )
    assert float(jnp.abs(found.state.liquid_fraction - start.liquid_fraction).max()) > 0.3  # it has moved


@pytest.mark.parametrize("bounded", [True, False])
def test_gas_that_a_heavy_drop_leaves_behind_is_not_shot_away(monkeypatch, bounded):
    """A stirred oblique stream: the gas keeps velocities of the size that was stirred up. With slopes that know the
    part of the volume alone, what stays in a control volume that the liquid has left gets their errors a thousandfold.
    """
    if not bounded:

        def plain(passing, velocity, *rest):
            return carried_momentum._Leaving(jnp.ones_like(velocity), jnp.zeros_like(velocity))

        monkeypatch.setattr(carried_momentum, "_leaving", plain)
    box = TwoFluids((12, 12), (1.0, 1.0), PERIODIC)
    rng, faces = np.random.default_rng(0), []
    for axis in range(2):
        noise = np.moveaxis(rng.normal(0.0, 0.05, box.grid.face_shape(axis)), axis, 0)
        noise[-1] = noise[0]
        faces.append(1.0 + np.moveaxis(noise, 0, axis))
    start = box.state(drop(box, (0.5, 0.5), 0.27), *faces)
    found = box.march(box.properties(1000.0, gravity=(0.0, 0.0)), start, 40, 0.018)
    stirred = largest(u - 1.0 for u in found.state.face_velocity)
    assert stirred < 0.1 if bounded else stirred > 2.0
