"""What the load on surfaces within the mesh changes by when they change their speed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.boundary import Boundary
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.grid import FaceField, Grid, box_largest, face_control_volume
from jaxdem.fluid.pressure import solve_pressure
from jaxdem.fluid.surface_loads import SurfaceShares, stress_on_cuts, surface_loads

TOLERANCE = 1e-6
"""Of the pressure, over its source [-]. Stable pistons need less, slopes by the numbers of the fluid do not."""


class SurfaceResponse(NamedTuple):
    """Mean loads over a coupling interval by a change of the speed of 1 m/s at its start.

    Attributes:
        pressure: (H, S, D) on every surface, when each of H pistons changes its speed along its direction [N s/m].
        friction: (S, D) on every surface, along each axis, when it changes its speed along this axis and the fluid
            beside it does not yet follow: the largest that it can be [N s/m].
        area: (S, D) of every surface that fluid touches, sizes of the components across the axes summed [m2].
        gap: (H, S) between each piston and the surfaces that it must not meet, see `CutCells`; None without [m].
    """

    pressure: Array
    friction: Array
    area: Array
    gap: Array | None = None


def surface_response(
    grid: Grid, boundary: Boundary, cut: CutCells, coefficient: FaceField, friction: FaceField, count: int
) -> SurfaceResponse:
    """How the load on every surface answers to the speeds of the pistons.

    A change of the speed by V sweeps V s, with s what the body sweeps at 1 m/s, and the pressure changes by V p,
    div(c grad p) = s, with c the coefficient of the projection: inertia of the fluid, and drag of the particles.

    Args:
        grid: the grid.
        boundary: its sides.
        cut: the open parts, with s of every piston.
        coefficient: c, of the pressure gradient, on the faces [m3 s/kg].
        friction: of the fluid on surfaces, over the difference of their velocities and the volume, on the faces
            [kg/(m3 s)].
        count: S, number of surfaces; static.
    """
    still = tuple(jnp.zeros_like(a) for a in cut.open_faces)
    cells = (jnp.zeros_like(cut.open_cells),) * grid.dimension
    dtype = cut.open_cells.dtype
    held = tuple(-face_control_volume(grid, axis).astype(dtype) * f for axis, f in enumerate(friction))
    by_friction = surface_loads(grid, cut, SurfaceShares(held, cells), count)[:, :, 0]
    units: Sequence[Array] = cut.unit_swept or ()
    gap = cut.piston_gaps
    found, cut = [], cut._replace(spin=None)
    wet = tuple(map(jnp.abs, stress_on_cuts(grid, cut, jnp.ones((), dtype), jnp.zeros((), dtype))))
    area = surface_loads(grid, cut, SurfaceShares(still, wet), count)[:, :, 0]
    for unit in units:
        source = cut._replace(swept=unit).growth(grid, 0.0, not boundary.has_outlet)
        tolerance = TOLERANCE * box_largest(grid, jnp.abs(source)) + jnp.finfo(dtype).tiny
        pressure, _ = solve_pressure(grid, boundary, coefficient, source, tolerance, cut.open_cells > 0.0)
        on_cells = stress_on_cuts(grid, cut, pressure, jnp.zeros((), dtype))
        found.append(surface_loads(grid, cut, SurfaceShares(still, on_cells), count)[:, :, 0])
    return SurfaceResponse(jnp.stack(found), by_friction, area, gap)
