"""Liquid of bridges that form and rupture: the few of a step that are taken one by one, and all at once."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.particles import liquid
from jaxdem.particles.cohesion import CohesionConstants
from jaxdem.particles.pairs import pairs_of

GRAINS = 240


def ring():
    """Every grain of a ring has the three before and behind it in reach."""
    steps = np.array([-3, -2, -1, 1, 2, 3])
    index = (np.arange(GRAINS)[None] + steps[:, None]) % GRAINS
    pairs, too_many = pairs_of(jnp.asarray(index, jnp.int32), 3 * GRAINS + 1)
    assert not too_many
    return pairs


@pytest.fixture(scope="module")
def both():
    """Volumes and films after changes: one by one where they are few, and all at once."""
    pairs = ring()
    numbers = (jnp.asarray(x) for x in (0.07, 0.1, 0.05, 0.6))
    constants = CohesionConstants(
        **dict(zip(("strength", "contact_angle", "bridge_share", "largest_film"), numbers, strict=True))
    )

    def change(changed, volume, film, sparsely):
        return liquid.with_pairs(changed, volume, film, pairs, constants, sparsely)

    compiled = jax.jit(change, static_argnums=3)
    return pairs, lambda *given: (compiled(*given, True), compiled(*given, False))


@pytest.mark.parametrize("number", [0, 1, liquid.FEW - 1, liquid.FEW, liquid.FEW + 1, 200])
def test_few_changes_one_by_one_are_all_at_once(both, number):
    """Also where they are too many for that, where several are of one grain, and in the last block of pairs."""
    pairs, change = both
    random, size = np.random.default_rng(number), len(pairs.first)
    volume = np.where(random.uniform(size=size) < 0.5, random.uniform(0.01, 0.1, size), 0.0)
    volume[-1], film = 0.0, random.uniform(0.1, 1.0, GRAINS)
    changed = np.zeros(size, bool)
    changed[random.choice(size - 1, number, replace=False)] = True
    if number > 1:
        changed[[0, 1, 2, size - 2]] = True  # three of grain 0, and the last
    one_by_one, at_once = change(jnp.asarray(changed), jnp.asarray(volume), jnp.asarray(film))
    for found, expected in zip(one_by_one, at_once, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-14)
    volumes, films = map(np.asarray, one_by_one)
    assert volumes.sum() + films.sum() == pytest.approx(volume.sum() + film.sum(), rel=1e-14)
    np.testing.assert_array_equal((volumes > 0) != (volume > 0), changed)
    # By hand: a new bridge takes 5 % of either film, or of 0.6, and one that ruptures gives half to either.
    expected, gives = film.copy(), 0.05 * np.minimum(film, 0.6)
    for place in np.flatnonzero(changed):
        for who in (int(pairs.first[place]), int(pairs.second[place])):
            expected[who] += 0.5 * volume[place] - (gives[who] if volume[place] == 0.0 else 0.0)
    np.testing.assert_allclose(films, expected, rtol=1e-13)


def test_worlds_of_a_batch_get_what_they_get_alone(both):
    """One with few changes beside one with many."""
    pairs, _ = both
    constants = CohesionConstants(jnp.asarray(0.07), bridge_share=jnp.asarray(0.05), largest_film=jnp.asarray(0.6))
    changed = np.zeros((2, len(pairs.first)), bool)
    changed[0, [3, 4, 90]], changed[1, :100] = True, True
    film = np.random.default_rng(1).uniform(0.1, 1.0, (2, GRAINS))

    def one(changed, film):
        return liquid.with_pairs(changed, jnp.zeros(len(changed)), film, pairs, constants, True)

    found = jax.jit(jax.vmap(one))(jnp.asarray(changed), jnp.asarray(film))
    alone = [jax.jit(one)(jnp.asarray(c), jnp.asarray(f)) for c, f in zip(changed, film, strict=True)]
    for k in range(2):
        for a, b in zip(found, alone[k], strict=True):
            np.testing.assert_array_equal(a[k], b)
