"""The optimisation loop of the fits: epochs of shuffled batches, compiled, with the data on the device.

Networks of the same shapes are trained together: mapped inside one compiled epoch, or side by side in threads.
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from threading import Event
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax import Array

Progress = Callable[[int, int, float], None]
"""progress(epoch, epochs, loss), called about a hundred times during a training."""

SMALLEST = 1e-7
"""Floor inside the logarithmic and the relative loss, as Keras has it."""


def _msle(predicted: Array, target: Array) -> Array:
    difference = jnp.log1p(jnp.maximum(predicted, SMALLEST)) - jnp.log1p(jnp.maximum(target, SMALLEST))
    return jnp.mean(difference**2)


def _log_cosh(predicted: Array, target: Array) -> Array:
    difference = predicted - target
    # ln cosh x = x + ln(1 + exp(-2 x)) - ln 2, which does not overflow
    return jnp.mean(difference + jax.nn.softplus(-2.0 * difference) - math.log(2.0))


LOSSES: dict[str, Callable[[Array, Array], Array]] = {
    "mse": lambda predicted, target: jnp.mean((predicted - target) ** 2),
    "mae": lambda predicted, target: jnp.mean(jnp.abs(predicted - target)),
    "msle": _msle,
    "mape": lambda predicted, target: (
        100.0 * jnp.mean(jnp.abs(predicted - target) / jnp.maximum(jnp.abs(target), SMALLEST))
    ),
    "log_cosh": _log_cosh,
}
"""Losses by name: (predicted, target) of one shape to a mean. msle and mape are those of Keras (the source
paper's library), which sees negative values as zero in msle."""

Tree = Any
"""A pytree of arrays; JAX has no type for it."""
Loss = Callable[[Tree, Tree], Array]
"""loss(weights, rows) of one network: a scalar. Losses that are equal share compiled programs."""


@dataclasses.dataclass(frozen=True)
class Plan:
    """What networks that are trained at once have in common.

    Attributes:
        loss: see `Loss`.
        batch: rows in a batch; all of them if there are fewer.
        epochs: passes through the data.
        schedule: of the learning rate, "constant" or "cosine".
    """

    loss: Loss
    batch: int
    epochs: int
    schedule: str


@dataclasses.dataclass(frozen=True, eq=False)
class Network:
    """A network to train.

    Attributes:
        weights: pytree of arrays, of the same shapes in all networks that are trained at once.
        data: pytree of arrays (M, ...), kept on the device; of the same shapes too.
        learning_rate: of Adamax.
        seed: of the shuffling.
    """

    weights: Tree
    data: Tree
    learning_rate: float
    seed: int


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What training a network gave.

    Attributes:
        weights: trained, in the dtypes of those given.
        history: mean loss of every epoch; where it ends in a number that is not finite the training stopped there.
    """

    weights: Tree
    history: list[float]

    @property
    def diverged(self) -> bool:
        """Whether the loss became something else than a finite number."""
        return not math.isfinite(self.history[-1])


def minimize(
    plan: Plan, networks: Sequence[Network], progress: Progress | None = None, mapped: bool | None = None
) -> list[Outcome]:
    """Minimise the mean of loss(weights, rows) over shuffled batches of rows, for one or several networks at once.

    Every epoch draws a new order from each network's seed and leaves out the rows that do not fill a batch. An epoch
    is one compiled call; the host reads losses about a hundred times in all. A network whose loss is not finite is
    cut off in its outcome, and the others go on.

    Several networks are mapped inside one compiled epoch (`jax.vmap`) on an accelerator. On a CPU they go side by side,
    a thread each with the epoch of one network: mapped, what passes between all their layers leaves the caches.

    Args:
        plan: of all networks.
        networks: at least one.
        progress: see `Progress`; epochs and loss are means over the networks.
        mapped: one program for all, or threads; None means whichever is faster here.
    """
    together = jax.default_backend() != "cpu" if mapped is None else mapped
    if together or len(networks) == 1:
        return _train(plan, networks, progress or (lambda *_: None), Event())
    return _side_by_side(plan, networks, progress)


def _side_by_side(plan: Plan, networks: Sequence[Network], progress: Progress | None) -> list[Outcome]:
    """A thread for every network, as many at a time as there are processors."""
    stop, reached = Event(), [(0, math.nan)] * len(networks)

    def train(number: int) -> Outcome:
        def report(epoch: int, _: int, loss: float) -> None:
            reached[number] = (epoch, loss)
            if progress is not None:
                done, losses = np.transpose([one for one in reached if one[0]])
                progress(int(done.sum()) // len(networks), plan.epochs, float(losses.mean()))

        return _train(plan, [networks[number]], report, stop)[0]

    with ThreadPoolExecutor(min(len(networks), os.cpu_count() or 1)) as threads:
        try:
            return list(threads.map(train, range(len(networks))))
        except BaseException:
            stop.set()  # or an interrupted search would wait for trainings of hours
            raise


def _train(plan: Plan, networks: Sequence[Network], progress: Progress, stop: Event) -> list[Outcome]:
    """Train networks, several of them mapped."""
    rows = jax.tree.leaves(networks[0].data)[0].shape[0]
    batch = min(plan.batch, rows)
    batches = rows // batch
    several = len(networks) > 1
    epoch = _Epoch(plan.loss, plan.epochs * batches if plan.schedule == "cosine" else None, several)
    generators = [np.random.default_rng(network.seed) for network in networks]

    def stack(parts: Sequence[Tree]) -> Tree:
        return jax.tree.map(lambda *leaves: jnp.stack(leaves), *parts) if several else parts[0]

    # The epoch gives its carry's memory to its results; the caller's weights must survive that.
    carry = jax.tree.map(jnp.copy, stack([(n.weights, epoch.optimizer.init(n.weights)) for n in networks]))
    data, rates = stack([n.data for n in networks]), stack([jnp.float32(n.learning_rate) for n in networks])
    history: list[np.ndarray] = []
    chunk = max(1, plan.epochs // 100)
    for first in range(0, plan.epochs, chunk):
        losses = []
        for _ in range(first, min(first + chunk, plan.epochs)):
            # A sort on the device would take a sixth of the paper's epoch; the host's shuffle runs beside it.
            orders = [generator.permutation(rows)[: batches * batch] for generator in generators]
            order = stack([o.astype(np.int32).reshape(batches, batch) for o in orders])
            carry, value = epoch.run(carry, data, order, rates)
            losses.append(value)
        history += [np.atleast_1d(value) for value in jax.device_get(losses)]
        progress(len(history), plan.epochs, float(np.mean(history[-1])))
        if stop.is_set() or not np.isfinite(history[-1]).any():
            break
    trained = (
        [jax.tree.map(lambda leaf, n=n: leaf[n], carry[0]) for n in range(len(networks))] if several else carry[:1]
    )
    return [Outcome(*pair) for pair in zip(trained, map(_until_not_finite, np.transpose(history)), strict=True)]


def _until_not_finite(losses: np.ndarray) -> list[float]:
    """Losses by epoch, up to the first that is not finite."""
    finite = np.isfinite(losses)
    end = len(losses) if finite.all() else int(np.argmin(finite)) + 1
    return losses[:end].astype(np.float64).tolist()


@dataclasses.dataclass(frozen=True)
class _Epoch:
    """One pass through the data, compiled once for equal ones.

    Attributes:
        loss: see `Loss`.
        updates: over which the learning rate falls to a hundredth along a cosine; None if it is constant.
        several: whether all arrays have networks along a first axis.
    """

    loss: Loss
    updates: int | None
    several: bool

    @property
    def optimizer(self) -> optax.GradientTransformation:
        """Adamax (0.9, 0.999, 1e-7) of learning rate 1; a network's own rate is multiplied to its changes.

        So networks that differ in the rate share a program. All parameters are one vector to it, a few loops instead
        of a few for every layer.

        Source: Kingma & Ba (2015), Adam: a method for stochastic optimization, algorithm 2.
        """
        rate: Any = 1.0 if self.updates is None else optax.cosine_decay_schedule(1.0, self.updates, alpha=0.01)
        return optax.flatten(optax.adamax(rate, b1=0.9, b2=0.999, eps=1e-7))

    @partial(jax.jit, static_argnums=0, donate_argnums=1)
    def run(self, carry: Tree, data: Tree, order: Array, rate: Array) -> tuple[Tree, Array]:
        """Weights and optimiser state after the epoch, and its mean loss; `order` (batches, batch) has the rows."""
        optimizer = self.optimizer

        def epoch(carry: Tree, data: Tree, order: Array, rate: Array) -> tuple[Tree, Array]:
            def update(carry: Tree, picked: Array) -> tuple[Tree, Array]:
                weights, state = carry
                selected = jax.tree.map(lambda leaf: leaf[picked], data)
                value, slopes = jax.value_and_grad(self.loss)(weights, selected)
                changes, state = optimizer.update(slopes, state, weights)
                weights = jax.tree.map(lambda leaf, change: leaf + rate * change, weights, changes)
                return (weights, state), value

            carry, values = jax.lax.scan(update, carry, order)
            return carry, jnp.mean(values)

        return (jax.vmap(epoch) if self.several else epoch)(carry, data, order, rate)
