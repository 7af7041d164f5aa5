"""The contact laws as functions, against their formulas written out in numpy."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.particles.contact import (
    Contact,
    ContactMaterial,
    HertzMindlin,
    LinearSpringDashpot,
    damping_ratio,
    pull_share,
)

E, G, RADIUS, MASS = 3.8e7, 6.9e6, 0.005, 0.0131  # effective constants of a pair
ROUND = 1e-13  # a few operations in float64


def material(restitution=1.0, friction=0.5, kn=1e4, kt=3e3):
    values = (E, G, restitution, friction, 0.0, 0.0, kn, kt)
    return ContactMaterial(*(jnp.asarray(value, jnp.float64) for value in values))


def contact(overlap, approach=0.0, slip=(0.0, 0.0), spring=(0.0, 0.0)):
    arrays = (jnp.asarray([x], jnp.float64) for x in (overlap, approach))
    slip, spring = (tuple(jnp.asarray([x], jnp.float64) for x in v) for v in (slip, spring))
    return Contact(*arrays, slip, spring, jnp.asarray([RADIUS]), jnp.asarray([MASS]), jnp.asarray([1e-6]))


@pytest.mark.parametrize("overlap", [1e-9, 1e-6, 1e-4, 1e-3])
def test_hertz_force(overlap):
    """F = 4/3 E* sqrt(R*) d^1.5 (Hertz 1881), the elastic part too, and no tangential force at rest."""
    force = HertzMindlin()(contact(overlap), material())
    expected = 4.0 / 3.0 * E * np.sqrt(RADIUS) * overlap**1.5
    np.testing.assert_allclose([force.normal[0], force.elastic[0]], expected, rtol=ROUND)
    assert force.tangential[0][0] == force.tangential[1][0] == 0.0


def test_damping_ratio():
    """|b| = -ln e / sqrt(ln^2 e + pi^2); 1 for e = 0 and 0 for e = 1 (Tsuji et al. 1992)."""
    e = np.array([0.2, 0.5, 0.9])
    expected = -np.log(e) / np.hypot(np.log(e), np.pi)
    np.testing.assert_allclose(damping_ratio(jnp.asarray(e)), expected, rtol=ROUND)
    assert damping_ratio(jnp.asarray(0.0)) == 1.0 and damping_ratio(jnp.asarray(1.0)) == 0.0
    # The limit e -> 0 is reached: |b| > 0.999 at e = 1e-40 and the value at 0 continues it.
    assert 0.999 < damping_ratio(jnp.asarray(1e-40)) < 1.0


@pytest.mark.parametrize("restitution", [0.0, 0.3, 1.0])
def test_hertz_mindlin_dashpots_and_spring(restitution):
    """F_n and F_t of the law with both dashpots, S_n = 2 E* sqrt(R* d), S_t = 8 G* sqrt(R* d) (Mindlin
    1949)."""
    d, rate, slip, xi = 2e-4, 0.3, np.array([0.02, -0.01]), np.array([3e-6, 4e-6])
    b = 1.0 if restitution == 0 else -np.log(restitution) / np.hypot(np.log(restitution), np.pi)
    sn, st = 2 * E * np.sqrt(RADIUS * d), 8 * G * np.sqrt(RADIUS * d)
    normal = 4 / 3 * E * np.sqrt(RADIUS) * d**1.5 + 2 * np.sqrt(5 / 6) * b * np.sqrt(sn * MASS) * rate
    tangential = -st * xi - 2 * np.sqrt(5 / 6) * b * np.sqrt(st * MASS) * slip
    force = HertzMindlin()(contact(d, rate, slip, xi), material(restitution, friction=10.0))
    np.testing.assert_allclose(force.normal[0], normal, rtol=ROUND)
    np.testing.assert_allclose([f[0] for f in force.tangential], tangential, rtol=ROUND)
    np.testing.assert_array_equal([s[0] for s in force.spring], xi)  # sticking: as it was


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_linear_spring_dashpot(restitution):
    """F_n = k_n d + 2 |b| sqrt(k_n m*) d', F_t = -k_t xi - c_n / 2 v_t (Cundall & Strack 1979, MFIX)."""
    d, rate, slip, xi = 1e-4, 0.2, np.array([0.03, 0.01]), np.array([1e-5, -2e-5])
    b = 1.0 if restitution == 0 else -np.log(restitution) / np.hypot(np.log(restitution), np.pi)
    c = 2 * b * np.sqrt(1e4 * MASS)
    force = LinearSpringDashpot()(contact(d, rate, slip, xi), material(restitution, friction=10.0))
    np.testing.assert_allclose(force.normal[0], 1e4 * d + c * rate, rtol=ROUND)
    np.testing.assert_allclose([f[0] for f in force.tangential], -3e3 * xi - 0.5 * c * slip, rtol=ROUND)


def pull_over_push(b):
    """Impulse of the pull at a contact's end over that of the dashpot until then, of x'' + 2 b x' + x = 0, by its
    closed form."""
    s = np.sqrt(1 - b * b)
    vanishes = np.arctan2(-2 * b * s, 1 - 2 * b * b) % np.pi
    speed = -np.exp(-b / s * vanishes) * (np.cos(vanishes) - b / s * np.sin(vanishes))
    return (speed - np.exp(-np.pi * b / s)) / (2 * b * np.exp(-b / s * np.arccos(b)))


def test_share_of_the_pull():
    """The cubic against the closed form; at b = 1, where x = t exp(-t), it is exp(-2) over 2 exp(-1)."""
    b = np.linspace(1e-3, 0.999, 200)
    np.testing.assert_allclose(pull_share(jnp.asarray(b)), pull_over_push(b), atol=0.005)
    np.testing.assert_allclose(pull_share(jnp.asarray(1.0)), 0.5 * np.exp(-1), atol=0.005)
    assert pull_share(jnp.asarray(0.0)) == 0.0


@pytest.mark.parametrize("law", [HertzMindlin(), LinearSpringDashpot()])
@pytest.mark.parametrize("restitution", [0.4, 1.0])
@pytest.mark.parametrize("approach", [0.1, 0.0, -0.02])
def test_coulomb_limit_cuts_the_spring_back(law, restitution, approach):
    """Sliding: |F_t| = mu F_n but for the part of a push that a pull will take back; the spring keeps its direction,
    and alone it gives that force, no more."""
    slip, xi, mu = (0.05, -0.02), (3e-3, 4e-3), 0.4
    force = law(contact(1e-4, approach, slip, xi), material(restitution, friction=mu))
    size = np.hypot(*(f[0] for f in force.tangential))
    elastic, b = force.elastic[0], float(damping_ratio(jnp.asarray(restitution)))
    share = pull_over_push(b) if b else 0.0
    expected = mu * (force.normal[0] - share * max(force.normal[0] - elastic, 0.0))
    np.testing.assert_allclose(size, expected, rtol=2e-3)  # the cubic for the share
    assert size <= mu * force.normal[0] * (1 + ROUND)
    spring = np.array([s[0] for s in force.spring])
    np.testing.assert_allclose(spring / np.hypot(*spring), np.array(xi) / np.hypot(*xi), rtol=ROUND)
    alone = law(contact(1e-4, approach, (0.0, 0.0), tuple(spring)), material(restitution, friction=mu))
    np.testing.assert_allclose(np.hypot(*(f[0] for f in alone.tangential)), size, rtol=1e-11)
    np.testing.assert_allclose(alone.spring, force.spring, rtol=1e-11)


@pytest.mark.parametrize("law", [HertzMindlin(), LinearSpringDashpot()])
def test_a_dashpot_above_the_limit_does_not_turn_the_spring(law):
    """At e = 0.1 the dashpot alone exceeds the limit: the force is the limit, and the spring, far under it, stays as it
    is."""
    slip, xi = (0.5, 0.0), (1e-7, 0.0)
    force = law(contact(1e-4, 0.0, slip, xi), material(0.1, friction=0.1))
    np.testing.assert_allclose(force.tangential[0][0], -0.1 * force.normal[0], rtol=ROUND)
    np.testing.assert_array_equal([s[0] for s in force.spring], xi)


@pytest.mark.parametrize("law", [HertzMindlin(), LinearSpringDashpot()])
def test_a_contact_that_pulls_has_no_friction(law):
    """The dashpot pulls harder than the spring pushes: no tangential force, and the spring is let go."""
    force = law(contact(1e-5, -1.0, (0.05, -0.02), (3e-6, 4e-6)), material(0.2, friction=0.4))
    assert force.normal[0] < 0.0
    np.testing.assert_array_equal(np.asarray([force.tangential, force.spring]), 0.0)


@pytest.mark.parametrize("law", [HertzMindlin(), LinearSpringDashpot()])
def test_without_friction_no_tangential_force(law):
    """mu = 0 leaves no tangential force, whatever slip and spring."""
    force = law(contact(1e-4, 0.1, (0.5, 1.0), (1e-4, 0.0)), material(0.5, friction=0.0))
    np.testing.assert_array_equal(np.asarray(force.tangential), 0.0)


@pytest.mark.parametrize("law", [HertzMindlin(), LinearSpringDashpot()])
@pytest.mark.parametrize("overlap", [1e-14, 1e-9, 1e-4])
@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_gradients_are_finite_and_right(law, overlap, restitution):
    """d F_n / d overlap is the closed form without damping; all gradients finite at zero slip and tiny
    overlap."""

    def total(d, slip, e, mu):
        force = law(contact(1.0)._replace(overlap=d, slip=(slip, slip)), material()._replace(
            restitution=e, friction=mu))  # fmt: skip
        return jnp.sum(force.normal + force.tangential[0] + force.tangential[1])

    zero = jnp.zeros(1)
    arguments = (jnp.asarray([overlap]), zero, jnp.asarray(restitution), jnp.asarray(0.3))
    gradients = jax.grad(total, (0, 1, 2, 3))(*arguments)
    assert all(np.isfinite(np.asarray(g)).all() for g in gradients)
    expected = 2 * E * np.sqrt(RADIUS * overlap) if isinstance(law, HertzMindlin) else 1e4
    np.testing.assert_allclose(gradients[0][0], expected, rtol=ROUND)


def test_without_a_tangential_stiffness_the_dashpot_is_left():
    """contact.tangential_stiffness = 0: F_t = -c_t v_t up to the Coulomb limit, the spring stays zero, gradients are
    finite."""
    law, d, b = LinearSpringDashpot(), 2e-4, -np.log(0.5) / np.hypot(np.log(0.5), np.pi)
    damping = b * np.sqrt(1e4 * MASS)
    for slip, expected in ((1e-3, -damping * 1e-3), (10.0, -0.5 * 1e4 * d)):

        def tangential(speed):
            force = law(contact(d, slip=(speed, 0.0)), material(0.5, kt=0.0))
            return force.tangential[0][0], force.spring[0][0]

        force, spring = tangential(slip)
        assert force == pytest.approx(expected, rel=1e-12) and spring == 0.0
        assert np.isfinite(jax.grad(lambda speed: tangential(speed)[0])(slip))
