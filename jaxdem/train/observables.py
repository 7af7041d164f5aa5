"""The observables of `jaxdem.metrics` as functions that can be differentiated, and profiles along the flow.

Those of the fluid are of fields averaged to the coarse mesh, on both sides: what a perfect coarse run would show.

Those that have a name of `jaxdem.metrics` give its value: run-off and height are the same percentile, whose slope
is that of the two grains that it lies between. The profiles are sums over all particles with a smooth kernel, so that
every grain has a share in where the pack is.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.fluid.boundary import Boundary
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.fluid.grid import Grid, cell_average
from jaxdem.metrics import PERCENTILE
from jaxdem.numerics.vectors import row_lengths

BINS = 24
"""Places along x at which the profiles are taken; the kernel's width is their distance."""


class Observables(NamedTuple):
    """What is compared with a reference run, at one time.

    Attributes:
        drag_force_mean, particle_velocity_mean, kinetic_energy, runoff, height: (), see `jaxdem.metrics`.
        solids_profile: (BINS,) volume of particles per length along x [m2].
        height_profile: (BINS,) volume of particles times the height of their centres, per length along x [m3].
        fluid_velocity_mean, fluid_pressure_mean: (), as in `jaxdem.metrics`; these and the following are None where
            the fluid is not compared, the pressure also in a box without an outlet, where its mean is zero.
        momentum_profile: (cells along x,) mean over each section of g u_x^2, the momentum that passes [m2/s2].
        flux_height_profile: (cells along x,) mean over each section of g u_x z, where the flow passes [m2/s].
    """

    drag_force_mean: Array
    particle_velocity_mean: Array
    kinetic_energy: Array
    runoff: Array
    height: Array
    solids_profile: Array
    height_profile: Array
    fluid_velocity_mean: Array | None = None
    fluid_pressure_mean: Array | None = None
    momentum_profile: Array | None = None
    flux_height_profile: Array | None = None


class Grains(NamedTuple):
    """What does not change of the particles.

    Attributes:
        mass, inertia, volume: () or (N,) [kg], [kg m2], [m3].
        length: of the box along x [m].
    """

    mass: Array
    inertia: Array
    volume: Array
    length: float


def observe_particles(
    grains: Grains, position: Array, velocity: Array, angular_velocity: Array, drag_force: Array
) -> Observables:
    """Observables of particles at one time.

    Args:
        grains: masses and sizes.
        position: (N, D) [m].
        velocity: (N, D) [m/s].
        angular_velocity: (N, A) [rad/s].
        drag_force: (N, D) [N].
    """
    moving = grains.mass * jnp.sum(velocity**2, axis=1) + grains.inertia * jnp.sum(angular_velocity**2, axis=1)
    solids = _profile(grains, position[:, 0], jnp.broadcast_to(grains.volume, position.shape[:1]))
    return Observables(
        drag_force_mean=jnp.mean(row_lengths(drag_force)),
        particle_velocity_mean=jnp.mean(row_lengths(velocity)),
        kinetic_energy=0.5 * jnp.sum(moving),
        runoff=jnp.percentile(position[:, 0], PERCENTILE),
        height=jnp.percentile(position[:, -1], PERCENTILE),
        solids_profile=solids,
        height_profile=_profile(grains, position[:, 0], grains.volume * position[:, -1]),
    )


def observe_fluid(observed: Observables, grid: Grid, boundary: Boundary, fluid: FluidState) -> Observables:
    """The observables with those of the fluid.

    Args:
        observed: those of the particles.
        grid, boundary: of the coarse mesh.
        fluid: on it, with a void fraction.
    """
    cells = jnp.stack(cell_average(fluid.face_velocity), axis=-1)
    sections = tuple(range(1, grid.dimension))
    height = (jnp.arange(grid.cells[-1], dtype=cells.dtype) + 0.5) * grid.spacing[-1]
    height = height.reshape((1,) * (grid.dimension - 1) + (-1,))
    along = cells[..., 0]
    flux = required(fluid.void_fraction, "void fraction") * along
    return observed._replace(
        fluid_velocity_mean=jnp.mean(row_lengths(cells.reshape(-1, grid.dimension))),
        fluid_pressure_mean=jnp.mean(fluid.pressure) if boundary.has_outlet else None,
        momentum_profile=jnp.mean(flux * along, axis=sections),
        flux_height_profile=jnp.mean(flux * height, axis=sections),
    )


def _profile(grains: Grains, along: Array, weight: Array) -> Array:
    """(BINS,) sum_i w_i K(x_k - x_i) with a Gaussian K of width h at x_k = (k + 1/2) h, integral 1."""
    width = grains.length / BINS
    places = (jnp.arange(BINS, dtype=along.dtype) + 0.5) * width
    distance = (places[:, None] - along[None, :]) / width
    kernel = jnp.exp(-0.5 * distance**2) / (width * jnp.sqrt(2.0 * jnp.pi).astype(along.dtype))
    return jnp.sum(kernel * weight[None, :], axis=1)
