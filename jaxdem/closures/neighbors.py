"""The drag, side force and torque that the places of the neighbours add to a mean law."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.closures.base import Drag, DragInputs
from jaxdem.closures.correlation import Correlation
from jaxdem.closures.moments import MomentBasis, Offset, carried_counts, moments, with_wake
from jaxdem.closures.network import Weights, apply_in_parts, constant, initial_weights, perceptron
from jaxdem.closures.tang import Tang
from jaxdem.numerics.products import PRECISION

REYNOLDS = (2.0, 40.0)
"""Reynolds numbers of the superficial slip that the data have."""
SOLID_FRACTION = (0.1, 0.3)
"""Solid fractions that the data have."""
FADING = ((1.0, 80.0), (0.05, 0.4))
"""Reynolds numbers and solid fractions beyond the data at which nothing but the mean law is left."""
DENSEST = FADING[1][1]
"""Solid fraction from which on the mean law acts alone."""
SCALE = (0.25, 0.18, 0.01, 0.03)
"""Scatter of force along, force across, torque about and torque across before it is known, over the mean force."""
LARGEST = 10.0
"""Bound of the fluctuation, in units of the scatter."""
SMALLEST_MULTIPLE = 0.2
"""Multiple of the mean drag under which a lower one is approached exponentially, so that the drag stays positive."""
ORDER = 3
"""Largest order of the moments."""
CONDITIONS = 3
"""Inputs of the network beside the neighbours: ln Re, its square, and the solid fraction."""


class Response(NamedTuple):
    """What the neighbours of N spheres add, over the mean force of the whole fluid F (and F d for torques).

    Attributes:
        along: (N,) force along the slip [-].
        across: (N, 2) force along the two axes across it [-].
        torque: (N, 3) about the slip and the two axes across it [-].
        weight: (N,) 1 in the range of the data, 0 far from it; the others have it as a factor [-].
    """

    along: Array
    across: Array
    torque: Array
    weight: Array


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
        widths = (CONDITIONS + scalars + 5 * channels, *hidden, 1 + 9 * channels)
        none = jnp.zeros(scalars, jnp.float32)
        return cls(mixing, none, none, initial_weights(widths, "silu", seed), channels, "silu")

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


@partial(
    jax.tree_util.register_dataclass,
    data_fields=["levels", "scale", "mean"],
    meta_fields=["base", "basis", "carried", "wake"],
)
@dataclasses.dataclass(frozen=True, eq=False)
class NeighborClosure:
    """Mean law, and a fluctuation that the places of the neighbours give, for equal spheres in 3-D.

    The first level sees the neighbours' density about a sphere, expanded in distance and direction about its slip
    (`moments`). A second one, if there is one, sees in addition the same expansion of the force that the first gives
    for the neighbours (`carried_moments`): what shields a neighbour is felt beyond the reach.

    The fluctuation is one of the force of the whole fluid F over its mean at this Re and solid fraction. `mean` is
    taken from it, so that the mean over a homogeneous array is zero. It is zero without neighbours, and beyond the data
    it fades: see `range_weight`. Neighbours count up to `basis.reach` diameters, with value and slope zero there.

    Scale and mean are constants to differentiation. Called as a drag law, without neighbours, it is the mean law.

    Attributes:
        levels: one or two.
        scale: (4, 6) logarithms of the scatter of force along, force across, torque about and torque across in the
            data, over F and F d: factors of 1, a, s, a^2, a s, s^2, with a and s the first and last of `conditions`.
        mean: (8,) the same factors of the mean of the fluctuation, and those of s^3 and s^4 [-].
        base: mean law, of model A.
        basis: of the moments.
        carried: of the second level's moments of forces; None with one level.
        wake: of further moments of order zero and one, stretched along the slip, that both levels see; None for none.

    Source: ours, of moments as in R. Drautz, Phys. Rev. B 99 (2019) 014104, about an axis; data: arXiv 2507.20767.
    """

    levels: tuple[Level, ...]
    scale: Array
    mean: Array
    base: Correlation
    basis: MomentBasis
    carried: MomentBasis | None = None
    wake: MomentBasis | None = None

    @classmethod
    def initial(
        cls,
        basis: MomentBasis,
        carried: MomentBasis | None = None,
        widths: Sequence[Width] = (LARGE, LARGE),
        seed: int = 0,
        base: Correlation | None = None,
        wake: MomentBasis | None = None,
    ) -> NeighborClosure:
        """Random weights, which the host draws; the bases have orders `ORDER`, two and one, the widths are of each
        level."""
        counts = [basis.count(order) for order in range(ORDER + 1)]
        if wake is not None:
            counts[:2] = [count + wake.count(order) for order, count in enumerate(counts[:2])]
        levels = [Level.initial(counts, widths[0], seed)]
        if carried is not None:
            zero, one = carried_counts(carried)
            further = [counts[0] + zero, counts[1] + one, *counts[2:]]
            levels.append(Level.initial(further, widths[1], seed + 1))
        scale = np.zeros((4, 6), np.float32)
        scale[:, 0] = np.log(SCALE)
        law = Tang() if base is None else base
        return cls(tuple(levels), jnp.asarray(scale), jnp.zeros(8, jnp.float32), law, basis, carried, wake)

    @property
    def reach(self) -> float:
        """Diameters within which neighbours count [-]."""
        return max(basis.length for basis in (self.basis, self.carried, self.wake) if basis is not None)

    @property
    def half_box(self) -> float:
        """Half of the narrowest periodic box of data for it [diameters]: within it each neighbour counts once, and in
        a wake, which is narrow, its images along the stream beside it, but not the sphere's own."""
        round_ones = max(basis.reach for basis in (self.basis, self.carried, self.wake) if basis is not None)
        return round_ones if self.wake is None else max(round_ones, 0.5 * self.wake.length)

    def moments(self, offset: Offset, present: Array) -> tuple[Array, ...]:
        """What the first level mixes: the moments of `basis`, and those of `wake` behind them; see `moments`."""
        found = moments(self.basis, offset, present)
        return found if self.wake is None else with_wake(found, moments(self.wake, offset, present))

    def __call__(self, inputs: DragInputs) -> Drag:
        """The mean law, with `out_of_range` where less than half of the fluctuation would act."""
        drag = self.base(inputs)
        outside = range_weight(inputs.reynolds, inputs.solid_fraction) < 0.5
        return drag._replace(out_of_range=drag.out_of_range | outside)

    def response(self, values: Array, crowd: Array, reynolds: Array, solid_fraction: Array) -> Response:
        """The fluctuation.

        Args:
            values: (N, 6) of the last level.
            crowd: (N,) the moment of n = l = m = 0, a number of neighbours [-].
            reynolds: (N,) of the superficial slip [-].
            solid_fraction: (N,) of the surroundings at large [-].
        """
        weight = range_weight(reynolds, solid_fraction) * presence(crowd)
        known = quartic(conditions(reynolds, solid_fraction))
        factors = constant(self.scale, values.dtype)
        scale = jnp.exp(jnp.dot(known[:, :6], factors.T, precision=PRECISION))
        along = scale[:, 0] * values[:, 0] - jnp.sum(known * constant(self.mean, values.dtype)[None], axis=1)
        across = scale[:, 1:2] * values[:, 1:3]
        torque = jnp.concatenate([scale[:, 2:3] * values[:, 3:4], scale[:, 3:] * values[:, 4:]], axis=1)
        return Response(weight * along, weight[:, None] * across, weight[:, None] * torque, weight)


def quartic(known: Array) -> Array:
    """(N, 8) terms 1, a, s, a^2, a s, s^2, s^3, s^4, with a and s the first and last of `conditions` (N, 3)."""
    a, s = known[:, 0], known[:, 2]
    return jnp.stack([jnp.ones_like(a), a, s, a * a, a * s, s * s, s**3, s**4], axis=1)


def presence(crowd: Array) -> Array:
    """Weight of what the neighbours do, 0 without any and 1 among as many as the data have, (N,) [-]."""
    return 1.0 - jnp.exp(-crowd)


def conditions(reynolds: Array, solid_fraction: Array) -> Array:
    """(N, 3) what the network sees of the flow: ln Re and solid fraction, taken into the range of the data, -1 to 1 in
    it; the second is the square of the first."""
    low, high = math.log(REYNOLDS[0]), math.log(REYNOLDS[1])
    inside = jnp.clip(reynolds, *REYNOLDS)
    a = 2.0 * (jnp.log(inside) - low) / (high - low) - 1.0
    middle = 0.5 * (SOLID_FRACTION[0] + SOLID_FRACTION[1])
    s = 2.0 * (jnp.clip(solid_fraction, *SOLID_FRACTION) - middle) / (SOLID_FRACTION[1] - SOLID_FRACTION[0])
    return jnp.stack([a, a * a, s], axis=1)


def range_weight(reynolds: Array, solid_fraction: Array) -> Array:
    """1 for Re and solid fraction in the range of the data, 0 beyond `FADING`, a smooth step between in ln Re and in
    the solid fraction [-]."""
    (slowest, fastest), (thinnest, densest) = FADING
    logarithm = jnp.log(jnp.clip(reynolds, 0.5 * slowest, 2.0 * fastest))
    bounds = [math.log(value) for value in (slowest, *REYNOLDS, fastest)]
    flow = _step((logarithm - bounds[0]) / (bounds[1] - bounds[0])) * _step(
        (bounds[3] - logarithm) / (bounds[3] - bounds[2])
    )
    lower = _step((solid_fraction - thinnest) / (SOLID_FRACTION[0] - thinnest))
    return flow * lower * _step((densest - solid_fraction) / (densest - SOLID_FRACTION[1]))


def positive_multiple(multiple: Array) -> Array:
    """The multiple where it is not small, else one that approaches zero exponentially; once differentiable [-]."""
    small = multiple < SMALLEST_MULTIPLE
    exponent = jnp.where(small, multiple / SMALLEST_MULTIPLE - 1.0, 0.0)
    return jnp.where(small, SMALLEST_MULTIPLE * jnp.exp(exponent), multiple)


def bounded(vector: Array) -> Array:
    """The vectors (N, D), shortened smoothly so that they stay within `LARGEST`: x / (1 + |x/L|^4)^(1/4) [-]."""
    squared = jnp.sum(vector**2, axis=1, keepdims=True) / LARGEST**2
    return vector / (1.0 + squared**2) ** 0.25


def _step(x: Array) -> Array:
    """3 x^2 - 2 x^3 between 0 and 1, constant beyond."""
    x = jnp.clip(x, 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)


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
