"""The momentum that the flow within a coarse cell carries: a stress whose coefficients a closure gives.

Averaging over cells leaves -div(g R) in the momentum equation, R_ij = mean(u_i u_j) - mean(u_i) mean(u_j). It is
taken as

    tau_ij = 2 nu_n S_ij - c_n sum_k h_k^2 du_i/dx_k du_j/dx_k,      nu_n = c_1 Delta^2 |S|,

with S = (grad u + grad u^T)/2, |S| = sqrt(2 S:S), h_k the cell sides, Delta the filter size, and c_1, c_n of every cell
from a closure of invariants. The second term is the leading one of R for smooth fields (c_n = 1/12 for a mean over
a cell). The fluid gets div(g tau), in flux form: what one control volume loses its neighbour gets. It carries
the fluid's own momentum, so particles feel nothing of it, and nothing of it passes through a side of the box along
that side.

Source: R. A. Clark, J. H. Ferziger, W. C. Reynolds, J. Fluid Mech. 91 (1979) 1-16 (the gradient term); B. Vreman, B.
Geurts, H. Kuerten, Theor. Comput. Fluid Dyn. 8 (1996) 309-324 (both together).
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.boundary import Boundary, Sides
from jaxdem.fluid.diffusion import edge_average, shear, stress_slope, to_boundary
from jaxdem.fluid.grid import FaceField, Grid, along, cell_average, face_average_along, gradient, sum_of
from jaxdem.fluid.mesh import with_ends
from jaxdem.fluid.subgrid import cell_mean, mean_along, strain_magnitude
from jaxdem.numerics.vectors import safe_sqrt

Gradients = dict[tuple[int, int], Array]
"""du_i/dx_k by (i, k): in the cells for i = k, else on the edges between the faces of both axes [1/s]."""


class SubgridLaw(Protocol):
    """What gives the coefficients of the stress: a pytree, so that one may differentiate by its weights."""

    def __call__(
        self,
        strain_rate: Array,
        rotation_rate: Array,
        filter_size: Array,
        viscosity: Array,
        void_fraction: Array,
        void_fraction_gradient: Array,
    ) -> tuple[Array, Array]:
        """(c_1, c_n) of every cell, both zero or any finite number where nothing is strained.

        Args:
            strain_rate: |S| in the cells [1/s].
            rotation_rate: sqrt(2 W:W), W = (grad u - grad u^T)/2 [1/s].
            filter_size: () Delta [m].
            viscosity: () kinematic [m2/s].
            void_fraction: in the cells [-].
            void_fraction_gradient: its size [1/m].
        """
        ...


class SubgridFlow(NamedTuple):
    """Velocity gradients, what a closure sees of them, and what it gives.

    Attributes:
        gradients: see `Gradients`.
        strain_rate, rotation_rate: in the cells [1/s].
        viscosity_coefficient, gradient_coefficient: c_1 and c_n in the cells [-].
    """

    gradients: Gradients
    strain_rate: Array
    rotation_rate: Array
    viscosity_coefficient: Array
    gradient_coefficient: Array


def subgrid_flow(
    grid: Grid, sides: Sides, law: SubgridLaw, velocity: FaceField, viscosity: Array, void_fraction: Array | None
) -> SubgridFlow:
    """Gradients and coefficients of a flow.

    Args:
        grid: the grid.
        sides: of the box.
        law: of the coefficients.
        velocity: u on the faces [m/s].
        viscosity: () kinematic [m2/s].
        void_fraction: in the cells, None for a fluid alone [-].
    """
    slopes = {}
    for i, component in enumerate(velocity):
        for k in range(grid.dimension):
            slopes[i, k] = (
                (along(component, i, 1, None) - along(component, i, None, -1)) / grid.spacing[i]
                if i == k
                else shear(grid, sides, component, i, k)
            )
    pairs = [(i, j) for i in range(grid.dimension) for j in range(i, grid.dimension)]
    strain = strain_magnitude({(i, j): slopes[i, j] + slopes[j, i] for i, j in pairs})
    turning = [cell_mean((slopes[i, j] - slopes[j, i]) ** 2, i, j) for i, j in pairs if i != j]
    rotation = safe_sqrt(sum_of(turning))
    if void_fraction is None:
        share, steepness = jnp.ones_like(strain), jnp.zeros_like(strain)
    else:
        share = void_fraction
        steepness = safe_sqrt(sum_of(s**2 for s in cell_average(gradient(grid, void_fraction))))
    size = jnp.asarray(grid.filter_size, strain.dtype)
    return SubgridFlow(slopes, strain, rotation, *law(strain, rotation, size, viscosity, share, steepness))


def subgrid_stress(grid: Grid, flow: SubgridFlow, weight: Array | None = None) -> Gradients:
    """tau_ij by (i, j), i <= j: in the cells for i = j, else on the edges, zero on the sides of the box [m2/s2].

    On an edge the coefficients are the mean of its four cells.

    Args:
        grid: the grid.
        flow: see `subgrid_flow`.
        weight: in the cells, multiplies the coefficients; None for 1.
    """
    eddy = flow.viscosity_coefficient * grid.filter_size**2 * flow.strain_rate
    bending = flow.gradient_coefficient
    if weight is not None:
        eddy, bending = weight * eddy, weight * bending
    stress = {}
    for i in range(grid.dimension):
        for j in range(i, grid.dimension):
            rate = flow.gradients[i, j] + flow.gradients[j, i]
            product = _products(grid, flow.gradients, i, j)
            nu, c = (a if i == j else edge_average(grid, a, i, j) for a in (eddy, bending))
            here = nu * rate - c * product
            stress[i, j] = here if i == j else _closed(grid, here, i, j)
    return stress


def subgrid_acceleration(grid: Grid, boundary: Boundary, stress: Gradients) -> FaceField:
    """div(tau) on the faces [m/s2], no stress outside; on boundary faces but outlets that of the next face inside."""
    result = []
    for which in range(grid.dimension):
        slopes = []
        for axis in range(grid.dimension):
            here = stress[min(which, axis), max(which, axis)]
            slopes.append(stress_slope(grid, here, jnp.zeros_like(here), which, axis))
        result.append(to_boundary(grid, boundary, sum_of(slopes), which))
    return tuple(result)


def subgrid_diffusivity(grid: Grid, flow: SubgridFlow) -> Array:
    """In the cells, a bound of the viscosity that a small disturbance meets, of either sign [m2/s].

    |nu_n| + 2 |c_n| h^2 |grad u|, h the longest cell side: the gradient term is linear in a disturbance, with twice
    the gradient that it meets.
    """
    size = safe_sqrt(0.5 * (flow.strain_rate**2 + flow.rotation_rate**2))
    eddy = jnp.abs(flow.viscosity_coefficient) * grid.filter_size**2 * flow.strain_rate
    return eddy + 2.0 * jnp.abs(flow.gradient_coefficient) * max(grid.spacing) ** 2 * size


def _products(grid: Grid, slopes: Gradients, i: int, j: int) -> Array:
    """sum_k h_k^2 du_i/dx_k du_j/dx_k where tau_ij is."""
    terms = []
    for k, h in enumerate(grid.spacing):
        if i == j:
            square = slopes[i, k] ** 2
            terms.append(h**2 * (square if k == i else cell_mean(square, i, k)))
        else:
            terms.append(h**2 * _on_edge(grid, slopes, i, k, j) * _on_edge(grid, slopes, j, k, i))
    return sum_of(terms)


def _on_edge(grid: Grid, slopes: Gradients, i: int, k: int, other: int) -> Array:
    """du_i/dx_k on the edges between the faces of i and those of another axis."""
    if k == other:
        return slopes[i, k]
    if k == i:
        return edge_average(grid, slopes[i, i], i, other)
    return face_average_along(grid, mean_along(slopes[i, k], k), other)


def _closed(grid: Grid, edge: Array, i: int, j: int) -> Array:
    """An edge array, zero on the sides of the box: no flow within a cell passes through a wall."""
    for axis in (i, j):
        if not grid.periodic[axis]:
            end = jnp.zeros_like(along(edge, axis, 0, 1))
            edge = with_ends(grid, axis, edge, (end, end))
    return edge
