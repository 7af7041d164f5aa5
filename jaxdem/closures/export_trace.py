"""A closure as a list of array operations on one particle, which the writers of other formats walk through.

The formulas stay where they are, in the closures: what is exported is the program that JAX traces from them. So
every base law and every learned closure can be written, and what is written cannot differ from what is run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.extend.core import ClosedJaxpr, Literal

from jaxdem.closures.base import DragClosure, DragInputs, asked_inputs

VECTORS = ("particle_velocity", "fluid_velocity", "void_fraction_gradient", "pressure_gradient")
"""Inputs with D components; all others are one number for each particle."""
FRACTIONS = ("solid_fraction", "wide_solid_fraction")
"""Inputs of one number that are never the same for all particles."""

UNITS = {
    "particle_velocity": "m/s",
    "fluid_velocity": "m/s, interstitial, at the particle",
    "solid_fraction": "1 - void fraction at the particle",
    "void_fraction_gradient": "1/m, at the particle",
    "pressure_gradient": "Pa/m, of p - rho g x, at the particle",
    "diameter": "m",
    "filter_size": "m, cell size",
    "fluid_density": "kg/m3",
    "dynamic_viscosity": "Pa s",
    "wide_solid_fraction": "mean over three cells along every axis, at the particle",
    "coefficient": "kg/s, >= 0",
    "remainder": "N",
    "force": "N, coefficient (u - v) + remainder",
    "out_of_range": "a floor or the base law acted instead",
}
"""What every input and output is, for the comments of the exported files."""


class Operation(NamedTuple):
    """An operation on elements in other languages.

    Attributes:
        c: expression in C of the operands {0}, {1}, ...
        onnx: the operator that does the same; none where it takes several (`jaxdem.closures.export_onnx`).
        numpy: the function that does the same to constants; without one JAX does it, which compiles a program.
    """

    c: str
    onnx: str = ""
    numpy: Callable[..., np.ndarray] | None = None


OPERATIONS = {
    "add": Operation("{0} + {1}", "Add", np.add),
    "sub": Operation("{0} - {1}", "Sub", np.subtract),
    "mul": Operation("{0} * {1}", "Mul", np.multiply),
    "div": Operation("{0} / {1}", "Div"),
    "neg": Operation("-{0}", "Neg"),
    # A NaN among the two stays one, as in JAX; fmaxf and fminf would drop it.
    "max": Operation("({0} > {1} || {0} != {0}) ? {0} : {1}", "Max", np.maximum),
    "min": Operation("({0} < {1} || {0} != {0}) ? {0} : {1}", "Min"),
    "gt": Operation("{0} > {1}", "Greater"),
    "ge": Operation("{0} >= {1}", "GreaterOrEqual"),
    "lt": Operation("{0} < {1}", "Less"),
    "le": Operation("{0} <= {1}", "LessOrEqual"),
    "eq": Operation("{0} == {1}", "Equal"),
    "ne": Operation("{0} != {1}"),
    "and": Operation("{0} && {1}", "And"),
    "or": Operation("{0} || {1}", "Or"),
    "not": Operation("!{0}", "Not"),
    "select_n": Operation("{0} ? {2} : {1}"),
    "logistic": Operation("1.0f / (1.0f + expf(-{0}))", "Sigmoid"),
    "exp": Operation("expf({0})", "Exp"),
    "expm1": Operation("expm1f({0})"),
    "log": Operation("logf({0})", "Log"),
    "log1p": Operation("log1pf({0})"),
    "sqrt": Operation("sqrtf({0})", "Sqrt"),
    "tanh": Operation("tanhf({0})", "Tanh"),
    "atan": Operation("atanf({0})", "Atan"),
    "abs": Operation("fabsf({0})", "Abs", np.abs),
    "pow": Operation("powf({0}, {1})", "Pow"),
}
"""Operations that act element by element, by the names of JAX."""


class ExportedDrag(NamedTuple):
    """What an exported closure gives, in this order; see `jaxdem.closures.base.Drag`.

    Attributes:
        coefficient: kg/s.
        remainder: (D,) [N], zero for closures that have none, so that all have one interface.
        force: (D,) coefficient (u - v) + remainder [N].
        out_of_range: bool.
    """

    coefficient: Array
    remainder: Array
    force: Array
    out_of_range: Array


def one_particle(closure: DragClosure) -> Callable[..., ExportedDrag]:
    """Drag on one particle as a function of its `asked_inputs`: vectors (D,), all else ()."""

    def drag(*values: Array) -> ExportedDrag:
        inputs = DragInputs(*values)
        given = {name: getattr(inputs, name) for name in (*VECTORS, *FRACTIONS)}
        rows = {name: value[None] for name, value in given.items() if value is not None}
        result = closure(inputs._replace(**rows))
        slip = inputs.fluid_velocity - inputs.particle_velocity
        coefficient = result.coefficient[0]
        remainder = jnp.zeros_like(slip) if result.remainder is None else result.remainder[0]
        return ExportedDrag(coefficient, remainder, coefficient * slip + remainder, result.out_of_range[0])

    return drag


def input_shapes(closure: DragClosure, dimension: int, batch: Sequence[Any] = ()) -> list[jax.ShapeDtypeStruct]:
    """Shapes of the `asked_inputs`, float32, with the batch in front."""
    return [
        jax.ShapeDtypeStruct((*batch, dimension) if name in VECTORS else batch, jnp.float32)
        for name in asked_inputs(closure)
    ]


def trace(closure: DragClosure, dimension: int) -> ClosedJaxpr:
    """The operations of `one_particle` in float32."""
    return jax.make_jaxpr(one_particle(closure))(*input_shapes(closure, dimension))


class Result(Protocol):
    """Shape and type of what an operation gives for one particle."""

    shape: tuple[int, ...]
    dtype: np.dtype
    size: int


Value = Any
"""What stands for an array in a writer; constants are numpy arrays of numbers."""
Apply = Callable[[str, Sequence[Value], dict[str, Any], Result], Value]
"""apply(operation, operands, settings, shape and type of the result) to the result, as a writer has it."""


def walk(program: ClosedJaxpr, inputs: Sequence[Value], apply: Apply) -> list[Value]:
    """Results of a program whose operations are done by `apply`.

    What depends on constants alone is computed here, and whole powers are handed on as products.

    Args:
        program: from `trace`.
        inputs: what stands for the inputs; no numpy arrays of numbers.
        apply: see `Apply`.

    Raises:
        NotImplementedError: a product other than of a row with a matrix, or what `apply` refuses.
    """
    values: dict[Any, Value] = dict(zip(program.jaxpr.constvars, map(np.asarray, program.consts), strict=True))
    values |= dict(zip(program.jaxpr.invars, inputs, strict=True))

    def value(place: Any) -> Value:
        if not isinstance(place, Literal):
            return values[place]
        kind: Any = place.aval
        return np.asarray(place.val, kind.dtype)

    for operation in program.jaxpr.eqns:
        operands = [value(place) for place in operation.invars]
        name, settings, result = operation.primitive.name, operation.params, operation.outvars[0].aval
        inner = settings.get("jaxpr", settings.get("call_jaxpr"))
        if inner is not None:
            results = walk(inner, operands, apply)
        elif name == "stop_gradient":
            results = operands
        elif all(map(_is_constant, operands)):
            results = [_folded(operation, operands)]
        elif name == "integer_pow":
            results = [_power(apply, operands[0], settings["y"], result)]
        elif name == "dot_general" and settings["dimension_numbers"] != (((1,), (0,)), ((), ())):
            raise NotImplementedError("no export of a product other than of a row with a matrix")
        else:
            results = [apply(name, operands, settings, result)]
        values |= dict(zip(operation.outvars, results, strict=True))
    return [value(place) for place in program.jaxpr.outvars]


def _power(apply: Apply, value: Value, exponent: int, result: Result) -> Value:
    """A power of a whole exponent as products."""
    if exponent == 0:
        return np.ones(result.shape, result.dtype)
    power = value
    for _ in range(abs(exponent) - 1):
        power = apply("mul", [power, value], {}, result)
    return power if exponent > 0 else apply("div", [np.ones((), result.dtype), power], {}, result)


def moved(
    operation: str, operands: Sequence[np.ndarray], settings: dict[str, Any], shape: tuple[int, ...]
) -> np.ndarray | None:
    """Result of an operation that only moves elements about, whatever they are; None of any other."""
    first = operands[0]
    if operation in ("reshape", "squeeze"):
        return first.reshape(shape)
    if operation == "broadcast_in_dim":
        places = [1] * len(shape)
        for length, place in zip(first.shape, settings["broadcast_dimensions"], strict=True):
            places[place] = length
        return np.broadcast_to(first.reshape(places), shape)
    if operation == "slice":
        strides = settings["strides"] or (1,) * len(shape)
        bounds = zip(settings["start_indices"], settings["limit_indices"], strides, strict=True)
        return first[tuple(slice(*bound) for bound in bounds)]
    if operation == "transpose":
        return np.transpose(first, settings["permutation"])
    if operation == "concatenate":
        return np.concatenate(operands, axis=settings["dimension"])
    if operation == "stack":
        return np.stack(operands, axis=settings["axis"])
    return None


def _folded(operation: Any, operands: Sequence[np.ndarray]) -> np.ndarray:
    """An operation on constants alone."""
    name, result = operation.primitive.name, operation.outvars[0].aval
    function = OPERATIONS[name].numpy if name in OPERATIONS else None
    if function is not None:
        return np.asarray(function(*operands))
    if name == "convert_element_type":
        return operands[0].astype(result.dtype)
    value = moved(name, operands, operation.params, result.shape)
    if value is None:
        value = operation.primitive.bind(*map(jnp.asarray, operands), **operation.params)
    return np.asarray(value)


def _is_constant(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype != object
