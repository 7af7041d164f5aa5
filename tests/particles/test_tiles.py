"""Contacts worked out in tiles of rows are those worked out at once, with all that they keep."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.particles import tiles
from jaxdem.scene.checked import scene_of_tables
from jaxdem.step import step

SCENE = {
    "precision": "float64",
    "domain": {"size": [0.21, 0.1], "gravity": [60.0, -60.0], "depth": 0.02},
    "materials": [{"name": "glass", "young_modulus": 2e7}, {"name": "steel", "friction": 0.6}],
    "particles": {
        "count": 70,
        "density": 2650.0,
        "species": [
            {"share": 0.5, "radius": 0.005, "material": "glass"},
            {"share": 0.5, "radius": 0.004, "material": "steel"},
        ],
        "pack": {"kind": "lattice", "start": [0.0, 0.012], "stop": [0.21, 0.1], "jitter": 0.01, "spacing": 1.02},
    },
    "contact": {
        "young_modulus": 4e7,
        "friction": 0.3,
        "rolling_friction": 0.1,
        "rolling_model": "epsd",
        "wall_material": "steel",
        "cohesion": {
            "kind": "capillary",
            "surface_tension": 0.07,
            "contact_angle": 0.2,
            "liquid_content": 0.01,
            "liquid_viscosity": 1e-3,
            "minimum_gap": 1e-6,
        },
    },
    "walls": [
        {
            "kind": "plane",
            "name": "floor",
            "point": [0.0, 0.01],
            "normal": [0.0, 1.0],
            "motion": [{"kind": "translation", "velocity": [0.3, 0.0]}],
        },
    ],
    "time": {"end": 0.04, "output_interval": 0.04},
}


@pytest.fixture
def end(monkeypatch):
    """State and step's report after an interval, in tiles of so many rows."""

    def after(rows):
        monkeypatch.setattr(tiles, "ROWS", rows)
        monkeypatch.setattr(tiles, "LEAST", 2)
        scene = scene_of_tables(SCENE)
        simulation, parameters = jaxdem.build(scene)
        state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
        assert len(neighbors.pairs.first) % 16
        return jax.jit(lambda s, n: step(simulation, parameters, s, n)[0:3:2])(state, neighbors)

    return after


def test_what_is_kept_changes_once(monkeypatch):
    """Also in rows that the last two tiles share, and by what it was."""
    monkeypatch.setattr(tiles, "ROWS", 16)
    monkeypatch.setattr(tiles, "LEAST", 2)
    other, kept = np.arange(70.0), np.arange(140.0).reshape(2, 70) + 1.0

    def compute(cut, before):
        return 2.0 * cut(jnp.asarray(other)) + before[0], 3.0 * before + cut(jnp.asarray(other))[None]

    found, after = jax.jit(lambda kept: tiles.in_tiles(70, compute, kept))(kept)
    np.testing.assert_array_equal(found, 2.0 * other + kept[0])
    np.testing.assert_array_equal(after, 3.0 * kept + other)


def test_tiles_change_nothing(end):
    at_once, in_tiles = end(10**6), end(16)
    particles = at_once[0].particles
    assert all(np.any(spring) for spring in (*particles.contact_spring, *particles.wall_spring))
    jax.tree.map(_same, at_once, in_tiles)


def _same(one, other):
    scale = max(np.max(np.abs(one), initial=0.0), 1e-300)
    np.testing.assert_allclose(np.asarray(other) / scale, np.asarray(one) / scale, rtol=0.0, atol=1e-9)
