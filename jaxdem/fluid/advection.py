"""Advection of momentum by the projected flux, in conservative form."""

from __future__ import annotations

import dataclasses
from typing import Protocol

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.boundary import Boundary, with_ghosts
from jaxdem.fluid.grid import FaceField, Grid, along, sum_of


class AdvectionScheme(Protocol):
    """How the advected value is found on the surface of a control volume."""

    def slope(self, behind: Array, ahead: Array) -> Array:
        """Difference over a control volume from the differences to its two neighbours."""
        ...


@dataclasses.dataclass(frozen=True)
class Upwind:
    """First-order upwind: the value of the control volume that the flow comes from."""

    def slope(self, behind: Array, ahead: Array) -> Array:
        """Zero."""
        return jnp.zeros_like(behind)


@dataclasses.dataclass(frozen=True)
class VanLeer:
    """Second-order upwind with van Leer's harmonic limiter: no new extrema, flat at extrema.

    slope = 2 a b / (a + b) where the neighbouring differences a and b have one sign, else 0.

    Source: B. van Leer, J. Comput. Phys. 14 (1974) 361-370; 32 (1979) 101-136.
    """

    def slope(self, behind: Array, ahead: Array) -> Array:
        """See the class."""
        product = behind * ahead
        monotone = product > 0
        total = jnp.where(monotone, behind + ahead, 1.0)
        return jnp.where(monotone, 2.0 * product / total, 0.0)


@dataclasses.dataclass(frozen=True)
class Superbee:
    """Second-order upwind with the steepest limiter without new extrema: fronts and shear layers stay two cells wide.

    slope = sign(a) max(min(2|a|, |b|), min(|a|, 2|b|)) where the neighbouring differences a and b have one sign, else 0. It
    loses least of eddies of a few cells; where a flow is smooth and resolved it makes steps of slopes.

    Source: P. L. Roe, in Large-Scale Computations in Fluid Mechanics, Lect. Appl. Math. 22 (1985) 163-193; P. K. Sweby,
    SIAM J. Numer. Anal. 21 (1984) 995-1011.
    """

    def slope(self, behind: Array, ahead: Array) -> Array:
        """See the class."""
        a, b = jnp.abs(behind), jnp.abs(ahead)
        size = jnp.maximum(jnp.minimum(2.0 * a, b), jnp.minimum(a, 2.0 * b))
        return jnp.where(behind * ahead > 0, jnp.sign(behind) * size, 0.0)


def advection(
    grid: Grid,
    boundary: Boundary,
    scheme: AdvectionScheme,
    side_velocity: tuple[Array, ...],
    flux: FaceField,
    velocity: FaceField,
    time: Array,
) -> FaceField:
    """-div(F u) on every face [m/s2 times void fraction]; the values on boundary faces are not used.

    Args:
        grid: the grid.
        boundary: sides.
        scheme: reconstruction.
        side_velocity: velocity of every side, see `velocity_at` [m/s].
        flux: F = g u on the faces, the flux of the fluid volume [m/s].
        velocity: u on the faces [m/s].
        time: [s].
    """
    result = []
    for which, component in enumerate(velocity):
        terms = []
        for axis in range(grid.dimension):
            padded = with_ghosts(grid, boundary, side_velocity, component, which, axis, time)
            carrier = _flux_through_control_surfaces(grid, flux, which, axis)
            transported = carrier * _upwind_value(scheme, padded, carrier, axis)
            difference = along(transported, axis, 1, None) - along(transported, axis, None, -1)
            terms.append(-difference / grid.spacing[axis])
        result.append(sum_of(terms))
    return tuple(result)


def _upwind_value(scheme: AdvectionScheme, padded: Array, carrier: Array, axis: int) -> Array:
    """Values on the surfaces between the second and the last but one entry of an array padded by two."""
    difference = along(padded, axis, 1, None) - along(padded, axis, None, -1)
    slope = scheme.slope(along(difference, axis, None, -1), along(difference, axis, 1, None))
    centre = along(padded, axis, 1, -1)
    from_below = along(centre + 0.5 * slope, axis, None, -1)
    from_above = along(centre - 0.5 * slope, axis, 1, None)
    return jnp.where(carrier > 0, from_below, from_above)


def _flux_through_control_surfaces(grid: Grid, flux: FaceField, which: int, axis: int) -> Array:
    """F_axis on the surfaces, normal to `axis`, of the control volumes of the faces of axis `which`."""
    f = flux[axis]
    if which == axis:
        inner = 0.5 * (along(f, axis, None, -1) + along(f, axis, 1, None))
        if grid.periodic[axis]:
            return jnp.concatenate((along(inner, axis, -1, None), inner, along(inner, axis, 0, 1)), axis)
        return jnp.concatenate((along(f, axis, 0, 1), inner, along(f, axis, -1, None)), axis)
    inner = 0.5 * (along(f, which, None, -1) + along(f, which, 1, None))
    first, last = along(f, which, 0, 1), along(f, which, -1, None)
    if grid.periodic[which]:
        first = last = 0.5 * (first + last)
    return jnp.concatenate((first, inner, last), which)
