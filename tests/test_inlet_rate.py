"""Inlets of particles whose rate or mass flow changes: when particles are due, against the integral in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

import jaxdem
from jaxdem.check.check import check_scene
from jaxdem.errors import InputError
from jaxdem.setup.inlet_flow import FlowOverTime
from jaxdem.setup.particles import particle_setup

END = 2.0
RADIUS, DENSITY = 0.01, 2500.0
MASS = 4.0 / 3.0 * math.pi * RADIUS**3 * DENSITY


def scene_of(**inlet):
    given = {"start": [0.1, 0.6], "stop": [0.9, 0.9], "velocity": [0.0, -1.0]} | inlet
    return jaxdem.load_scene(
        {
            "precision": "float64",
            "domain": {"size": [1.0, 1.0]},
            "particles": {"radius": RADIUS, "density": DENSITY, "inlet": [given]},
            "contact": {"young_modulus": 1e6, "speed": 1.0},
            "time": {"end": END, "output_interval": END},
        }
    )


def due(**inlet):
    """(M,) [s]."""
    return particle_setup(scene_of(**inlet)).arrivals[0].time


def test_a_ramp_from_zero():
    """q = q1 t / T has brought q1 t^2 / (2 T), so t_k = sqrt(2 k T / q1); at constant rate q1 after T."""
    rate, ramp = 200.0, 0.5
    times = due(rate=[0.0, rate], times=[0.0, ramp])
    by_then = rate * ramp / 2.0
    k = np.arange(1, len(times) + 1)
    exact = np.where(k <= by_then, np.sqrt(2.0 * k * ramp / rate), ramp + (k - by_then) / rate)
    assert len(times) == round(by_then + rate * (END - ramp))
    np.testing.assert_allclose(times, exact, rtol=1e-12)


def test_a_rate_that_falls_to_zero():
    """q = q0 (1 - t / T): t_k = T (1 - sqrt(1 - 2 k / (q0 T))), the last one at T where q0 T / 2 is whole; none
    later."""
    rate, fall = 100.0, 1.0
    times = due(rate=[rate, 0.0], times=[0.0, fall])
    k = np.arange(1, 51)
    assert len(times) == 50
    np.testing.assert_allclose(times, fall * (1.0 - np.sqrt(1.0 - 2.0 * k / (rate * fall))), rtol=1e-9)


def test_two_pulses_with_a_pause():
    """Ten in each; the tenth comes at the end of the first pulse and not after the pause."""
    times = due(
        rate=[100.0, 100.0, 0.0, 0.0, 100.0, 100.0, 0.0], times=[0.0, 0.1, 0.1 + 1e-9, 1.0, 1.0 + 1e-9, 1.1, 1.1 + 1e-9]
    )
    assert len(times) == 20
    np.testing.assert_allclose(
        times, np.concatenate([0.01 * np.arange(1, 11), 1.0 + 0.01 * np.arange(1, 11)]), atol=1e-8
    )


def test_begin_and_end_cut_the_table():
    """Of a ramp over the whole run the part from 0.5 to 1 s: t_k = sqrt(0.25 + 2 k T / q1), 75 of them for q1 =
    400/s."""
    times = due(rate=[0.0, 400.0], times=[0.0, END], begin=0.5, end=1.0)
    assert len(times) == 75
    np.testing.assert_allclose(times, np.sqrt(0.25 + 2.0 * np.arange(1, 76) * END / 400.0), rtol=1e-12)


def test_a_mass_flow_brings_the_mass_of_its_integral():
    """Two sizes: each is due when the ramp has brought the mass up to its own."""
    ramp = 40.0 * MASS
    species = [{"share": 0.5, "radius": RADIUS}, {"share": 0.5, "radius": 1.5 * RADIUS}]
    coming = particle_setup(scene_of(mass_flow=[0.0, ramp], times=[0.0, END], species=species)).arrivals[0]
    mass = np.cumsum(4.0 / 3.0 * math.pi * coming.bodies.radius**3 * DENSITY)
    assert len(np.unique(coming.bodies.radius)) == 2
    np.testing.assert_allclose(coming.time, np.sqrt(2.0 * mass * END / ramp), rtol=1e-12)
    brought = 0.5 * ramp * END
    assert brought - 1.5**3 * MASS < mass[-1] <= brought


def test_a_table_of_one_value_is_that_rate():
    """The same number of particles, and the times to rounding, as of a single number."""
    np.testing.assert_allclose(due(rate=[70.0, 70.0], times=[0.2, 0.9]), due(rate=70.0), rtol=1e-12)


def test_a_single_number_is_as_it_was():
    """t_k = t0 + k / q, bit for bit; the last one is due at the end."""
    np.testing.assert_array_equal(due(rate=70.0, begin=0.3), 0.3 + np.arange(1.0, 120.0) / 70.0)


def test_an_amount_that_is_not_reached_has_no_time():
    flow = FlowOverTime((0.0, 1.0), (0.0, 2.0), 0.0, 1.0)
    assert flow.total == 1.0
    np.testing.assert_array_equal(flow.times(np.asarray([0.25, 1.0, 1.1])), [0.5, 1.0, np.inf])


def test_an_amount_that_a_pulse_just_reaches_does_not_wait_for_the_next():
    """The pulse brings 29, of which rounding leaves 28.999999999999996; the pause is from 0.58 to 1 s."""
    flow = FlowOverTime((0.0, 0.58, 1.0, 2.0), (100.0, 0.0, 0.0, 100.0), 0.0, 2.0)
    assert 100.0 * 0.58 / 2.0 < 29.0
    np.testing.assert_allclose(flow.times(np.asarray([29.0])), [0.58], rtol=1e-12)


def test_check_tells_the_range_of_the_rate():
    rows = dict(check_scene(scene_of(rate=[0.0, 20.0], times=[0.0, 1.0])).population)
    assert rows["inlet 0"].startswith("30 particles at 0 to 20 1/s, due from 0.3")


@pytest.mark.parametrize(
    ("keys", "key", "words"),
    [
        ({"rate": [1.0, 2.0]}, "rate", "needs times as well"),
        ({"rate": 1.0, "times": [0.0, 1.0]}, "times", "needs rate as well"),
        ({"mass_flow": [1.0, 2.0, 3.0], "times": [0.0, 1.0]}, "mass_flow", "needs 2 entries"),
        ({"rate": [1.0, 2.0], "times": [1.0, 0.5]}, "times", "must increase"),
        ({"rate": [1.0, 2.0], "times": [1.0, 1.0]}, "times", "must increase"),
        ({"rate": [0.0, 0.0], "times": [0.0, 1.0]}, "rate", "zero at all times"),
        ({"rate": [1.0, -2.0], "times": [0.0, 1.0]}, "rate.1", "greater than or equal to 0"),
        ({"rate": 0.0}, "rate", "greater than 0"),
        ({"rate": "fast"}, "rate", "number"),
        ({"rate": [0.0, 1.0], "times": [1.5, 2.0]}, "rate", "brings no particle"),
        ({"rate": [0.0, 1e12], "times": [0.0, 2.0]}, "rate", "up to 1e+12"),
    ],
)  # fmt: skip
def test_mistakes_are_named(keys, key, words):
    with pytest.raises(InputError) as caught:
        due(**keys)
    assert caught.value.key == f"particles.inlet.0.{key}" and words in str(caught.value) and caught.value.remedy
