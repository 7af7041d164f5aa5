"""A closure of neighbours as an ONNX graph of all spheres and all pairs, whose numbers are free."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.closures.base import DragInputs
from jaxdem.closures.export_neighbors_parts import (
    THERE,
    carried_of_pair,
    cut,
    flat,
    handed_on,
    one_neighbor,
    response_of,
    shapes_of,
)
from jaxdem.closures.export_onnx import Tensor, Writer
from jaxdem.closures.export_trace import UNITS, walk
from jaxdem.closures.neighbor_effect import neighbor_effect
from jaxdem.closures.neighbor_places import axes_along
from jaxdem.closures.neighbors import NeighborClosure

OF_SPHERES = {
    "slip": ((3,), "m/s, interstitial velocity of the fluid less that of the sphere"),
    "solid_fraction": ((), UNITS["solid_fraction"]),
    "diameter": ((), UNITS["diameter"]),
    "fluid_density": ((), UNITS["fluid_density"]),
    "dynamic_viscosity": ((), UNITS["dynamic_viscosity"]),
}
"""Inputs of each sphere: shape and meaning."""
RESULTS = {
    "coefficient": ((), UNITS["coefficient"]),
    "across": ((3,), "N, force across the slip"),
    "torque": ((3,), "N m"),
    "out_of_range": ((), "less than half of the fluctuation acts, or a floor of the base law does"),
}
"""Outputs: shape and meaning."""


def neighbor_onnx(closure: NeighborClosure, about: str, version: str) -> bytes:
    """Bytes of an ONNX file: what the neighbours do to spheres, in model A.

    The inputs of P pairs, each neighbour within the reach of each sphere once, so that two spheres are two pairs:
        own (P,) and other (P,), int64, the sphere and its neighbour;
        offset (P, 3), centre of the neighbour, of its nearest image, less that of the sphere [m].
    Those of spheres are `OF_SPHERES`, the outputs are `RESULTS`. The force is coefficient times slip, plus `across`.

    Args:
        closure: of one level or two.
        about: description kept in the file.
        version: of jaxdem.

    Raises:
        InputError: the package onnx is not installed.
    """
    graph = _Graph(closure)
    sums, carried = graph.summed(graph.add), None
    if closure.carried is not None:
        graph.handed = graph.rows(graph.force, [sums, graph.axes, *graph.flow])[0]
        carried = graph.summed(graph.carry)
    given = [sums, *([] if carried is None else [carried]), graph.axes, *graph.flow]
    for value, (name, (shape, text)) in zip(graph.rows(graph.drag, given), RESULTS.items(), strict=True):
        graph.writer.output(value, name, shape, text, "spheres")
    return graph.writer.model(about, version)


class _Graph:
    """The graph, and functions of one sphere or one pair of which it is made.

    Attributes:
        writer: of the graph.
        flow: inputs of the spheres.
        axes: (spheres, 3, 3) see `axes_along`.
        handed: (spheres, 3) force that a sphere hands on to its neighbours.
    """

    handed: Tensor

    def __init__(self, closure: NeighborClosure):
        self._closure, self.writer = closure, Writer()
        self._sums = shapes_of(lambda place: closure.moments(one_neighbor(place), THERE), 3)
        self._carried = []
        if closure.carried is not None:
            self._carried = shapes_of(lambda both: carried_of_pair(closure, both[:3], both[3:]), 6)
        self.flow = [self.writer.input(name, *about, "spheres") for name, about in OF_SPHERES.items()]
        pairs: dict[str, Any] = {"rows": "pairs", "kind": np.int64}
        self._own = self.writer.input("own", (), "number of the sphere", **pairs)
        self._other = self.writer.input("other", (), "number of its neighbour", **pairs)
        self._offset = self.writer.input("offset", (3,), "m, neighbour less sphere", "pairs")
        self.axes = self.rows(lambda slip: jnp.stack(axes_along(slip[None]), axis=1)[0], self.flow[:1])[0]

    def rows(self, function: Callable[..., Any], inputs: Sequence[Tensor]) -> list[Any]:
        """What a function of one row gives for all rows."""
        shapes = [jax.ShapeDtypeStruct(tensor.shape, jnp.float32) for tensor in inputs]
        return walk(jax.make_jaxpr(function)(*shapes), inputs, self.writer.apply)

    def summed(self, function: Callable[..., Array]) -> Tensor:
        """Sums over the neighbours of what a function gives for each pair."""
        diameter = self.flow[list(OF_SPHERES).index("diameter")]
        given = [self._offset, *(self._of(self._own, one) for one in (self.axes, diameter))]
        if function == self.carry:
            given.append(self._of(self._other, self.handed))
        values = self.rows(function, given)[0]
        size = np.asarray(values.shape, np.int64)
        count = self.writer.node("Shape", self.flow[0], start=0, end=1)
        none = self.writer.node("Expand", np.zeros((), np.float32), self.writer.node("Concat", count, size, axis=0))
        place = self.writer.node("Unsqueeze", self._own, np.asarray([1], np.int64))
        found = self.writer.node("ScatterND", none, place, values, reduction="add")
        found.shape = values.shape
        return found

    def _of(self, number: Tensor, values: Tensor) -> Tensor:
        """The rows of spheres for each pair."""
        found = self.writer.node("Gather", values, number, axis=0)
        found.shape = values.shape
        return found

    def add(self, offset: Array, axes: Array, diameter: Array) -> Array:
        """What a neighbour adds to the moments of a sphere."""
        return flat(self._closure.moments(one_neighbor(_along(axes, offset) / diameter), THERE))

    def force(self, sums: Array, axes: Array, *flow: Array) -> Array:
        """(3,) what a sphere hands on to its neighbours."""
        inputs = _inputs(flow)
        force = handed_on(self._closure, cut(sums, self._sums), inputs.reynolds, inputs.solid_fraction)
        return jnp.sum(force[:, None] * axes, axis=0)

    def carry(self, offset: Array, axes: Array, diameter: Array, vector: Array) -> Array:
        """What a neighbour adds to the moments of forces of a sphere."""
        return flat(carried_of_pair(self._closure, _along(axes, offset) / diameter, _along(axes, vector)))

    def drag(self, sums: Array, *rest: Array) -> tuple[Array, ...]:
        """The results of a sphere, of its sums and, with a second level, carried sums, axes and flow."""
        closure, inputs, axes = self._closure, _inputs(rest[-len(OF_SPHERES) :]), rest[-len(OF_SPHERES) - 1]
        carried = cut(rest[0], self._carried) if self._carried else None
        response = response_of(closure, cut(sums, self._sums), carried, inputs.reynolds, inputs.solid_fraction)
        frame = axes[None, 0], axes[None, 1], axes[None, 2]
        effect, law = neighbor_effect(closure.base, "A", response, frame, inputs), closure.base(inputs)
        outside = effect.out_of_range | law.out_of_range
        return (effect.multiple * law.coefficient)[0], effect.across[0], effect.torque[0], outside[0]


def _inputs(flow: Sequence[Array]) -> DragInputs:
    """Inputs of the base law of one sphere."""
    slip, solid_fraction, diameter, density, viscosity = (value[None] for value in flow)
    none = jnp.zeros_like(slip)
    return DragInputs(none, slip, solid_fraction, none, none, diameter, diameter, density, viscosity)


def _along(axes: Array, vector: Array) -> Array:
    """(3,) components of a vector along the axes, rows."""
    return jnp.sum(axes * vector[None], axis=1)
