"""What passes the boundaries that let the fluid pass: inlets and outlets of the box, and openings of surfaces.

Through a side of the box it is the sum of A g u over its faces, with A their area and g u the flux that satisfies
continuity over the fluid step; through an opening it is what the step supplies. So the volume of the fluid changes by
what comes in less what leaves, to the tolerance of the pressure solver.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.boundary import Boundary
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.grid import FaceField, Grid, along
from jaxdem.fluid.mesh import at_side


def passages(
    grid: Grid, boundary: Boundary, flux: FaceField, cut: CutCells | None = None, liquid: FaceField | None = None
) -> Array | None:
    """(B, 2) volume per time that comes in and that leaves, each counted face by face; None where nothing may pass.

    First the sides of `Boundary.passable`, then the openings. Of two fluids (B, 4), then the same of the liquid. In a
    slab what passes there [m3/s].

    Args:
        grid: the grid.
        boundary: the sides.
        flux: a g u on the faces [m/s].
        cut: surfaces, with what passes their openings.
        liquid: of two fluids, flux of the liquid on the faces [m/s].
    """
    fluxes = (flux,) if liquid is None else (flux, liquid)
    rows = [jnp.concatenate([_through_side(grid, number, one) for one in fluxes]) for number in boundary.passable]
    if cut is not None and cut.openings is not None and cut.speeds is not None:
        for part, speed in zip(cut.openings, cut.speeds, strict=True):
            rows.append(_both_ways(speed * grid.cell_volume * part.supply))
    return jnp.stack(rows) if rows else None


def _through_side(grid: Grid, number: int, flux: FaceField) -> Array:
    """(2,) through a side, by its number, lower before upper, axis by axis."""
    axis, upper = divmod(number, 2)
    faces = along(flux[axis], axis, -1, None) if upper else along(flux[axis], axis, 0, 1)
    area = grid.cell_volume / grid.spacing[axis]
    return at_side(grid, axis, bool(upper), _both_ways((-area if upper else area) * faces), 0.0)


def _both_ways(inward: Array) -> Array:
    """(2,) what comes in and what leaves."""
    return jnp.stack([jnp.sum(jnp.maximum(inward, 0.0)), jnp.sum(jnp.maximum(-inward, 0.0))])
