"""Radl and Sundaresan's filtered drag: a correlation, less what unresolved clusters take from it."""

from __future__ import annotations

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.closures.base import Drag, DragInputs
from jaxdem.closures.correlation import Correlation
from jaxdem.closures.wen_yu import WenYu

# Rows: solid fraction from which a row holds, solid fraction that is subtracted, coefficients c_0 to c_3.
_A = (
    (0.000, 0.00, 21.51, 0.0, 0.0, 0.0),
    (0.016, 0.00, 1.96, 29.40, 164.91, -1923.0),
    (0.100, 0.10, 4.63, 4.68, -412.04, 2254.0),
    (0.180, 0.18, 3.52, -17.99, 128.80, -603.0),
    (0.250, 0.25, 2.68, -8.20, 2.18, 112.33),
    (0.400, 0.00, 1.79, 0.0, 0.0, 0.0),
)
_H = (
    (0.00, 0.00, 0.0, 7.97, 0.0, 0.0),
    (0.03, 0.03, 0.239, 4.640, -4.410, 253.630),
    (0.08, 0.08, 0.492, 6.100, 33.630, -789.600),
    (0.12, 0.12, 0.739, 5.010, -61.100, 310.800),
    (0.18, 0.18, 0.887, 1.030, -5.170, 5.990),
    (0.34, 0.34, 0.943, -0.170, -2.290, -9.120),
    (0.48, 0.48, 0.850, -1.350, -6.130, -132.600),
    (0.55, 0.55, 0.680, -2.340, -225.200, 0.0),
)


@partial(jax.tree_util.register_dataclass, data_fields=["length"], meta_fields=["base"])
@dataclasses.dataclass(frozen=True, eq=False)
class RadlSundaresan:
    """A drag law for coarse meshes in gas-solid flows, in closed form.

    force = C F_base, with L the width of the filter (of the cells) and s the solid fraction,
    C = 1 - h(s) / (1 + a(s) L_c / L),  L_c = (u_t^2 / g) Fr^(-2/3),  Fr = u_t^2 / (g d),
    a and h piecewise polynomials of s. C goes to 1 as L/L_c gets small, at s = 0, and where h reaches zero (s = 0.6);
    beyond, where the polynomial of h is negative, it stays 1.

    Valid for simulations of clusters of equal spheres in a gas, in 3-D; s from 0 to 0.55.
    Source: S. Radl & S. Sundaresan (2014), Chem. Eng. Sci. 117, 416-425. The coefficients are those of the public
    implementation in CFDEMcoupling-PFM (BeetstraDrag.C); they were not compared with the paper itself. There
    neighbouring pieces of h meet within 0.001, and h reaches zero at s = 0.6; those of a meet within 5 %,
    but for the jump from 21.5 to 2.5 at s = 0.016.

    Attributes:
        length: L_c [m].
        base: the law that is corrected.
    """

    length: Array
    base: Correlation

    @classmethod
    def of_grain(
        cls, terminal_speed: float, diameter: float, gravity: float = 9.81, base: Correlation | None = None
    ) -> RadlSundaresan:
        """The law for grains of one kind.

        Args:
            terminal_speed: u_t of a single grain [m/s].
            diameter: d of a grain [m].
            gravity: g [m/s2].
            base: law to correct; Wen and Yu's by default.
        """
        length = (terminal_speed**2 / gravity) ** (1.0 / 3.0) * diameter ** (2.0 / 3.0)
        return cls(jnp.asarray(np.float32(length)), WenYu() if base is None else base)

    def factor(self, solid_fraction: Array, filter_size: Array) -> Array:
        """C, from 0 to 1 [-].

        Args:
            solid_fraction: s [-].
            filter_size: L [m].
        """
        solid_fraction = jnp.asarray(solid_fraction)
        hidden = jnp.clip(_pieces(_H, solid_fraction), 0.0, 1.0)
        return 1.0 - hidden * filter_size / (filter_size + _pieces(_A, solid_fraction) * self.length)

    def __call__(self, inputs: DragInputs) -> Drag:
        """Drag for every particle."""
        drag = self.base(inputs)
        solid_fraction = jnp.maximum(inputs.solid_fraction, 0.0)
        return drag._replace(coefficient=drag.coefficient * self.factor(solid_fraction, inputs.filter_size))


def _pieces(rows: tuple[tuple[float, ...], ...], solid_fraction: Array) -> Array:
    """The piecewise polynomial of a table above."""
    table = jnp.asarray(np.asarray(rows), solid_fraction.dtype)
    row = jnp.searchsorted(table[1:, 0], solid_fraction, side="right")
    _, start, *coefficients = jnp.moveaxis(table[row], -1, 0)
    distance, value = solid_fraction - start, jnp.zeros_like(solid_fraction)
    for coefficient in reversed(coefficients):
        value = value * distance + coefficient
    return value
