"""A learned closure of the momentum that the flow within a coarse cell carries."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from functools import partial
from numbers import Real

import jax
import jax.numpy as jnp
from jax import Array

from jaxdem.closures.network import Weights, initial_weights, layer_name, perceptron
from jaxdem.errors import InputError

LARGEST_VISCOSITY = 0.1
"""Of c_1, a Smagorinsky constant of 0.32."""
LEAST_VISCOSITY = -0.02
"""Of c_1: as far below zero as the numerical viscosity of the advection at extrema, |u| h / 2, carries."""
VISCOSITY_SLOPE = 0.05
"""Of c_1 by the network's output, where that is zero."""
LARGEST_GRADIENT = 0.25
"""Of |c_n|: three times what the mean of a smooth field over a cell gives."""

FEATURES = 4
OUTPUTS = 2


@partial(jax.tree_util.register_dataclass, data_fields=["weights"], meta_fields=["hidden", "activation"])
@dataclasses.dataclass(frozen=True, eq=False)
class SubgridClosure:
    """Coefficients of the subgrid stress of `jaxdem.fluid.subgrid_stress` from invariants of the coarse flow.

    tau_ij = 2 c_1 Delta^2 |S| S_ij - c_n sum_k h_k^2 du_i/dx_k du_j/dx_k, with (n_1, n_2) = network(x) and
    c_1    0.1 tanh(n_1 / 2) where n_1 > 0, else 0.02 tanh(5 n_1 / 2), so that it lies in (-0.02, 0.1),
    c_n    tanh(n_2) / 4.
    The features x, from |S| = sqrt(2 S:S), |W| = sqrt(2 W:W) of the rotation rate, the filter size Delta and the
    void fraction g:
    ln(1 + |S| Delta^2 / nu) / 10;  |W| / (|S| + |W|), 0 at rest;  g;  Delta |grad g|.

    The last layer starts at zero: the untrained closure gives no stress. Nothing but gradients enters, so the stress
    is zero in a uniform flow, the same in a frame of constant velocity, and turns with the flow. Both bounds hold
    for any weights, and it has no range of its own: outside of what it was trained on it is what its network
    extends to, within the bounds.

    Attributes:
        weights: of the network.
        hidden: widths of the hidden layers.
        activation: a name of `ACTIVATIONS`.
    """

    weights: Weights
    hidden: tuple[int, ...]
    activation: str

    @classmethod
    def initial(cls, hidden: Sequence[int] = (8, 8), activation: str = "elu", seed: int = 0) -> SubgridClosure:
        """A closure that gives no stress yet.

        Raises:
            InputError: see `initial_weights`.
        """
        weights = initial_weights(FEATURES, hidden, OUTPUTS, activation, seed, zero_last=True)
        return cls(weights, tuple(hidden), activation)

    @classmethod
    def constant(
        cls, viscosity: float, gradient: float, hidden: Sequence[int] = (8, 8), seed: int = 0
    ) -> SubgridClosure:
        """A closure that gives the same c_1 and c_n everywhere, until it is trained: (0, 1/12) is the gradient model.

        Args:
            viscosity: c_1 [-].
            gradient: c_n [-].
            hidden: widths of the hidden layers.
            seed: of their weights.

        Raises:
            InputError: a coefficient that is no number, or not within its bounds.
        """
        for name, value in (("viscosity", viscosity), ("gradient", gradient)):
            if isinstance(value, bool) or not isinstance(value, Real):
                raise InputError(name, value, "is no number", "Give one.")
        bound = LARGEST_VISCOSITY if viscosity > 0 else -LEAST_VISCOSITY
        for name, value, limit in (("viscosity", viscosity, bound), ("gradient", gradient, LARGEST_GRADIENT)):
            if not abs(value) < limit:
                raise InputError(name, value, f"must be less than {limit:g} in size", "Choose another.")
        closure = cls.initial(hidden, seed=seed)
        last = layer_name(len(hidden))
        bias = (bound / VISCOSITY_SLOPE * math.atanh(viscosity / bound), math.atanh(gradient / LARGEST_GRADIENT))
        layer = closure.weights[last] | {"bias": jnp.asarray(bias, jnp.float32)}
        return dataclasses.replace(closure, weights=closure.weights | {last: layer})

    def __call__(
        self,
        strain_rate: Array,
        rotation_rate: Array,
        filter_size: Array,
        viscosity: Array,
        void_fraction: Array,
        void_fraction_gradient: Array,
    ) -> tuple[Array, Array]:
        """(c_1, c_n), each of the shape of the strain rate.

        Args:
            strain_rate: |S| [1/s].
            rotation_rate: |W| [1/s].
            filter_size: () Delta [m].
            viscosity: () kinematic, positive [m2/s].
            void_fraction: g [-].
            void_fraction_gradient: |grad g| [1/m].
        """
        total = strain_rate + rotation_rate
        features = jnp.stack(
            [
                0.1 * jnp.log1p(strain_rate * filter_size**2 / viscosity),
                rotation_rate / jnp.where(total > 0, total, 1.0),
                void_fraction,
                filter_size * void_fraction_gradient,
            ],
            axis=-1,
        )
        output = perceptron(self.weights, self.activation, features)
        return _viscosity_coefficient(output[..., 0]), LARGEST_GRADIENT * jnp.tanh(output[..., 1])


def _viscosity_coefficient(output: Array) -> Array:
    """c_1: of one slope at zero, towards `LARGEST_VISCOSITY` above and `LEAST_VISCOSITY` below."""
    bound = jnp.where(output > 0, LARGEST_VISCOSITY, -LEAST_VISCOSITY)
    return bound * jnp.tanh(VISCOSITY_SLOPE * output / bound)
