"""Inlets that are no box: places even in the region, particles wholly inside it, and the rate that was asked for."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import jaxdem
from jaxdem.errors import InputError
from jaxdem.particle_step import renewed_particles
from jaxdem.particles import regions
from jaxdem.particles.inlet_regions import Prism, Round, Tube
from jaxdem.report.walls import openings

OWN = 0.05
L_SHAPE = ((0.0, 0.0), (1.0, 0.0), (1.0, 0.4), (0.4, 0.4), (0.4, 1.0), (0.0, 1.0))
AXIS = tuple((np.asarray([1.0, 2.0, -2.0]) / 3.0).tolist())


def drawn(region, dimension, count=20_000):
    u = np.random.default_rng(3).uniform(size=(count, dimension))
    points, inside = jax.jit(region.places)(jnp.asarray(u), jnp.asarray(OWN))
    return np.asarray(points)[np.asarray(inside)]


def even(sample):
    """Kolmogorov and Smirnov do not tell the sample from an even one, 0 to 1."""
    return stats.kstest(sample, "uniform").pvalue > 0.01


@pytest.mark.parametrize("center", [(0.3, 0.7), (0.3, 0.7, -0.2)])
def test_places_in_a_disc_and_a_ball_are_even(center):
    dimension, reach = len(center), 0.5 - OWN
    points = drawn(Round(center, 0.5), dimension) - center
    away = np.linalg.norm(points, axis=1)
    assert away.max() <= reach + 1e-12
    assert even((away / reach) ** dimension)
    assert even(0.5 + np.arctan2(points[:, 1], points[:, 0]) / (2.0 * np.pi))
    if dimension == 3:  # Archimedes: the heights on a sphere are even
        assert even(0.5 + 0.5 * points[:, 2] / away)
    assert stats.spearmanr(away, points[:, 0]).pvalue > 0.01


def test_places_in_a_cylinder_are_even():
    base = np.asarray([0.1, 0.2, 0.3])
    points = drawn(Tube(tuple(base), AXIS, 0.5, 2.0), 3) - base
    height = points @ np.asarray(AXIS)
    away = np.linalg.norm(points - np.outer(height, AXIS), axis=1)
    assert even((height - OWN) / (2.0 - 2.0 * OWN))
    assert even((away / (0.5 - OWN)) ** 2)
    assert regions.cylinder(base, AXIS, 0.5, 2.0).inside(points + base, OWN).all()


@pytest.mark.parametrize("across", [(), (0.2, 0.9)])
def test_places_in_a_polygon_are_even_and_keep_away_from_its_edges(across):
    """The lower part of an L whose bars are 0.4 wide, with corners that stand out and one that stands in."""
    points = drawn(Prism(L_SHAPE, across), 3 if across else 2)
    assert regions.polygon(L_SHAPE, across or None).inside(points, OWN).all()
    x, z = points[:, 0], points[:, -1]
    low = (z < 0.4 - OWN) & (x > 0.4)
    assert even((x[low] - 0.4) / (0.6 - OWN)) and even((z[low] - OWN) / (0.4 - 2.0 * OWN))
    bar = (0.4 - 2.0 * OWN) * (1.0 - 2.0 * OWN)
    # Two bars, less the square that both have, and the corner: a square of 0.05 less the quarter of a disc.
    area = 2.0 * bar - (0.4 - 2.0 * OWN) ** 2 + (1.0 - np.pi / 4.0) * OWN**2
    share = 0.3 * (0.6 - OWN) / area
    assert abs(low.mean() - share) < 4.0 * np.sqrt(share / len(points))
    if across:
        assert even((points[:, 1] - 0.2 - OWN) / (0.7 - 2.0 * OWN))


SCENE = {
    "precision": "float64",
    "domain": {"size": [1.0, 1.0, 1.0]},
    "particles": {
        "radius": 0.01,
        "density": 2500.0,
        "inlet": [
            {"region": {"shape": "cylinder", "base": [0.3, 0.3, 0.7], "axis": [0, 0, 1], "radius": 0.1, "length": 0.1},
             "rate": 400.0, "velocity": [0.0, 0.0, -1.0]},
            {"region": {"shape": "sphere", "center": [0.7, 0.3, 0.5], "radius": 0.1}, "rate": 250.0,
             "velocity": [1.0, 0.0, 0.0]},
            {"region": {"shape": "polygon", "vertices": [[0.1, 0.1], [0.4, 0.1], [0.1, 0.4]], "from": 0.6, "to": 0.8},
             "rate": 300.0, "velocity": [0.0, 1.0, 0.0]},
            {"region": {"shape": "box", "start": [0.6, 0.6, 0.6], "stop": [0.8, 0.8, 0.8]}, "rate": 10.0,
             "velocity": [0.0, 0.0, 1.0]},
        ],
    },
    "contact": {"young_modulus": 1e6, "speed": 1.0},
    "boundary": {side: {"particles": "remove"} for side in ("left", "right", "front", "back", "bottom", "top")},
    "coupling": {"interval": 0.01},
    "time": {"end": 0.1, "output_interval": 0.01},
}  # fmt: skip


def test_the_rate_is_kept_and_particles_come_in_wholly_inside():
    scene = jaxdem.load_scene(SCENE)
    assert jaxdem.load_scene(scene.tables()) == scene
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    renew = jax.jit(lambda p, n, k: renewed_particles(simulation, parameters, p, n, k))
    particles, rates = state.particles, [400.0, 250.0, 300.0, 10.0]
    spaces = [regions.cylinder((0.3, 0.3, 0.7), (0, 0, 1), 0.1, 0.1), regions.ball((0.7, 0.3, 0.5), 0.1),
              regions.polygon([[0.1, 0.1], [0.4, 0.1], [0.1, 0.4]], (0.6, 0.8)),
              regions.box((0.6, 0.6, 0.6), (0.8, 0.8, 0.8))]  # fmt: skip
    owner = np.repeat(np.arange(4), [len(inlet.due) for inlet in simulation.population.inlets])
    for step in range(1, 11):
        before = np.asarray(particles.active)
        particles, neighbors = renew(particles, neighbors, jnp.int32(step))
        new = np.asarray(particles.active) & ~before
        inserted = np.asarray(particles.inserted)
        assert inserted.tolist() == [int(rate * step * 0.01 + 1e-9) for rate in rates]
        for number, space in enumerate(spaces):
            rows = new & (owner == number)
            assert space.inside(np.asarray(particles.position)[rows], 0.01).all()
        away = np.where(np.asarray(particles.active)[:, None], [[1.5, 0.5, 0.5]], np.asarray(particles.position))
        particles = particles._replace(position=jnp.asarray(away))
    waiting = np.asarray(state.particles.position)
    assert (waiting[owner == 1] == [0.7, 0.3, 0.5]).all()


def test_the_pictures_have_the_box_round_a_region():
    tables = jaxdem.load_scene(SCENE).tables()  # as in scene.toml of a run
    ends = [(one.start, one.stop) for one in openings(tables, (1.0, 1.0, 1.0)) if one.kind == "inlet"]
    expected = [((0.2, 0.7), (0.4, 0.8)), ((0.6, 0.4), (0.8, 0.6)), ((0.1, 0.1), (0.4, 0.4)), ((0.6, 0.6), (0.8, 0.8))]
    np.testing.assert_allclose(ends, expected, atol=1e-12)


ROUND = {"shape": "sphere", "center": [0.7, 0.3, 0.5], "radius": 0.1}


@pytest.mark.parametrize(
    ("changes", "key", "words"),
    [
        ({"side": "top"}, "side", "or a region"),
        ({"region": ROUND | {"radius": 0.009}}, "region", "no room for a particle of radius 0.01"),
        ({"region": ROUND | {"radius": 0.31}}, "region", "must lie in the box"),
        ({"region": {"shape": "cylinder", "base": [0.3, 0.3, 0.7], "axis": [0, 0, 1], "radius": 0.1, "length": 0.019}},
         "region", "no room"),
        ({"region": {"shape": "polygon", "vertices": [[0.1, 0.1], [0.9, 0.9], [0.9, 0.93]]}}, "region", "% of the"),
        ({"region": {"shape": "polygon", "vertices": [[0, 0], [1, 1], [1, 0], [0, 1]]}}, "region.vertices",
         "two edges"),
        ({"region": ROUND, "velocity": 1.0}, "velocity", "vector"),
    ],
)  # fmt: skip
def test_a_region_that_cannot_be_is_named(changes, key, words):
    inlet = SCENE["particles"]["inlet"][1] | changes
    with pytest.raises(InputError, match=words) as caught:
        jaxdem.build(jaxdem.load_scene({**SCENE, "particles": {**SCENE["particles"], "inlet": [inlet]}}))
    assert caught.value.key == f"particles.inlet.0.{key}"
