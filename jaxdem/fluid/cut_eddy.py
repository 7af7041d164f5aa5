"""Smagorinsky's viscosity beside surfaces within the mesh, see `cut_cells` and `subgrid`.

The velocity of a cut face stands at the middle of its open part and not of the face, so differences with it are no
slopes. The eddy viscosity of a cell whose strain rate asks for a face that is not whole goes on linearly from the next
cells; so a linear shear flow along a plane has one eddy viscosity everywhere, and keeps its stress.

Friction on a surface is with the viscosity of the fluid beside it, molecular and eddy, of the start of a step. As at
the sides of a box the eddy viscosity is not damped there.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.boundary import Sides
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.diffusion import edge_average, shear, strain_rates, stress_slope
from jaxdem.fluid.grid import CellOrOne, FaceField, Grid, along, divergence, own_layers, sum_of
from jaxdem.fluid.mesh import beyond, end_faces
from jaxdem.fluid.subgrid import eddy_viscosity

LAYERS = 3
"""Of cells beside surfaces whose eddy viscosity is found from the next ones: two, three in corners."""

OF_ONE = 1e-3
"""Weight of a neighbour with no other behind it, from which nothing can go on linearly [-]."""


def eddy_beside_surfaces(
    grid: Grid, sides: Sides, open_faces: FaceField, velocity: FaceField, length: CellOrOne
) -> Array:
    """nu_t in the cells [m2/s]. In gaps of few cells, where no cell has a strain rate of whole faces, it is that of the
    faces as they are.

    Args:
        grid: the grid.
        sides: of the box.
        open_faces: open fractions.
        velocity: u on the faces, on closed ones that of the surface [m/s].
        length: mixing length, () or in the cells [m].
    """
    eddy = eddy_viscosity(strain_rates(grid, sides, velocity), length)
    known = _whole_stencils(grid, open_faces)
    for _ in range(LAYERS):
        total = count = jnp.zeros_like(eddy)
        for axis in range(grid.dimension):
            for way in (-1, 1):
                near, there = (_behind(grid, part, axis, way) for part in (eddy, known))
                far, also = (_behind(grid, part, axis, 2 * way) for part in (eddy, known))
                weight = jnp.where(there, jnp.where(also, 1.0, OF_ONE), 0.0).astype(eddy.dtype)
                found = jnp.where(also, jnp.maximum(2.0 * near - far, 0.0), near)
                total, count = total + weight * found, count + weight
        new = ~known & (count > 0.0)
        eddy, known = jnp.where(new, total / jnp.where(count > 0.0, count, 1.0), eddy), known | new
    return eddy


def at_links(grid: Grid, eddy: Array, which: int, axis: int) -> Array:
    """nu_t between the faces of a component that follow each other along an axis; beyond a side that of the cell."""
    if axis != which:
        return edge_average(grid, eddy, which, axis)
    before, after = beyond(grid, axis, eddy, (-1,), (0,), own_layers(eddy, axis))
    return jnp.concatenate((before, eddy, after), axis)


def transposed_stress(
    grid: Grid, sides: Sides, cut: CutCells, velocity: FaceField, eddy: Array, inverse: bool = False
) -> tuple[FaceField, FaceField]:
    """div(nu_t (grad u)^T - 2/3 nu_t div(u) 1) of the stress in and between whole cells, on faces among these; and what
    it gives to other faces [m/s2].

    A surface feels nothing of it: its normal derivative of the normal velocity is zero. So the second result, which the
    surfaces take, falls with the size of the cells.

    Args:
        grid: the grid.
        sides: of the box.
        cut: the open parts.
        velocity: u on the faces [m/s].
        eddy: nu_t in the cells [m2/s].
        inverse: whether `eddy` is one over the viscosity, of which the mean on an edge is then the harmonic one.
    """

    def times(local: Array, rate: Array) -> Array:
        return rate / local if inverse else local * rate

    expansion, result, lost = divergence(grid, velocity), [], []
    cells = cut.open_cells >= 1.0
    for which, component in enumerate(velocity):
        terms, whole = [], beside_whole_cells(grid, cells, which)
        for axis in range(grid.dimension):
            if axis == which:
                stretch = (along(component, axis, 1, None) - along(component, axis, None, -1)) / grid.spacing[axis]
                stress = jnp.where(cells, times(eddy, stretch - (2.0 / 3.0) * expansion), 0.0)
            else:
                of_edge = edge_average(grid, cells.astype(eddy.dtype), which, axis) >= 1.0
                whole = whole & along(of_edge, axis, None, -1) & along(of_edge, axis, 1, None)
                stress = times(edge_average(grid, eddy, which, axis), shear(grid, sides, velocity[axis], axis, which))
                stress = jnp.where(of_edge, stress, 0.0)
            terms.append(stress_slope(grid, stress, stress, which, axis))
        total = sum_of(terms)
        result.append(jnp.where(whole, total, 0.0))
        lost.append(jnp.where(whole, 0.0, total))
    return tuple(result), tuple(lost)


def _whole_stencils(grid: Grid, open_faces: FaceField) -> Array:
    """Cells whose strain rate is of whole faces alone."""
    found = jnp.ones(grid.cells, bool)
    for which, a in enumerate(open_faces):
        whole = along(a, which, None, -1) + along(a, which, 1, None) >= 2.0
        for axis in range(grid.dimension):
            if axis != which:
                before, after = beyond(grid, axis, whole, (-1,), (0,), own_layers(whole, axis))
                wide = jnp.concatenate((before, whole, after), axis)
                whole = whole & along(wide, axis, 2, None) & along(wide, axis, None, -2)
        found = found & whole
    return found


def _behind(grid: Grid, cell: Array, axis: int, number: int) -> Array:
    """What stands so many cells further along an axis; zero beyond a side."""
    count, nothing = grid.cells[axis], jnp.zeros_like(along(cell, axis, 0, 1))
    reach = range(1, abs(number) + 1)
    ends = beyond(
        grid, axis, cell, tuple(-k % count for k in reversed(reach)), tuple((k - 1) % count for k in reach),
        lambda: (jnp.concatenate([nothing] * len(reach), axis),) * 2,
    )  # fmt: skip
    wide = jnp.concatenate((ends[0], cell, ends[1]), axis)
    return along(wide, axis, 2 * number, None) if number > 0 else along(wide, axis, None, 2 * number)


def beside_whole_cells(grid: Grid, whole: Array, axis: int) -> Array:
    """Faces of an axis whose cells are whole."""
    inner = along(whole, axis, None, -1) & along(whole, axis, 1, None)
    ends = end_faces(grid, axis, whole, lambda below, above: below & above, lambda first, last: (first, last))
    return jnp.concatenate((ends[0], inner, ends[1]), axis)
