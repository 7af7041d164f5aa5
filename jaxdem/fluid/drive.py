"""What drives a fluid round a periodic box: a mean pressure gradient, given or such that it holds a bulk velocity.

Along a periodic axis the pressure is G x + p with p periodic. The solver's p is the reduced pressure, of which the
weight of the fluid is taken out, so what acts beside its gradient is

    G' = G - rho g    [Pa/m],

with G the gradient of the pressure itself that the scene gives, and g the gravity along the axis. Model A divides G'
among fluid and particles by their volumes, as every pressure gradient.

A bulk velocity U, the volume flow over the cross-section, is held by a controller. In every fluid step

    G'_(n+1) = G'_n + (mean(g u*) - U) / mean(g c),

with g the void fraction, u* the velocity before the projection and c the change of it by a unit gradient. Without
particles this holds U to rounding. With particles the projection changes the mean, by a part that the next steps take
out.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.grid import CellOrOne, FaceField, Grid, along, box_mean
from jaxdem.numerics.static import static
from jaxdem.numerics.tables import at_time


@static
class Drive:
    """Which axes are driven, and how; static.

    Attributes:
        driven: whether each axis is: the periodic ones.
        held: whether the bulk velocity along it is held.
        times: increasing, of the tables in `DriveParameters` [s]; None for values that do not change.
    """

    driven: tuple[bool, ...]
    held: tuple[bool, ...]
    times: tuple[float, ...] | None = None


class DriveParameters(NamedTuple):
    """Numbers of a drive; traced.

    Attributes:
        pressure_gradient: (D,) G, or (T, D) at the drive's T times [Pa/m].
        bulk_velocity: (D,) U, or (T, D); None where none is held [m/s].
    """

    pressure_gradient: Array
    bulk_velocity: Array | None = None


def given_gradient(drive: Drive, parameters: DriveParameters, weight: Array, time: Array) -> Array:
    """(D,) G' along the driven axes, 0 along the others [Pa/m].

    Args:
        drive: which axes are driven.
        parameters: its numbers.
        weight: (D,) rho g of the fluid [N/m3].
        time: () [s].
    """
    gradient = at_time(drive.times, parameters.pressure_gradient, time) - weight
    return jnp.where(jnp.asarray(drive.driven), gradient, 0.0)


def bulk_velocity(grid: Grid, drive: Drive, velocity: FaceField, void_fraction: tuple[CellOrOne, ...]) -> Array:
    """(D,) mean of g u along the driven axes, the volume flow over the cross-section; 0 along the others [m/s].

    Args:
        grid: the grid.
        drive: which axes are driven.
        velocity: u on the faces [m/s].
        void_fraction: g on the faces [-].
    """
    zero, terms = jnp.zeros((), velocity[0].dtype), zip(void_fraction, velocity, strict=True)
    flow = [_mean(grid, g * u, axis) if drive.driven[axis] else zero for axis, (g, u) in enumerate(terms)]
    return jnp.stack(flow)


def held(
    grid: Grid,
    drive: Drive,
    target: Array,
    velocity: FaceField,
    void_fraction: tuple[CellOrOne, ...],
    response: tuple[CellOrOne, ...],
) -> tuple[FaceField, Array]:
    """The velocity with the bulk velocity that is to be held, and the change (D,) of the gradient that does it [Pa/m].

    Args:
        grid: the grid.
        drive: which axes are held.
        target: (D,) U [m/s].
        velocity: before the projection, on the faces [m/s].
        void_fraction: on the faces [-].
        response: c, what a unit gradient takes from the velocity, on the faces [m3 s/kg].
    """
    flow, change, result = bulk_velocity(grid, drive, velocity, void_fraction), jnp.zeros_like(target), list(velocity)
    for axis, holds in enumerate(drive.held):
        if holds:
            taken = jnp.broadcast_to(void_fraction[axis] * response[axis], velocity[axis].shape)
            more = (flow[axis] - target[axis]) / _mean(grid, taken, axis)
            change = change.at[axis].set(more)
            result[axis] = velocity[axis] - more * response[axis]
    return tuple(result), change


def _mean(grid: Grid, faces: Array, axis: int) -> Array:
    """Mean over the box of a quantity on the faces of a periodic axis, whose first and last face are one."""
    return box_mean(grid, along(faces, axis, None, -1))
