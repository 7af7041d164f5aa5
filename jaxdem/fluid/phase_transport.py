"""Transport of what two fluids with a sharp surface hold, by a flux that has moved the surface.

    d(W v)/dt + div(Phi v) = 0

W is what a cell can hold, and changes by Phi alone, so that a uniform v stays uniform: of heat the capacity of both
fluids (`carried_heat`), of what is dissolved in one of them the volume of that fluid (`dissolved`).

One axis follows the other, in the order of the surface: liquid may pass a corner of a cell in a step, and has to be
there with what it holds before it leaves. No cell is left with less than none of either fluid, so what leaves a cell in
a sweep is a part of what it holds, and values stay between those around up to `volume_of_fluid.SURFACE_COURANT`. What
leaves has the mean over the part of the cell that it comes from, with van Leer's slope.

Source: Weymouth & Yue as in `volume_of_fluid`; the flux of a quantity by that of the surface as M. Rudman, Int. J.
Numer. Meth. Fluids 28 (1998) 357-378, has it of momentum. Derived here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.advection import VanLeer
from jaxdem.fluid.grid import FaceField, Grid, along, own_layers
from jaxdem.fluid.mesh import Ends, at_side, beyond, with_ends
from jaxdem.fluid.sweeps import in_order


class Held(NamedTuple):
    """What the cells hold between the sweeps of a step.

    Attributes:
        content: W v by volume.
        capacity: W by volume.
        passed: (2 D,) content that has come in through every side, lower before upper.
    """

    content: Array
    capacity: Array
    passed: Array

    def value(self, least: float | None) -> Array:
        """v of the cells; zero in those that hold no more than `least` of what carries it, None for none such."""
        if least is None:
            return self.content / self.capacity
        there = self.capacity > least
        return jnp.where(there, self.content / jnp.where(there, self.capacity, 1.0), 0.0)


class Transport(NamedTuple):
    """How it is carried, over a step.

    Attributes:
        grid: the grid.
        carrier: Phi, mean over the step, on the faces.
        inflow: of every side, lower before upper: value of what comes in, None for that of the cell there.
        step: () [s].
        order: () int, number of the step, see `sweeps`.
        least: capacity up to which a cell holds nothing; None where all cells hold much. Static.
    """

    grid: Grid
    carrier: FaceField
    inflow: tuple[Array | None, ...]
    step: Array
    order: Array
    least: float | None = None

    def carried(self, start: Held) -> Held:
        """What the cells hold after the step."""
        return in_order([self._sweep(axis) for axis in range(self.grid.dimension)], self.order, start)

    def through_sides(self) -> Array:
        """(2 D,) capacity that comes in through every side in the step."""
        grid = self.grid
        parts = [
            _at_ends(grid, (self.step / h) * f, axis)
            for axis, (h, f) in enumerate(zip(grid.spacing, self.carrier, strict=True))
        ]
        return sum(parts[1:], parts[0])

    def _sweep(self, axis: int) -> Callable[[Held, Array], Held]:
        """The transport along one axis."""
        grid = self.grid

        def swept(carry: Held, _: Array) -> Held:
            passing = (self.step / grid.spacing[axis]) * self.carrier[axis]
            carried = passing * self._value_of_passing(carry, passing, axis)
            content, capacity = (
                amount - (along(through, axis, 1, None) - along(through, axis, None, -1))
                for amount, through in ((carry.content, carried), (carry.capacity, passing))
            )
            return Held(content, capacity, carry.passed + _at_ends(grid, carried, axis))

        return swept

    def _value_of_passing(self, held: Held, passing: Array, axis: int) -> Array:
        """Value of what passes the faces of an axis: of the cell that it comes from, with (1 - p) of half the slope, p
        the part of the cell's capacity that leaves.

        Then what stays differs from the value of the cell by half a slope at most, whatever leaves through two faces.
        Cells beside one that holds nothing have no slope.
        """
        grid, value = self.grid, held.value(self.least)
        lower, upper = beside(grid, value, axis)
        behind, ahead = value - along(lower, axis, None, -1), along(upper, axis, 1, None) - value
        room = held.capacity
        if self.least is not None:
            there = jnp.where(room > self.least, 1.0, 0.0).astype(value.dtype)
            low, high = beside(grid, there, axis)
            behind, ahead = behind * along(low * high, axis, None, -1), ahead * along(low * high, axis, 1, None)
            room = jnp.where(there > 0.0, room, 1.0)
        half = beside(grid, 0.5 * VanLeer().slope(behind, ahead), axis)
        capacities = beside(grid, room, axis)
        left, right = (1.0 - jnp.clip(jnp.abs(passing) / c, 0.0, 1.0) for c in capacities)
        found = jnp.where(passing > 0.0, lower + half[0] * left, upper - half[1] * right)
        if grid.periodic[axis]:
            return found
        inflow, ends = self.inflow[2 * axis : 2 * axis + 2], []
        for given, place, sign in zip(inflow, ((0, 1), (-1, None)), (1.0, -1.0), strict=True):
            own = along(found, axis, *place)
            ends.append(own if given is None else jnp.where(sign * along(passing, axis, *place) > 0.0, given, own))
        return with_ends(grid, axis, found, (ends[0], ends[1]))


def beside(grid: Grid, cells: Array, axis: int, outside: Ends | None = None) -> Ends:
    """The cells below and above every face of an axis; beyond a side its own cell, or what is `outside`."""
    there = own_layers(cells, axis) if outside is None else lambda: outside
    ends = beyond(grid, axis, cells, (-1,), (0,), there)
    wide = jnp.concatenate((ends[0], cells, ends[1]), axis)
    return along(wide, axis, None, -1), along(wide, axis, 1, None)


def _at_ends(grid: Grid, passing: Array, axis: int) -> Array:
    """(2 D,) what comes in through the two sides across an axis, of what passes its faces over the volume of a cell;
    zero for the others and along periodic axes; in a slab what passes there."""
    found = jnp.zeros(2 * grid.dimension, passing.dtype)
    if grid.periodic[axis]:
        return found
    lower, upper = (
        at_side(grid, axis, is_upper, jnp.sum(along(passing, axis, *place)), 0.0)
        for is_upper, place in ((False, (0, 1)), (True, (-1, None)))
    )
    return found.at[2 * axis : 2 * axis + 2].set(grid.cell_volume * jnp.stack((lower, -upper)))
