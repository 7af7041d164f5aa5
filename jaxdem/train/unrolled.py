"""Coarse runs unrolled from frames of a reference: their loss, and its gradient by the weights of closures.

    loss = mean over observables and times of mean((m - m_ref)^2) / s^2,

with s the mean size of m_ref over the reference.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.errors import required
from jaxdem.failures import Failure
from jaxdem.particles.neighbors import Neighbors, Room
from jaxdem.run.differentiable import measured_rollout
from jaxdem.state import Diagnostics, State
from jaxdem.train.closures import Closures, Weights
from jaxdem.train.observables import Observables
from jaxdem.train.reference import CoarseCase

ENLARGEMENTS = 4
"""So often a run gets more room for its neighbour list, five times as much in the end; then it has blown up."""


class Unrolled:
    """Coarse runs from frames of the reference, their loss and its gradient."""

    def __init__(self, case: CoarseCase, closures: Closures, longest: int):
        self.case, self.closures, self.longest = case, closures, longest
        self.scales = jax.tree.map(_mean_size, case.targets)
        self.room: Room | None = None
        self.forward_runs = self.resizes = 0
        self._states: dict[int, State] = {}
        self._listed: dict[int, tuple[State, Neighbors]] = {}
        # One program for all horizons: the gradient's takes a minute to compile.
        self._loss = jax.jit(self.loss_of_run)
        self._slope = jax.jit(jax.value_and_grad(self.loss_of_run, has_aux=True))

    def loss(self, weights: Weights, index: int, outputs: int) -> tuple[float, int]:
        """Loss of the run from frame `index` over some outputs, and its failure flags."""
        (value, code), _ = self._evaluated(False, weights, index, outputs)
        return value, code

    def slope(self, weights: Weights, index: int, outputs: int) -> tuple[float, int, Weights]:
        """`loss`, and its gradient by the weights."""
        (value, code), slopes = self._evaluated(True, weights, index, outputs)
        return value, code, slopes

    def loss_of_run(
        self, weights: Weights, state: State, neighbors: Neighbors, targets: Observables, outputs: Array
    ) -> tuple[Array, Array]:
        """Loss and failure flags as a pure function of the weights; see the module.

        Args:
            weights: of the closures that are trained.
            state, neighbors: to start from.
            targets: of the coming outputs, as many as the longest horizon has.
            outputs: () int32, how many of them count.
        """
        case, longest = self.case, len(targets.runoff)
        parameters = self.closures.with_weights(weights).put_into(case.parameters)

        def measure(state: State, diagnostics: Diagnostics) -> Observables:
            drag = required(diagnostics.forces, "exchange").drag
            return case.observe(required(state.particles, "particles"), state.fluid, drag)

        each, simulation = case.per_output, case.simulation.reversible()
        result = measured_rollout(simulation, parameters, state, neighbors, longest * each, measure, outputs * each)
        counts = jnp.arange(longest) < outputs

        def term(observed: Array, target: Array, scale: Array) -> Array:
            squared = ((observed[each - 1 :: each] - target) / scale) ** 2
            of_time = squared if squared.ndim == 1 else jnp.mean(squared, axis=1)
            return jnp.sum(jnp.where(counts, of_time, 0.0)) / outputs

        terms = jax.tree.leaves(jax.tree.map(term, result.observations, targets, self.scales))
        return jnp.mean(jnp.stack(terms)), result.failures

    def _evaluated(self, sloped: bool, weights: Weights, index: int, outputs: int) -> tuple[tuple[float, int], Weights]:
        """A compiled call; on overflow of the neighbour list again, with more room, `ENLARGEMENTS` times at most."""
        # Beyond the horizon any row will do; it does not count.
        rows = np.minimum(np.arange(index + 1, index + 1 + self.longest), self.case.run.number_of_frames - 1)
        targets = jax.tree.map(lambda m: m[rows], self.case.targets)
        program = self._slope if sloped else self._loss
        self._start(index)
        before = self.room
        for left in reversed(range(ENLARGEMENTS + 1)):
            state, neighbors = self._start(index)
            self.forward_runs += 1
            result = program(weights, state, neighbors, targets, jnp.asarray(outputs, jnp.int32))
            (value, code), slopes = result if sloped else (result, {})
            if not int(code) & Failure.OVERFLOW:
                break
            # In the end grains lie in a heap or fly at a wall: the update failed, and others need no room of that size.
            self.room = neighbors.room.enlarged() if left else before
            self.resizes += left > 0
        return (float(value), int(code)), slopes

    def _start(self, index: int) -> tuple[State, Neighbors]:
        """State and list of a frame; all lists have the same room, so that they share their programs."""
        if index not in self._states:
            self._states[index] = self.case.start(index)
            needed = self.case.with_list(self._states[index])[1].room
            self.room = needed if self.room is None else needed.covering(self.room)
        if index not in self._listed or self._listed[index][1].room != self.room:
            self._listed[index] = self.case.with_list(self._states[index], self.room)
        return self._listed[index]


def _mean_size(values: Array) -> Array:
    """Mean over times of the size of an observable, and of its largest element where it is a profile."""
    sizes = jnp.abs(values) if values.ndim == 1 else jnp.max(jnp.abs(values), axis=1)
    return jnp.maximum(jnp.mean(sizes), jnp.finfo(values.dtype).tiny)
