"""What a step of the fluid does to the sides of the box and to surfaces within the mesh.

Here is what particles hand to them through boundary faces and closed faces; the rest is in `side_forces` and
`cut_cells`.
"""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.fluid.boundary import Boundary
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.fluid_state import FaceExchange, FluidProperties, FluidState
from jaxdem.fluid.grid import CellOrOne, FaceField, Grid, face_average, face_control_volume
from jaxdem.fluid.open_faces import continued
from jaxdem.fluid.projection import pressure_slope
from jaxdem.fluid.side_forces import gained_at_sides
from jaxdem.fluid.surface_loads import SurfaceShares, stress_on_cuts, surface_loads


@dataclasses.dataclass(frozen=True)
class StepLoads:
    """The end of a step, from which loads are found; made and used up inside of one trace.

    Attributes:
        grid: the mesh.
        boundary: its sides.
        shares_stress: whether particles take their volume's share of pressure gradient and stress (model A).
        properties: of the fluid.
        fluid: at the end of the step.
        weight: part of pressure gradient and stress that acts on the fluid, on the faces [-].
        exchange: of the particles; None without.
        time_step: [s].
    """

    grid: Grid
    boundary: Boundary
    shares_stress: bool
    properties: FluidProperties
    fluid: FluidState
    weight: tuple[CellOrOne, ...]
    exchange: FaceExchange | None
    time_step: Array

    def handed_to_sides(self, measured: tuple[int, ...], stress: FaceField) -> Array:
        """Load on the measured sides of what particles hand to the boundary faces: what these lose, and the part of
        pressure gradient and stress [m/s2] that the particles take there; see `side_forces` for its shape."""
        grid, exchange, force = self.grid, required(self.exchange, "exchange of the particles"), []
        for axis, u in enumerate(self.fluid.face_velocity):
            volume = face_control_volume(grid, axis).astype(u.dtype)
            given = (exchange.forcing[axis] - exchange.resistance[axis] * u) / (self.time_step * volume)
            if self.shares_stress:
                slope = pressure_slope(grid, self.boundary, self.fluid, continued=True)[axis]
                given = given + (1.0 - self.weight[axis]) * (slope - self.properties.density * stress[axis])
            force.append(given)
        return gained_at_sides(grid, measured, tuple(force))

    def taken_from_surfaces(self, stress: FaceField, solids: Array) -> FaceField:
        """What particles take of pressure gradient and stress beyond what the fluid leaves them on cut and closed
        faces, over the volume of whole control volumes [N/m3]: the surfaces take the opposite.

        Args:
            stress: as particles see it [m/s2].
            solids: volume of the particles over that of whole cells [-].
        """
        grid, cut = self.grid, self._cut
        if not self.shares_stress:
            return tuple(jnp.zeros_like(u) for u in self.fluid.face_velocity)
        slope = continued(grid, cut.open_faces, pressure_slope(grid, self.boundary, self.fluid, continued=True))
        seen = face_average(grid, solids)
        parts = zip(seen, cut.open_faces, self.weight, slope, stress, strict=True)
        return tuple((s - a * (1.0 - w)) * (p - self.properties.density * t) for s, a, w, p, t in parts)

    def on_surfaces(self, on_faces: FaceField, viscosity: Array, number: int) -> Array:
        """(S, D, 1 + D) load on each of `number` surfaces: what acts on its faces [N/m3], what particles hand to closed
        faces, and pressure and stress of a viscosity, () or in the cells [m2/s]; see `cut_cells`."""
        grid, cut, forces = self.grid, self._cut, []
        for axis, density in enumerate(on_faces):
            force = face_control_volume(grid, axis).astype(density.dtype) * density
            if self.exchange is not None:
                handed = self.exchange.forcing[axis] - self.exchange.resistance[axis] * cut.velocity[axis]
                force = force + jnp.where(cut.open_faces[axis] > 0.0, 0.0, handed / self.time_step)
            forces.append(force)
        viscosity = self.properties.density * viscosity
        shares = SurfaceShares(tuple(forces), stress_on_cuts(grid, cut, self.fluid.pressure, viscosity))
        return surface_loads(grid, cut, shares, number)

    @property
    def _cut(self) -> CutCells:
        return required(self.properties.cut, "cut cells")
