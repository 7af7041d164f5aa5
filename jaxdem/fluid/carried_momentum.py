"""Momentum that is carried by the flux of mass, over a whole step."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.advection import AdvectionScheme, advection, flux_through_control_surfaces
from jaxdem.fluid.boundary import Sides
from jaxdem.fluid.grid import FaceField, Grid, along


class _MeanOverStep(NamedTuple):
    """What passes a surface is the mean over the part u t/h of the control volume that it comes from.

    A slope within that volume counts (1 - u t/h) then: with it one stage is of second order in time and needs no
    second one, for which the surface between the fluids would have to move twice.

    Attributes:
        mass_flux: on the faces [kg/(m2 s)].
        velocity: on the faces [m/s].
        time_step: () [s].
    """

    mass_flux: FaceField
    velocity: FaceField
    time_step: Array

    def surface_value(self, grid: Grid, value: Array, around: Array, which: int, axis: int) -> Array:
        """`value` on the surfaces nearer to that of the control volume that it comes from."""
        carrier = flux_through_control_surfaces(grid, self.mass_flux, which, axis)
        speed = flux_through_control_surfaces(grid, self.velocity, which, axis)
        crossed = jnp.minimum(jnp.abs(speed) * (self.time_step / grid.spacing[axis]), 1.0)
        centre = along(around, axis, 1, -1)
        upstream = jnp.where(carrier > 0, along(centre, axis, None, -1), along(centre, axis, 1, None))
        return upstream + (1.0 - crossed) * (value - upstream)


def carried_momentum(
    grid: Grid, sides: Sides, scheme: AdvectionScheme, mass_flux: FaceField, velocity: FaceField, time_step: Array
) -> FaceField:
    """-div(M u) on every face [N/m3], M the flux of mass.

    Through the surface of a control volume of a face goes the mean of the fluxes M of the two faces beside it, as
    the mass of that volume is the mean of those of the two cells. So what a face loses of mass, and of momentum, is
    one flux: a uniform velocity stays uniform whatever the densities, and a heavy fluid does not push a light one by
    the difference of two large numbers.

    Args:
        grid: the grid.
        sides: of the box.
        scheme: reconstruction of the velocity.
        mass_flux: M, on the faces, that the masses of the cells have changed by [kg/(m2 s)].
        velocity: u at the start of the step, on the faces [m/s].
        time_step: () [s].

    Source: M. Rudman, Int. J. Numer. Meth. Fluids 28 (1998) 357-378, whose condition it satisfies on one mesh; M.
    Bussmann, D. B. Kothe, J. M. Sicilian, ASME FEDSM2002-31125.
    """
    mean = _MeanOverStep(mass_flux, velocity, time_step)
    return advection(grid, sides, scheme, mass_flux, velocity, mean)
