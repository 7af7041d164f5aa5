"""The multilayer perceptron of the learned closures, and the closure of the source paper."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import linen
from jax import Array

from jaxdem.closures.base import Drag, DragInputs
from jaxdem.closures.correlation import Correlation
from jaxdem.closures.koch_hill import KochHill
from jaxdem.errors import InputError
from jaxdem.numerics.products import PRECISION

ROWS_AT_ONCE = 5000
"""Particles that a network treats at once on a CPU: what passes between its layers then stays in the cache."""


@jax.custom_jvp
def elu(x: Array) -> Array:
    """x where positive, exp(x) - 1 elsewhere; its slope is exp(x) there, which is known already.

    `jax.nn.elu` has expm1, which XLA:CPU evaluates as tanh and exp both, for leading digits near zero that the
    next layer's sum loses again: the absolute error is that of a float either way.

    Source: Clevert, Unterthiner & Hochreiter (2016), Fast and accurate deep network learning by exponential
    linear units, eq. 8 with alpha = 1.
    """
    return jnp.where(x > 0, x, jnp.exp(jnp.minimum(x, 0.0)) - 1.0)


@elu.defjvp
def _elu_slope(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    value = elu(primals[0])
    return value, tangents[0] * (1.0 + jnp.minimum(value, 0.0))


ACTIVATIONS: dict[str, Callable[[Array], Array]] = {
    "elu": elu,
    "relu": linen.relu,
    "sigmoid": linen.sigmoid,
    "tanh": jnp.tanh,
    "softsign": linen.soft_sign,
    "softplus": linen.softplus,
    "selu": linen.selu,
}
"""Activation functions by the names of the settings."""

RANGE_MARGIN = 0.1
"""The training range is extended by this part of its length before an input counts as out of range."""
RANGE_RELATIVE_TOLERANCE = 0.01
"""... and by this part of its largest magnitude, so that an input constant in training survives rounding."""


class Perceptron(linen.Module):
    """Dense layers with an activation between them.

    Attributes:
        hidden: widths of the hidden layers.
        outputs: width of the last, linear layer.
        activation: a name of `ACTIVATIONS`.
    """

    hidden: tuple[int, ...]
    outputs: int
    activation: str

    @linen.compact
    def __call__(self, values: Array) -> Array:
        """(..., inputs) to (..., outputs)."""
        for width in self.hidden:
            values = ACTIVATIONS[self.activation](linen.Dense(width, precision=PRECISION)(values))
        return linen.Dense(self.outputs, precision=PRECISION)(values)


def initial_weights(network: Perceptron, inputs: int, seed: int, zero_last: bool = False) -> dict[str, Any]:
    """Random float32 weights of a network with `inputs` inputs, the same for the same seed.

    Kernels are uniform in +-sqrt(6 / (inputs + outputs of the layer)), biases zero (Glorot & Bengio 2010, eq.
    16, and what Keras, the library of the source paper, does). Drawn on the host, which compiles nothing.
    With `zero_last` the last layer is zero, so that the untrained network gives 0.

    Raises:
        InputError: unknown activation, or a layer without neurons.
    """
    if network.activation not in ACTIVATIONS:
        names = ", ".join(ACTIVATIONS)
        raise InputError("activation", network.activation, "is not known", f"Use one of {names}.")
    if any(width < 1 for width in network.hidden):
        raise InputError("hidden", network.hidden, "every layer needs a neuron", "Use widths of at least 1.")
    generator = np.random.default_rng(seed)
    widths = (inputs, *network.hidden, network.outputs)
    weights = {}
    for layer, shape in enumerate(itertools.pairwise(widths)):
        limit = 0.0 if zero_last and layer == len(network.hidden) else np.sqrt(6.0 / sum(shape))
        kernel = generator.uniform(-limit, limit, shape).astype(np.float32)
        weights[f"Dense_{layer}"] = {
            "kernel": jnp.asarray(kernel),
            "bias": jnp.zeros(shape[1], jnp.float32),
        }
    return weights


def apply_weights(network: Perceptron, weights: dict[str, Any], values: Array) -> Array:
    """Output of the network, computed in the dtype of its inputs whatever that of the weights."""
    weights = jax.tree.map(lambda leaf: leaf.astype(values.dtype), weights)
    return network.apply({"params": weights}, values)  # type: ignore[return-value]


def apply_in_parts(apply: Callable[[Array], Array], values: Array) -> Array:
    """`apply` of (N, K) rows, on a CPU `ROWS_AT_ONCE` of them after the others: twice as fast for many rows."""
    if values.shape[0] <= ROWS_AT_ONCE:
        return apply(values)
    return jax.lax.platform_dependent(
        values,
        cpu=lambda rows: jax.lax.map(lambda row: apply(row[None])[0], rows, batch_size=ROWS_AT_ONCE),
        default=apply,
    )


def inside_range(values: Array, low: Array, high: Array) -> Array:
    """(N,) whether all values (N, K) lie in the training range, low to high (K,), extended by its margin.

    The margin is `RANGE_MARGIN` (high - low) + `RANGE_RELATIVE_TOLERANCE` max(|low|, |high|). NaN is outside.
    """
    margin = RANGE_MARGIN * (high - low) + RANGE_RELATIVE_TOLERANCE * jnp.maximum(jnp.abs(low), jnp.abs(high))
    return jnp.all((values >= (low - margin)[None]) & (values <= (high + margin)[None]), axis=-1)


@partial(
    jax.tree_util.register_dataclass,
    data_fields=[
        "weights",
        "input_mean",
        "input_scale",
        "input_low",
        "input_high",
        "output_mean",
        "output_scale",
    ],
    meta_fields=["base", "hidden", "activation"],
)
@dataclasses.dataclass(frozen=True, eq=False)
class PaperNetwork:
    """The source paper's closure: raw velocities and void fraction in, drag force out.

    In D dimensions there are K = 2 D + 1 inputs.

    force = output_mean + output_scale * network((x - input_mean) / input_scale), x = (v, u, g): particle
    velocity (D,) [m/s], interstitial fluid velocity (D,) [m/s], void fraction [-]. In 2-D: v_x, v_z, u_x,
    u_z, g to F_x, F_z. Returned as base coefficient and, in the remainder, force less base coefficient times
    slip.

    Validity: the particle size, fluid and range of velocities that it was trained on; it knows neither
    diameter nor viscosity and is neither Galilean nor rotation invariant (`InvariantClosure` is). Where an
    input leaves the training range by more than its margin (`inside_range`) the base law acts alone and
    `out_of_range` is set.

    The weights are trained; normalisation and range are constants to differentiation.

    Attributes:
        weights: of the `Perceptron`.
        input_mean, input_scale: (K,) normalisation in the units of x.
        input_low, input_high: (K,) smallest and largest inputs of the training data.
        output_mean, output_scale: (D,) [N].
        base: drag law for the implicit coefficient and for inputs out of range.
        hidden: widths of the hidden layers; the paper's 170-70-30.
        activation: a name of `ACTIVATIONS`; the paper's ELU.

    Source: Davydzenka & Tahmasebi (2022), J. Fluid Mech. 938, A20.
    """

    weights: dict[str, Any]
    input_mean: Array
    input_scale: Array
    input_low: Array
    input_high: Array
    output_mean: Array
    output_scale: Array
    base: Correlation
    hidden: tuple[int, ...]
    activation: str

    @classmethod
    def initial(
        cls,
        dimension: int,
        base: Correlation | None = None,
        hidden: Sequence[int] = (170, 70, 30),
        activation: str = "elu",
        seed: int = 0,
    ) -> PaperNetwork:
        """Random weights, no normalisation, unlimited range.

        Raises:
            InputError: unknown activation or an empty layer.
        """
        inputs = 2 * dimension + 1
        network = Perceptron(tuple(hidden), dimension, activation)
        infinity = jnp.full(inputs, jnp.inf, jnp.float32)
        return cls(
            weights=initial_weights(network, inputs, seed),
            input_mean=jnp.zeros(inputs, jnp.float32),
            input_scale=jnp.ones(inputs, jnp.float32),
            input_low=-infinity,
            input_high=infinity,
            output_mean=jnp.zeros(dimension, jnp.float32),
            output_scale=jnp.ones(dimension, jnp.float32),
            base=KochHill() if base is None else base,
            hidden=tuple(hidden),
            activation=activation,
        )

    @property
    def dimension(self) -> int:
        """D, from the normalisation's shape."""
        return self.output_mean.shape[-1]

    @staticmethod
    def features(inputs: DragInputs) -> Array:
        """x = (v, u, g), (N, 2 D + 1) in SI units."""
        void_fraction = 1.0 - inputs.solid_fraction
        return jnp.concatenate([inputs.particle_velocity, inputs.fluid_velocity, void_fraction[:, None]], axis=-1)

    def normalised_force(self, normalised: Array) -> Array:
        """(N, D) network output (normalised force) from (N, K) normalised inputs [-]."""
        network = Perceptron(self.hidden, self.dimension, self.activation)
        return apply_weights(network, self.weights, normalised)

    def __call__(self, inputs: DragInputs) -> Drag:
        """Drag for every particle: the base coefficient and the network's force less the base force."""
        dtype = inputs.fluid_velocity.dtype
        constants = (self.input_mean, self.input_scale, self.input_low, self.input_high)
        mean, scale, low, high = (jax.lax.stop_gradient(leaf).astype(dtype) for leaf in constants)
        offset, unit = (jax.lax.stop_gradient(leaf).astype(dtype) for leaf in (self.output_mean, self.output_scale))
        values = self.features(inputs)
        inside = inside_range(values, low, high)
        # Outside, the network sees its mean input, so that no infinity reaches the gradient.
        normalised = jnp.where(inside[:, None], (values - mean[None]) / scale[None], 0.0)
        force = offset[None] + unit[None] * apply_in_parts(self.normalised_force, normalised)
        base = self.base(inputs)
        base_force = base.coefficient[:, None] * inputs.slip_velocity
        remainder = jnp.where(inside[:, None], force - base_force, 0.0)
        return Drag(base.coefficient, remainder, base.out_of_range | ~inside)
