"""A level of a closure of neighbours: from moments to force and torque."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.closures.neighbor_range import CONDITIONS
from jaxdem.closures.network import Weights, apply_in_parts, initial_weights, perceptron
from jaxdem.numerics.products import PRECISION

LARGEST = 10.0
"""Bound of the fluctuation, in units of the scatter."""
ORDER = 3
"""Largest order of the moments."""


class Width(NamedTuple):
    """Sizes of a level: channels of order zero, channels of the others, and widths of the hidden layers."""

    scalars: int
    channels: int
    hidden: tuple[int, ...]


LARGE = Width(70, 16, (128, 128, 128))


@partial(
    jax.tree_util.register_dataclass,
    data_fields=["mixing", "offset", "direct", "weights"],
    meta_fields=["channels", "activation"],
)
@dataclasses.dataclass(frozen=True, eq=False)
class Level:
    """From moments to force and torque: channels are mixed, and a network weighs their products.

    B_0 = A_0 M_0 + offset, and for orders m > 0 the complex B_m = A_m M_m. From the invariants
        B_0, |B_m|^2, Re(B_2 B_1*^2), Re(B_3 B_2* B_1*), Re and solid fraction
    the network gives the force along the axis, to which B_0 . direct is added, and factors of vectors across it: of
    B_1, of further channels of order one, and of B_2 B_1*. Their sum is the force across; another sum, turned by a
    right angle, is the torque across. The torque about the axis is a sum of Im(V B_1*), V the further channels. So
    force and torque turn with the neighbours about the axis and are mirrored with them (a torque as an axial vector),
    whatever the weights are.

    Attributes:
        mixing: M_m (C_m, channels) of each order: of order zero (C_0, scalars), of order one three times as many.
        offset: of B_0 (scalars,).
        direct: weights of B_0 in the force along the axis (scalars,).
        weights: of the network.
        channels: their number.
        activation: a name of `ACTIVATIONS`.
    """

    mixing: tuple[Array, ...]
    offset: Array
    direct: Array
    weights: Weights
    channels: int
    activation: str

    @classmethod
    def initial(cls, counts: Sequence[int], width: Width, seed: int = 0) -> Level:
        """Random weights, drawn on the host; `counts` are the C_m."""
        generator, (scalars, channels, hidden) = np.random.default_rng(seed), width
        sizes = (scalars, 3 * channels, *(channels,) * (ORDER - 1))
        mixing = tuple(
            jnp.asarray(generator.normal(0.0, count**-0.5, (count, size)), jnp.float32)
            for count, size in zip(counts, sizes, strict=True)
        )
        weights = initial_weights(CONDITIONS + scalars + 5 * channels, hidden, 1 + 9 * channels, "silu", seed)
        none = jnp.zeros(scalars, jnp.float32)
        return cls(mixing, none, none, weights, channels, "silu")

    @property
    def width(self) -> Width:
        """Sizes of the level."""
        layers = [layer["bias"].shape[0] for layer in self.weights.values()]
        return Width(self.offset.shape[0], self.channels, tuple(layers[:-1]))

    def mixed(self, moments: Sequence[Array], further: bool = False) -> tuple[Array, ...]:
        """Channels (N, P, channels) of each order, without offset.

        A level mixes `moments` and, if it is the second, `carried_moments` behind them: all together, or a part and the
        other, whose sum it then is.

        Args:
            moments: of each order (N, P, C).
            further: whether they are the last ones of the level, and not the first.
        """
        found = []
        for part, matrix in zip(moments, self.mixing[: len(moments)], strict=True):
            rows = matrix[-part.shape[2] :] if further else matrix[: part.shape[2]]
            flat = part.reshape(part.shape[0] * part.shape[1], part.shape[2])
            product = jnp.dot(flat, rows.astype(part.dtype), precision=PRECISION)
            found.append(product.reshape(*part.shape[:2], rows.shape[1]))
        return tuple(found)

    def values(self, mixed: Sequence[Array], known: Array) -> Array:
        """(N, 6) force along, across (2), torque about, across (2), in units of the scatter.

        Args:
            mixed: from `mixed`.
            known: (N, 3), see `conditions`.
        """
        shifted = (mixed[0] + self.offset.astype(mixed[0].dtype)[None, None], *mixed[1:])
        invariants, vectors, axial = _products(shifted, self.channels)
        inputs = jnp.concatenate([known, invariants], axis=1)

        def network(rows: Array) -> Array:
            return perceptron(self.weights, self.activation, rows)

        # An exported module is for any number of spheres, which cannot be divided into parts.
        given = apply_in_parts(network, inputs) if isinstance(inputs.shape[0], int) else network(inputs)
        count = vectors.shape[2]
        force = jnp.sum(given[:, None, 1 : 1 + count] * vectors, axis=2) / count
        turned = jnp.sum(given[:, None, 1 + count : 1 + 2 * count] * vectors, axis=2) / count
        about = jnp.sum(given[:, 1 + 2 * count :] * axial, axis=1) / axial.shape[1]
        torque = jnp.stack([about, -turned[:, 1], turned[:, 0]], axis=1)
        direct = jnp.dot(shifted[0][:, 0], self.direct.astype(given.dtype)[:, None], precision=PRECISION)
        along = given[:, 0] + direct[:, 0]
        return jnp.concatenate([bounded(along[:, None]), bounded(force), bounded(torque)], axis=1)


def bounded(vector: Array) -> Array:
    """The vectors (N, D), shortened smoothly so that they stay within `LARGEST`: x / (1 + |x/L|^4)^(1/4) [-]."""
    squared = jnp.sum(vector**2, axis=1, keepdims=True) / LARGEST**2
    return vector / (1.0 + squared**2) ** 0.25


def _products(mixed: tuple[Array, ...], channels: int) -> tuple[Array, Array, Array]:
    """Invariants (N, scalars + 5 channels), vectors across (N, 2, 4 channels), and pseudoscalars (N, channels)."""
    scalars = mixed[0][:, 0]
    x1, y1 = mixed[1][:, 0, :channels], mixed[1][:, 1, :channels]
    further = mixed[1][:, :, channels:]
    (x2, y2), (x3, y3) = ((part[:, 0], part[:, 1]) for part in mixed[2:4])
    # B_2 B_1*, a vector, and its products.
    x, y = x2 * x1 + y2 * y1, y2 * x1 - x2 * y1
    triple = (x3 * x1 + y3 * y1) * x2 + (y3 * x1 - x3 * y1) * y2
    squares = [x1 * x1 + y1 * y1, x2 * x2 + y2 * y2, x3 * x3 + y3 * y3, x * x1 + y * y1, triple]
    invariants = jnp.concatenate([scalars, *(3.0 * jnp.tanh(square / 3.0) for square in squares)], axis=1)
    vectors = jnp.concatenate([further, jnp.stack([x, y], axis=1) / 3.0, jnp.stack([x1, y1], axis=1)], axis=2)
    axial = x1 * further[:, 1, :channels] - y1 * further[:, 0, :channels]
    return invariants, vectors, axial
