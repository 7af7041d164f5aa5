"""The exchange with particles that are not all present: those that are not give nothing and get nothing."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.closures.base import Drag
from jaxdem.coupling.interpolation import Weights


def present_weights(weights: Weights, active: Array | None) -> Weights:
    """Weights that deposit nothing of particles that are not present, and show them a field of zeros.

    Args:
        weights: of all N particles.
        active: (N,) bool; None where all are present.
    """
    if active is None:
        return weights
    along_axes = weights.along_axes
    if along_axes is not None:
        (cells, weight), *others = along_axes
        along_axes = ((cells, weight * active[:, None]), *others)
    return weights._replace(weight=weights.weight * active[:, None], along_axes=along_axes)


def present_drag(drag: Drag, active: Array | None) -> Drag:
    """The drag law's answer, with none for particles that are not present; see `present_weights`."""
    if active is None:
        return drag
    remainder = None if drag.remainder is None else jnp.where(active[:, None], drag.remainder, 0.0)
    return Drag(jnp.where(active, drag.coefficient, 0.0), remainder, drag.out_of_range & active)


def present_volume(volume: Array, count: int, active: Array | None) -> Array:
    """() volume of all particles present [m3].

    Args:
        volume: () or (N,) of the particles [m3].
        count: N.
        active: (N,) bool; None where all are present.
    """
    each = jnp.broadcast_to(volume, (count,))
    return jnp.sum(each if active is None else jnp.where(active, each, 0.0))


def volume_error(deposited: Array, total: Array) -> Array:
    """() |deposited - total| / total; zero where nothing is present and nothing deposited [-].

    Args:
        deposited: () volume of the solids in all cells [m3].
        total: () volume of the particles present [m3].
    """
    return jnp.abs(deposited - total) / jnp.maximum(total, jnp.finfo(total.dtype).tiny)
