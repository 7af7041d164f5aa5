"""What is dissolved in one of two fluids with a sharp surface, or in both, and does not act on them.

    d(W s)/dt + div(Phi s) = div(w D grad s)

s is the concentration by volume of the fluid that it is dissolved in, W the volume of this fluid in a cell over that of
the cell and Phi its flux on the faces, the one that has moved the surface:

    liquid  W = g c,        Phi = F_c
    second  W = g (1 - c),  Phi = F - F_c
    both    W = g,          Phi = F.

So a uniform concentration stays uniform, and the sum of W s changes by what passes the sides alone. It is carried, and
diffuses, less the middle of its extremes: a uniform one is then zero, and stays as it is to the last digit.

Cells with less than `least_volume` of the fluid keep the value that they had; what they hold beside it is spread over
all of the fluid. It is a rounding, and without it what is left of a cell that has run dry would be divided by nothing.

It diffuses through the part w of a face that lies in the fluid in both cells beside it (`wetted_faces`), and so not
through the surface. w is at most `MOST_BY_VOLUME` W of either cell: what a cell with little of the fluid passes in a
step is a part of what it holds, and it takes the value of the cell beside it in a time that does not depend on how
little that is.

Derived here.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxdem.fluid.carried_heat import mixed, mixed_flux
from jaxdem.fluid.grid import CellOrOne, FaceField, Grid, box_largest, box_mean, box_smallest, face_average
from jaxdem.fluid.phase_transport import Held, Transport, beside
from jaxdem.fluid.wetted_faces import wetted_faces

Phase = Literal["liquid", "second", "both"]
"""Fluid that a scalar is dissolved in."""

PART: dict[Phase, tuple[float, float]] = {"liquid": (1.0, 0.0), "second": (0.0, 1.0), "both": (1.0, 1.0)}
"""Of liquid and second fluid, that a scalar is dissolved in [-]."""

MOST_BY_VOLUME = 2.0
"""Largest part of a face that diffusion acts on, over the part of a cell beside it that is full of the fluid [-]."""


class Dissolved(NamedTuple):
    """Numbers of a scalar that two fluids carry.

    Attributes:
        part: of liquid and second fluid, see `PART`.
        inflow: of every side, lower before upper: value of what comes in, None for that of the cell there; traced.
    """

    part: tuple[float, float]
    inflow: tuple[Array | None, ...]


class CarriedScalar(NamedTuple):
    """A scalar of two fluids within a coupling interval.

    Attributes:
        value: on the cells [unit].
        through_sides: (2 D,) what came in through every side since the start of the interval, lower before upper
            [unit m3].
    """

    value: Array
    through_sides: Array


def least_volume(values: Array | np.ndarray) -> float:
    """Part of a cell up to which it holds none of a fluid: so much of it has a concentration to half the digits [-]."""
    return float(jnp.finfo(values.dtype).eps) ** 0.5


def volume_of(phase: Phase, fraction: Array, void_fraction: CellOrOne) -> Array:
    """W of cells with a liquid fraction [-]."""
    return void_fraction * mixed(PART[phase], fraction)


def middle_of(grid: Grid, values: Array) -> Array:
    """() middle of the extremes in the box, without slope: what is computed less it, and it added, does not depend on
    it."""
    return lax.stop_gradient(0.5 * (box_largest(grid, values) + box_smallest(grid, values)))


def carried_dissolved(
    grid: Grid,
    numbers: tuple[Dissolved, ...],
    scalars: tuple[CarriedScalar, ...],
    fluxes: tuple[FaceField, FaceField],
    contents: tuple[tuple[Array, CellOrOne], tuple[Array, CellOrOne]],
    step: Array,
    order: Array,
) -> tuple[CarriedScalar, ...]:
    """The scalars after a step of the fluids.

    Args:
        grid: the grid.
        numbers, scalars: of each, at the start.
        fluxes: of both fluids and of the liquid, means over the step, on the faces [m/s].
        contents: liquid fraction and void fraction of the cells at the start and at the end [-].
        step: () [s].
        order: () int, number of the step, see `sweeps`.
    """
    found = []
    for own, scalar in zip(numbers, scalars, strict=True):
        before, after = (gaps * mixed(own.part, fraction) for fraction, gaps in contents)
        least = least_volume(scalar.value)
        middle = middle_of(grid, scalar.value)
        apart = scalar.value - middle
        inflow = tuple(None if value is None else value - middle for value in own.inflow)
        transport = Transport(grid, mixed_flux(own.part, *fluxes), inflow, step, order, least)
        held = transport.carried(Held(before * apart, before, jnp.zeros_like(scalar.through_sides)))
        value = jnp.where(held.capacity > least, held.value(least), apart)
        left, volume = box_mean(grid, held.content - after * value), box_mean(grid, after)
        value = value + jnp.where(volume > 0.0, left / jnp.where(volume > 0.0, volume, 1.0), 0.0)
        passed = scalar.through_sides + held.passed + middle * transport.through_sides()
        found.append(CarriedScalar(middle + value, passed))
    return tuple(found)


def open_to_diffusion(grid: Grid, phase: Phase, fraction: Array, void_fraction: CellOrOne) -> tuple[FaceField, Array]:
    """w on the faces, and W of the cells, with 1 for those that hold nothing: no face of them is open [-]."""
    volume = volume_of(phase, fraction, void_fraction)
    there = volume > least_volume(volume)
    gaps, open_part = face_average(grid, void_fraction), []
    wet = None if phase == "both" else wetted_faces(grid, fraction, phase == "second")
    for axis in range(grid.dimension):
        lower, upper = beside(grid, jnp.where(there, volume, 0.0), axis)
        most = MOST_BY_VOLUME * jnp.minimum(lower, upper)
        full = gaps[axis] if wet is None else gaps[axis] * wet[axis]
        open_part.append(jnp.minimum(full, most))
    return tuple(open_part), jnp.where(there, volume, 1.0)
