"""Particles and fluid in a periodic box: what one gains the other loses, and closed forms of even suspensions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.coupling.kernel import kernel_weights
from jaxdem.failures import Failure
from jaxdem.fluid import momentum
from tests.cases.suspensions import CELLS, DEPTH, RADIUS, SIDE, STOKES_TIME, Suspension
from tests.cases.tiers import COMBINATION


@pytest.fixture(scope="module")
def suspension():
    return Suspension()


@pytest.fixture(scope="module")
def suspension_b():
    return Suspension("B")


@pytest.mark.parametrize("relaxation", [1e3, 1.0, 1e-3, 1e-6])
def test_total_momentum_is_conserved_in_model_b(suspension_b, relaxation):
    """All of pressure and stress in the fluid: in a periodic box they sum to nothing, drag goes both ways."""
    drag = STOKES_TIME / 2650.0 * 1001.0 / (relaxation * 0.01)
    parameters = suspension_b.given(1001.0, drag, law="koch_hill", lift=0.4)
    error, exchanged, code, worst = suspension_b.drift(parameters, suspension_b.stirred(0.2, seed=1))
    assert code == 0
    assert error < 1e-10 and worst[1] < 1e-10
    if relaxation <= 1.0:
        assert exchanged > 1e-3


@COMBINATION
def test_total_momentum_is_conserved_with_central_advection():
    """Its third stage, half-way through the step, takes the same from one control volume as it gives to the next."""
    central = Suspension(advection="central")
    error, exchanged, code, worst = central.drift(central.given(), central.stirred(1.0, particle_speed=0.2), 50)
    assert code == 0 and exchanged > 1e-3
    assert error < 1e-10 and worst[1] < 1e-10


def test_hydrostatic_rest_in_model_b(suspension_b):
    """Neutral particles, uneven void fraction, gravity: the reduced pressure is even and nothing moves."""
    parameters = suspension_b.given(density=1000.0, gravity=9.81)
    end, code, _, _ = suspension_b.run(parameters, suspension_b.stirred(0.0, seed=3), 50)
    assert int(code) == 0
    assert float(jnp.abs(end.particles.velocity).max()) < 1e-14
    assert max(float(jnp.abs(u).max()) for u in end.fluid.face_velocity) < 1e-14


def test_even_suspension_relaxes_as_two_bodies_in_model_b(suspension_b):
    """As in model A with a drag of c / g: slip falls by 1 + t c/g (1/m + 1/M) in each step."""
    parameters, state = suspension_b.given(drag=10.0), suspension_b.state(velocity=(0.13, -0.05))
    mass, volume = float(parameters.bodies.mass), float(parameters.bodies.volume)
    cell = SIDE**2 * DEPTH / len(suspension_b.lattice)
    fluid_mass = 1000.0 * (cell - volume)
    grip = 0.01 * 10.0 * 6 * np.pi * 1000.0 * 1e-5 * RADIUS / (1.0 - volume / cell)
    end, code, _, _ = suspension_b.run(parameters, state, 50)
    assert int(code) == 0
    slip = np.array([-0.13, 0.05]) / (1.0 + grip * (1.0 / mass + 1.0 / fluid_mass)) ** 50
    together = mass * np.array([0.13, -0.05]) / (mass + fluid_mass)
    for axis in range(2):
        u = together[axis] + slip[axis] * mass / (mass + fluid_mass)
        np.testing.assert_allclose(end.fluid.face_velocity[axis], u, atol=1e-10)


def test_total_momentum_is_conserved_with_a_remainder(suspension):
    parameters = suspension.given(law="koch_hill", lift=0.4)
    error, exchanged, code, _ = suspension.drift(parameters, suspension.stirred(0.2))
    assert code == 0 and error < 1e-10 and exchanged > 1e-3


@COMBINATION
def test_total_momentum_is_conserved_with_a_subgrid_viscosity(suspension):
    """The stress that the fluid loses to the solids is the one they get, the subgrid part too: most of it here."""
    parameters, state = suspension.given(smagorinsky=0.5), suspension.stirred(0.2)
    error, exchanged, code, _ = suspension.drift(parameters, state)
    assert code == 0 and error < 1e-10 and exchanged > 1e-3
    viscous = [np.abs(suspension.run(p, state, 1)[2].viscous).max() for p in (suspension.given(), parameters)]
    assert viscous[1] > 5.0 * viscous[0]


@pytest.mark.parametrize(("speed", "substeps"), [(0.2, 1), (3.5, 2), (7.0, 4), (14.0, 8), (40.0, 8)])
def test_substeps_follow_the_courant_number_and_conserve_momentum(suspension, speed, substeps):
    """1, 2, 4 or 8 fluid steps in an interval, and a flag beyond; |u| t/h summed is 0.04 ... 8, its limit 0.7."""
    state = suspension.stirred(speed, particle_speed=0.2)
    error, _, code, worst = suspension.drift(suspension.given(), state, 50)
    assert worst[0] == substeps
    assert error < 1e-10 and not code & Failure.OVERFLOW
    assert bool(code & Failure.COURANT) == (speed > 20.0)


def test_momentum_without_the_pressure_gradient_on_particles_is_not_conserved(suspension, monkeypatch):
    """Negative control: the same scene fails the gate when the particles do not feel the pressure."""
    right = momentum.pressure_slope

    def dropped(grid, boundary, fluid, continued=False):
        slope = right(grid, boundary, fluid, continued=continued)
        return tuple(0.0 * s for s in slope) if continued else slope

    monkeypatch.setattr(momentum, "pressure_slope", dropped)
    error, *_ = suspension.drift(suspension.given(), suspension.stirred(0.2), 5, suspension.compiled())
    assert error > 1e-6


def test_neutral_particles_rest_in_water_under_gravity(suspension):
    """Hydrostatic rest: weight less buoyancy is nothing, pressure is reduced, so that nothing moves at all."""
    parameters = suspension.given(density=1000.0, gravity=9.81)
    state = suspension.stirred(0.0, seed=3)
    end, code, _, _ = suspension.run(parameters, state, 50)
    assert int(code) == 0
    # (m g - rho V g) is zero up to rounding of two products: 1e-16 g over 0.5 s.
    assert float(jnp.abs(end.particles.velocity).max()) < 1e-14
    assert max(float(jnp.abs(u).max()) for u in end.fluid.face_velocity) < 1e-14


def test_viscous_force_in_a_shear_wave(suspension):
    """w = W sin(k x): V_p mu w'' on every particle, in the discrete form -(2 - 2 cos kh)/h^2 of the wave seen."""
    h, k, position = SIDE / CELLS, 2 * np.pi / SIDE, suspension.stirred(0.0).particles.position
    wave = np.sin(k * (np.arange(CELLS) + 0.5) * h)
    viscosity = 1e-4
    parameters = suspension.given(viscosity=viscosity, drag=0.0)
    state = suspension.state(position, fluid=(0.0, 0.01 * np.tile(wave[:, None], (1, CELLS + 1))))
    _, code, forces, _ = suspension.run(parameters, state, 1)
    weights = kernel_weights(suspension.grid, suspension.simulation.coupling.deposition.half_width, position)
    cell = np.repeat(wave, CELLS)[np.asarray(weights.index)]
    seen = 0.01 * np.sum(np.asarray(weights.weight) * cell, axis=1)
    volume = float(parameters.bodies.volume)
    expected = -volume * 1000.0 * viscosity * (2 - 2 * np.cos(k * h)) / h**2 * seen
    assert int(code) == 0 and np.abs(expected).max() > 1e-7
    # The force is the mean over the step, in which the wave decays by nu k^2 t = 0.07 %; an uneven void fraction
    # lets pressure bend the flow by as much.
    np.testing.assert_allclose(forces.viscous[:, 1], expected, atol=2e-3 * np.abs(expected).max())


def test_viscous_force_of_the_subgrid_viscosity_in_a_shear_wave(suspension):
    """w = W sin(k x): V_p rho d/dx[(nu + nu_t) w'] on every particle, nu_t = (C_s h)^2 |w'|, by finite differences."""
    h, k, position = SIDE / CELLS, 2 * np.pi / SIDE, suspension.stirred(0.0).particles.position
    wave = 0.01 * np.sin(k * (np.arange(CELLS) + 0.5) * h)
    parameters = suspension.given(viscosity=1e-5, drag=0.0, smagorinsky=0.8)
    state = suspension.state(position, fluid=(0.0, np.tile(wave[:, None], (1, CELLS + 1))))
    _, code, forces, _ = suspension.run(parameters, state, 1)
    slope = (wave - np.roll(wave, 1)) / h  # on the side below each cell
    eddy = (0.8 * h) ** 2 * np.sqrt(0.5 * (slope**2 + np.roll(slope, -1) ** 2))
    stress = (1e-5 + 0.5 * (eddy + np.roll(eddy, 1))) * slope
    force = np.repeat((np.roll(stress, -1) - stress) / h, CELLS)
    weights = kernel_weights(suspension.grid, suspension.simulation.coupling.deposition.half_width, position)
    seen = np.sum(np.asarray(weights.weight) * force[np.asarray(weights.index)], axis=1)
    expected = float(parameters.bodies.volume) * 1000.0 * seen
    assert int(code) == 0 and eddy.max() > 10 * 1e-5
    # Over the step the wave decays by nu_t k^2 t = 0.7 % at most, and an uneven void fraction bends the flow.
    np.testing.assert_allclose(forces.viscous[:, 1], expected, atol=2e-2 * np.abs(expected).max())


def test_viscosity_number_in_model_b_is_over_the_void_fraction(suspension_b):
    """The whole stress acts on the part g of the volume: nu t sum(1/h^2) / min g."""
    state = suspension_b.stirred(0.0)
    report = jax.jit(suspension_b.simulation.step)(suspension_b.given(viscosity=1e-2), state, suspension_b.neighbors)[
        2
    ].fluid
    lowest = float(state.fluid.void_fraction.min())
    expected = 1e-2 * 0.01 * 2.0 / (SIDE / CELLS) ** 2 / lowest
    assert lowest < 0.95
    assert float(report.viscous * report.substeps) == pytest.approx(expected, rel=1e-12)
