"""A bed of loose grains under a driven stream: what `scenes/river_bed.toml` and its benchmark do, in small."""

from __future__ import annotations

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from benchmarks import river_bed
from tests.cases.tiers import COMBINATION

SCENE = Path(__file__).parents[2] / "scenes" / "river_bed.toml"
LENGTH, WIDTH, HEIGHT, DEPTH = 0.010, 0.010, 0.012, 0.006
DIAMETER, WEIGHT = 2e-3, 1650.0 * 9.81
"""Mean diameter [m], and the submerged weight of grains per volume [N/m3]."""
SMALL = {
    "domain.size": [LENGTH, WIDTH, HEIGHT],
    "particles.count": 75,
    "particles.pack.stop": [LENGTH, WIDTH, 0.0068],
    "fluid.cells": [4, 4, 12],
    "fluid.bulk_velocity": None,
    "fluid.drive_times": None,
    "fluid.pressure_gradient": [0.0, 0.0, 0.0],
    "probes": [],
}


@pytest.fixture(scope="module")
def small():
    """Simulation, parameters, and a state in which 75 grains have settled to a bed of three layers."""
    scene = jaxdem.load_scene(SCENE, SMALL)
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    run = jax.jit(jaxdem.rollout, static_argnames=("steps", "reversible"))

    def driven(shields, state, neighbors):
        """200 ms under the gradient whose force on the water gives this Shields number on the bed."""
        gradient = -shields * WEIGHT * DIAMETER / DEPTH
        drive = parameters.fluid.drive._replace(pressure_gradient=jnp.asarray([gradient, 0.0, 0.0], jnp.float32))
        changed = parameters._replace(fluid=parameters.fluid._replace(drive=drive))
        end = run(simulation, changed, state, neighbors, steps=100, reversible=False)
        assert int(end.failures) == 0
        return end.state, end.neighbors

    return parameters, driven, driven(0.0, state, neighbors)


def momentum(parameters, state):
    """Of grains and water along the stream [kg m/s]."""
    g = np.asarray(state.fluid.void_fraction)
    u = np.asarray(state.fluid.face_velocity[0])[: g.shape[0]]
    water = 1000.0 * LENGTH * WIDTH * HEIGHT * np.mean(0.5 * (g + np.roll(g, 1, 0)) * u)
    return water + float(jnp.sum(parameters.bodies.mass * state.particles.velocity[:, 0]))


@COMBINATION
def test_a_weak_stream_moves_no_grain_and_a_strong_one_does(small):
    """At a Shields number of 0.01 the bed stays; at 1 grains travel, and the floor takes a part of the momentum."""
    parameters, driven, (bed, neighbors) = small
    weak, _ = driven(0.01, bed, neighbors)
    strong, _ = driven(1.0, bed, neighbors)
    assert float(jnp.abs(weak.particles.position - bed.particles.position).max()) < 0.05 * DIAMETER
    way = strong.particles.position[:, 0] - bed.particles.position[:, 0]
    assert float(way.max()) > 2.0 * DIAMETER and float(way.mean()) > 0.0
    # The floor can only hold back: less than the gradient gives, and with the grains' own weight at rest, not less
    # than the limit of its friction.
    given = 1.0 * WEIGHT * DIAMETER / DEPTH * LENGTH * WIDTH * HEIGHT * 0.2
    gained = momentum(parameters, strong) - momentum(parameters, bed)
    assert 0.0 < gained < given
    held = given - gained
    grains = float(jnp.sum(parameters.bodies.volume * jnp.ones(len(way)))) * WEIGHT * 0.2
    assert held < 1.5 * grains


def test_slices_hold_the_volume_of_the_grains():
    """Caps of a sphere: half below its centre, all of it below its top; the surface of a bed with a sharp one."""
    below = river_bed.volume_below(np.array([-2.0, 0.0, 0.5, 1.0, 3.0]), np.array([0.0]), np.array([1.0]))[:, 0]
    whole = 4.0 / 3.0 * np.pi
    cap = np.pi * 0.25 * (1.0 - 0.5 / 3.0)  # of height 0.5: pi h^2 (r - h/3)
    np.testing.assert_allclose(below, [0.0, 0.5 * whole, whole - cap, whole, whole], rtol=1e-12)
    height = np.linspace(0.05, 9.95, 100)
    solid = np.clip(0.6 * (7.5 - height), 0.0, 0.6)  # falls to half of 0.6 at 7
    bed = river_bed.Bed(height, solid, solid, height, height)
    assert river_bed.surface(bed, 1.0) == pytest.approx((7.0, 0.6))


def test_laws_of_bed_load():
    """Values by hand: 8 x 0.253^1.5 and 3.97 x 0.2505^1.5 at a Shields number of 0.3; nothing below the threshold."""
    assert float(river_bed.law_of_meyer_peter(0.3)) == pytest.approx(1.0181, abs=1e-4)
    assert float(river_bed.law_of_wong(0.3)) == pytest.approx(0.4977, abs=1e-4)
    assert float(river_bed.law_of_meyer_peter(0.04)) == float(river_bed.law_of_wong(0.04)) == 0.0


def test_scatter_of_the_bed_load():
    """Ratios of 10 and 1/1000 to a law: log10 of 1 and -3, mean -1, root mean square sqrt(5); the first alone: 1."""
    rows = [
        {"shields": theta, "flux": ratio, "wong": 1.0, "meyer_peter": 0.0}
        for theta, ratio in ((0.5, 10.0), (0.1, 1e-3))
    ]
    found = river_bed.scatter([*rows, {"shields": 0.05, "flux": 0.0, "wong": 1.0, "meyer_peter": 0.0}], 0.0)
    assert found == {"wong": pytest.approx({"mean_log10": -1.0, "rms_log10": np.sqrt(5.0), "largest": 3.0, "runs": 2})}
    assert river_bed.scatter(rows, 0.3)["wong"]["rms_log10"] == pytest.approx(1.0)
