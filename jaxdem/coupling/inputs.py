"""The fluid at the particles: the inputs of the drag law."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.closures.base import DragInputs
from jaxdem.coupling.interpolation import Weights, interpolate
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.fluid_state import FluidProperties
from jaxdem.fluid.grid import FaceField, Grid, cell_average, gradient, mean_over_three, second_differences
from jaxdem.fluid.second_fluid import fluidity, mixture_density
from jaxdem.particles.integrate import ParticleProperties


class MeshFields(NamedTuple):
    """What a mesh has for the drag law.

    Attributes:
        face_velocity: interstitial, on the faces [m/s].
        pressure_gradient: of the reduced pressure, on the faces [Pa/m].
        solid_fraction: on the cells [-].
        liquid_fraction: on the cells, of two fluids; None of one [-].
    """

    face_velocity: FaceField
    pressure_gradient: FaceField
    solid_fraction: Array
    liquid_fraction: Array | None = None


def drag_inputs(
    grid: Grid,
    weights: Weights,
    fields: MeshFields,
    particle_velocity: Array,
    bodies: ParticleProperties,
    properties: FluidProperties,
) -> DragInputs:
    """Fluid fields at the particles, interpolated all at once.

    Of two fluids a particle feels the density and the viscosity of the content of cells that has the liquid fraction at
    the particle, see `second_fluid`.

    Args:
        grid: the grid.
        weights: of the N particles.
        fields: of the mesh.
        particle_velocity: (N, D) [m/s].
        bodies: size of the particles.
        properties: of the fluid.
    """
    velocity, slope, solids, liquid = fields
    of_liquid = () if liquid is None else (liquid,)
    of_gaps = (solids, *of_liquid)
    in_cells = (cell_average(velocity), cell_average(gradient(grid, -solids)), cell_average(slope), of_gaps)
    sampled = interpolate(weights, tuple(itertools.chain(*in_cells)))
    d = grid.dimension
    at_particles = None if liquid is None else sampled[:, 3 * d + 1]
    return DragInputs(
        particle_velocity,
        sampled[:, :d],
        sampled[:, 3 * d],
        sampled[:, d : 2 * d],
        sampled[:, 2 * d : 3 * d],
        2.0 * bodies.grain_radius,
        jnp.asarray(grid.filter_size, sampled.dtype),
        *_density_and_viscosity(properties, at_particles),
    )


def _density_and_viscosity(properties: FluidProperties, liquid: Array | None) -> tuple[Array, Array]:
    """Density [kg/m3] and dynamic viscosity [Pa s] of the fluid; (N,) of two fluids, by the liquid fraction at the
    particles."""
    second = properties.second
    if second is None or liquid is None:
        return properties.density, properties.density * properties.viscosity
    there = jnp.clip(liquid, 0.0, 1.0)
    density = mixture_density(second, properties.density, there)
    return density, 1.0 / fluidity(second, properties.density, properties.viscosity, there)


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


def with_wide_solids(
    grid: Grid, weights: Weights, inputs: DragInputs, solids: Array, cut: CutCells | None = None
) -> DragInputs:
    """The inputs with the solid fraction at the particles of the field that is averaged over three cells along every
    axis; between surfaces over what they leave open of these.

    Args:
        grid: of the fluid.
        weights: of the N particles.
        inputs: without it.
        solids: solid fraction of the cells [-].
        cut: surfaces in the fluid, None for none.
    """
    if cut is None:
        wide = mean_over_three(grid, solids)
    else:
        content, room = (mean_over_three(grid, x) for x in (cut.open_cells * solids, cut.open_cells))
        wide = jnp.where(room > 0.0, content / jnp.where(room > 0.0, room, 1.0), 0.0)
    return inputs._replace(wide_solid_fraction=interpolate(weights, (wide,))[:, 0])
