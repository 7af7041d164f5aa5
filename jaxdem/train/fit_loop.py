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
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax import Array

Progress = Callable[[int, int, float], None]
"""progress(epoch, epochs, loss), called about a hundred times during a training."""

SMALLEST = 1e-7
"""Floor inside the logarithmic and the relative loss, as Keras has it."""


def _mse(predicted: Array, target: Array) -> Array:
    return jnp.mean((predicted - target) ** 2)


def _mae(predicted: Array, target: Array) -> Array:
    return jnp.mean(jnp.abs(predicted - target))


def _msle(predicted: Array, target: Array) -> Array:
    difference = jnp.log1p(jnp.maximum(predicted, SMALLEST)) - jnp.log1p(jnp.maximum(target, SMALLEST))
    return jnp.mean(difference**2)


def _mape(predicted: Array, target: Array) -> Array:
    return 100.0 * jnp.mean(jnp.abs(predicted - target) / jnp.maximum(jnp.abs(target), SMALLEST))


def _log_cosh(predicted: Array, target: Array) -> Array:
    difference = predicted - target
    # ln cosh x = x + ln(1 + exp(-2 x)) - ln 2, which does not overflow
    return jnp.mean(difference + jax.nn.softplus(-2.0 * difference) - math.log(2.0))


LOSSES: dict[str, Callable[[Array, Array], Array]] = {
    "mse": _mse,
    "mae": _mae,
    "msle": _msle,
    "mape": _mape,
    "log_cosh": _log_cosh,
}
"""Losses by name: (predicted, target) of one shape to a mean. msle and mape are those of Keras (the source
paper's library), which sees negative values as zero in msle."""


Loss = Callable[[Any, Any], Array]
"""loss(weights, rows) of one network: a scalar. Losses that are equal share compiled programs."""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What training a network gave.

    Attributes:
        weights: trained, in the dtypes of those given.
        history: mean loss of every epoch; where it ends in a number that is not finite the training stopped there.
    """

    weights: Any
    history: list[float]

    @property
    def diverged(self) -> bool:
        """Whether the loss became something else than a finite number."""
        return not math.isfinite(self.history[-1])


def make_optimizer(updates: int | None) -> optax.GradientTransformation:
    """Adamax (0.9, 0.999, 1e-7) of learning rate 1, which falls to a hundredth along a cosine of so many updates.

    None: the rate is constant. All parameters are one vector to it, a few loops instead of a few for every layer. `minimize`
    multiplies by the learning rate, so that networks that differ in it share a program.

    Source: Kingma & Ba (2015), Adam: a method for stochastic optimization, algorithm 2.
    """
    rate: Any = 1.0 if updates is None else optax.cosine_decay_schedule(1.0, updates, alpha=0.01)
    return optax.flatten(optax.adamax(rate, b1=0.9, b2=0.999, eps=1e-7))


def minimize(
    loss: Loss,
    weights: Sequence[Any],
    data: Sequence[Any],
    *,
    batch: int,
    epochs: int,
    learning_rates: Sequence[float],
    schedule: str,
    seeds: Sequence[int],
    progress: Progress | None = None,
    mapped: bool | None = None,
) -> list[Outcome]:
    """Minimise the mean of loss(weights, rows) over shuffled batches of rows, for one or several networks at once.

    Every epoch draws a new order from each network's seed and leaves out the rows that do not fill a batch. An epoch
    is one compiled call; the host reads losses about a hundred times in all. A network whose loss is not finite is
    cut off in its outcome, and the others go on.

    Several networks are mapped inside one compiled epoch (`jax.vmap`) on an accelerator. On a CPU they go side by side, a
    thread each with the epoch of one network: mapped, what passes between the layers of all of them leaves the caches.

    Args:
        loss: see `Loss`; the same for all networks.
        weights: of every network; pytrees of arrays of the same shapes.
        data: for every network a pytree of arrays (M, ...), kept on the device.
        batch: rows in a batch; M if there are fewer.
        epochs: passes through the data.
        learning_rates: of Adamax, one a network.
        schedule: "constant" or "cosine".
        seeds: of the shuffling, one a network.
        progress: see `Progress`; epochs and loss are means over the networks.
        mapped: one program for all, or threads; None means whichever is faster here.

    Returns:
        The outcome of every network.
    """
    plan = _Plan(loss, batch, epochs, schedule)
    networks = list(zip(weights, data, learning_rates, seeds, strict=True))
    together = jax.default_backend() != "cpu" if mapped is None else mapped
    if together or len(networks) == 1:
        return _train(plan, networks, progress or (lambda *_: None), Event())
    return _side_by_side(plan, networks, progress)


class _Plan(NamedTuple):
    """What networks that are trained at once have in common; see `minimize`."""

    loss: Loss
    batch: int
    epochs: int
    schedule: str


def _side_by_side(plan: _Plan, networks: list[Any], progress: Progress | None) -> list[Outcome]:
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


def _train(plan: _Plan, networks: list[Any], progress: Progress, stop: Event) -> list[Outcome]:
    """Train networks, several of them mapped: (weights, data, learning rate, seed) each."""
    weights, data, learning_rates, seeds = zip(*networks, strict=True)
    rows = jax.tree.leaves(data[0])[0].shape[0]
    batch = min(plan.batch, rows)
    batches = rows // batch
    updates = plan.epochs * batches if plan.schedule == "cosine" else None
    optimizer, several = make_optimizer(updates), len(networks) > 1
    generators = [np.random.default_rng(seed) for seed in seeds]

    def stack(parts: Sequence[Any]) -> Any:
        return jax.tree.map(lambda *leaves: jnp.stack(leaves), *parts) if several else parts[0]

    # The epoch gives its carry's memory to its results; the caller's weights must survive that.
    carry = jax.tree.map(jnp.copy, stack([(w, optimizer.init(w)) for w in weights]))
    everything, rates = stack(data), stack([jnp.float32(rate) for rate in learning_rates])
    history: list[Any] = []
    chunk = max(1, plan.epochs // 100)
    for first in range(0, plan.epochs, chunk):
        losses = []
        for _ in range(first, min(first + chunk, plan.epochs)):
            # A sort on the device would take a sixth of the paper's epoch; the host's shuffle runs beside it.
            orders = [generator.permutation(rows)[: batches * batch] for generator in generators]
            order = stack([o.astype(np.int32).reshape(batches, batch) for o in orders])
            carry, value = _epoch(carry, everything, order, rates, plan.loss, updates, several)
            losses.append(value)
        history += [np.atleast_1d(value) for value in jax.device_get(losses)]
        progress(len(history), plan.epochs, float(np.mean(history[-1])))
        if stop.is_set() or not np.isfinite(history[-1]).any():
            break
    return _outcomes(carry[0], np.array(history, np.float64), len(networks))


def _outcomes(weights: Any, history: np.ndarray, networks: int) -> list[Outcome]:
    """Weights and losses by network."""
    outcomes = []
    for number in range(networks):
        own = jax.tree.map(lambda leaf, n=number: leaf[n], weights) if networks > 1 else weights
        losses = history[:, number]
        finite = np.isfinite(losses)
        end = len(losses) if finite.all() else int(np.argmin(finite)) + 1
        outcomes.append(Outcome(own, losses[:end].tolist()))
    return outcomes


@partial(jax.jit, static_argnums=(4, 5, 6), donate_argnums=0)
def _epoch(
    carry: Any, data: Any, order: Array, rate: Array, loss: Loss, updates: int | None, several: bool
) -> tuple[Any, Array]:
    """One pass through the data: weights, optimiser state, mean loss.

    Args:
        carry: weights and optimiser state.
        data: rows (M, ...).
        order: (batches, batch) rows of each batch.
        rate: learning rate.
        loss: see `Loss`.
        updates: see `make_optimizer`.
        several: whether all of the arrays have networks along a first axis.
    """
    optimizer = make_optimizer(updates)

    def epoch(carry: Any, data: Any, order: Array, rate: Array) -> tuple[Any, Array]:
        def update(carry: Any, picked: Array) -> tuple[Any, Array]:
            weights, state = carry
            selected = jax.tree.map(lambda leaf: leaf[picked], data)
            value, slopes = jax.value_and_grad(loss)(weights, selected)
            changes, state = optimizer.update(slopes, state, weights)
            weights = jax.tree.map(lambda leaf, change: leaf + rate * change, weights, changes)
            return (weights, state), value

        carry, values = jax.lax.scan(update, carry, order)
        return carry, jnp.mean(values)

    return (jax.vmap(epoch) if several else epoch)(carry, data, order, rate)
