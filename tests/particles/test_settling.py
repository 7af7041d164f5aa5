"""Packs that settle before the run: at rest, on walls that carry the weight, the same each time; and refusals."""

from __future__ import annotations

import numpy as np
import pytest

import jaxdem
from jaxdem.check.check import check_scene
from jaxdem.errors import InputError
from jaxdem.particles.packing import deepest_overlap
from jaxdem.setup import builder, settling
from jaxdem.setup.builder import build_case

RADIUS, COUNT = 5e-4, 60
SCENE = {
    "seed": 1,
    "domain": {"size": [0.01, 0.02]},
    "particles": {
        "radius": RADIUS, "density": 2500.0,
        "pack": {"kind": "settled", "start": [0.0, 0.0], "stop": [0.01, 0.012], "count": COUNT},
    },
    "contact": {"young_modulus": 1e6, "restitution": 0.5, "friction": 0.5},
    "boundary": {"bottom": {"particles": "remove"}},
    "time": {"end": 0.1, "output_interval": 0.05},
}  # fmt: skip


def changed(pack=None, **tables):
    particles = SCENE["particles"] | {"pack": SCENE["particles"]["pack"] | (pack or {})}
    return jaxdem.load_scene(SCENE | {"particles": particles} | tables)


@pytest.fixture(scope="module")
def rested():
    """The case, its state, and what was told on the way."""
    told = []
    case = build_case(changed())
    state, _ = case.initial_state(lambda time, longest: told.append((time, longest)))
    return case, state, told


def test_the_particles_are_at_rest(rested):
    """The fastest moves by less than sqrt(g d) / 100; none overlaps by more than a pack may; the clock is 0."""
    case, state, told = rested
    x, v = (np.asarray(a, float) for a in (state.particles.position, state.particles.velocity))
    assert np.linalg.norm(v, axis=1).max() < 0.01 * np.sqrt(9.81 * 2.0 * RADIUS)
    loose = np.asarray(case.unsettled_state()[0].particles.position)
    assert x[:, 1].mean() < loose[:, 1].mean() - RADIUS and len(x) == COUNT
    assert deepest_overlap(x, np.full(COUNT, RADIUS), (0.01, 0.02), (False, False))[0] < 0.01
    assert int(state.step) == 0
    times = [time for time, _ in told]
    assert len(told) > 3 and times == sorted(times) and times[-1] < told[0][1]


def test_the_walls_carry_the_weight(rested):
    """Contacts between particles cancel: the sum of all contact forces is that of the walls, and holds the weight up.

    The floor is there though particles leave through it later; what the program of the run has no wall for has no
    spring.
    """
    case, state, _ = rested
    force = np.asarray(state.particles.contact_force, float).sum(axis=0)
    weight = COUNT * 4.0 / 3.0 * np.pi * RADIUS**3 * 2500.0 * 9.81
    np.testing.assert_allclose(force / weight, [0.0, 1.0], atol=0.01)
    assert state.particles.wall_spring[0].shape == (case.simulation.contact.model.walls, COUNT)
    assert case.simulation.contact.model.walls == 3


def test_the_coordination_number_is_that_of_rough_discs(rested):
    """Between D + 1 = 3 and 2 D = 4 for rough discs at rest (M. van Hecke, J. Phys.: Condens. Matter 22 (2010) 033101,
    section 4), contacts with walls counted whole, those that carry nothing left out."""
    _, state, _ = rested
    x = np.asarray(state.particles.position, float)
    apart = np.linalg.norm(x[:, None] - x[None], axis=2) + np.eye(COUNT)
    touching = (apart < 2.0 * RADIUS) & ~np.eye(COUNT, dtype=bool)
    walls = (x[:, 0] < RADIUS).astype(int) + (x[:, 0] > 0.01 - RADIUS) + (x[:, 1] < RADIUS)
    number = touching.sum(axis=1) + walls
    carrying = number > 1
    assert 3.0 <= number[carrying].mean() <= 4.2
    assert carrying.mean() > 0.9


def test_the_same_each_time(rested):
    case, state, _ = rested
    again, neighbors = jaxdem.initial_state(case.scene, case.simulation, case.parameters)
    for name in ("position", "velocity", "angular_velocity"):
        np.testing.assert_array_equal(getattr(again.particles, name), getattr(state.particles, name))
    assert int(neighbors.builds) == 0


def test_a_check_lets_nothing_fall(monkeypatch):
    monkeypatch.setattr(builder, "settled", None)
    report = check_scene(changed())
    (name, text), *_ = report.packs
    area = COUNT * np.pi * RADIUS**2 / (0.01 * 0.012)
    assert name == "pack" and f"settled, {COUNT} particles, solid fraction {area:.4g}" in text


def test_particles_without_rest_are_an_error_that_says_what_to_do(rested, monkeypatch):
    """After two hundredths of a second they still fall."""
    case = build_case(changed({"settling_time": 0.02}))
    with pytest.raises(InputError, match="not at rest after 0.02 s") as caught:
        case.initial_state()
    assert caught.value.key == "particles.pack.settling_time" and "friction" in caught.value.remedy
    assert case.simulation == rested[0].simulation and settling.REST_ENERGY < 1e-6


def test_a_time_under_a_coupling_interval_is_refused_before_work_starts():
    interval = build_case(changed()).simulation.interval
    build_case(changed({"settling_time": interval}))
    with pytest.raises(InputError, match="less than the coupling interval") as caught:
        build_case(changed({"settling_time": 0.9 * interval}))
    assert caught.value.key == "particles.pack.settling_time"


@pytest.mark.parametrize(
    ("tables", "key"),
    [
        ({"domain": {"size": [0.01, 0.02], "gravity": [0.0, 0.0]}}, "domain.gravity"),
        ({"boundary": {"left": {"kind": "periodic"}}, "domain": {"size": [0.01, 0.02], "gravity": [1.0, -9.81]}},
         "domain.gravity"),
        ({"particles": SCENE["particles"] | {"velocity": [[0.0, 0.0]] * COUNT}}, "particles.velocity"),
    ],
)  # fmt: skip
def test_what_cannot_settle_is_refused(tables, key):
    with pytest.raises(InputError) as caught:
        jaxdem.load_scene(SCENE | tables)
    assert caught.value.key == key


@pytest.mark.parametrize(
    "domain", [{"gravity": [0.0, 0.0]}, {"gravity": [[0.0, -9.81], [9.81, 0.0]], "gravity_times": [0.0, 1.0]}]
)
def test_particles_that_have_settled_in_a_run_before_may_go_on_under_any_gravity(domain):
    """A pack settles once: what it needs for that is no demand on the scenes that begin from its run."""
    later = {"start": {"from": "before"}, "time": {"end": 0.2, "output_interval": 0.05}}
    with pytest.raises(InputError):
        jaxdem.load_scene(SCENE | {"domain": SCENE["domain"] | domain})
    jaxdem.load_scene(later | {"domain": SCENE["domain"] | domain}, former=SCENE)
