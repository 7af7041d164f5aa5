"""The closures of a coarse run, and which of their weights are trained."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.closures import InvariantClosure, PaperNetwork, SubgridClosure
from jaxdem.closures.network import Weights as NetworkWeights
from jaxdem.closures.network import layer_name
from jaxdem.errors import InputError, required
from jaxdem.state import Parameters

LearnedClosure = PaperNetwork | InvariantClosure
Weights = dict[str, NetworkWeights]
"""Weights by the name of the closure, `drag` or `subgrid`."""


class Closures(NamedTuple):
    """The closures of a coarse run.

    Attributes:
        drag: learned drag, None for the scene's own.
        subgrid: learned subgrid stress, None for the scene's own.
        trained: names of those whose weights change.
    """

    drag: LearnedClosure | None = None
    subgrid: SubgridClosure | None = None
    trained: tuple[str, ...] = ("drag",)

    @property
    def weights(self) -> Weights:
        """Of those that are trained."""
        return {name: getattr(self, name).weights for name in self.trained}

    def with_weights(self, weights: Weights) -> Closures:
        """The same with these weights."""
        changed = {name: dataclasses.replace(getattr(self, name), weights=values) for name, values in weights.items()}
        return self._replace(**changed)

    def put_into(self, parameters: Parameters) -> Parameters:
        """Parameters with those that are trained."""
        if "drag" in self.trained:
            parameters = parameters._replace(closure=self.drag)
        if "subgrid" in self.trained:
            fluid = required(parameters.fluid, "fluid")
            parameters = parameters._replace(fluid=fluid._replace(subgrid=self.subgrid))
        return parameters

    def check(self) -> None:
        """Raise InputError where nothing is trained, or something that there is not."""
        given = [name for name in ("drag", "subgrid") if getattr(self, name) is not None]
        if not self.trained:
            raise InputError("trained", self.trained, "names no closure", "Name drag, subgrid or both.")
        for name in self.trained:
            if name not in given:
                limit = f"is none of the closures that are given: {', '.join(given) or 'none'}"
                raise InputError("trained", name, limit, "Name those of drag and subgrid that are given.")


def few_parameters(closures: Closures) -> tuple[Array, Callable[[Array], Weights]]:
    """A handful of parameters for a search without gradients: (p, weights of p), p = 0 for the closures themselves.

    For each closure the bias of the last layer moves by p_k for output k, and its kernel is multiplied by exp(p_last):
    not where it is zero, as in a closure that has not been trained, whose outputs stay the same for every input.
    """
    layers = {name: _last_layer(closures, name)[1] for name in closures.trained}
    sizes = {n: layer["bias"].shape[0] + int(np.any(layer["kernel"])) for n, layer in layers.items()}

    def weights(p: Array) -> Weights:
        moved, start = {}, 0
        for name, size in sizes.items():
            own, (last, layer) = p[start : start + size], _last_layer(closures, name)
            start += size
            outputs = layer["bias"].shape[0]
            changed = {"kernel": layer["kernel"], "bias": jnp.asarray(layer["bias"]) + own[:outputs]}
            if size > outputs:
                changed["kernel"] = layer["kernel"] * jnp.exp(own[-1])
            moved[name] = closures.weights[name] | {last: changed}
        return moved

    first = _last_layer(closures, closures.trained[0])[1]["bias"]
    return jnp.zeros(sum(sizes.values()), jnp.asarray(first).dtype), weights


def _last_layer(closures: Closures, name: str) -> tuple[str, dict[str, Array]]:
    last = layer_name(len(getattr(closures, name).hidden))
    return last, closures.weights[name][last]
