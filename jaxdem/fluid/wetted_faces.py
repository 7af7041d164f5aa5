"""The parts of the faces of the mesh that one of two fluids with a sharp surface touches on both of their sides."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.grid import FaceField, Grid, along
from jaxdem.fluid.phase_transport import beside
from jaxdem.fluid.plane_cut import volume_of_slab
from jaxdem.fluid.volume_of_fluid import planes_of_surface


def wetted_faces(grid: Grid, fraction: Array, second: bool = False) -> FaceField:
    """Part of every face that the planes of the surface leave to a fluid in both cells beside it [-].

    On the sides of the box that of the cell there. A face between cells full of different fluids has none.

    Args:
        grid: the grid.
        fraction: c on the cells [-].
        second: of the second fluid, else of the liquid.
    """
    plane, found = planes_of_surface(grid, fraction), []
    thin = jnp.asarray(float(jnp.finfo(fraction.dtype).eps) ** 0.5, fraction.dtype)
    for axis in range(grid.dimension):
        sizes, ahead = [jnp.abs(m) for m in plane.normal], plane.normal[axis] > 0.0
        of_slabs = (volume_of_slab(sizes, plane.offset, axis, far, thin) for far in (ahead, ~ahead))
        upper, lower = (jnp.clip(jnp.where(plane.cut, part, fraction), 0.0, 1.0) for part in of_slabs)
        ends = along(lower, axis, 0, 1), along(upper, axis, -1, None)
        below, above = beside(grid, upper, axis, ends)[0], beside(grid, lower, axis, ends)[1]
        found.append(jnp.minimum(1.0 - below, 1.0 - above) if second else jnp.minimum(below, above))
    return tuple(found)
