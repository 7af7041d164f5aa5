"""The multilayer perceptron of the learned closures, and the closure of the source paper."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.closures.base import Drag, DragInputs
from jaxdem.closures.correlation import Correlation
from jaxdem.closures.koch_hill import KochHill
from jaxdem.errors import InputError, is_whole
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
    "relu": jax.nn.relu,
    "sigmoid": jax.nn.sigmoid,
    "tanh": jnp.tanh,
    "softsign": jax.nn.soft_sign,
    "softplus": jax.nn.softplus,
    "selu": jax.nn.selu,
    "silu": jax.nn.silu,
}
"""Activation functions by the names of the settings."""

Weights = dict[str, dict[str, Array]]
"""Kernel and bias of every layer by its name."""


def layer_name(number: int) -> str:
    """Name of a layer in `Weights` and in closure files: that of flax.linen, whose `Dense` layers can take them."""
    return f"Dense_{number}"


RANGE_MARGIN = 0.1
"""The training range is extended by this part of its length before an input counts as out of range."""
RANGE_RELATIVE_TOLERANCE = 0.01
"""... and by this part of its largest magnitude, so that an input constant in training survives rounding."""


def base_law(base: Correlation | None, default: Correlation) -> Correlation:
    """The drag law that a closure stands on.

    Raises:
        InputError: it is none, such as the name of one.
    """
    if base is None:
        return default
    if not callable(base) or isinstance(base, type):
        raise InputError("base", base, "is no drag law", "give an object: jaxdem.closures.drag_law(NAME)")
    return base


def initial_weights(
    inputs: int, hidden: Sequence[int], outputs: int, activation: str, seed: int, zero_last: bool = False
) -> Weights:
    """Random float32 weights, the same for the same seed.

    Kernels are uniform in +-sqrt(6 / (inputs + outputs of the layer)), biases zero (Glorot & Bengio 2010, eq.
    16, and what Keras, the library of the source paper, does). Drawn on the host, which compiles nothing.

    Args:
        inputs, outputs: numbers of them.
        hidden: numbers of the neurons of each hidden layer.
        activation: a name of `ACTIVATIONS`.
        seed: of the draw.
        zero_last: the last layer is zero, so that the untrained network gives 0.

    Raises:
        InputError: unknown activation, no list of layers, a layer without neurons, or a seed that is none.
    """
    if not isinstance(activation, str) or activation not in ACTIVATIONS:
        raise InputError("activation", activation, "is not known", f"Use one of {', '.join(ACTIVATIONS)}.")
    if not isinstance(hidden, Sequence) or not all(is_whole(width) and width >= 1 for width in hidden):
        limit = "is no list of the widths of the hidden layers; every layer needs a neuron"
        raise InputError("hidden", hidden, limit, "Use whole numbers of at least 1, as in (8, 8).")
    if not is_whole(seed) or seed < 0:
        raise InputError("seed", seed, "must be a whole number from 0 up", "Give one.")
    generator, weights = np.random.default_rng(seed), {}
    for layer, shape in enumerate(itertools.pairwise((inputs, *hidden, outputs))):
        bound = 0.0 if zero_last and layer == len(hidden) else np.sqrt(6.0 / sum(shape))
        kernel = generator.uniform(-bound, bound, shape).astype(np.float32)
        weights[layer_name(layer)] = {"kernel": jnp.asarray(kernel), "bias": jnp.zeros(shape[1], jnp.float32)}
    return weights


def perceptron(weights: Weights, activation: str, values: Array) -> Array:
    """(..., inputs) to (..., outputs): dense layers with an activation between them, in the dtype of the inputs.

    x_0 = values, x_(k+1) = a(x_k W_k + b_k), without the activation a after the last layer.

    Args:
        weights: kernels W_k (inputs, outputs of the layer) and biases b_k, as `initial_weights` gives them.
        activation: a name of `ACTIVATIONS`.
        values: inputs.
    """
    for number in range(len(weights)):
        layer = {name: jnp.asarray(leaf).astype(values.dtype) for name, leaf in weights[layer_name(number)].items()}
        axes = (((values.ndim - 1,), (0,)), ((), ()))
        values = jax.lax.dot_general(values, layer["kernel"], axes, precision=PRECISION)
        values = values + layer["bias"].reshape((1,) * (values.ndim - 1) + (-1,))
        if number < len(weights) - 1:
            values = ACTIVATIONS[activation](values)
    return values


def apply_in_parts(apply: Callable[[Array], Array], values: Array) -> Array:
    """`apply` of (N, K) rows, on a CPU `ROWS_AT_ONCE` of them after the others: twice as fast for many rows."""
    if values.shape[0] <= ROWS_AT_ONCE:
        return apply(values)
    return jax.lax.platform_dependent(
        values,
        cpu=lambda rows: jax.lax.map(lambda row: apply(row[None])[0], rows, batch_size=ROWS_AT_ONCE),
        default=apply,
    )


def normalised_inputs(values: Array, mean: Array, scale: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """What a network sees (N, K), (values - mean) / scale, and whether all values lie in the training range (N,).

    The range, low to high (K,), is extended by `RANGE_MARGIN` (high - low) + `RANGE_RELATIVE_TOLERANCE` max(|low|,
    |high|). NaN is outside. Outside the network sees its mean input, 0, so that no infinity reaches the gradient. The
    four arrays are constants to differentiation.
    """
    mean, scale, low, high = (constant(leaf, values.dtype) for leaf in (mean, scale, low, high))
    margin = RANGE_MARGIN * (high - low) + RANGE_RELATIVE_TOLERANCE * jnp.maximum(jnp.abs(low), jnp.abs(high))
    inside = jnp.all((values >= (low - margin)[None]) & (values <= (high + margin)[None]), axis=-1)
    return jnp.where(inside[:, None], (values - mean[None]) / scale[None], 0.0), inside


def constant(leaf: Array, dtype: jnp.dtype) -> Array:
    """An array that does not change in training, in the precision of a run."""
    return jax.lax.stop_gradient(leaf).astype(dtype)


@partial(
    jax.tree_util.register_dataclass,
    data_fields=["weights", "input_mean", "input_scale", "input_low", "input_high", "output_mean", "output_scale"],
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
    input leaves the training range by more than its margin (`normalised_inputs`) the base law acts alone and
    `out_of_range` is set.

    The weights are trained; normalisation and range are constants to differentiation.

    Attributes:
        weights: of the network.
        input_mean, input_scale: (K,) normalisation in the units of x.
        input_low, input_high: (K,) smallest and largest inputs of the training data.
        output_mean, output_scale: (D,) [N].
        base: drag law for the implicit coefficient and for inputs out of range.
        hidden: widths of the hidden layers; the paper's 170-70-30.
        activation: a name of `ACTIVATIONS`; the paper's ELU.

    Source: Davydzenka & Tahmasebi (2022), J. Fluid Mech. 938, A20.
    """

    weights: Weights
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
            InputError: another dimension than 2 or 3, a base that is no drag law, or see `initial_weights`.
        """
        if not is_whole(dimension) or dimension not in (2, 3):
            raise InputError("dimension", dimension, "is neither 2 nor 3", "give that of the scene")
        inputs = 2 * dimension + 1
        infinity = jnp.full(inputs, jnp.inf, jnp.float32)
        return cls(
            weights=initial_weights(inputs, hidden, dimension, activation, seed),
            input_mean=jnp.zeros(inputs, jnp.float32),
            input_scale=jnp.ones(inputs, jnp.float32),
            input_low=-infinity,
            input_high=infinity,
            output_mean=jnp.zeros(dimension, jnp.float32),
            output_scale=jnp.ones(dimension, jnp.float32),
            base=base_law(base, KochHill()),
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
        return perceptron(self.weights, self.activation, normalised)

    def __call__(self, inputs: DragInputs) -> Drag:
        """Drag for every particle: the base coefficient and the network's force less the base force."""
        normalised, inside = normalised_inputs(
            self.features(inputs), self.input_mean, self.input_scale, self.input_low, self.input_high
        )
        offset, unit = (constant(leaf, normalised.dtype) for leaf in (self.output_mean, self.output_scale))
        force = offset[None] + unit[None] * apply_in_parts(self.normalised_force, normalised)
        base = self.base(inputs)
        base_force = base.coefficient[:, None] * inputs.slip_velocity
        remainder = jnp.where(inside[:, None], force - base_force, 0.0)
        return Drag(base.coefficient, remainder, base.out_of_range | ~inside)
