"""Boundary conditions of the fluid, per side of the box and per patch of a side."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.fluid.grid import CellOrOne, FaceField, Grid, along
from jaxdem.fluid.inlet import InletProfile
from jaxdem.fluid.mesh import Ends, at_side, beyond, layers, of_slab, with_ends
from jaxdem.fluid.side_conditions import CONDITIONS, Inlet, Outlet, SideCondition
from jaxdem.numerics.static import static
from jaxdem.numerics.tables import at_time, largest_between


@static
class Side:
    """One side of the box; static.

    Attributes:
        axis: the axis it is normal to.
        upper: whether it is the side at the upper end of that axis.
        kind: one of `CONDITIONS`; it holds on the patch, and the rest of the side is a no-slip wall.
        start: lower corner of the patch in the other axes [m], or None for the whole side.
        stop: upper corner [m].
        ramp_time: over which the velocity rises linearly from zero [s].
        profile: of an inlet, one for each of the other axes, None where it is even; None if it is so in all.
        times: increasing, of the velocities of a side whose velocity is a table in time; None for one velocity [s].
        own: what the fluid does here instead of what the kind says, on the whole side.
    """

    axis: int
    upper: bool
    kind: str
    start: tuple[float, ...] | None = None
    stop: tuple[float, ...] | None = None
    ramp_time: float = 0.0
    profile: tuple[InletProfile | None, ...] | None = None
    times: tuple[float, ...] | None = None
    own: SideCondition | None = None

    @property
    def condition(self) -> SideCondition:
        """What the fluid does here."""
        return CONDITIONS[self.kind] if self.own is None else self.own

    @property
    def is_passable(self) -> bool:
        """Whether fluid may pass it; a condition of the user's may let it."""
        return self.own is not None or isinstance(self.condition, Inlet | Outlet)


@static
class Boundary:
    """All sides, lower before upper, axis by axis; static."""

    sides: tuple[Side, ...]

    def side(self, axis: int, upper: bool) -> Side:
        """The side at one end of an axis."""
        return self.sides[2 * axis + upper]

    @property
    def passable(self) -> tuple[int, ...]:
        """Numbers of the sides that fluid may pass."""
        return tuple(number for number, side in enumerate(self.sides) if side.is_passable)

    @property
    def has_outlet(self) -> bool:
        """Whether the pressure is set anywhere; without it only its differences have a meaning."""
        return any(side.condition.sets_pressure for side in self.sides)


def coverage(grid: Grid, side: Side, staggered: int | None = None) -> np.ndarray:
    """Fraction of every boundary face of a side that the patch covers; of an inlet with a profile, its mean.

    The mean is over the whole face, with zero beyond the patch. Summed with the areas of the faces it is the
    integral of the profile over the patch on every mesh, to round-off.

    Args:
        grid: the grid; of a slab, that of the whole box is taken.
        side: the side.
        staggered: another axis on whose faces the values live (for tangential velocities), or None.

    Returns:
        Array with one entry per face in the axes other than the side's, size 1 along the side's axis.
    """
    result = np.ones([1] * grid.dimension)
    others = [axis for axis in range(grid.dimension) if axis != side.axis]
    for position, axis in enumerate(others):
        edges = np.linspace(0.0, grid.size[axis], grid.whole_cells[axis] + 1)
        if axis == staggered:
            centres = 0.5 * (edges[1:] + edges[:-1])
            edges = np.concatenate(([0.0], centres, [grid.size[axis]]))
        profile = None if side.profile is None else side.profile[position]
        if (side.start is None or side.stop is None) and profile is None:
            covered = np.ones(len(edges) - 1)
        else:
            start = 0.0 if side.start is None else side.start[position]
            stop = grid.size[axis] if side.stop is None else side.stop[position]
            inside = np.clip(edges, start, stop)
            passed = inside if profile is None else profile.integral(inside, start, stop)
            covered = np.diff(passed) / np.diff(edges)
        shape = [-1 if a == axis else 1 for a in range(grid.dimension)]
        result = result * covered.reshape(shape)
    return result


def momentum_excess(grid: Grid, side: Side) -> np.ndarray | None:
    """1/c - 1 over every face of an inlet, c the part of it that the patch covers [-].

    The fluid comes in through that part alone, 1/c times as fast as the face's mean velocity says, and brings so much
    more momentum than its square. Without it an inlet that ends within a face would have a weaker jet on a coarse mesh
    than on a fine one. A profile's own variation over a face is not in it: within the box that is not resolved either.

    Args:
        grid: the grid.
        side: the side.

    Returns:
        An array as that of `coverage`, zero on faces that nothing enters by; None where there is none in all: other
        kinds of sides, and inlets that end between faces.
    """
    if not isinstance(side.condition, Inlet):
        return None
    covered = coverage(grid, dataclasses.replace(side, profile=None))
    # Faces that rounding alone puts into the patch, or leaves out of it, are none of it.
    part = (covered > 1e-9) & (covered < 1.0 - 1e-9)
    return np.where(part, 1.0 / np.where(part, covered, 1.0) - 1.0, 0.0) if part.any() else None


def open_fraction(grid: Grid, side: Side) -> np.ndarray:
    """1 on the faces of a side through which the pressure drives the flow (outlet), else 0."""
    covered = coverage(grid, side)
    return np.where((covered >= 0.5) & side.condition.sets_pressure, 1.0, 0.0)


def net_inflow(grid: Grid, boundary: Boundary, side_velocity: Sequence[np.ndarray], time: float) -> tuple[float, float]:
    """What comes in through all sides at a time, what inlets draw off taken away, and the same added up [m3/s].

    Args:
        grid: the grid.
        boundary: the sides.
        side_velocity: (D,) of every side, or (T, D) at its T times [m/s].
        time: [s].
    """
    net = gross = 0.0
    for side, velocity in zip(boundary.sides, side_velocity, strict=True):
        if not isinstance(side.condition, Inlet):
            continue
        speed = float(velocity_at(side, jnp.asarray(velocity), jnp.asarray(time))[side.axis])
        faces = [1 if axis == side.axis else cells for axis, cells in enumerate(grid.whole_cells)]
        area = float(np.sum(np.broadcast_to(coverage(grid, side), faces)))
        area *= grid.cell_volume / grid.spacing[side.axis]
        flow = (-speed if side.upper else speed) * area
        net, gross = net + flow, gross + abs(flow)
    return net, gross


def ramp(ramp_time: float, time: Array) -> Array:
    """Factor of a velocity at a time [s]: rises linearly from 0 to 1 over the ramp [s]."""
    if ramp_time == 0.0:
        return jnp.ones_like(time)
    return jnp.clip(time / ramp_time, 0.0, 1.0)


def velocity_at(side: Side, velocity: Array, time: Array) -> Array:
    """(D,) velocity of a side at a time [m/s]: ramp times the velocity, or times its table interpolated linearly.

    Before the first and after the last time of the table its first and last velocity hold.

    Args:
        side: the side.
        velocity: (D,), or (T, D) at the side's T times [m/s].
        time: () [s].
    """
    return ramp(side.ramp_time, time) * at_time(side.times, velocity, time)


class Sides(NamedTuple):
    """The sides of the box as they move at a time.

    Attributes:
        boundary: static.
        velocity: of every side, see `velocity_at` [m/s].
        time: () [s].
    """

    boundary: Boundary
    velocity: tuple[Array, ...]
    time: Array

    def velocity_of(self, axis: int, upper: bool) -> Array:
        """(D,) velocity of the side at one end of an axis [m/s]."""
        return velocity_at(self.boundary.side(axis, upper), self.velocity[2 * axis + upper], self.time)


def largest_inflow(side: Side, velocity: Array, start: Array, stop: Array) -> Array:
    """() largest normal speed that an inlet may have between two times, whatever its ramp has reached [m/s].

    Args:
        side: the side.
        velocity: (D,), or (T, D) at the side's T times [m/s].
        start: () [s].
        stop: () [s].
    """
    normal = largest_between(side.times, velocity[..., side.axis], start, stop)
    for profile in side.profile or ():
        normal = normal if profile is None else profile.peak * normal
    return normal


def set_normal_velocity(
    grid: Grid, sides: Sides, velocity: FaceField, void_fraction: tuple[CellOrOne, ...]
) -> FaceField:
    """Face velocities with the boundary faces set.

    Each side by its `SideCondition`: the faces of an outlet keep what the balance of momentum gave them; an inlet has
    the superficial velocity of the side times the covered fraction of each face (or the mean of its profile). Periodic:
    the doubles are made equal.

    Args:
        grid: the grid.
        sides: of the box.
        velocity: D face arrays [m/s].
        void_fraction: on the faces.
    """
    result = []
    for axis, component in enumerate(velocity):
        if grid.periodic[axis]:
            result.append(component)
            continue
        ends = []
        for upper in (False, True):
            side = sides.boundary.side(axis, upper)
            own = side.condition.sets_pressure
            place = ((-1, None) if own else (-2, -1)) if upper else ((0, 1) if own else (1, 2))
            predicted = along(component, axis, *place)
            g = void_fraction[axis]
            there = g if isinstance(g, float) else (along(g, axis, -1, None) if upper else along(g, axis, 0, 1))
            covered = of_slab(grid, coverage(grid, side), component.dtype)
            speed = sides.velocity_of(axis, upper)[axis]
            value = side.condition.normal(predicted, covered * speed, there, upper)
            if own:
                value = of_slab(grid, open_fraction(grid, side), component.dtype) * value
            ends.append(value)
        result.append(with_ends(grid, axis, component, (ends[0], ends[1])))
    return tuple(result)


def with_outflow(grid: Grid, boundary: Boundary, flux: FaceField, rate: Array) -> FaceField:
    """The flux with so much more, evenly over all outlets, going out of the box.

    Args:
        grid: the grid.
        boundary: sides, of which at least one is an outlet.
        flux: D face arrays [m/s].
        rate: () volume that is to leave over that of the box [1/s].
    """
    is_open = [open_fraction(grid, side) for side in boundary.sides]
    area = sum(float(np.sum(o)) / grid.spacing[s.axis] for o, s in zip(is_open, boundary.sides, strict=True))
    speed = rate * (math.prod(grid.whole_cells) / area)
    result = list(flux)
    for side, faces in zip(boundary.sides, is_open, strict=True):
        if faces.any():
            place = (slice(None),) * side.axis + (slice(-1, None) if side.upper else slice(0, 1),)
            outward = speed * of_slab(grid, faces if side.upper else -faces, flux[0].dtype)
            outward = at_side(grid, side.axis, side.upper, outward, 0.0)
            result[side.axis] = result[side.axis].at[place].add(outward)
    return tuple(result)


def with_ghosts(grid: Grid, sides: Sides, component: Array, which: int, axis: int) -> Array:
    """The face array of component `which` with two ghost layers on either end of `axis`.

    Along its own axis the values are continued evenly, across a side as its `SideCondition` says.
    """
    count = grid.cells[axis]
    if which == axis:
        # Faces 0 and `count` are one face where the axis is periodic.
        below, above = (-2 % count, -1 % count), (1, 1 + 1 % count)
        ends = beyond(
            grid, axis, component, below, above,
            lambda: (layers(component, axis, (0, 0)), layers(component, axis, (count, count))),
        )  # fmt: skip
    else:
        below, above = (-2 % count, -1 % count), (0, 1 % count)
        ends = beyond(
            grid, axis, component, below, above, lambda: _ghosts_of_sides(grid, sides, component, which, axis)
        )
    return jnp.concatenate((ends[0], component, ends[1]), axis)


def _ghosts_of_sides(grid: Grid, sides: Sides, component: Array, which: int, axis: int) -> Ends:
    """Tangential velocity in two layers beyond the sides across an axis."""
    count, ghosts = grid.cells[axis], []
    for upper in (False, True):
        side = sides.boundary.side(axis, upper)
        second = min(1, count - 1)
        mirror = (count - 1, count - 1 - second) if upper else (second, 0)
        mirrored = layers(component, axis, mirror)
        covered = of_slab(grid, coverage(grid, side, staggered=which), component.dtype)
        speed = sides.velocity_of(axis, upper)[which]
        lengths = np.array([index + 0.5 for index in (mirror if not upper else (0, second))]) * grid.spacing[axis]
        shape = [-1 if a == axis else 1 for a in range(grid.dimension)]
        distance = jnp.asarray(lengths.reshape(shape), component.dtype)
        ghosts.append(side.condition.ghosts(mirrored, speed, covered, distance))
    return ghosts[0], ghosts[1]
