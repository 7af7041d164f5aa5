"""The network of a closure as a module of flax, for those who train it with a loop of their own.

Nothing of a run imports this: flax takes a second to import, and `closures.network` evaluates the same weights.
"""

from __future__ import annotations

from typing import Protocol

from flax import linen
from jax import Array

from jaxdem.closures.network import ACTIVATIONS, Weights, layer_name
from jaxdem.numerics.products import PRECISION


class Perceptron(linen.Module):
    """Dense layers with an activation between them, x_(k+1) = a(x_k W_k + b_k); the last one is linear.

    Attributes:
        widths: number of neurons of every layer, that of the outputs last.
        activation: a name of `ACTIVATIONS`.
    """

    widths: tuple[int, ...]
    activation: str

    @linen.compact
    def __call__(self, values: Array) -> Array:
        """(..., inputs) to (..., outputs)."""
        for number, width in enumerate(self.widths):
            values = linen.Dense(width, precision=PRECISION, param_dtype=values.dtype)(values)
            if number < len(self.widths) - 1:
                values = ACTIVATIONS[self.activation](values)
        return values


class Networked(Protocol):
    """A closure with a network: `PaperNetwork`, `InvariantClosure`, `SubgridClosure`."""

    @property
    def weights(self) -> Weights:
        """Kernel and bias of every layer."""
        ...

    @property
    def activation(self) -> str:
        """A name of `ACTIVATIONS`."""
        ...


def flax_module(closure: Networked) -> tuple[Perceptron, dict[str, Weights]]:
    """A closure's network as a module of flax, and its variables: `module.apply(variables, inputs)`.

    What has been trained goes back with `dataclasses.replace(closure, weights=variables["params"])`.
    """
    layers = [closure.weights[layer_name(number)] for number in range(len(closure.weights))]
    widths = tuple(layer["bias"].shape[0] for layer in layers)
    return Perceptron(widths, closure.activation), {"params": closure.weights}
