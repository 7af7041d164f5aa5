"""Forces and torques of the fluid on surfaces within the mesh, see `cut_cells`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.grid import FaceField, Grid, along
from jaxdem.fluid.mesh import at_side
from jaxdem.numerics import vectors
from jaxdem.numerics.blocks import total
from jaxdem.numerics.products import PRECISION

MASKED = 4
"""Surfaces up to which a sum for each of them takes less time than scattering to them."""


class SurfaceShares(NamedTuple):
    """What acts on the surfaces in a fluid step.

    Attributes:
        on_faces: force on the surface that is nearest to every face [N].
        on_cells: D arrays, the same of every cell: of the pressure [N].
    """

    on_faces: FaceField
    on_cells: tuple[Array, ...]


def stress_on_cuts(grid: Grid, cut: CutCells, pressure: Array, dynamic_viscosity: Array) -> tuple[Array, ...]:
    """p A on the cut of every cell, A its area along the normal out of the fluid: the difference of the open parts of
    the cell's opposite faces; and where the surface turns with W, mu W cross A [N].

    The second is what the transposed gradient of the velocity, which the balance of momentum leaves out, does to the
    surface. It has no resultant on a closed surface, but a torque. `dynamic_viscosity` is () or in the cells.
    """
    areas = tuple(
        (grid.cell_volume / grid.spacing[axis]) * (along(a, axis, None, -1) - along(a, axis, 1, None))
        for axis, a in enumerate(cut.open_faces)
    )
    found = tuple(pressure * area for area in areas)
    if cut.spin is None:
        return found
    own = cut.spin[cut.nearest_to_cells]
    turned = vectors.rotate(tuple(own[..., k] for k in range(own.shape[-1])), areas)
    return tuple(f + dynamic_viscosity * t for f, t in zip(found, turned, strict=True))


def surface_loads(grid: Grid, cut: CutCells, shares: SurfaceShares, count: int) -> Array:
    """(S, D, 1 + D) force on every surface and its first moments, as `side_forces` has them [N], [N m].

    A force acts at the middle of its face or cell. Over slabs of the box it is the sum, to which a face on a border is
    counted by the upper one.

    Args:
        grid: the grid.
        cut: the open parts.
        shares: the forces.
        count: S, number of surfaces; static.
    """
    loads = []
    for which in range(grid.dimension):
        faces, cells = shares.on_faces[which], shares.on_cells[which]
        if grid.periodic[which] or grid.cut_along(which) is not None:
            last = along(faces, which, -1, None)
            counted = 0.0 * last if grid.periodic[which] else at_side(grid, which, True, last, 0.0)
            faces = jnp.concatenate((along(faces, which, None, -1), counted), which)
        places = [_places(grid, k, k == which) for k in range(grid.dimension)]
        both = _moments(faces, places, cut.nearest_to_faces[which], count)
        both = both + _moments(
            cells, [_places(grid, k, False) for k in range(grid.dimension)], cut.nearest_to_cells, count
        )
        loads.append(_in_the_box(grid, both).at[:, 1 + which].set(0.0))
    return total(grid.blocks, jnp.stack(loads, axis=1))


def _in_the_box(grid: Grid, moments: Array) -> Array:
    """Sum and first moments (S, 1 + D) with arms from the lower end of the box, not from that of the slab."""
    cut = grid.blocks
    if cut is None:
        return moments
    begin = grid.cells[cut.axis] * grid.spacing[cut.axis] * cut.index().astype(moments.dtype)
    return moments.at[:, 1 + cut.axis].add(begin * moments[:, 0])


def _places(grid: Grid, axis: int, on_faces: bool) -> np.ndarray:
    """Of faces or of the middles of cells along an axis [m]."""
    return (np.arange(grid.cells[axis] + 1.0) if on_faces else np.arange(grid.cells[axis]) + 0.5) * grid.spacing[axis]


def _moments(field: Array, places: Sequence[np.ndarray], nearest: Array, count: int) -> Array:
    """(S, 1 + D) sum of a field over the entries that are nearest to every surface, and its first moments."""
    if count > MASKED:
        arms = np.meshgrid(*places, indexing="ij", sparse=True)
        columns = jnp.stack([field, *(field * jnp.asarray(arm, field.dtype) for arm in arms)], -1)
        return jnp.zeros((count, columns.shape[-1]), field.dtype).at[nearest].add(columns)
    own = field[None] if count == 1 else jnp.stack([jnp.where(nearest == k, field, 0.0) for k in range(count)])
    found = []
    for place in reversed(places):
        # A product with rows as they lie in memory: what is summed is computed once, and in vectors.
        both = jnp.matmul(
            own, jnp.asarray(np.stack([np.ones_like(place), place], -1), field.dtype), precision=PRECISION
        )
        own = both[..., 0]
        found.append(both[..., 1].reshape(count, -1).sum(-1))
    return jnp.stack([own, *reversed(found)], -1)
