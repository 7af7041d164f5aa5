"""Drag of model A in the form of model B, and back."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.closures.base import Drag
from jaxdem.closures.correlation import VOID_FRACTION_FLOOR


def drag_of_model_b(drag: Drag, solid_fraction: Array) -> Drag:
    """Drag of model A in the form of model B, over the void fraction: f_B = f_A / g.

    In a steady, even flow through n particles per volume, model A has -g grad p = n f_A, so that a particle gets
    -V grad p + f_A = f_A / g in all; model B makes all of it drag. Where the fluid accelerates they differ. The
    void fraction is not taken under the floor at which the laws are evaluated.

    Args:
        drag: of a law of model A.
        solid_fraction: (N,) at the particles [-].

    Source: Z. Y. Zhou, S. B. Kuang, K. W. Chu, A. B. Yu, J. Fluid Mech. 661 (2010) 482-510, sets II and III.
    """
    share = _share_of_model_b(solid_fraction)
    remainder = None if drag.remainder is None else drag.remainder / share[:, None]
    return Drag(drag.coefficient / share, remainder, drag.out_of_range)


def drag_of_model_a(force: Array, solid_fraction: Array) -> Array:
    """Drag force of model B in the form of model A, (N, D) [N]; the inverse of `drag_of_model_b`."""
    return force * _share_of_model_b(solid_fraction)[:, None]


def _share_of_model_b(solid_fraction: Array) -> Array:
    """(N,) f_A / f_B [-]."""
    return jnp.maximum(1.0 - solid_fraction, VOID_FRACTION_FLOOR)
