"""Rates of change of the fluid's momentum by advection and stress, as a stage of the Runge-Kutta method needs them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.advection import AdvectionScheme, advection
from jaxdem.fluid.boundary import Boundary, Sides
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.cut_eddy import eddy_beside_surfaces
from jaxdem.fluid.cut_stress import CutViscosity, cut_stress
from jaxdem.fluid.diffusion import stress_divergence
from jaxdem.fluid.fluid_state import FluidProperties
from jaxdem.fluid.grid import CellOrOne, FaceField, Grid, face_average, sum_of
from jaxdem.fluid.mixing_length import mixing_length_over_bed
from jaxdem.fluid.side_forces import gained_at_sides, stress_on_sides, viscous_stresses
from jaxdem.fluid.subgrid_stress import SubgridFlow, subgrid_acceleration, subgrid_flow, subgrid_stress
from jaxdem.numerics.static import static


class Rates(NamedTuple):
    """What a stage of the Runge-Kutta method gives, on the faces [m/s2].

    Attributes:
        total: rate of change of g u by advection and stress; on faces that a surface closes, what these would gain.
        stress: divergence of the stress over density.
        on_sides: load of stress and advection on the sides over density, see `side_forces`; None unless measured.
        lost: what surfaces take of the stress besides, see `cut_stress`; None where they take nothing [m/s2].
    """

    total: FaceField
    stress: FaceField
    on_sides: Array | None = None
    lost: FaceField | None = None


@static
class MomentumRates:
    """How advection and stress are formed; attributes as those of `FluidSolver`."""

    grid: Grid
    boundary: Boundary
    advection: AdvectionScheme
    viscous: bool
    measured_sides: tuple[int, ...] = ()

    def sides(self, properties: FluidProperties, time: Array) -> Sides:
        """The sides of the box as they move at a time [s]."""
        return Sides(self.boundary, properties.side_velocity, time)

    def mixing_length(self, properties: FluidProperties, void_fraction: Array | None) -> Array | None:
        """Of the eddy viscosity, () or in the cells [m]; None without one."""
        if properties.bed_mixing is not None:
            return mixing_length_over_bed(self.grid, properties.bed_mixing, void_fraction)
        return None if properties.smagorinsky is None else properties.smagorinsky * self.grid.filter_size

    def cut_viscosity(
        self, properties: FluidProperties, velocity: FaceField, void_fraction: Array | None, time: Array
    ) -> CutViscosity:
        """Of the fluid between surfaces; without an eddy part where there are none."""
        length = None if properties.cut is None else self.mixing_length(properties, void_fraction)
        if properties.cut is None or length is None:
            return CutViscosity(properties.viscosity)
        sides = self.sides(properties, time)
        eddy = eddy_beside_surfaces(self.grid, sides, properties.cut.open_faces, velocity, length)
        return CutViscosity(properties.viscosity, eddy)

    def subgrid_flow(
        self, properties: FluidProperties, velocity: FaceField, void_fraction: Array | None, time: Array
    ) -> SubgridFlow | None:
        """What the subgrid stress is made of, None without one."""
        if properties.subgrid is None:
            return None
        sides = self.sides(properties, time)
        return subgrid_flow(self.grid, sides, properties.subgrid, velocity, properties.viscosity, void_fraction)

    def of_stage(
        self,
        properties: FluidProperties,
        flux: FaceField,
        velocity: FaceField,
        weight: tuple[CellOrOne, ...],
        void_fraction: Array | None,
        time: Array,
    ) -> Rates:
        """Rates of a stage.

        The subgrid stress belongs to the first: it moves the fluid's momentum and is no force on what is in the fluid.
        """
        grid, sides, cut = self.grid, self.sides(properties, time), properties.cut
        rates = advection(grid, sides, self.advection, flux, velocity, cut)
        on_sides = gained_at_sides(grid, self.measured_sides, rates) if self.measured_sides else None
        if cut is not None:
            viscosity = self.cut_viscosity(properties, velocity, void_fraction, time)
            return self._between_surfaces(cut, rates, sides, velocity, weight, (viscosity, void_fraction))
        flow = self.subgrid_flow(properties, velocity, void_fraction, time)
        if flow is not None:
            within = subgrid_stress(grid, flow, void_fraction)
            moved = subgrid_acceleration(grid, self.boundary, within)
            rates = tuple(r + m for r, m in zip(rates, moved, strict=True))
            if on_sides is not None:
                on_sides = on_sides + stress_on_sides(grid, self.measured_sides, self.boundary, within)
        if not self.viscous:
            return Rates(rates, tuple(jnp.zeros_like(u) for u in velocity), on_sides)
        length = self.mixing_length(properties, void_fraction)
        if on_sides is not None:
            found = viscous_stresses(grid, sides, velocity, properties.viscosity, length)
            on_sides = on_sides + stress_on_sides(grid, self.measured_sides, self.boundary, found)
        stress = stress_divergence(grid, sides, velocity, properties.viscosity, length)
        total = tuple(r + g * s for r, g, s in zip(rates, weight, stress, strict=True))
        return Rates(total, stress, on_sides)

    def _between_surfaces(
        self,
        cut: CutCells,
        rates: FaceField,
        sides: Sides,
        velocity: FaceField,
        weight: tuple[CellOrOne, ...],
        fluid: tuple[CutViscosity, Array | None],
    ) -> Rates:
        """Rates of a stage between surfaces, from those of advection; `fluid` are viscosity and void fraction."""
        viscosity, void_fraction = fluid
        stress, lost = tuple(jnp.zeros_like(u) for u in velocity), None
        if self.viscous:
            stress, lost = cut_stress(self.grid, sides, cut, velocity, viscosity, void_fraction is not None)
        if cut.swept is not None:
            kept = face_average(self.grid, cut.swept)
            rates = tuple(r - u * g for r, u, g in zip(rates, velocity, kept, strict=True))
        if cut.supply is not None and cut.brought is not None:
            leaves = face_average(self.grid, jnp.minimum(cut.supply, 0.0))
            rates = tuple(r + b + s * u for r, b, s, u in zip(rates, cut.brought, leaves, velocity, strict=True))
        parts = zip(cut.open_faces, rates, weight, stress, cut.inertia, strict=True)
        total = tuple(jnp.where(a > 0.0, (r + g * s) / m, r) for a, r, g, s, m in parts)
        return Rates(total, stress, lost=lost)


def weighted(stages: Sequence[Rates], weights: tuple[float, ...]) -> Rates:
    """Sum of the stages with weights."""
    mean: Rates = jax.tree.map(lambda *rates: sum_of(w * r for w, r in zip(weights, rates, strict=True)), *stages)
    return mean
