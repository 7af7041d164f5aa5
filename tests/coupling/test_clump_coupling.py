"""Clumps in a fluid: the volume that they deposit, and the drag by their sphericity."""

from __future__ import annotations

import math

import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.closures import HaiderLevenspiel, HoelzerSommerfeld
from jaxdem.closures.shaped import ParticleShape
from jaxdem.coupling.interpolation import deposit
from jaxdem.coupling.member_weights import body_weights
from jaxdem.particles.union import union_of_spheres
from tests.cases.clumps import ROD, settled_speed, settling_rod
from tests.cases.correlations import haider_levenspiel_coefficient, hoelzer_sommerfeld_coefficient


@pytest.fixture(scope="module")
def rod():
    """A rod alone in still air, in a box so large that it does not feel what it does to the air."""
    scene = jaxdem.load_scene(settling_rod("hoelzer_sommerfeld"))
    simulation, parameters = jaxdem.build(scene)
    return simulation, parameters, *jaxdem.initial_state(scene, simulation, parameters)


def test_deposited_volume_is_that_of_the_union(rod):
    simulation, parameters, state, _ = rod
    grid, bodies = simulation.coupling.interval.solver.grid, parameters.bodies
    particles = state.particles._replace(orientation=jnp.asarray([[0.7]]))
    weights = body_weights(simulation.coupling.deposition, grid, particles, particles.position, bodies)
    union = union_of_spheres(np.asarray(ROD["centres"]), np.ones(3))
    scale = float(bodies.radius) / union.radius
    total = float(jnp.sum(deposit(grid, weights, jnp.broadcast_to(bodies.volume, (1,)))))
    assert total == pytest.approx(union.volume * scale**3, rel=1e-12)
    # Whole members would deposit what they share twice.
    assert 3.0 * 4.0 / 3.0 * math.pi * scale**3 > 1.2 * total


@pytest.mark.parametrize("angle", [0.0, 0.5 * math.pi])
def test_settling_speed(rod, angle):
    """Broadside and end on, against the law in the form of its paper at the speed where it carries the weight."""
    simulation, parameters, state, neighbors = rod
    got, expected, sphere = settled_speed(simulation, parameters, state, neighbors, angle, "hoelzer_sommerfeld")
    assert got == pytest.approx(expected, rel=1e-3)
    assert abs(expected / sphere - 1.0) > 0.015  # of the same volume and weight


@pytest.mark.parametrize("sphericity", [0.7, 0.9, 1.0])
def test_laws_with_sphericity(sphericity):
    """C_D Re / 24 of both laws, one particle, against the papers' forms."""
    for reynolds in (1e-2, 1.0, 100.0, 1e4):
        for crosswise in (0.5, 1.2):
            shape = ParticleShape(jnp.asarray(sphericity), jnp.asarray(crosswise))
            re, none = jnp.asarray([reynolds]), jnp.zeros(1)
            haider = float(HaiderLevenspiel().shaped_multiple(none, re, shape)[0])
            hoelzer = float(HoelzerSommerfeld().shaped_multiple(none, re, shape)[0])
            assert haider == pytest.approx(
                haider_levenspiel_coefficient(reynolds, sphericity) * reynolds / 24, rel=1e-12
            )
            expected = hoelzer_sommerfeld_coefficient(reynolds, sphericity, crosswise) * reynolds / 24
            assert hoelzer == pytest.approx(expected, rel=1e-12)
