"""Branches of contacts."""

from __future__ import annotations

import jax.numpy as jnp
import pytest

from jaxdem.observables.contacts import Contacts
from jaxdem.observables.lines import contact_lines
from jaxdem.particles.forces import Touching


@pytest.mark.parametrize(("pull", "acts"), [(2.0, True), (0.0, False)])
def test_a_pull_over_a_gap_has_a_branch_where_nothing_touches(pull, acts):
    """A bridge of liquid across a gap: its stress was left out as long as no two grains of the list touched."""
    none = jnp.zeros(1)
    bridge = Touching(jnp.asarray([-1e-3]), (jnp.ones(1), none), (jnp.asarray([-pull]), none), none, None)
    found = Contacts(jnp.asarray([0]), jnp.asarray([1]), bridge, None)
    (line,) = contact_lines(None, found, (0,), jnp.asarray([[0.021, 0.0], [0.0, 0.0]]), jnp.asarray(0.01))
    assert bool(line.touches) == acts
    assert float(line.moment[0, 0]) == pytest.approx(-pull * 0.021)
