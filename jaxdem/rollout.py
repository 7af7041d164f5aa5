"""Many coupled steps as one pure function, for gradients through the whole simulation."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxdem.build import Simulation
from jaxdem.failures import failures
from jaxdem.particles.neighbors import Neighbors
from jaxdem.state import Parameters, State


class Rollout(NamedTuple):
    """Result of a rollout.

    Attributes:
        state: after the last step.
        neighbors: list at the end.
        failures: () int32 flags of all steps together, see `jaxdem.failures`; 0 for a sound rollout.
        observations: what `observe` gave after each step, stacked; None without it.
    """

    state: State
    neighbors: Neighbors | None
    failures: Array
    observations: Any


def rollout(
    simulation: Simulation,
    parameters: Parameters,
    state: State,
    neighbors: Neighbors | None,
    steps: int,
    observe: Callable[[State], Any] | None = None,
) -> Rollout:
    """The simulation run for `steps` coupling intervals; pure, for jit, grad and vmap.

    Reverse mode keeps the state at about sqrt(steps) checkpoints and computes the stretches between them
    again, so memory grows with the square root of the length. Nothing is raised inside: look at `failures`.

    Args:
        simulation: from `jaxdem.build`.
        parameters: what one may differentiate by.
        state: to start from.
        neighbors: its neighbour list.
        steps: number of coupling intervals.
        observe: function of the state, evaluated after each step.
    """
    simulation = simulation.reversible()

    def one(carry: Any, _: None) -> tuple[Any, Any]:
        state, neighbors, code = carry
        state, neighbors, diagnostics = simulation.step(parameters, state, neighbors)
        code = code | failures(simulation, diagnostics)
        return (state, neighbors, code), None if observe is None else observe(state)

    def stretch(length: int) -> Callable[[Any, None], tuple[Any, Any]]:
        return jax.checkpoint(lambda carry, _: lax.scan(jax.checkpoint(one), carry, None, length=length))

    length = max(1, math.isqrt(steps))
    count, rest = divmod(steps, length)
    carry = (state, neighbors, jnp.zeros((), jnp.int32))
    carry, seen = lax.scan(stretch(length), carry, None, length=count)
    carry, last = lax.scan(jax.checkpoint(one), carry, None, length=rest)
    observations = None
    if observe is not None:
        observations = jax.tree.map(
            lambda a, b: jnp.concatenate((a.reshape(-1, *a.shape[2:]), b)), seen, last
        )
    return Rollout(*carry, observations)
