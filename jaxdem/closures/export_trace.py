"""A closure as a list of array operations on one particle, which the writers of other formats walk through.

The formulas stay where they are, in the closures: what is exported is the program that JAX traces from them. So
every base law and every learned closure can be written, and what is written cannot differ from what is run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.extend.core import ClosedJaxpr, Literal

from jaxdem.closures.base import DragClosure, DragInputs

VECTORS = ("particle_velocity", "fluid_velocity", "void_fraction_gradient", "pressure_gradient")
"""Inputs with D components; all others are one number for each particle."""

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
    "coefficient": "kg/s, >= 0",
    "remainder": "N",
    "force": "N, coefficient (u - v) + remainder",
    "out_of_range": "a floor or the base law acted instead",
}
"""What every input and output is, for the comments of the exported files."""


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
    """Drag on one particle as a function of the fields of `DragInputs`: vectors (D,), all else ()."""

    def drag(*values: Array) -> ExportedDrag:
        inputs = DragInputs(*values)
        rows = {name: getattr(inputs, name)[None] for name in (*VECTORS, "solid_fraction")}
        result = closure(inputs._replace(**rows))
        slip = inputs.fluid_velocity - inputs.particle_velocity
        coefficient = result.coefficient[0]
        remainder = jnp.zeros_like(slip) if result.remainder is None else result.remainder[0]
        return ExportedDrag(coefficient, remainder, coefficient * slip + remainder, result.out_of_range[0])

    return drag


def input_shapes(dimension: int, batch: Sequence[Any] = ()) -> list[jax.ShapeDtypeStruct]:
    """Shapes of the inputs in the order of `DragInputs`, float32, with the batch in front."""
    return [
        jax.ShapeDtypeStruct((*batch, dimension) if name in VECTORS else batch, jnp.float32)
        for name in DragInputs._fields
    ]


def trace(closure: DragClosure, dimension: int) -> ClosedJaxpr:
    """The operations of `one_particle` in float32."""
    return jax.make_jaxpr(one_particle(closure))(*input_shapes(dimension))


Apply = Callable[[str, Sequence[Any], dict[str, Any], Any], Any]
"""apply(operation, operands, settings, shape and type of the result) to the result, as a writer has it."""


def walk(program: ClosedJaxpr, inputs: Sequence[Any], apply: Apply) -> list[Any]:
    """Results of a program whose operations are done by `apply`.

    Constants are numpy arrays; what depends on constants alone is computed here.

    Args:
        program: from `trace`.
        inputs: what stands for the inputs; no numpy arrays of numbers.
        apply: see `Apply`.
    """
    values: dict[Any, Any] = dict(zip(program.jaxpr.constvars, map(np.asarray, program.consts), strict=True))
    values |= dict(zip(program.jaxpr.invars, inputs, strict=True))

    def value(place: Any) -> Any:
        if not isinstance(place, Literal):
            return values[place]
        kind: Any = place.aval
        return np.asarray(place.val, kind.dtype)

    for operation in program.jaxpr.eqns:
        operands = [value(place) for place in operation.invars]
        name, settings = operation.primitive.name, operation.params
        inner = settings.get("jaxpr", settings.get("call_jaxpr"))
        if inner is not None:
            results = walk(inner, operands, apply)
        elif name == "stop_gradient":
            results = operands
        elif all(map(_is_constant, operands)):
            results = [_folded(operation, operands)]
        else:
            results = [apply(name, operands, settings, operation.outvars[0].aval)]
        values |= dict(zip(operation.outvars, results, strict=True))
    return [value(place) for place in program.jaxpr.outvars]


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
    if operation == "concatenate":
        return np.concatenate(operands, axis=settings["dimension"])
    if operation == "stack":
        return np.stack(operands, axis=settings["axis"])
    return None


_ARITHMETIC = {"add": np.add, "sub": np.subtract, "mul": np.multiply, "max": np.maximum, "abs": np.abs}
"""What the closures do with their constants, in numpy: JAX would compile a program for each of them."""


def _folded(operation: Any, operands: Sequence[np.ndarray]) -> np.ndarray:
    """An operation on constants alone."""
    name, result = operation.primitive.name, operation.outvars[0].aval
    if name in _ARITHMETIC:
        return np.asarray(_ARITHMETIC[name](*operands))
    if name == "convert_element_type":
        return operands[0].astype(result.dtype)
    value = moved(name, operands, operation.params, result.shape)
    if value is None:
        value = operation.primitive.bind(*map(jnp.asarray, operands), **operation.params)
    return np.asarray(value)


def _is_constant(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype != object
