"""The solid fraction at a parcel, with the volume of one of its grains in place of its own.

The solid fraction that a particle sees has a part of its own, s_o = V / V_cell sum_c w_c^2, and its neighbours leave
its place free. With kernels wider than a particle, the mean over equal hard spheres that stand at random is

    <s_seen> = s + S s_o,   S = lim_(k -> 0) of the structure factor,

from Carnahan and Starling's equation of state S = (1 - s)^4 / (1 + 4 s + 4 s^2 - 4 s^3 + s^4) for spheres, and from the
scaled-particle theory S = (1 - a)^3 / (1 + a) for discs that cover the area a. S is 1 for few particles and near 0 in a
pack. s_o of a parcel is l^D times that of a grain in the same kernel. The drag law receives

    s_law = s_seen - S(s_seen) s_o (1 - l^-D),

whose mean is the one that grains see. In a regular lattice S is 0, so there it takes away too much.

Sources: J.-P. Hansen & I. R. McDonald, Theory of Simple Liquids, 4th ed. (2013), sec. 2.6 and 3.9 (S and the
compressibility; Carnahan-Starling); E. Helfand, H. L. Frisch & J. L. Lebowitz, J. Chem. Phys. 34 (1961) 1037-1042
(discs).
"""

from __future__ import annotations

import math

import jax.numpy as jnp
from jax import Array

from jaxdem.closures.base import DragInputs
from jaxdem.coupling.interpolation import Weights
from jaxdem.coupling.self_disturbance import own_solid_fraction
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.grid import Grid
from jaxdem.particles.integrate import ParticleProperties


def with_volume_of_grain(
    grid: Grid, weights: Weights, inputs: DragInputs, bodies: ParticleProperties, cut: CutCells | None = None
) -> DragInputs:
    """The inputs with the volume of one grain in place of the parcel's own; as they are where particles are grains.

    Args:
        grid: of the inputs.
        weights: of the N particles.
        inputs: with the solid fraction that is seen.
        bodies: size of the particles.
        cut: surfaces in the fluid, None for none.
    """
    if bodies.parcels is None:
        return inputs
    seen = inputs.solid_fraction
    excess = own_solid_fraction(grid, weights, bodies.volume, cut) * (1.0 - 1.0 / bodies.parcels.grains)
    filled = seen * _packing(grid, bodies)
    scatter = scatter_of_discs(filled) if grid.dimension == 2 else scatter_of_spheres(filled)
    return inputs._replace(solid_fraction=seen - scatter * excess)


def scatter_of_spheres(solid_fraction: Array) -> Array:
    """S of hard spheres, see the module [-]."""
    s = jnp.clip(solid_fraction, 0.0, 1.0)
    return (1.0 - s) ** 4 / (1.0 + s * (4.0 + s * (4.0 + s * (s - 4.0))))


def scatter_of_discs(area_fraction: Array) -> Array:
    """S of hard discs, see the module [-]."""
    a = jnp.clip(area_fraction, 0.0, 1.0)
    return (1.0 - a) ** 3 / (1.0 + a)


def _packing(grid: Grid, bodies: ParticleProperties) -> Array | float:
    """Volume that particles of this radius cover in the layer, or the box, over that of their grains [-]."""
    if grid.dimension == 3:
        return 1.0
    return math.pi * bodies.radius**2 * grid.depth / bodies.volume
