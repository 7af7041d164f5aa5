"""The optimisation loop of the fits: epochs of shuffled batches, compiled, with the data on the device."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax import Array

from jaxdem.errors import RunError

Progress = Callable[[int, int, float], None]
"""progress(epoch, epochs, loss), called about a hundred times during a fit."""

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


def make_optimizer(
    learning_rate: float, schedule: str, updates: int
) -> optax.GradientTransformationExtraArgs:
    """Adamax (0.9, 0.999, 1e-7) with a constant rate or one that falls to a hundredth along a cosine.

    Source: Kingma & Ba (2015), Adam: a method for stochastic optimization, algorithm 2.
    """
    rate: Any = learning_rate
    if schedule == "cosine":
        rate = optax.cosine_decay_schedule(learning_rate, updates, alpha=0.01)
    return optax.adamax(rate, b1=0.9, b2=0.999, eps=1e-7)


def minimize(
    loss: Callable[[Any, Any], Array],
    weights: Any,
    data: Any,
    *,
    batch: int,
    epochs: int,
    learning_rate: float,
    schedule: str,
    seed: int,
    progress: Progress | None = None,
) -> tuple[Any, list[float]]:
    """Minimise the mean of loss(weights, rows) over shuffled batches of rows.

    Every epoch draws a new order from the seed and leaves out the rows that do not fill a batch. An epoch is
    one compiled call; the host reads losses about a hundred times in all.

    Args:
        loss: (weights, rows) to a scalar, rows being `data` with `batch` rows.
        weights: pytree of arrays; given back trained, in the same dtypes.
        data: pytree of arrays (M, ...), kept on the device.
        batch: rows in a batch; M if there are fewer.
        epochs: passes through the data.
        learning_rate: of Adamax.
        schedule: "constant" or "cosine".
        seed: of the shuffling.
        progress: see `Progress`.

    Returns:
        The weights, and the mean loss of every epoch.

    Raises:
        RunError: a loss is not finite.
    """
    rows = jax.tree.leaves(data)[0].shape[0]
    batch = min(batch, rows)
    batches = rows // batch
    optimizer = make_optimizer(learning_rate, schedule, epochs * batches)
    # The epoch gives its arguments' memory to its results; the caller's weights must survive that.
    weights = jax.tree.map(jnp.copy, weights)
    carry = (weights, jax.jit(optimizer.init)(weights))
    generator = np.random.default_rng(seed)
    started = time.perf_counter()
    history: list[float] = []
    epoch_of = jax.jit(partial(_epoch, loss, optimizer), donate_argnums=0)
    chunk = max(1, epochs // 100)
    for first in range(0, epochs, chunk):
        losses = []
        for _ in range(first, min(first + chunk, epochs)):
            # A sort on the device would take a sixth of the paper's epoch; the host's shuffle runs beside it.
            order = generator.permutation(rows)[: batches * batch].astype(np.int32)
            carry, value = epoch_of(carry, data, order.reshape(batches, batch))
            losses.append(value)
        history += [float(value) for value in jax.device_get(losses)]
        _check_finite(history, first, started)
        if progress is not None:
            progress(len(history), epochs, history[-1])
    return carry[0], history


def _check_finite(history: list[float], first: int, started: float) -> None:
    for epoch, value in enumerate(history[first:], first + 1):
        if not math.isfinite(value):
            remedy = "Lower the learning rate, or look for outliers in the dataset's forces."
            elapsed = time.perf_counter() - started
            raise RunError(f"the training loss is {value}, not finite", f"epoch {epoch}", elapsed, remedy)


def _epoch(
    loss: Callable[[Any, Any], Array],
    optimizer: optax.GradientTransformationExtraArgs,
    carry: Any,
    data: Any,
    order: Array,
) -> tuple[Any, Array]:
    """One pass through the data in the order (batches, batch): weights, optimiser state, mean loss."""

    def update(carry: Any, picked: Array) -> tuple[Any, Array]:
        weights, state = carry
        selected = jax.tree.map(lambda leaf: leaf[picked], data)
        value, slopes = jax.value_and_grad(loss)(weights, selected)
        changes, state = optimizer.update(slopes, state, weights)
        return (optax.apply_updates(weights, changes), state), value

    carry, values = jax.lax.scan(update, carry, order)
    return carry, jnp.mean(values)
