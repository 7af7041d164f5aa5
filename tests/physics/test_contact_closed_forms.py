"""The references of the contact cases checked once more, and controls: what breaks them on purpose.

The cases themselves, MFIX DEM01-04, Hertz and restitution, are in `tests/cases/contact.py`.
"""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
import numpy as np

from jaxdem.particles import contact, verlet
from tests.cases.contact import (
    DROP_RADIUS,
    GRAVITY,
    drop_mass,
    dropped,
    drops,
    head_on,
    soft_sphere,
)
from tests.cases.registry import table
from tests.cases.worlds import track


def test_soft_sphere_form_is_that_of_the_table():
    """Two independent evaluations of the closed form agree: ours below and the table's."""
    for row in drops()[0]:
        ours = soft_sphere(float(row["kn"]), float(row["e"]), -row["v_impact"])
        expected = [row["contact_duration_s"], row["max_overlap_m"], row["v_rebound"]]
        np.testing.assert_allclose(ours, expected, rtol=2e-6)  # the table has eight digits


def test_start_of_step_damping_would_fail_dem01(monkeypatch):
    """Negative control: with the dashpots on the velocity at the start of the step the rebound is off by 1
    %."""
    original = verlet.contact_forces

    def at_start(step, neighbors):
        return original(dataclasses.replace(step, mid_velocity=step.motion.velocity), neighbors)

    monkeypatch.setattr(verlet, "contact_forces", at_start)
    scene, step = dropped(1e4, 0.5), np.pi * np.sqrt(drop_mass() / 1e4) / 100
    _, seen = track(scene, step, 480)
    expected = next(row["v_rebound"] for row in table("mfix_dem01_closed_form.csv") if row["e"] == 0.5)
    x, v = seen.position[:, 0, 1], seen.velocity[:, 0, 1]
    assert x[-1] > DROP_RADIUS and v[-1] > 0
    rebound = np.sqrt(v[-1] ** 2 + 2 * GRAVITY * (x[-1] - DROP_RADIUS))
    assert abs(rebound / expected - 1) > 3e-3


def test_wrong_damping_would_fail_restitution(monkeypatch):
    """Negative control: without the factor sqrt(5/6) of the Hertz dashpot the rebound misses the gate."""
    true = contact.damping_ratio
    monkeypatch.setattr(contact, "damping_ratio", lambda e: true(e) / jnp.sqrt(5.0 / 6.0))
    scene, step = head_on(0.01, 2500.0, 7e7, 0.3, 1.0, 0.5, 1 / 100)
    _, seen = track(scene, step, 200)
    assert abs(seen.velocity[-1, 1, 0] - seen.velocity[-1, 0, 0] - 0.5) > 0.02
