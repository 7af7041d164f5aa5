"""The fluid at the particles: the inputs of the drag law."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.closures.base import DragInputs
from jaxdem.coupling.interpolation import Weights, interpolate
from jaxdem.fluid.grid import FaceField, Grid, cell_average, gradient, second_differences


def drag_inputs(
    grid: Grid,
    weights: Weights,
    particle_velocity: Array,
    diameter: Array,
    face_velocity: FaceField,
    pressure_gradient: FaceField,
    solid_fraction: Array,
    fluid_density: Array,
    kinematic_viscosity: Array,
) -> DragInputs:
    """Fluid fields at the particles, interpolated all at once.

    Args:
        grid: the grid.
        weights: of the N particles.
        particle_velocity: (N, D) [m/s].
        diameter: () or (N,) [m].
        face_velocity: interstitial, on the faces [m/s].
        pressure_gradient: of the reduced pressure, on the faces [Pa/m].
        solid_fraction: on the cells [-].
        fluid_density: () [kg/m3].
        kinematic_viscosity: () [m2/s].
    """
    slope = cell_average(gradient(grid, -solid_fraction))
    fields = (*cell_average(face_velocity), *slope, *cell_average(pressure_gradient), solid_fraction)
    seen = interpolate(weights, fields)
    d = grid.dimension
    return DragInputs(
        particle_velocity=particle_velocity,
        fluid_velocity=seen[:, :d],
        solid_fraction=seen[:, 3 * d],
        void_fraction_gradient=seen[:, d : 2 * d],
        pressure_gradient=seen[:, 2 * d : 3 * d],
        diameter=diameter,
        filter_size=jnp.asarray(grid.filter_size, seen.dtype),
        fluid_density=fluid_density,
        dynamic_viscosity=fluid_density * kinematic_viscosity,
    )


def deconvolved(
    grid: Grid, weights: Weights, inputs: DragInputs, face_velocity: FaceField, strength: float
) -> DragInputs:
    """The inputs with what averages took from the fluid's velocity given back to first order: u - a sum_k h_k^2
    d2u/dx_k2.

    A filter of variance s^2 takes -s^2/2 lap(u) from a smooth field, so a h^2 is half the variance of all that lies
    between the fluid at a particle and the velocity that it is shown: the cell, its two faces, the kernel.

    Args:
        grid: of the fluid.
        weights: of the N particles.
        inputs: with the velocity that is seen.
        face_velocity: interstitial [m/s].
        strength: a [-].

    Source: S. Stolz & N. A. Adams, Phys. Fluids 11 (1999) 1699-1701; for suspensions S. Schneiderbauer & M. Saeedipour,
    Phys. Fluids 30 (2018) 023301. Van Cittert's series is cut after its second term.
    """
    curvature = tuple(second_differences(grid, component) for component in cell_average(face_velocity))
    return inputs._replace(fluid_velocity=inputs.fluid_velocity - strength * interpolate(weights, curvature))
