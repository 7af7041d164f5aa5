"""Momentum and angular momentum of particles that only meet each other; energy: `benchmarks/cases/contact.py`."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.cases.worlds import World, constants, track, world
from jaxdem.particles import forces

FRICTION = constants(young_modulus=1e7, restitution=0.6, friction=0.4)


def totals(scene: World, seen):
    """Linear and angular momentum about the origin at every frame; spin counts with 2/5 m r^2."""
    count = seen.position.shape[1]
    mass = np.broadcast_to(np.asarray(scene.properties.mass), (count,))
    inertia = np.broadcast_to(np.asarray(scene.properties.inertia), (count,))
    linear = np.einsum("i,tid->td", mass, seen.velocity)
    x, p = seen.position, mass[None, :, None] * seen.velocity
    flat = x.shape[2] == 2
    orbital = (x[..., :1] * p[..., 1:] - x[..., 1:] * p[..., :1]) if flat else np.cross(x, p)
    angular = np.sum(orbital + inertia[None, :, None] * seen.spin, axis=1)
    return linear, angular


def cluster(dimension):
    """Six particles of two sizes (five in 2-D) that fall towards their centre with spin, no walls."""
    generator = np.random.default_rng(3)
    angle = np.arange(5) * 2 * np.pi / 5
    flat, axes = np.stack([np.cos(angle), np.sin(angle)], 1), np.concatenate([np.eye(3), -np.eye(3)])
    corners = flat if dimension == 2 else axes
    position = 0.022 * corners + generator.uniform(-1e-3, 1e-3, corners.shape)
    count = len(position)
    radius = np.where(np.arange(count) % 2 == 0, 0.01, 0.007)
    spin = generator.uniform(-30, 30, (count, 1 if dimension == 2 else 3))
    velocity = -30.0 * position + generator.uniform(-0.2, 0.2, position.shape)
    return world(position, velocity, spin, radius=radius, walls=False, rebuild=False, material=FRICTION)


@pytest.mark.parametrize("dimension", [2, 3])
def test_momentum_is_conserved_to_round_off(dimension):
    """Both forces of a pair are equal and opposite, and the arms r - d/2 meet in one point.

    2,000 steps with some ten contacts at a time: round-off of 1e-16 in every one of 1e4 terms, random, is
    1e-14 of the momentum exchanged; ten times that is allowed. Positions are 0.03 m at most.
    """
    scene = cluster(dimension)
    mass = np.asarray(scene.properties.mass)
    _, seen = track(scene, 2e-5, 80, 25)
    linear, angular = totals(scene, seen)
    scale = np.sum(mass[:, None] * np.abs(np.asarray(scene.state.velocity)))
    assert np.abs(seen.force).max() > 0.1  # they do touch
    assert np.ptp(seen.spin, axis=0).max() > 5.0  # and turn each other
    np.testing.assert_allclose(linear, np.broadcast_to(linear[:1], linear.shape), rtol=0, atol=1e-13 * scale)
    np.testing.assert_allclose(
        angular, np.broadcast_to(angular[:1], angular.shape), rtol=0, atol=1e-14 * scale
    )


def test_full_arm_would_lose_angular_momentum(monkeypatch):
    """Negative control: with the tangential force turned about r instead of r - d/2 angular momentum
    drifts."""
    original = forces._pair_geometry

    def deeper(*arguments):
        overlap, normal = original(*arguments)
        return overlap * (1 + 1e-3), normal

    monkeypatch.setattr(forces, "_pair_geometry", deeper)
    scene = cluster(2)
    _, seen = track(scene, 2e-5, 80, 25)
    _, angular = totals(scene, seen)
    scale = np.sum(np.asarray(scene.properties.mass)[:, None] * np.abs(np.asarray(scene.state.velocity)))
    assert np.abs(angular - angular[:1]).max() > 1e-10 * scale
