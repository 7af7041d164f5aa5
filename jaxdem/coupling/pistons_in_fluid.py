"""Walls that a force holds and that the fluid sees: where they are in an interval, and what the fluid does to them.

In a coupling interval the fluid sees a piston of mass m go on with the velocity v that it has at its start. The load L
of the fluid, the mean over the interval, then moves it together with the grains. A change of v acts on the fluid in
the next interval, so L has a part -M' a: a is the change of v that the fluid saw from the last interval to this one,
over the interval t, and M' = Z t with Z the mean load over an interval that a change of the speed by 1 m/s makes, by
inertia and drag, see `fluid.surface_response`. A piston lighter than the fluid that it moves would be unstable if L
were all. So M' is on both sides:

    (m + M') dv/dt = F + m g.e + L + M' a - c v + f.e - rho V g.e

Z counts the changes of the load by all pistons, each as an amount. The loads are M a with a matrix M that is symmetric;
the diagonal matrix of the sums of its rows is not less than M, which the diagonal of M alone may be where pistons share
their fluid: three of them would swing ever wider.

Where M' is the added mass this is exact for a motion with constant acceleration, and stable whatever m is: an error of
a is times (M' - M)/(m + M') in the next interval, M the true added mass, which is less than M'. V is the volume of
fluid that a body displaces, as L is of the reduced pressure. Derived here; for explicit coupling and added mass see P.
Causin, J. F. Gerbeau, F. Nobile, Comput. Methods Appl. Mech. Eng. 194 (2005) 4506-4527.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxdem.fluid.grid import Grid, along, sum_of
from jaxdem.fluid.surface_response import SurfaceResponse
from jaxdem.numerics.blocks import largest
from jaxdem.numerics.compensated import Pair
from jaxdem.numerics.host import least_of, namespace
from jaxdem.numerics.static import static
from jaxdem.particles.moving_walls import Numbers, PistonNumbers, PistonState

TOUCHING = 0.01
"""Gap between a piston and a wall over the size of a cell, up to which they touch from the start: a piston in its guide
[-]."""

FACING = 0.7
"""Two bodies face each other along the way of a piston where the product of the slopes of their distances is below
minus this: a wall at less than 45 degrees to the way of a plane is its guide [-]."""


@static
class PistonInFluid:
    """A piston that the fluid sees; static.

    Attributes:
        number: among the pistons.
        wall: number of its wall in the scene.
        surfaces: its surfaces, among those that the fluid sees.
        direction: unit vector that it moves along, D numbers.
        displaced: V, volume of fluid that it displaces; 0 of a plane or wedge, which has no other side [m3].
        apart: surfaces among those that the fluid sees, each with its wall in the scene, which it must not meet: those
            of other walls that it does not touch where the scene has it, and those that come later.
        along: others that it touches where the scene has it, or slides along: it must not move against these.
    """

    number: int
    wall: int
    surfaces: tuple[int, ...]
    direction: tuple[float, ...]
    displaced: float = 0.0
    apart: tuple[tuple[int, int], ...] = ()
    along: tuple[tuple[int, int], ...] = ()

    def touches(self, response: SurfaceResponse) -> Array:
        """() bool, whether there is fluid beside it."""
        return jnp.any(response.area[jnp.asarray(self.surfaces)] > 0.0)


def gaps_of(grid: Grid, pistons: Sequence[PistonInFluid], distances: Sequence[Array]) -> Array:
    """(H, S) gaps between each of H pistons and the surfaces that it must not meet; the size of the box for others [m].

    The least over the corners of the mesh of the sum of two signed distances, each from -h up: not less than the gap of
    bodies that are apart, and larger by what the nearest corner is off the line of the shortest way: nothing between
    planes, a tenth of h between balls of 4 h, half of h at a sharp edge. Where they overlap by more it is negative.
    Deeper than a cell within a body the distance of another one may not be known.

    Of a surface that the piston slides along only corners count between parts that face each other along its way, where
    the product of the slopes of both distances is below -`FACING`: not the sides of a guide, but its end.

    Args:
        grid: the mesh of the fluid.
        pistons: H of them.
        distances: of all surfaces at the corners, positive in the fluid [m].
    """
    xp, depth = namespace(distances[0]), min(grid.spacing)
    shallow = [xp.maximum(distance, -depth) for distance in distances]
    found = []
    for piston in pistons:
        own = least_of([shallow[k] for k in piston.surfaces])
        apart, along = ({number for number, _ in walls} for walls in (piston.apart, piston.along))
        far = xp.asarray(math.hypot(*grid.size), own.dtype)
        slope = _slope(grid, piston, least_of([distances[k] for k in piston.surfaces])) if along else 0.0
        for k, other in enumerate(shallow):
            gap = far
            if k in apart:
                gap = xp.min(own + other)
            elif k in along:
                facing = slope * _slope(grid, piston, distances[k]) < -FACING
                gap = xp.min(xp.where(facing, own + other, far)) + TOUCHING * depth
            found.append(gap)
    gaps = xp.reshape(xp.stack(found), (len(pistons), len(distances)))
    return gaps if xp is np else -largest(grid.blocks, -lax.stop_gradient(gaps))


def _slope(grid: Grid, piston: PistonInFluid, distance: Array) -> Array:
    """Change of a distance at the corners along the way of a piston [-]."""
    return sum_of([part * _change(grid, distance, axis) for axis, part in enumerate(piston.direction) if part])


def _change(grid: Grid, corners: Array, axis: int) -> Array:
    """Change of a distance at the corners along an axis, by those on both sides, at an end of the box by one [-]."""
    h, cut = grid.spacing[axis], grid.cut_along(axis)
    own: Array = namespace(corners).gradient(corners, h, axis=axis)
    if cut is None:
        return own
    # The layer next to a border between slabs, which is in both.
    second, last_but_one = along(corners, axis, 1, 2), along(corners, axis, -2, -1)
    before, after = cut.from_both(second, last_but_one)
    ends = (second - before) / (2.0 * h), (after - last_but_one) / (2.0 * h)
    first = jnp.where(cut.index() == 0, along(own, axis, 0, 1), ends[0])
    last = jnp.where(cut.index() == cut.number - 1, along(own, axis, -1, None), ends[1])
    return jnp.concatenate((first, along(own, axis, 1, -1), last), axis)


class FluidOnWalls(NamedTuple):
    """What the fluid does to the surfaces in an interval.

    Attributes:
        load: (S, D) mean force on every surface [N].
        response: its change by the speed of the pistons.
        density: () [kg/m3].
    """

    load: Array
    response: SurfaceResponse
    density: Array


def numbers_of_interval(
    pistons: Sequence[PistonInFluid], numbers: Sequence[Numbers], state: PistonState, start: Pair
) -> tuple[Numbers, ...]:
    """Numbers of the motion of every wall, with those of the pistons after their given ones: see `motion.Drift`.

    Args:
        pistons: that the fluid sees.
        numbers: of the given motion of every wall.
        state: at the start of the interval.
        start: () of the interval as a pair [s].
    """
    found = list(numbers)
    for piston in pistons:
        k, low = piston.number, state.displacement_low
        own = {
            "displacement": (state.displacement[k], None if low is None else low[k]),
            "velocity": state.velocity[k],
            "since": start,
        }
        found[piston.wall] = (*numbers[piston.wall], own)  # type: ignore[arg-type,assignment]
    return tuple(found)


def under_load(
    pistons: Sequence[PistonInFluid],
    numbers: Sequence[PistonNumbers],
    state: PistonState,
    fluid: FluidOnWalls,
    gravity: Array,
    duration: Array,
) -> tuple[tuple[PistonNumbers, ...], PistonState]:
    """The numbers of all pistons in an interval, with the fluid's part, and their state as the next one needs it.

    Args:
        pistons: that the fluid sees.
        numbers: of all.
        state: of all at its start.
        fluid: what it does to the surfaces.
        gravity: (D,) [m/s2].
        duration: () t, of the interval [s].
    """
    found, before = list(numbers), state.velocity if state.seen_velocity is None else state.seen_velocity
    for piston in pistons:
        k, along = piston.number, jnp.asarray(piston.direction, gravity.dtype)
        own, weight = numbers[k], jnp.dot(along, gravity)
        rows = jnp.asarray(piston.surfaces)
        load = jnp.dot(along, jnp.sum(fluid.load[rows], axis=0)) - piston.displaced * fluid.density * weight
        friction = -jnp.dot(along**2, jnp.sum(fluid.response.friction[rows], axis=0))
        by_each = jnp.sum(fluid.response.pressure[:, rows], axis=1) @ along
        added = (friction + jnp.sum(jnp.abs(by_each))) * duration
        held = (state.velocity[k] - before[k]) / duration - weight
        found[k] = own._replace(force=own.force + load + added * held, mass=own.mass + added)
    return tuple(found), state._replace(seen_velocity=state.velocity)
