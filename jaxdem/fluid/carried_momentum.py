"""Momentum that is carried by the flux of mass, over a whole step."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.advection import AdvectionScheme, advection, flux_through_control_surfaces
from jaxdem.fluid.boundary import Sides, with_ghosts
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.grid import FaceField, Grid, along, own_layers, sum_of
from jaxdem.fluid.mesh import beyond


class _MeanOverStep(NamedTuple):
    """What passes a surface is the mean over the part u t/h of the control volume that it comes from.

    A slope within that volume counts (1 - u t/h) then: with it one stage is of second order in time and needs no
    second one, for which the surface between the fluids would have to move twice.

    Attributes:
        mass_flux: on the faces [kg/(m2 s)].
        velocity: on the faces [m/s].
        time_step: () [s].
        leaving: what leaves the control volumes of the faces of every axis.
    """

    mass_flux: FaceField
    velocity: FaceField
    time_step: Array
    leaving: tuple[_Leaving, ...]

    def surface_value(self, grid: Grid, value: Array, around: Array, which: int, axis: int) -> Array:
        """`value` on the surfaces nearer to that of the control volume that it comes from."""
        carrier = flux_through_control_surfaces(grid, self.mass_flux, which, axis)
        speed = flux_through_control_surfaces(grid, self.velocity, which, axis)
        crossed = jnp.minimum(jnp.abs(speed) * (self.time_step / grid.spacing[axis]), 1.0)
        own = (_wide(grid, part, which, axis) for part in self.leaving[which])
        upstream, staying, change = (
            jnp.where(carrier > 0, along(centre, axis, None, -1), along(centre, axis, 1, None))
            for centre in (along(around, axis, 1, -1), *own)
        )
        return upstream + change + staying * (1.0 - crossed) * (value - upstream)


class _Leaving(NamedTuple):
    """What leaves control volumes in a step, where more of their mass leaves than of their volume.

    Of a control volume that liquid leaves and gas enters little mass is left, and its velocity is what is left of the
    momentum over it: an error of what has left would be there a thousandfold.

    Attributes:
        staying: part of the mass that stays over that of the volume, between 0 and 1: the slope counts for less by
            it, since what stays has the slope of what has left against it. One where the density is one [-].
        change: of the velocity that is carried out. More mass than there was leaves where liquid passes in a step: what
            is beyond has the velocity of what has come in. Zero where the density is one [m/s].
    """

    staying: Array
    change: Array


def carried_momentum(
    grid: Grid,
    sides: Sides,
    scheme: AdvectionScheme,
    mass_flux: FaceField,
    velocity: FaceField,
    mass: FaceField,
    time_step: Array,
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
        mass: at the start of the step, on the faces, by the volume of the box [kg/m3].
        time_step: () [s].

    Source: M. Rudman, Int. J. Numer. Meth. Fluids 28 (1998) 357-378, whose condition it satisfies on one mesh; M.
    Bussmann, D. B. Kothe, J. M. Sicilian, ASME FEDSM2002-31125. The slopes beside a surface are bounded here.
    """
    leaving = tuple(
        _leaving(_passing(grid, sides, mass_flux, velocity, which), velocity[which], m, time_step)
        for which, m in enumerate(mass)
    )
    mean = _MeanOverStep(mass_flux, velocity, time_step, leaving)
    return advection(grid, sides, scheme, mass_flux, velocity, mean)


class CarriedBesideWalls(NamedTuple):
    """Momentum carried between surfaces within the mesh, on the faces.

    Attributes:
        gain: -div(M u); on closed faces what they would gain [N/m3].
        into: mass that comes into the control volumes [kg/(m3 s)].
    """

    gain: FaceField
    into: FaceField


class _BesideSurfaces(NamedTuple):
    """Values carried between surfaces: those over a step, and between an open and a closed face the open one's."""

    mean: _MeanOverStep
    cut: CutCells

    def surface_value(self, grid: Grid, value: Array, around: Array, which: int, axis: int) -> Array:
        """See the class."""
        value = self.mean.surface_value(grid, value, around, which, axis)
        return self.cut.surface_value(grid, value, around, which, axis)


def carried_beside_walls(
    grid: Grid,
    sides: Sides,
    scheme: AdvectionScheme,
    mass_flux: FaceField,
    velocity: FaceField,
    mass: tuple[FaceField, FaceField],
    time_step: Array,
    cut: CutCells,
) -> CarriedBesideWalls:
    """`carried_momentum` between surfaces; out of control volumes that they cut goes their velocity, without a slope.

    Args:
        grid, sides, scheme, mass_flux, velocity, time_step: as there; the flux through the open parts of the faces.
        mass: at the start of the step, by the volume of the box [kg/m3]; and 1 on whole control volumes, 0 on others.
        cut: the surfaces.
    """
    leaving, into = [], []
    for which, (m, whole) in enumerate(zip(*mass, strict=True)):
        passing = _passing(grid, sides, mass_flux, velocity, which)
        own = _leaving(passing, velocity[which], jnp.where(whole > 0.0, m, 1.0), time_step)
        leaving.append(_Leaving(whole * own.staying, whole * own.change))
        into.append(passing.into)
    mean = _MeanOverStep(mass_flux, velocity, time_step, tuple(leaving))
    gain = advection(grid, sides, scheme, mass_flux, velocity, _BesideSurfaces(mean, cut))
    return CarriedBesideWalls(gain, tuple(into))


class _Passing(NamedTuple):
    """Through the surfaces of the control volumes of the faces of an axis, by their volume.

    Attributes:
        out: mass that leaves [kg/(m3 s)].
        volume: that leaves [1/s].
        into: mass that comes in [kg/(m3 s)].
        brought: its momentum [N/m3].
    """

    out: Array
    volume: Array
    into: Array
    brought: Array


def _passing(grid: Grid, sides: Sides, mass_flux: FaceField, velocity: FaceField, which: int) -> _Passing:
    """See `_Passing`, of the faces of axis `which`."""
    own, terms = velocity[which], []
    for axis, h in enumerate(grid.spacing):
        padded = with_ghosts(grid, sides, own, which, axis)
        mass, volume = (flux_through_control_surfaces(grid, flux, which, axis) / h for flux in (mass_flux, velocity))
        for sign, ends, beside in ((-1.0, (None, -1), (1, -3)), (1.0, (1, None), (3, -1))):
            out, entering = (jnp.maximum(s * along(mass, axis, *ends), 0.0) for s in (sign, -sign))
            leaves = jnp.maximum(sign * along(volume, axis, *ends), 0.0)
            terms.append((out, leaves, entering, entering * along(padded, axis, *beside)))
    return _Passing(*(sum_of(parts) for parts in zip(*terms, strict=True)))


def _leaving(passing: _Passing, velocity: Array, mass: Array, time_step: Array) -> _Leaving:
    """See `_Leaving`, of control volumes with this velocity and mass by volume at the start of the step."""
    kept, volume = mass - time_step * passing.out, 1.0 - time_step * passing.volume
    staying = jnp.clip(kept / (mass * jnp.maximum(volume, 0.1)), 0.0, 1.0)
    beyond = jnp.maximum(-kept, 0.0) / jnp.maximum(time_step * passing.out, mass)
    there = passing.into > 0.0
    came = jnp.where(there, passing.brought / jnp.where(there, passing.into, 1.0), velocity)
    return _Leaving(staying, beyond * (came - velocity))


def _wide(grid: Grid, faces: Array, which: int, axis: int) -> Array:
    """Values on the faces of axis `which` with one layer more on either end of an axis."""
    shared = int(which == axis)  # face of a border or of a periodic axis, which stands in both arrays
    before, after = beyond(grid, axis, faces, (-1 - shared,), (shared,), own_layers(faces, axis))
    return jnp.concatenate((before, faces, after), axis)
