"""Walls that move: where their surfaces are in a contact step, and walls that a force holds (pistons).

A surface is evaluated in its body's frame, so that what does not move has the program of a wall at rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

import jax.numpy as jnp
from jax import Array

from jaxdem.numerics import pair_arithmetic as pairs
from jaxdem.numerics.compensated import Low, Pair, advance
from jaxdem.numerics.placement import Placement, at_rest
from jaxdem.numerics.static import static
from jaxdem.numerics.tables import at_time

Numbers = Sequence[Mapping[str, Array]]


class WallMotion(Protocol):
    """A given motion; static. `jaxdem.solids.motion.RigidMotion` is one."""

    def at(self, numbers: Numbers, time: Pair) -> Placement:
        """The placement at a time [s], with the traced numbers of the motion."""
        ...


@static
class HeldMotion:
    """A motion that stands still where it is at a time.

    Attributes:
        motion: the motion.
        time: [s].
    """

    motion: WallMotion
    time: float

    def at(self, numbers: Numbers, time: Pair) -> Placement:
        """See `WallMotion`."""
        placed = self.motion.at(numbers, pairs.pair_of(self.time, time[0].dtype))
        return placed._replace(velocity=jnp.zeros_like(placed.velocity), angular_velocity=None)


@static
class SurfaceMotion:
    """How a surface moves; static.

    Attributes:
        motion: given; None for a piston without.
        wall: number of its wall's entry in `WallMotions.numbers`.
        piston: number of the piston that it belongs to; None where it is none.
        direction: unit vector that the piston moves along, D numbers.
    """

    motion: WallMotion | None
    wall: int
    piston: int | None = None
    direction: tuple[float, ...] = ()


class PistonNumbers(NamedTuple):
    """Numbers of a piston; traced.

    Attributes:
        force: () along its direction beside weight and contacts, or (T,) at the times of `Piston.force_times` [N].
        mass: () [kg].
        damping: () force against its motion over its speed [N s/m].
    """

    force: Array
    mass: Array
    damping: Array


class PistonState(NamedTuple):
    """What evolves of H pistons.

    Attributes:
        displacement: (H,) from where the scene has them, along their directions, leading part [m].
        displacement_low: (H,) trailing part; None in float64 [m].
        velocity: (H,) along the directions [m/s].
        seen_velocity: (H,) that the fluid saw in the interval before; None where it sees no piston [m/s].
    """

    displacement: Array
    displacement_low: Low
    velocity: Array
    seen_velocity: Array | None = None

    def drifted(self, time_step: Array) -> PistonState:
        """Moved by velocity times `time_step` [s]."""
        high, low = advance(self.displacement, self.displacement_low, time_step * self.velocity)
        return self._replace(displacement=high, displacement_low=low)


class WallMotions(NamedTuple):
    """What the moving walls of an interval need; traced.

    Attributes:
        numbers: of the motion of every wall of the scene, () of one at rest.
        pistons: of every piston.
        start, start_low: () time at the start of the interval as a pair [s].
        gravity: (D,) [m/s2].
    """

    numbers: tuple[Numbers, ...]
    pistons: tuple[PistonNumbers, ...]
    start: Array
    start_low: Low
    gravity: Array

    def time(self, elapsed: Array) -> Pair:
        """Time `elapsed` after the start [s], as a pair."""
        return pairs.total((self.start, self.start_low), pairs.as_pair(elapsed))


@static
class Piston:
    """A wall held by a force: m dv/dt = F + m g.e - c v + f.e along its unit vector e, f the force of the grains on
    it, g gravity; static.

    Attributes:
        direction: e, D numbers.
        walls: numbers of the walls that are its surfaces, the sides of the box first.
        force_times: T increasing times of its force [s]; None for one that does not change.
    """

    direction: tuple[float, ...]
    walls: tuple[int, ...]
    force_times: tuple[float, ...] | None = None

    def acceleration(self, numbers: PistonNumbers, motions: WallMotions, time: Array, load: Array) -> Array:
        """() without damping [m/s2].

        Args:
            numbers: traced.
            motions: of the interval, with gravity.
            time: () [s].
            load: (D,) force of the grains on it [N].
        """
        along = jnp.asarray(self.direction, load.dtype)
        force = (
            numbers.force if self.force_times is None else at_time(self.force_times, numbers.force[:, None], time)[0]
        )
        return (force + jnp.dot(along, load)) / numbers.mass + jnp.dot(along, motions.gravity)


def placements(
    surfaces: Sequence[SurfaceMotion | None], motions: WallMotions, elapsed: Array, pistons: PistonState | None
) -> tuple[Placement | None, ...]:
    """Where each surface is `elapsed` after the start of the interval [s]; None for those at rest."""
    time, found = motions.time(elapsed), []
    for surface in surfaces:
        placed = None
        if surface is not None:
            if surface.motion is None:
                placed = at_rest(len(surface.direction), time[0])
            else:
                placed = surface.motion.at(motions.numbers[surface.wall], time)
            if surface.piston is not None and pistons is not None:
                k, low = surface.piston, pistons.displacement_low
                way = pistons.displacement[k], None if low is None else low[k]
                placed = placed.moved(way, surface.direction, pistons.velocity[k])
        found.append(placed)
    return tuple(found)


def change_of_walls(
    surfaces: Sequence[SurfaceMotion | None], sides: int, before: PistonState, after: PistonState
) -> Array:
    """(S, D) by which the velocity of every wall changes that a force holds, the sides of the box first [m/s]."""
    dimension = max(len(surface.direction) for surface in surfaces if surface is not None)
    still = jnp.zeros(dimension, before.velocity.dtype)
    found = [still] * sides
    for surface in surfaces:
        if surface is None or surface.piston is None:
            found.append(still)
            continue
        gained = after.velocity[surface.piston] - before.velocity[surface.piston]
        found.append(gained * jnp.asarray(surface.direction, still.dtype))
    return jnp.stack(found)


def pushed(
    pistons: Sequence[Piston], motions: WallMotions, state: PistonState, elapsed: Array, loads: Array, step: Array
) -> PistonState:
    """The pistons with velocities after a contact step [m/s]; damping is implicit, so that none is too strong.

    Args:
        pistons: H of them.
        motions: of the interval.
        state: in the middle of the step.
        elapsed: time of the middle since the start of the interval [s].
        loads: (H, D) force of the grains on each [N].
        step: contact step [s].
    """
    time, found = pairs.value(motions.time(elapsed)), []
    for k, (piston, own) in enumerate(zip(pistons, motions.pistons, strict=True)):
        gained = state.velocity[k] + step * piston.acceleration(own, motions, time, loads[k])
        found.append(gained / (1.0 + step * own.damping / own.mass))
    return state._replace(velocity=jnp.stack(found))
