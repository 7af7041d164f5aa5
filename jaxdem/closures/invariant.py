"""A learned closure on a base law that is positive and the same under rotation and in a moving frame."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxdem.closures.base import Drag, DragInputs
from jaxdem.closures.correlation import Correlation
from jaxdem.closures.koch_hill import KochHill
from jaxdem.closures.network import Weights, base_law, initial_weights, normalised_inputs, perceptron
from jaxdem.errors import InputError
from jaxdem.numerics.vectors import row_lengths

FEATURES = (
    "solid_fraction",
    "log1p_reynolds",
    "log_filter_over_diameter",
    "void_fraction_gradient_along_slip",
    "void_fraction_gradient_size",
    "pressure_gradient_along_slip",
    "pressure_gradient_size",
)
"""Names of the network's possible inputs, in order; `InvariantClosure` defines them."""

WITHOUT_PRESSURE = FEATURES[:5]
"""The features that do not see the pressure gradient."""

WIDE = "log_wide_solid_fraction"
"""The feature for which the solid fraction of three cells along every axis is taken."""

FURTHER_FEATURES = ("log_solid_fraction", WIDE)
"""Inputs that a network has if it is asked to, after those of `FEATURES`."""

THIN = 0.01
"""Solid fraction that is added to that under a logarithm, which is then finite [-]."""

TERMS = ("void_fraction_gradient", "pressure_gradient")
"""Directions that the remainder may have beside the slip."""

GATE_LENGTH = 4.0
"""l of the gate 1 - exp(-(filter/d) / l): 0.22 at filter/d = 1, 0.63 at 4, 0.98 at 16."""

LARGEST_LOG_FACTOR = 2.302585092994046
"""ln 10: the correction stays between a tenth and ten times the base law."""

UNTRAINED = 3.0
"""Output at which a network begins whose factor is at most one: ln(1 + exp(-3)) is 0.05, so that the factor is 0.95."""


class PreparedInputs(NamedTuple):
    """What the closure needs of its inputs, free of weights (N particles, T terms, D dimensions).

    Attributes:
        features: (N, K) network inputs in the order of `FEATURES` [-].
        gate: (N,) weight of the correction, 0 for a small filter to 1 for a large one [-].
        slip: (N, D) [m/s].
        coefficient: (N,) of the base law [kg/s].
        term_vectors: (N, T, D) what the terms of the remainder multiply [N], or None.
        out_of_range: (N,) of the base law.
    """

    features: Array
    gate: Array
    slip: Array
    coefficient: Array
    term_vectors: Array | None
    out_of_range: Array


@partial(
    jax.tree_util.register_dataclass,
    data_fields=["weights", "feature_mean", "feature_scale", "feature_low", "feature_high"],
    meta_fields=["base", "hidden", "activation", "terms", "features", "bounded"],
)
@dataclasses.dataclass(frozen=True, eq=False)
class InvariantClosure:
    """Base law times a positive factor of invariants, for coarse (filtered) fluid fields.

    force = c exp(G B(n_0)) (u - v) + sum_t G B(n_t) a_t, with
    c       coefficient of the base law [kg/s],
    n       network((x - feature_mean) / feature_scale), one output n_0 for the factor and one for each term,
    B(n)    ln 10 tanh(n / ln 10), so that the factor lies in [0.1, 10] and a term's weight in [-2.3, 2.3],
            with `bounded` B(n_0) is -ln 10 tanh(ln(1 + exp(-n_0 - 3)) / ln 10), and the factor lies in [0.1, 1],
    G       1 - exp(-(L / d) / 4): no correction as the filter L gets small against the diameter d,
    a_t     [N] "void_fraction_gradient": c |u - v| L grad g; "pressure_gradient": pi d^3 / 6 grad p.
    The features x, from s solid and g void fraction, Re = g rho |u - v| d / mu:
    s;  ln(1 + Re);  ln(L / d);  L grad g . (u - v)/|u - v| Re / (1 + Re);  L |grad g|.
    and, from the size D = c |u - v| of the base force and P = pi d^3 / 6 |grad p| of the pressure force,
    pi d^3 / 6 grad p . (u - v)/|u - v| Re / (1 + Re) / (P + D);  P / (P + D).
    On request ("log_solid_fraction") also ln(s + 0.01), for data from thin to dense: of s alone a small network does
    not resolve the thin end; and ("log_wide_solid_fraction") ln(s_w + 0.01) with the mean s_w over three cells along
    every axis: whether the particle is in a cluster or in a suspension that is as dense all around.
    Re / (1 + Re) keeps the fourth and the sixth smooth at zero slip, where they are 0.

    The last layer starts at zero: the untrained closure is its base law. Without terms there is no remainder,
    and the force always points along the slip. Only differences of velocities, dot products and lengths
    enter: the force turns with its inputs and is the same in a frame of constant velocity.

    Validity: the range of features seen in training; where a feature leaves it by more than the margin of
    `normalised_inputs`, the base law acts alone and `out_of_range` is set. The weights are trained; normalisation
    and range are constants to differentiation.

    Attributes:
        weights: of the network.
        feature_mean, feature_scale: (K,) normalisation of x [-].
        feature_low, feature_high: (K,) range of the training data, without the thousandth at either end [-].
        base: drag law that is corrected.
        hidden: widths of the hidden layers.
        activation: a name of `ACTIVATIONS`.
        terms: names of `TERMS` that the remainder has; none by default.
        features: names of `FEATURES` and `FURTHER_FEATURES` that the network sees, in their order.
        bounded: whether the factor is at most one. Unresolved clusters lower the drag; a fit to noisy slips may raise
            it where the slip is small, so that a dense suspension stays uniform.
    """

    weights: Weights
    feature_mean: Array
    feature_scale: Array
    feature_low: Array
    feature_high: Array
    base: Correlation
    hidden: tuple[int, ...]
    activation: str
    terms: tuple[str, ...] = ()
    features: tuple[str, ...] = FEATURES
    bounded: bool = False

    @classmethod
    def initial(
        cls,
        base: Correlation | None = None,
        hidden: Sequence[int] = (8,),
        activation: str = "elu",
        terms: Sequence[str] = (),
        seed: int = 0,
        features: Sequence[str] = FEATURES,
        bounded: bool = False,
    ) -> InvariantClosure:
        """The base law with an untrained correction, no normalisation, unlimited range.

        Raises:
            InputError: unknown term or feature, a base that is no drag law, or see `initial_weights`.
        """
        check_terms(terms)
        check_features(features)
        if not isinstance(bounded, bool):
            raise InputError("bounded", bounded, "is neither True nor False", "Give one of them.")
        size = len(features)
        infinity = jnp.full(size, jnp.inf, jnp.float32)
        return cls(
            weights=initial_weights(size, hidden, 1 + len(terms), activation, seed, zero_last=True),
            feature_mean=jnp.zeros(size, jnp.float32),
            feature_scale=jnp.ones(size, jnp.float32),
            feature_low=-infinity,
            feature_high=infinity,
            base=base_law(base, KochHill()),
            hidden=tuple(hidden),
            activation=activation,
            terms=tuple(terms),
            features=tuple(features),
            bounded=bounded,
        )

    @property
    def sees_wide(self) -> bool:
        """See `jaxdem.closures.base.sees_wide`."""
        return WIDE in self.features

    def prepare(self, inputs: DragInputs) -> PreparedInputs:
        """Features, gate, base coefficient, term vectors; without weights, so training does it once."""
        base = self.base(inputs)
        features, gate = invariant_features(inputs, base.coefficient, self.features)
        vectors = None
        if self.terms:
            vectors = jnp.stack([_term_vector(name, inputs, base.coefficient) for name in self.terms], axis=1)
        return PreparedInputs(features, gate, inputs.slip_velocity, base.coefficient, vectors, base.out_of_range)

    def evaluate(self, prepared: PreparedInputs) -> Drag:
        """Drag from prepared inputs: everything that depends on the weights."""
        normalised, inside = self.normalised(prepared.features)
        return corrected(prepared, perceptron(self.weights, self.activation, normalised), inside, self.bounded)

    def normalised(self, features: Array) -> tuple[Array, Array]:
        """What the network sees (N, K) [-], and whether the features are in the range of the training (N,)."""
        return normalised_inputs(features, self.feature_mean, self.feature_scale, self.feature_low, self.feature_high)

    def __call__(self, inputs: DragInputs) -> Drag:
        """Drag for every particle."""
        return self.evaluate(self.prepare(inputs))


def corrected(prepared: PreparedInputs, output: Array, inside: Array, bounded: bool = False) -> Drag:
    """Drag with the correction that a network's output (N, 1 + T) makes; the base law's where not `inside` (N,).

    See `InvariantClosure` for `bounded`.
    """
    if bounded:
        logarithm = -jax.nn.softplus(-output[:, :1] - UNTRAINED)
        output = jnp.concatenate([logarithm, output[:, 1:]], axis=1)
    limited = LARGEST_LOG_FACTOR * jnp.tanh(output / LARGEST_LOG_FACTOR)
    correction = jnp.where(inside[:, None], prepared.gate[:, None] * limited, 0.0)
    coefficient = prepared.coefficient * jnp.exp(correction[:, 0])
    remainder = None
    if prepared.term_vectors is not None:
        remainder = jnp.sum(correction[:, 1:, None] * prepared.term_vectors, axis=1)
    return Drag(coefficient, remainder, prepared.out_of_range | ~inside)


def _check_names(name: str, given: object) -> None:
    if not isinstance(given, Sequence) or isinstance(given, str):
        raise InputError(name, given, "is no list of names", "Give a list, such as ().")


def check_terms(terms: Sequence[str]) -> None:
    """Raise InputError for a term that is not in `TERMS` or is named twice."""
    _check_names("terms", terms)
    unknown = [name for name in terms if name not in TERMS]
    if unknown or len(set(terms)) != len(terms):
        raise InputError("terms", tuple(terms), f"must be names from {TERMS}, each once", "Correct the names.")


def check_features(features: Sequence[str]) -> None:
    """Raise InputError for features that are not some of `FEATURES` and `FURTHER_FEATURES` in their order."""
    _check_names("features", features)
    known = FEATURES + FURTHER_FEATURES
    if not features or tuple(features) != tuple(name for name in known if name in features):
        limit = f"must be names from {known}, each once, in this order"
        raise InputError("features", tuple(features), limit, "Correct the names.")


def invariant_features(inputs: DragInputs, coefficient: Array, names: Sequence[str] = FEATURES) -> tuple[Array, Array]:
    """Features x (N, K) and gate G (N,) of `InvariantClosure`; `coefficient` (N,) [kg/s] is the base law's."""
    solid_fraction, reynolds = inputs.solid_fraction, inputs.reynolds
    ratio = jnp.broadcast_to(inputs.filter_size / inputs.diameter, solid_fraction.shape)
    gradient = inputs.void_fraction_gradient * inputs.filter_size
    # direction of the slip times Re / (1 + Re), written without a division by the slip
    direction = (
        inputs.slip_velocity
        * (
            (1.0 - solid_fraction)
            * (inputs.fluid_density * inputs.diameter / inputs.dynamic_viscosity)
            / (1.0 + reynolds)
        )[:, None]
    )
    values = {
        "solid_fraction": solid_fraction,
        "log1p_reynolds": jnp.log1p(reynolds),
        "log_filter_over_diameter": jnp.log(ratio),
        "log_solid_fraction": jnp.log(jnp.maximum(solid_fraction, 0.0) + THIN),
        "void_fraction_gradient_along_slip": jnp.sum(gradient * direction, axis=-1),
        "void_fraction_gradient_size": row_lengths(gradient),
    }
    if WIDE in names:
        if inputs.wide_solid_fraction is None:
            limit, remedy = "needs wide_solid_fraction, which these inputs lack", "Make the dataset again, or add it."
            raise InputError("features", WIDE, limit, remedy)
        values[WIDE] = jnp.log(jnp.maximum(inputs.wide_solid_fraction, 0.0) + THIN)
    if set(names) & set(FEATURES[5:]):
        force = _term_vector("pressure_gradient", inputs, coefficient)
        size = row_lengths(force)
        total = size + coefficient * inputs.slip_speed
        # Without slip and gradient both forces are zero, and so are the features.
        total = jnp.where(total > 0, total, 1.0)
        values["pressure_gradient_along_slip"] = jnp.sum(force * direction, axis=-1) / total
        values["pressure_gradient_size"] = size / total
    features = jnp.stack([values[name] for name in names], axis=-1)
    return features, 1.0 - jnp.exp(-ratio / GATE_LENGTH)


def _term_vector(name: str, inputs: DragInputs, coefficient: Array) -> Array:
    """(N, D) the force that a term's weight multiplies [N]; it vanishes with the field that it is along."""
    if name == "void_fraction_gradient":
        strength = coefficient * inputs.slip_speed * inputs.filter_size
        return strength[:, None] * inputs.void_fraction_gradient
    volume = jnp.broadcast_to(jnp.pi / 6.0 * inputs.diameter**3, coefficient.shape)
    return volume[:, None] * inputs.pressure_gradient
