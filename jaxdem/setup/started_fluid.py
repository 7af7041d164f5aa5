"""The fluid of a run as another scene goes on with it. Host side."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import DTypeLike

from jaxdem.errors import InputError
from jaxdem.fluid.boundary import Sides, set_normal_velocity
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.fluid_state import FluidProperties, FluidState
from jaxdem.fluid.grid import Grid, face_average
from jaxdem.fluid.momentum import FluidSolver
from jaxdem.fluid.projection import Continuity
from jaxdem.fluid.remap import remap_cells, remap_flux
from jaxdem.fluid.two_fluids import TwoFluidSolver
from jaxdem.numerics.host import on_device
from jaxdem.scene import Scene
from jaxdem.setup.fluid_walls import with_start_of_solver
from jaxdem.setup.start_point import StartPoint
from jaxdem.setup.surface import KeptLiquid, with_liquid

REMEDY = 'keep the box, or start the fluid anew: start.fluid = "new"'


@dataclasses.dataclass(frozen=True)
class StartedFluid:
    """The fluid at the start of a scene.

    Attributes:
        start: state of the run.
        solver: of the scene.
        flow: its numbers.
        void_fraction: of the cells; None without particles.
        dtype: of the arrays.
    """

    start: StartPoint
    solver: FluidSolver
    flow: FluidProperties
    void_fraction: Array | None
    dtype: DTypeLike

    def state(self) -> FluidState:
        """The fluid: face velocities, pressure, void fraction and what drives it.

        Raises:
            InputError: the box is another one.
        """
        arrays, grid = self.start.arrays, self.solver.grid
        size, cells = tuple(self.start.tables["domain"]["size"]), tuple(self.start.tables["fluid"]["cells"])
        if size != grid.size:
            limit = f"the fluid of the run {self.start.source} fills the box {list(size)} m"
            raise InputError("domain.size", list(grid.size), limit, REMEDY)
        from_faces = "state.fluid.pressure" in arrays
        pressure = np.asarray(arrays["state.fluid.pressure" if from_faces else "cells/pressure"], float)
        if from_faces and cells == grid.cells:
            faces = [arrays[f"state.fluid.face_velocity[{k}]"] for k in range(grid.dimension)]
            velocity = tuple(on_device(self._doubled(face, axis), self.dtype) for axis, face in enumerate(faces))
        else:
            velocity = self._solenoidal(self._flux(cells, from_faces))
            pressure = remap_cells(dataclasses.replace(grid, cells=cells), grid, pressure)
        fluid = FluidState(velocity, on_device(pressure, self.dtype), self.void_fraction, self._mean_gradient())
        fluid = self._with_start_of_solver(fluid)
        name = "state.fluid.liquid_fraction" if from_faces else "cells/liquid_fraction"
        if (name in arrays) != isinstance(self.solver, TwoFluidSolver):
            here, there = ("two fluids", "one") if name in arrays else ("one fluid", "two")
            limit = f"the run {self.start.source} has {here}, and this scene {there}"
            raise InputError("start.fluid", "keep", limit, 'start the fluid anew: start.fluid = "new"')
        if name not in arrays:
            return fluid
        fraction, cut = np.asarray(arrays[name], float), self.flow.cut
        if cut is not None:
            return with_liquid(fluid, grid, self._beside_walls(cut, fraction), self.dtype, cut)
        if cells != grid.cells:
            fraction = remap_cells(dataclasses.replace(grid, cells=cells), grid, fraction)
        return with_liquid(fluid, grid, fraction, self.dtype)

    def _beside_walls(self, cut: CutCells, fraction: np.ndarray) -> np.ndarray:
        """The liquid fraction between walls that the fluid sees; none where they are.

        Raises:
            InputError: the run is on another mesh.
        """
        if fraction.shape != self.solver.grid.cells:
            limit = f"the liquid of the run {self.start.source} is in the cells that walls cut of another mesh"
            remedy = f'set it to {list(fraction.shape)}, or begin anew: start.fluid = "new"'
            raise InputError("fluid.cells", list(self.solver.grid.cells), limit, remedy)
        return np.where(np.asarray(cut.open_cells) > 0.0, fraction, 0.0)

    def _with_start_of_solver(self, fluid: FluidState) -> FluidState:
        """The fluid with what the solver between surfaces begins with: that of the run on the same mesh."""
        fluid = with_start_of_solver(fluid, self.flow)
        stored = self.start.arrays.get("state.fluid.pressure_change")
        if fluid.pressure_change is None or stored is None or stored.shape != fluid.pressure_change.shape:
            return fluid
        return fluid._replace(pressure_change=on_device(stored, self.dtype))

    def _doubled(self, face: np.ndarray, axis: int) -> np.ndarray:
        """Face velocities whose first and last layer are one where the axis is periodic now."""
        lower = "left" if axis == 0 else ("bottom" if axis == self.solver.grid.dimension - 1 else "front")
        was = self.start.tables["boundary"][lower]["kind"] == "periodic"
        if was or not self.solver.grid.periodic[axis]:
            return face
        first, last = np.take(face, [0], axis), np.take(face, [-1], axis)
        inner = np.delete(face, [0, face.shape[axis] - 1], axis)
        return np.concatenate([0.5 * (first + last), inner, 0.5 * (first + last)], axis)

    def _flux(self, cells: tuple[int, ...], from_faces: bool) -> tuple[np.ndarray, ...]:
        """Flux g u on the faces of the scene's mesh, by area [m/s]."""
        arrays, grid = self.start.arrays, self.solver.grid
        before = dataclasses.replace(grid, cells=cells)
        name = "state.fluid.void_fraction" if from_faces else "cells/void_fraction"
        void = np.asarray(arrays.get(name, np.ones(cells)), float)
        if from_faces:
            faces = [np.asarray(arrays[f"state.fluid.face_velocity[{k}]"], float) for k in range(grid.dimension)]
        else:
            velocity = arrays["cells/velocity"]
            faces = [_on_faces(before, velocity[..., axis], axis) for axis in range(grid.dimension)]
        gaps = [_on_faces(before, void, axis) for axis in range(grid.dimension)]
        return remap_flux(before, grid, tuple(g * u for g, u in zip(gaps, faces, strict=True)))

    def _solenoidal(self, flux: tuple[np.ndarray, ...]) -> tuple[Array, ...]:
        """Face velocities of a flux after the sides are set and its divergence is taken out, by a gradient."""
        grid, time = self.solver.grid, float(self.start.time)

        @jax.jit
        def velocity(flux: tuple[Array, ...], void_fraction: Array | None, flow: FluidProperties) -> tuple[Array, ...]:
            gaps = face_average(grid, 1.0 if void_fraction is None else void_fraction)
            faces = tuple(f / g for f, g in zip(flux, gaps, strict=True))
            sides = Sides(self.solver.boundary, flow.side_velocity, jnp.asarray(time, flux[0].dtype))
            faces = set_normal_velocity(grid, sides, faces, gaps)
            through = Continuity(self.solver.grid, self.solver.boundary, 0.0).corrected(
                tuple(g * u for g, u in zip(gaps, faces, strict=True))
            )
            return tuple(f / g for f, g in zip(through, gaps, strict=True))

        given = tuple(on_device(f, self.dtype) for f in flux)
        return velocity(given, self.void_fraction, self.flow)

    def _mean_gradient(self) -> Array | None:
        """Of the reduced pressure along periodic axes [Pa/m]; None where nothing drives the fluid."""
        arrays, drive = self.start.arrays, self.solver.drive
        if drive is None:
            return None
        if "state.fluid.mean_gradient" in arrays:
            return on_device(arrays["state.fluid.mean_gradient"], self.dtype)
        first = jax.jit(self.solver.first_gradient)(self.flow)
        if "cells/gradient" not in arrays or self.flow.gravity is None:
            return first
        # The history has what drives the fluid, gravity included.
        density, gravity = np.asarray(self.flow.density), np.asarray(self.flow.gravity)
        return on_device(np.where(drive.driven, arrays["cells/gradient"] - density * gravity, 0.0), self.dtype)


def kept_liquid(scene: Scene, start: StartPoint | None) -> KeptLiquid | None:
    """The liquid of a run that a scene goes on with; None where it begins anew, or one of both has one fluid."""
    if start is None or scene.surface is None or (scene.start is not None and scene.start.fluid == "new"):
        return None
    arrays = start.arrays
    of_frame = "state.fluid.liquid_fraction" not in arrays
    fraction = arrays.get("cells/liquid_fraction" if of_frame else "state.fluid.liquid_fraction")
    if fraction is None:
        return None
    name = "cells/velocity" if of_frame else "state.fluid.face_velocity"
    speeds = [float(np.abs(values).max()) for key, values in arrays.items() if key.startswith(name)]
    return KeptLiquid(np.asarray(fraction, float), max(speeds, default=0.0))


def _on_faces(grid: Grid, cell: np.ndarray, axis: int) -> np.ndarray:
    """Mean of the two cells of every face of an axis; at a side that is not periodic that of its one cell."""
    first, last = np.take(cell, [0], axis), np.take(cell, [-1], axis)
    below, above = (last, first) if grid.periodic[axis] else (first, last)
    padded = np.concatenate([below, cell, above], axis)
    count = padded.shape[axis]
    return 0.5 * (np.take(padded, range(count - 1), axis) + np.take(padded, range(1, count), axis))
