"""The one particle loop that all drag correlations share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import Array

from jaxdem.closures.base import Drag, DragInputs

VOID_FRACTION_FLOOR = 0.2
"""Correlations are evaluated at no lower void fraction; the densest packing of equal spheres has 0.26."""


class Correlation(ABC):
    """A drag law given by F(solid fraction, Re), the multiple of Stokes drag.

    force = 3 pi mu d F (u - v), with the interstitial slip u - v and Re = g rho |u - v| d / mu.
    A subclass implements `stokes_multiple` and names its source; nothing else is needed.
    All laws here are of model A: the pressure gradient force is not part of them. The exchange converts them
    for model B. Every subclass is a pytree without leaves: a part of the program, not of its numbers.
    """

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        jax.tree_util.register_static(cls)

    @abstractmethod
    def stokes_multiple(self, solid_fraction: Array, reynolds: Array) -> Array:
        """F(solid fraction, Re) >= 0, elementwise [-]."""

    def __call__(self, inputs: DragInputs) -> Drag:
        """Drag for every particle; beyond solid fraction 1 - `VOID_FRACTION_FLOOR` it is out of range."""
        return self.evaluated(inputs, self.stokes_multiple)

    def evaluated(self, inputs: DragInputs, multiple: Callable[[Array, Array], Array]) -> Drag:
        """The same of a given F(solid fraction, Re)."""
        limit = 1.0 - VOID_FRACTION_FLOOR
        # Interpolation may leave a round-off below zero, which would make a coefficient negative.
        solid_fraction = jnp.where(inputs.solid_fraction < 0, 0.0, inputs.solid_fraction)
        solid_fraction = jnp.minimum(solid_fraction, limit)
        # Re carries the void fraction that F sees, so that F is a function of its two arguments alone.
        reynolds = (
            (1.0 - solid_fraction)
            * inputs.fluid_density
            * inputs.slip_speed
            * inputs.diameter
            / inputs.dynamic_viscosity
        )
        factor = multiple(solid_fraction, reynolds)
        return Drag(inputs.stokes_coefficient * factor, None, inputs.solid_fraction > limit)

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and vars(self) == vars(other)

    def __hash__(self) -> int:
        return hash(type(self))
