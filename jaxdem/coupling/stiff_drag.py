"""The drag coefficient of an interval, from the slip at its start and the one predicted for its end."""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
from jax import Array

from jaxdem.closures.base import DragInputs
from jaxdem.particles.integrate import as_column


def settling_coefficient(
    law: Callable[[DragInputs], Array],
    inputs: DragInputs,
    coefficient: Array,
    mass: Array,
    others: Array,
    duration: Array,
) -> Array:
    """Coefficient for a coupling interval, between those at two slips (N,) [kg/s].

    With c(s) the law's coefficient at a slip s = u - v, F the other forces, t the interval and x = t c(s) / m,

        s* = (s - t F / m) / (1 + x),        c = c(s)^(1 - k) c(s*)^k,        k = x / (2 + 2 x):

    s* is the slip at the end of the interval with c(s) and with the fluid as it is. Where the drag grows as s^p
    and relaxes far within the interval, an error e of ln s at the start is -(p - 1)(2 - p)/2 e at its end, an
    eighth at most for 1 <= p <= 2 and nothing for p = 2. With c(s) alone it is -(p - 1) e, and for p = 2 the slip
    flips between two values for ever. Where the drag is resolved c differs from c(s) by t^2 only: the order is
    that of c(s), second for p = 2, where c(s) times the slip at the end is the geometric mean of the drag. In a
    steady state s* = s, so that the law is met as it is.

    Args:
        law: coefficient (N,) for given inputs [kg/s].
        inputs: at the start of the interval.
        coefficient: (N,) the law's for these inputs [kg/s].
        mass: () or (N,) inertia of the particles [kg].
        others: (N, D) forces on the particles beside the coefficient's drag [N].
        duration: () of the interval [s].

    Source: our own; the factors above follow by linearising about the settled slip.
    """
    relaxations = coefficient * duration / mass
    push = (duration / as_column(mass)) * others
    predicted = (inputs.slip_velocity - push) / (1.0 + as_column(relaxations))
    later = law(inputs._replace(particle_velocity=inputs.fluid_velocity - predicted))
    acts = (coefficient > 0) & (later > 0)
    ratio = jnp.where(acts, later, 1.0) / jnp.where(acts, coefficient, 1.0)
    return jnp.where(acts, coefficient * ratio ** (0.5 * relaxations / (1.0 + relaxations)), coefficient)
