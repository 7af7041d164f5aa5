"""What the fluid does to the particles apart from drag, and what the drag law is shown."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.closures.base import DragInputs
from jaxdem.coupling.interpolation import Weights, interpolate
from jaxdem.fluid.grid import FaceField, Grid, cell_average, gradient


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
