"""What the drag law would see on a coarser mesh: fields averaged to it and sampled with its own weights.

The flux g u is averaged by area and the pressure by volume, the void fraction is deposited from the particles with the
coarse mesh's kernel, and the interstitial velocity is the averaged flux over it: continuity holds on the coarse mesh
too.
"""

from __future__ import annotations

from jax import Array

from jaxdem.closures.base import DragInputs
from jaxdem.coupling.deposition import Deposition
from jaxdem.coupling.inputs import MeshFields, deconvolved, drag_inputs, with_wide_solids
from jaxdem.coupling.interpolation import Weights
from jaxdem.coupling.member_weights import body_weights
from jaxdem.coupling.own_volume import with_volume_of_grain
from jaxdem.coupling.presence import present_weights
from jaxdem.coupling.void_fraction import solid_fraction
from jaxdem.fluid.boundary import Boundary
from jaxdem.fluid.fluid_state import FluidProperties, FluidState
from jaxdem.fluid.grid import FaceField, Grid, face_average
from jaxdem.fluid.projection import pressure_slope
from jaxdem.fluid.remap import remap_cells, remap_flux
from jaxdem.numerics.static import static
from jaxdem.particles.integrate import ParticleProperties, ParticleState, centres_in_box


@static
class CoarseInputs:
    """A coarser mesh of the same box, to look at the fluid through; static.

    Attributes:
        grid: the coarse one.
        boundary: sides of the box.
        deposition: of the particles on its cells.
        deconvolution: see `deconvolved`, 0 for none [-].
        grain_volume: whether a parcel sees the volume of one grain in place of its own, see `own_volume`.
        wide: whether the law sees the solid fraction of three cells along every axis.
    """

    grid: Grid
    boundary: Boundary
    deposition: Deposition
    deconvolution: float = 0.0
    grain_volume: bool = False
    wide: bool = False

    def __call__(
        self,
        fine: Grid,
        fluid: FluidState,
        solids: Array,
        particles: ParticleState,
        bodies: ParticleProperties,
        properties: FluidProperties,
    ) -> DragInputs:
        """Inputs of the drag law as a solver on the coarse mesh has them.

        Args:
            fine: grid of the fluid.
            fluid: velocity [m/s] and pressure [Pa] on it.
            solids: solid fraction on its cells, of the particles where they are [-].
            particles: where they are.
            bodies: radius [m] and volume [m3].
            properties: density and viscosity.
        """
        fractions = face_average(fine, 1.0 - solids)
        flux = tuple(g * u for g, u in zip(fractions, fluid.face_velocity, strict=True))
        pressure = remap_cells(fine, self.grid, fluid.pressure)
        flux = remap_flux(fine, self.grid, flux)
        return self.sample(flux, pressure, particles, bodies, properties, fluid.mean_gradient)[0]

    def sample(
        self,
        flux: FaceField,
        pressure: Array,
        particles: ParticleState,
        bodies: ParticleProperties,
        properties: FluidProperties,
        mean_gradient: Array | None = None,
    ) -> tuple[DragInputs, FluidState, Weights]:
        """The inputs, and the fluid on the coarse mesh and the weights that they are made with.

        Args:
            flux: g u, averaged to the coarse faces [m/s].
            pressure: averaged to the coarse cells [Pa].
            particles: where they are.
            bodies: radius [m] and volume [m3].
            properties: density and viscosity.
            mean_gradient: see `FluidState`.
        """
        centres = centres_in_box(particles, self.grid.size, self.grid.periodic)
        weights = body_weights(self.deposition, self.grid, particles, centres, bodies)
        weights = present_weights(weights, particles.active)
        solids = solid_fraction(self.grid, weights, bodies.volume)
        fractions = face_average(self.grid, 1.0 - solids)
        velocity = tuple(f / g for f, g in zip(flux, fractions, strict=True))
        fluid = FluidState(velocity, pressure, 1.0 - solids, mean_gradient)
        slope = pressure_slope(self.grid, self.boundary, fluid, continued=True)
        fields = MeshFields(velocity, slope, solids)
        inputs = drag_inputs(self.grid, weights, fields, particles.velocity, bodies, properties)
        if self.wide:
            inputs = with_wide_solids(self.grid, weights, inputs, solids)
        if self.grain_volume:
            inputs = with_volume_of_grain(self.grid, weights, inputs, bodies)
        if self.deconvolution > 0.0:
            inputs = deconvolved(self.grid, weights, inputs, velocity, self.deconvolution)
        return inputs, fluid, weights
