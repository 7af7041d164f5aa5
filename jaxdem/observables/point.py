"""The fluid at points."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import InputError, required
from jaxdem.fluid.grid import Grid
from jaxdem.numerics.blocks import total
from jaxdem.observables.arguments import require_arguments
from jaxdem.state import State
from jaxdem.structure import Structure


class FluidAt(NamedTuple):
    """The fluid at P points.

    Attributes:
        velocity: (P, D) interstitial [m/s].
        pressure: (P,) reduced pressure [Pa].
        void_fraction: (P,) [-].
    """

    velocity: Array
    pressure: Array
    void_fraction: Array


def fluid_at(structure: Structure, state: State, points: Array) -> FluidAt:
    """The fluid of a state at points, linear along every axis between the places at which the solver has it.

    A component of the velocity stands on the faces of its axis, pressure and void fraction in the centres of the cells.
    Beyond the outermost of these places a value is that at the nearest one.

    Args:
        structure: or a `Simulation`.
        state: with a fluid.
        points: (P, D) in the domain [m].

    Raises:
        InputError: they have another shape.
    """
    require_arguments(structure=structure, state=state)
    fluid, grid = required(state.fluid, "fluid"), required(structure.fluid, "fluid").solver.grid
    dimension, shape = grid.dimension, getattr(points, "shape", None)
    if shape is None or len(shape) != 2 or shape[1] != dimension:
        given = shape or type(points).__name__
        raise InputError("points", given, f"must be an array (P, {dimension})", "give a row for each point")
    velocity = [_linear(grid, u, points, axis) for axis, u in enumerate(fluid.face_velocity)]
    void = jnp.ones_like(fluid.pressure) if fluid.void_fraction is None else fluid.void_fraction
    pressure, void_there = _linear(grid, fluid.pressure, points, dimension), _linear(grid, void, points, dimension)
    return FluidAt(jnp.stack(velocity, axis=1), pressure, void_there)


def _linear(grid: Grid, field: Array, points: Array, staggered: int) -> Array:
    """(P,) values of a field that stands on the faces of the axis `staggered`, and in the middle along others."""
    flat, weight = jnp.zeros((points.shape[0], 1), jnp.int32), jnp.ones((points.shape[0], 1), points.dtype)
    for axis, (spacing, cells) in enumerate(zip(grid.spacing, grid.whole_cells, strict=True)):
        size = field.shape[axis] - grid.cells[axis] + cells
        place = points[:, axis] / spacing - (0.0 if axis == staggered else 0.5)
        wraps = grid.periodic[axis] and axis != staggered  # the faces of a periodic axis hold the first one twice
        if not wraps:
            place = jnp.clip(place, 0.0, size - 1.0)
        first = jnp.floor(place).astype(jnp.int32)
        first = first if wraps else jnp.clip(first, 0, max(size - 2, 0))
        share = place - first
        both = jnp.stack([first, first + 1], axis=1)
        both = both % cells if wraps else jnp.minimum(both, size - 1)
        shares = jnp.stack([1.0 - share, share], axis=1)
        if grid.cut_along(axis) is not None:
            both, shares = _of_slab(grid, axis, both, shares, size - cells)
            size = field.shape[axis]
        flat = (flat[:, :, None] * size + both[:, None, :]).reshape(points.shape[0], -1)
        weight = (weight[:, :, None] * shares[:, None, :]).reshape(points.shape[0], -1)
    return total(grid.blocks, jnp.sum(weight * field.reshape(-1)[flat], axis=1))


def _of_slab(grid: Grid, axis: int, both: Array, shares: Array, more: int) -> tuple[Array, Array]:
    """Layers (P, 2) of the whole box by their numbers in this slab, with no share of those of others; the face between
    two slabs is that of the upper one. `more` layers than cells are there of the whole box."""
    cut, count = required(grid.cut_along(axis), "slabs along the axis"), grid.cells[axis]
    own = both - cut.index() * count
    last = count - 1 + jnp.where(cut.index() == cut.number - 1, more, 0)
    return jnp.clip(own, 0, count - 1 + more), jnp.where((own >= 0) & (own <= last), shares, 0.0)
