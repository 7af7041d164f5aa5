"""Forces and torques of the fluid on surfaces within the mesh, see `cut_cells`."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.grid import FaceField, Grid, along, sum_of
from jaxdem.numerics import vectors


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

    A force acts at the middle of its face or cell.

    Args:
        grid: the grid.
        cut: the open parts.
        shares: the forces.
        count: S, number of surfaces; static.
    """
    loads = []
    for which in range(grid.dimension):
        faces, cells = shares.on_faces[which], shares.on_cells[which]
        if grid.periodic[which]:
            last = along(faces, which, -1, None)
            faces = jnp.concatenate((along(faces, which, None, -1), 0.0 * last), which)
        row = []
        for k in range(-1, grid.dimension):
            parts = []
            for field, nearest, is_face in (
                (faces, cut.nearest_to_faces[which], True),
                (cells, cut.nearest_to_cells, False),
            ):
                if k == which:
                    parts.append(jnp.zeros(count, field.dtype))
                    continue
                arm = 1.0 if k < 0 else _places(grid, field, k, is_face and k == which)
                parts.append(jnp.zeros(count, field.dtype).at[nearest].add(field * arm))
            row.append(sum_of(parts))
        loads.append(jnp.stack(row, axis=-1))
    return jnp.stack(loads, axis=1)


def _places(grid: Grid, field: Array, axis: int, on_faces: bool) -> Array:
    points = np.arange(field.shape[axis]) + (0.0 if on_faces else 0.5)
    shape = [-1 if a == axis else 1 for a in range(grid.dimension)]
    return jnp.asarray((points * grid.spacing[axis]).reshape(shape), field.dtype)
