"""Grains sheared between two plates: what `scenes/shear_cell.toml` and its benchmark do, in small."""

from __future__ import annotations

from types import SimpleNamespace

import jax
import numpy as np
import pytest

import jaxdem
from benchmarks import shear_cell
from jaxdem.observables import contacts
from tests.cases.tiers import COMBINATION

SIDE, SPEED, FRICTION = 0.006, 0.3, 0.6


@pytest.fixture(scope="module")
def cell():
    """Simulation, parameters, and the end of 20 intervals of shear of 150 grains of 1 mm, with the state before it."""
    velocity = np.random.default_rng(0).normal(0.0, 0.1, (150, 3))
    scene = jaxdem.load_scene(
        {
            "precision": "float64",
            "domain": {"size": [SIDE] * 3, "gravity": [0.0, 0.0, 0.0]},
            "particles": {
                "count": 150,
                "radius": 5e-4,
                "density": 2500.0,
                "velocity": velocity.tolist(),
                "pack": {"kind": "random", "start": [0.0] * 3, "stop": [SIDE] * 3},
            },
            "contact": {"young_modulus": 1e6, "friction": 0.5, "wall_friction": FRICTION, "speed": 0.5},
            "boundary": {
                "left": {"kind": "periodic"},
                "front": {"kind": "periodic"},
                "top": {"kind": "moving_wall", "velocity": [SPEED, 0.0, 0.0]},
            },
            "coupling": {"interval": 1e-3},
            "time": {"end": 0.02, "output_interval": 0.02},
        }
    )
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    run = jax.jit(jaxdem.rollout, static_argnames=("steps", "reversible"))
    before = run(simulation, parameters, state, neighbors, steps=1, reversible=False)
    for _ in range(20):
        start = before
        before = run(simulation, parameters, start.state, start.neighbors, steps=1, reversible=False)
        assert int(before.failures) == 0
    return simulation, parameters, start, before


@COMBINATION
def test_the_plates_alone_change_the_momentum(cell):
    """Contacts between grains cancel: the momentum gained in an interval is the plates' impulse, to rounding."""
    simulation, parameters, start, end = cell
    mass = float(parameters.bodies.mass)
    gained = mass * (np.asarray(end.state.particles.velocity) - np.asarray(start.state.particles.velocity)).sum(axis=0)
    impulse = np.asarray(end.state.particles.contact_force).sum(axis=0) * simulation.interval
    scale = mass * np.abs(np.asarray(end.state.particles.velocity)).sum()
    np.testing.assert_allclose(gained, impulse, rtol=0.0, atol=1e-9 * scale)
    assert np.abs(impulse).max() > 1e-6 * scale


@COMBINATION
def test_friction_of_the_plates_is_at_most_coulombs(cell):
    """|T| <= mu N in each contact of grains with plates, so tau / P at a plate is at most the friction there."""
    simulation, parameters, _, end = cell
    found = contacts(simulation, parameters, end.state, end.neighbors).walls
    force, overlap = np.stack([np.asarray(x) for x in found.force], -1), np.asarray(found.overlap)
    touching = overlap > 0.0
    assert touching.any()
    normal, across = np.abs(force[touching][:, 2]), np.hypot(force[touching][:, 0], force[touching][:, 1])
    assert (across <= FRICTION * normal * (1.0 + 1e-9)).all()
    assert across.max() > 0.0


@COMBINATION
def test_the_moving_plate_drags_the_grains(cell):
    """Grains gain momentum along the plate, never more than its speed would give."""
    _, _, _, end = cell
    mean = float(np.asarray(end.state.particles.velocity)[:, 0].mean())
    assert 0.0 < mean < SPEED


def test_friction_law():
    """tan 20.9 degrees at rest, half way at I_0, tan 32.76 degrees in the limit."""
    assert shear_cell.friction_law(0.0) == pytest.approx(0.3819, abs=1e-4)
    assert shear_cell.friction_law(0.279) == pytest.approx(0.5 * (0.38186 + 0.64342), abs=1e-4)
    assert shear_cell.friction_law(1e9) == pytest.approx(0.6434, abs=1e-4)


def test_solid_fraction_law():
    """0.6 at rest, 0.55 half way to I = 1, where it is 0.5."""
    assert shear_cell.solid_fraction_law(np.array([0.0, 0.5, 1.0])) == pytest.approx([0.6, 0.55, 0.5])


def test_friction_and_inertial_number_of_a_uniform_flow():
    """Shear of 10 per second, 1 mm, 2,500 kg/m3, 250 Pa: I = 10 x 1e-3 / sqrt(250 / 2500); tau / P = 100 / 250."""
    layers, times = 8, np.arange(1, 11) * 0.1
    z = (np.arange(layers) + 0.5) * 1e-3
    lines = {"time": np.repeat(times, layers), "z": np.tile(z, 10), "velocity_x": np.tile(0.1 + 10.0 * z, 10)}
    for pair, stress in {"xx": 260.0, "yy": 240.0, "zz": 230.0, "xz": -90.0}.items():
        lines[f"stress_{pair}"] = np.full(80, stress)
        lines[f"streaming_stress_{pair}"] = np.full(80, {"zz": 20.0, "xz": -10.0}.get(pair, 0.0))
    lines |= {"solid_fraction": np.full(80, 0.55), "coordination": np.full(80, 3.0)}
    run = SimpleNamespace(
        probes={"layers": lines},
        times=np.array([0.0, 1.0]),
        scene={
            "domain": {"size": [1.0, 1.0, 8e-3]},
            "particles": {"density": 2500.0},
            "contact": {"young_modulus": 1e6},
        },
        particles=lambda _: {"radius": np.full(5, 5e-4)},
    )
    found = shear_cell.measure(run)
    assert found["friction"] == pytest.approx(0.4) and found["inertial_number"] == pytest.approx(0.01 / np.sqrt(0.1))
    assert found["solid_fraction"] == pytest.approx(0.55) and found["pressure_pa"] == pytest.approx(250.0)
