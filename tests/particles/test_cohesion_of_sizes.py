"""Cohesion of spheres of different sizes against closed forms, and how far their list reaches."""

from __future__ import annotations

import copy
import math

import jax
import numpy as np
import pytest

import jaxdem
from jaxdem.particles.adhesion import JohnsonKendallRoberts
from jaxdem.particles.capillary_bridge import CapillaryBridge
from tests.cases.worlds import World, batch, constants, forces, track, world
from tests.particles.test_cohesion import JKR, KINDS, tables_of

SMALL, RATIO, WORK, MODULUS = 1e-3, 3.0, 0.1, 1e7
LARGE = RATIO * SMALL
TOGETHER = SMALL * LARGE / (SMALL + LARGE)
"""R*, 0.75 of the small radius."""

EFFECTIVE = MODULUS / (2.0 * (1.0 - 0.3**2))


def small_and_large(kind, gap, held, numbers, liquid=None):
    """A small and a large sphere with a gap between them; `held` is what the contact remembers."""
    made = world(
        [[0.0, 0.0, 0.0], [SMALL + LARGE + gap, 0.0, 0.0]], radius=np.array([SMALL, LARGE]), walls=False,
        rebuild=False, cohesion=kind, material=constants(young_modulus=MODULUS, cohesion=numbers), liquid=liquid,
    )  # fmt: skip
    *springs, memory = made.state.contact_spring
    state = made.state._replace(contact_spring=(*springs, memory.at[0].set(held)))
    return made._replace(state=state)


def pulls(kind, gaps, held, numbers):
    """Force that draws both spheres together, at gaps [N]."""
    worlds = [small_and_large(kind, gap, held, numbers) for gap in gaps]
    made, stacked = worlds[0], batch(worlds)

    def force(arrays):
        return forces(World(made.interval, *arrays))[0][0, 0]

    return np.asarray(jax.jit(jax.vmap(force))(tuple(stacked[1:])))


def test_unequal_spheres_part_at_three_halves_of_pi_w_r():
    """JKR: 1.5 pi w R*, with the R* of both; at the contact radius where that is, and less beside it."""
    cube = 9.0 * math.pi * WORK * TOGETHER**2 / (8.0 * EFFECTIVE)
    radii = cube ** (1 / 3) * np.array([0.9, 1.0, 1.1])
    overlap = radii**2 / TOGETHER - np.sqrt(2.0 * math.pi * WORK * radii / EFFECTIVE)
    found = pulls(JohnsonKendallRoberts(), -overlap, 1.0, {"strength": WORK})
    assert found[1] == pytest.approx(1.5 * math.pi * WORK * TOGETHER, rel=1e-12)
    assert found[[0, 2]].max() < 0.999 * found[1]


def test_a_bridge_between_unequal_spheres():
    """Pull by Willett et al. with R = 2 R*; nothing without a bridge."""
    tension, angle, volume = 0.07, 0.3, 1e-13
    end = (1.0 + 0.5 * angle) * volume ** (1 / 3)
    gaps = np.array([1e-9, 0.1, 0.5, 1.0 - 1e-6]) * np.array([1.0, end, end, end])
    numbers = {"strength": tension, "contact_angle": angle, "bridge_share": 0.05, "largest_film": 1e-12}
    scaled = gaps * math.sqrt(2.0 * TOGETHER / volume)
    expected = 4.0 * math.pi * TOGETHER * tension * math.cos(angle) / (1.0 + 1.05 * scaled + 2.5 * scaled**2)
    np.testing.assert_allclose(pulls(CapillaryBridge(), gaps, volume, numbers), expected, rtol=1e-12)
    assert np.all(pulls(CapillaryBridge(), gaps, 0.0, numbers) == 0.0)


def test_a_bridge_between_unequal_spheres_ruptures():
    """At h = (1 + t/2) V^(1/3) by Lian et al., whatever the sizes; either sphere then gets half of its liquid."""
    angle, volume = 0.3, 1e-13
    end = (1.0 + 0.5 * angle) * volume ** (1 / 3)
    numbers = {"strength": 0.07, "contact_angle": angle, "bridge_share": 0.05, "largest_film": 1e-12}
    gaps = end * np.array([1.0 - 1e-6, 1.0 + 1e-6])
    worlds = [small_and_large(CapillaryBridge(), gap, volume, numbers, [0.0, 0.0]) for gap in gaps]
    after = track(batch(worlds), np.full(2, 1e-12), 1)[0].state
    np.testing.assert_array_equal(after.contact_spring[-1][:, 0], [volume, 0.0])
    np.testing.assert_array_equal(after.liquid, [[0.0, 0.0], [0.5 * volume, 0.5 * volume]])


@pytest.mark.parametrize("kind", ["jkr", "capillary", "van_der_waals"])
def test_every_pair_is_listed_as_far_as_it_attracts(kind):
    """A large and a small grain at the end of the reach of the longest attraction and of the skin, and beyond."""
    tables = copy.deepcopy(tables_of(KINDS[kind]))
    tables["particles"] = {"radius": [SMALL, LARGE, SMALL], "density": 2500.0,
                           "position": [[0.002, 0.01], [0.009, 0.01], [0.018, 0.018]]}  # fmt: skip
    tables["domain"]["size"] = [0.03, 0.03]
    simulation = jaxdem.build(jaxdem.load_scene(tables))[0]
    search = simulation.search
    # At a wall of the same material: R* of the largest grain, E* of two.
    soft = 2.0 * math.pi * JKR["work_of_adhesion"] * 2.0 * 0.91 / 1e6
    reach = {
        "jkr": 3.0 / 16.0 ** (2 / 3) * soft ** (2 / 3) * LARGE ** (1 / 3),
        "capillary": (2.0 * share_of(tables) * 0.01 * 4.0 / 3.0 * math.pi * LARGE**3) ** (1 / 3),
        "van_der_waals": 1e-6,
    }[kind]
    found = search.reaches(np.array([SMALL, LARGE, SMALL]))
    skin = 0.4 * 2.0 * (2.0 * SMALL + LARGE) / 3.0
    assert found[0] + found[1] == pytest.approx(SMALL + LARGE + reach + skin, rel=1e-6)
    assert found[0] + found[2] == pytest.approx(2.0 * SMALL + reach + skin, rel=1e-6)


def share_of(tables):
    """`bridge_share` of a scene."""
    return jaxdem.load_scene(tables).contact.cohesion.bridge_share or 0.0
