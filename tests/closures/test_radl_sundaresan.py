"""Radl and Sundaresan's filtered drag: its limits, values by hand, and what it does to a law."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.closures import Beetstra, DragInputs, RadlSundaresan, WenYu

SPEED, DIAMETER = 0.22, 75e-6


@pytest.fixture(scope="module")
def law() -> RadlSundaresan:
    return RadlSundaresan.of_grain(SPEED, DIAMETER)


def factor(law: RadlSundaresan, solid_fraction: object, filter_size: float) -> np.ndarray:
    return np.asarray(law.factor(jnp.asarray(solid_fraction, jnp.float32), jnp.float32(filter_size)))


def test_length_is_that_of_the_paper(law):
    froude = SPEED**2 / (9.81 * DIAMETER)
    assert float(law.length) == pytest.approx(SPEED**2 / 9.81 * froude ** (-2 / 3), rel=1e-6)


def test_no_correction_for_a_small_filter_a_single_grain_and_a_packed_bed(law):
    assert factor(law, np.linspace(0.0, 0.64, 50), 0.0) == pytest.approx(1.0)
    assert factor(law, [0.0, 0.6, 0.64, 0.8], 1.0) == pytest.approx(1.0, abs=1e-5)


def test_values_by_hand(law):
    """At the starts of pieces the polynomials are their first coefficients; a(0.1) = 4.63, h(0.12) = 0.739."""
    length = float(law.length)
    expected = 1.0 - 0.887 / (1.0 + 3.52)  # s = 0.18, filter equal to the length
    assert factor(law, 0.18, length) == pytest.approx(expected, rel=1e-5)
    # between the starts: h = 0.492 + 6.1 x + 33.63 x^2 - 789.6 x^3 with x = 0.02, filter three times the length
    hidden = 0.492 + 0.122 + 0.013452 - 0.0063168
    assert factor(law, 0.1, 3.0 * length) == pytest.approx(1.0 - hidden / (1.0 + 4.63 / 3.0), rel=1e-5)


def test_a_very_large_filter_leaves_what_the_paper_calls_h(law):
    assert factor(law, 0.34, 1e4) == pytest.approx(1.0 - 0.943, abs=1e-4)


def test_the_correction_is_between_zero_and_one_and_falls_with_the_filter(law):
    fractions = np.linspace(0.0, 0.7, 141)
    factors = np.stack([factor(law, fractions, size) for size in (1e-4, 1e-3, 1e-2)])
    assert factors.min() > 0.0 and factors.max() <= 1.0
    assert (np.diff(factors, axis=0) <= 0.0).all()


def test_the_drag_is_the_base_law_times_the_factor(law):
    rows = 4
    inputs = DragInputs(
        particle_velocity=jnp.zeros((rows, 2)),
        fluid_velocity=jnp.full((rows, 2), 0.1),
        solid_fraction=jnp.asarray([0.0, 0.05, 0.2, 0.4], jnp.float32),
        void_fraction_gradient=jnp.zeros((rows, 2)),
        pressure_gradient=jnp.zeros((rows, 2)),
        diameter=jnp.asarray(DIAMETER),
        filter_size=jnp.asarray(12.0 * DIAMETER),
        fluid_density=jnp.asarray(1.3),
        dynamic_viscosity=jnp.asarray(1.8e-5),
    )
    factors = factor(law, inputs.solid_fraction, 12.0 * DIAMETER)
    for one in (law, dataclasses.replace(law, base=Beetstra())):
        ratio = np.asarray(jax.jit(lambda x, one=one: one(x).coefficient / one.base(x).coefficient)(inputs))
        assert ratio == pytest.approx(factors, rel=1e-5)
    assert law.base == WenYu() and factors[0] == 1.0 and (factors[1:] < 0.9).all()
