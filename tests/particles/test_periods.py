"""Particles that have gone round a periodic box many times touch as near ones do, in float32 too."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.particles.integrate import Motion, centres_in_box
from tests.cases.worlds import world

RADIUS, OVERLAP, LENGTHS, PERIODS = 0.01, 1e-5, (0.3, 2.3), (0, 1, -1, 333, 1001, 4097)


def apart(length, number):
    """Two grains that overlap by OVERLAP, the second `number` periods away."""
    start = [[0.123, 0.1], [0.123 + 2 * RADIUS - OVERLAP + number * length, 0.1]]
    return world(start, radius=RADIUS, box=(length, 0.3), periodic=(True, False), walls=False, dtype=jnp.float32)


@pytest.mark.parametrize("length", LENGTHS)
def test_overlap_across_many_periods(length):
    """The one pair is listed, with its overlap to 1e-9 m, a hundredth of a thousandth of a period's rounding."""
    scenes = [apart(length, number) for number in PERIODS]
    search = scenes[0].interval.search
    list_of = jax.jit(lambda motion: search.update(motion.position, motion.low, scenes[0].neighbors))
    for scene in scenes:
        listed = list_of(Motion.of(scene.state))
        np.testing.assert_allclose(float(listed.overlap[0]), OVERLAP, atol=1e-9)


def test_centres_in_the_box():
    """What is deposited and written: the place in the box to a float's rounding; those inside keep their bits."""
    length = LENGTHS[1]
    states = [apart(length, number).state for number in PERIODS]
    inside = jax.jit(lambda state: centres_in_box(state, (length, 0.3), (True, False)))
    for state in states:
        place = np.asarray(inside(state))
        np.testing.assert_allclose(place[:, 0], [0.123, 0.123 + 2 * RADIUS - OVERLAP], atol=2e-7)
        np.testing.assert_array_equal(place[0], state.position[0])
