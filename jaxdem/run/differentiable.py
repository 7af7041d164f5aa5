"""Many coupled steps as one pure function, for gradients through the whole simulation and for batches of scenes."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxdem.errors import InputError, is_whole, require_kinds
from jaxdem.failures import failures
from jaxdem.numerics.shapes import with_shapes, zeros_of
from jaxdem.particles.neighbors import Neighbors
from jaxdem.scene.drive import check_gravity
from jaxdem.setup.given import require_built
from jaxdem.simulation import Simulation
from jaxdem.state import Diagnostics, Parameters, State

KEPT_STEPS = 128
"""Up to this length reverse mode keeps the state of every step. The contact steps within a single interval
keep 50 to 250 states anyway; a second level of checkpoints costs a fourth forward run, and its compilation."""

Carry = tuple[State, Neighbors | None, Array]
"""State, its list, and the flags of all steps so far."""


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
    reversible: bool = True,
) -> Rollout:
    """The simulation run for `steps` coupling intervals; pure, for jit, grad and vmap.

    Reverse mode keeps the state of every step of a rollout up to `KEPT_STEPS`; of a longer one it keeps about
    sqrt(steps) states and computes the stretches between them again, so memory grows with the square root of
    the length. Nothing is raised inside: look at `failures`.

    Args:
        simulation: from `jaxdem.build`.
        parameters: what one may differentiate by.
        state: to start from.
        neighbors: its neighbour list.
        steps: number of coupling intervals.
        observe: function of the state, evaluated after each step.
        reversible: False for a rollout that is not differentiated in reverse mode: the numbers are the same to
            rounding, in about half the time.

    Raises:
        InputError: an argument is of another kind, or `steps` is negative or no whole number. Or gravity has a
            component along a periodic axis of a fluid that the scene does not drive. That is seen where gravity is a
            number; traced (as an argument under jit, grad or vmap) it has no value.
    """
    _require(simulation, parameters, state, neighbors, steps, observe)
    if not isinstance(reversible, (bool, np.bool_)):
        raise InputError("reversible", reversible, "is neither True nor False", "give one of them")
    if simulation.fluid is not None and not isinstance(parameters.gravity, jax.core.Tracer):
        drive = simulation.fluid.solver.drive
        driven = (False,) * len(simulation.periodic) if drive is None else drive.driven
        largest = np.abs(np.atleast_2d(np.asarray(parameters.gravity))).max(axis=0)
        check_gravity(largest.tolist(), driven, simulation.periodic)
    if reversible:
        simulation = simulation.reversible()
    measure = None if observe is None else (lambda state, _: observe(state))
    return measured_rollout(simulation, parameters, state, neighbors, steps, measure)


def _require(
    simulation: object, parameters: object, state: object, neighbors: object, steps: object, observe: object
) -> None:
    """Refuses arguments that are of another kind, such as two in the wrong order."""
    require_built(simulation, parameters)
    remedy = "give both as jaxdem.initial_state makes them: state, neighbors"
    require_kinds(remedy, state=(state, State))
    if isinstance(simulation, Simulation) and simulation.contact is not None:
        require_kinds(remedy, neighbors=(neighbors, Neighbors))
    if not is_whole(steps) or steps < 0:  # type: ignore[operator]
        raise InputError("steps", steps, "is no whole number from 0 up", "give the number of coupling intervals")
    if observe is not None and not callable(observe):
        raise InputError("observe", observe, "is no function of the state", "give one, or None")


def measured_rollout(
    simulation: Simulation,
    parameters: Parameters,
    state: State,
    neighbors: Neighbors | None,
    steps: int,
    measure: Callable[[State, Diagnostics], Any] | None,
    stop: Array | None = None,
) -> Rollout:
    """`rollout` with observations that also need what a step reports, such as the forces on the particles.

    Args:
        simulation: `Simulation.reversible` if the result is differentiated in reverse mode.
        parameters, state, neighbors, steps: as for `rollout`.
        measure: function of the state after a step and of its diagnostics.
        stop: () int32, the steps after so many are left out and their observations are zero; so runs of all lengths
            share one program, with the memory of the longest. None takes all `steps`.
    """

    def one(carry: Carry) -> tuple[Carry, Any]:
        state, neighbors, code = carry
        state, neighbors, diagnostics = simulation.step(parameters, state, neighbors)
        seen = None if measure is None else measure(state, diagnostics)
        return (state, neighbors, code | failures(simulation, diagnostics)), seen

    length = steps if steps <= KEPT_STEPS else math.isqrt(steps)
    count = -(-steps // max(length, 1))

    done, shapes = with_shapes(one)

    def none(carry: Carry) -> tuple[Carry, Any]:
        return carry, zeros_of(shapes(carry)[1])

    @jax.checkpoint
    def checked(carry: Carry, number: Array) -> tuple[Carry, Any]:
        # The last stretch is filled up with steps left out: a loop of its own would compile it all once more.
        if stop is None and count * length == steps:
            return one(carry)
        return lax.cond(number < (steps if stop is None else stop), done, none, carry)

    def stretch(carry: Carry, numbers: Array) -> tuple[Carry, Any]:
        return lax.scan(checked, carry, numbers)

    carry: Carry = (state, neighbors, jnp.zeros((), jnp.int32))
    numbers = jnp.arange(count * length)
    if count <= 1:
        carry, observations = stretch(carry, numbers)
        return Rollout(*carry, observations)
    carry, seen = lax.scan(jax.checkpoint(stretch), carry, numbers.reshape(count, length))
    observations = jax.tree.map(lambda a: a.reshape(-1, *a.shape[2:])[:steps], seen)
    return Rollout(*carry, observations)
