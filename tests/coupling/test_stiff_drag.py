"""The drag coefficient of an interval: settles at every stiffness, and follows the exact fall where it resolves it."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.closures.base import DragInputs
from jaxdem.coupling.stiff_drag import settling_coefficient

MASS, GRAVITY = 1e-3, 9.81


def inputs(velocity):
    one = jnp.ones(velocity.shape[:1])
    return DragInputs(velocity, jnp.zeros_like(velocity), 0.0 * one, velocity, velocity, *([one] * 4))


def fall(power, terminal, speed, step, count, lagging=False):
    """Speeds of bodies with the drag W (v / terminal)^p, by the implicit step of the exchange."""
    weight = jnp.asarray([[MASS * GRAVITY]])

    def law(seen):
        ratio = seen.slip_speed / terminal
        return MASS * GRAVITY / terminal * jnp.where(ratio > 0, ratio, 1e-300) ** (power - 1.0)

    def advance(_, velocity):
        seen = inputs(velocity)
        coefficient = law(seen)
        if not lagging:
            args = (seen, coefficient, jnp.asarray(MASS), weight, step)
            coefficient = settling_coefficient(law, *args)
        return (velocity + step / MASS * weight) / (1.0 + coefficient * step / MASS)[:, None]

    return jax.lax.fori_loop(0, count, advance, jnp.broadcast_to(speed, (terminal.size, 1)))[:, 0]


@pytest.mark.parametrize("power", [1.0, 1.3, 1.687, 2.0])
def test_settles_at_every_stiffness(power):
    """Relaxation time over interval 1e-6 ... 1e3, from near rest and from a hundred times too fast."""
    step, ratio = 1e-2, jnp.logspace(-6.0, 3.0, 19)
    terminal = ratio * step * GRAVITY
    for start in (1e-6, 100.0):
        # Twenty relaxation times of the slowest.
        end = fall(power, terminal, start * terminal[:, None], jnp.asarray(step), 20000)
        np.testing.assert_allclose(end, terminal, rtol=1e-4)
    stiff = fall(power, terminal[:9], 100.0 * terminal[:9, None], jnp.asarray(step), 8)
    np.testing.assert_allclose(stiff, terminal[:9], rtol=2e-2)


def test_coefficient_of_the_start_flips():
    """Negative control: c(s) alone leaves a quadratic drag at its period of two."""
    terminal = jnp.asarray([1e-4])
    ends = [float(fall(2.0, terminal, terminal * 3.0, 1.0, n, lagging=True)[0]) for n in (20, 21)]
    assert ends[0] / float(terminal[0]) == pytest.approx(3.0, rel=0.01)
    assert ends[1] / float(terminal[0]) == pytest.approx(1.0 / 3.0, rel=0.01)


def test_resolved_fall_is_the_exact_one():
    """Quadratic drag from rest: v = V tanh(g t / V), to second order, as with the coefficient of the start."""
    terminal = jnp.asarray([GRAVITY])  # a relaxation time of one second
    speed = {n: float(fall(2.0, terminal, 0.0, jnp.asarray(1.0 / n), n)[0]) for n in (20, 40)}
    error = {n: abs(v / (GRAVITY * math.tanh(1.0)) - 1.0) for n, v in speed.items()}
    print(error)
    assert error[40] < 0.3 * error[20] < 3e-4


def test_gradient_is_that_of_central_differences_and_finite_at_rest():
    terminal = jnp.asarray([0.02, 0.3])

    def speed(scale):
        return jnp.sum(fall(1.7, scale * terminal, scale * 0.01 * terminal[:, None], jnp.asarray(0.02), 6))

    slope = jax.grad(speed)(1.0)
    assert float(slope) == pytest.approx(float(speed(1.0 + 1e-5) - speed(1.0 - 1e-5)) / 2e-5, rel=1e-7)

    def coefficient(drag):
        seen = inputs(jnp.zeros((2, 1)))
        args = (seen, drag * jnp.ones(2), jnp.asarray(MASS), jnp.zeros((2, 1)), jnp.asarray(0.1))
        return jnp.sum(settling_coefficient(lambda i: drag * (1.0 + i.slip_speed), *args))

    assert float(jax.grad(coefficient)(0.0)) == 2.0
    assert float(jax.grad(coefficient)(2.0)) == pytest.approx(2.0)
