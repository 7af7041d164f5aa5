"""The networks as they are trained: samples along columns, so that every product is of the kind that XLA:CPU does fast.

The gradient by a weight matrix is a product over the samples. With samples along rows its left factor has to be read
across, for which XLA:CPU falls back on a library that takes twice as long; with samples along columns it has not,
and what is read across is a weight matrix, a few thousand numbers that are copied.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import Array
from jax.lax import optimization_barrier

from jaxdem.closures.network import ACTIVATIONS, Weights, layer_name
from jaxdem.numerics.products import PRECISION


@jax.custom_vjp
def _product(kernel: Array, columns: Array) -> Array:
    """(outputs, M) of a kernel (inputs, outputs) and columns (inputs, M)."""
    # Without the barrier XLA folds the transposition into the product, which is then the slow kind.
    return jnp.matmul(optimization_barrier(kernel.T), columns, precision=PRECISION)


def _product_forward(kernel: Array, columns: Array) -> tuple[Array, tuple[Array, Array]]:
    return _product(kernel, columns), (kernel, columns)


def _product_backward(kept: tuple[Array, Array], slope: Array) -> tuple[Array, Array]:
    kernel, columns = kept
    return jnp.matmul(columns, slope.T, precision=PRECISION), jnp.matmul(kernel, slope, precision=PRECISION)


_product.defvjp(_product_forward, _product_backward)


def network_columns(weights: Weights, activation: str, columns: Array) -> Array:
    """Outputs (outputs, M) of a network with the given weights from its inputs (inputs, M).

    The same numbers as the closure's own evaluation, to rounding; reverse mode only.
    """
    last = len(weights) - 1
    for layer in range(len(weights)):
        parameters = weights[layer_name(layer)]
        columns = _product(parameters["kernel"], columns) + parameters["bias"][:, None]
        if layer < last:
            columns = ACTIVATIONS[activation](columns)
    return columns
