"""Continuity between surfaces within the mesh, see `cut_cells`: fluxes and velocities that keep the volume.

The solver is iterative here, as the open fractions differ from face to face, so it begins where little is left to do:
with the change of the pressure in the last step, times the number that leaves least of the source, by least squares.
That is a start alone, and no part of the result.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array, lax

from jaxdem.fluid.boundary import Boundary
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.grid import CellOrOne, FaceField, Grid, agreed, box_largest, divergence, sum_of
from jaxdem.fluid.multigrid import multigrid
from jaxdem.fluid.pressure import (
    PressureProblem,
    SolverReport,
    pressure_gradient,
    solve_preconditioned,
    solve_pressure,
)
from jaxdem.fluid.projection import Projected
from jaxdem.numerics.batches import cond_in_batch
from jaxdem.numerics.blocks import total
from jaxdem.numerics.products import PRECISION

FLUX_TOLERANCE = 1e-3
"""Largest divergence of the flux that carries momentum within a step, in units of U/h."""


EXACT_FLUX = {"float32": 1e-6, "float64": 1e-11}
"""The same of the flux that carries two fluids: what it lacks is what a volume fraction is beyond 0 and 1 by."""


class CutContinuity(NamedTuple):
    """What a flux must satisfy between surfaces: div(a g u) = -growth.

    Attributes:
        grid: the mesh; static.
        boundary: its sides; static.
        growth: rate of change of the volume of fluid over that of a whole cell [1/s].
        cut: the surfaces.
        trend: change of the pressure in the last step; None where it is not known [Pa].
        jumps: see `Continuity`.
    """

    grid: Grid
    boundary: Boundary
    growth: Array | float
    cut: CutCells
    trend: Array | None = None
    jumps: bool = False

    def corrected(self, flux: FaceField) -> FaceField:
        """The flux a g u [m/s] changed by a gradient so that it keeps the volume, to `FLUX_TOLERANCE`: the projection
        after it is exact. Of two fluids, whose volumes it carries, to `EXACT_FLUX`."""
        grid, excess = self.grid, divergence(self.grid, flux) + self.growth
        # Of a flow that is slower than the volumes change, what is left of that counts.
        scale = jnp.maximum(self._rate(flux), box_largest(grid, jnp.abs(excess)))
        slope, excess, _ = self._foreseen(excess, self.cut.open_faces)
        tolerance = (EXACT_FLUX[str(scale.dtype)] if self.jumps else FLUX_TOLERANCE) * scale
        potential, _ = solve_pressure(grid, self.boundary, self.cut.open_faces, excess, tolerance, self._fluid)
        further = pressure_gradient(grid, self.boundary, potential)
        slope = further if slope is None else tuple(s + f for s, f in zip(slope, further, strict=True))
        return tuple(f - a * s for f, a, s in zip(flux, self.cut.open_faces, slope, strict=True))

    def projected(
        self,
        pressure: Array,
        predicted: FaceField,
        void_fraction: tuple[CellOrOne, ...],
        push: tuple[Array | float, ...],
        least: Array | None = None,
    ) -> tuple[FaceField, Array, SolverReport, Array]:
        """Velocity made to satisfy continuity, the pressure that did it, and how well the solver has done.

        Args:
            pressure: at the start of the step [Pa].
            predicted: velocity before the projection [m/s].
            void_fraction: a g on the faces [-].
            push: change of the velocity by a pressure gradient, on the faces [m3 s/kg].
            least: () see `Continuity.projected`.

        Returns:
            velocity [m/s], pressure [Pa], the report, and the largest divergence that is left in units of U/h.
        """
        grid, dtype = self.grid, pressure.dtype
        coefficient = tuple(g * c for g, c in zip(void_fraction, push, strict=True))
        flux = tuple(g * u for g, u in zip(void_fraction, predicted, strict=True))
        # In units of U/h: 1e-10 is asked for in float64, 1e-5 in float32.
        scale = self._rate(flux) + box_largest(grid, jnp.abs(jnp.asarray(self.growth, dtype))) + jnp.finfo(dtype).tiny
        if least is not None:
            scale = scale + least
        tolerance = 2e-6 if dtype == jnp.float32 else 2e-12
        slope, source, ahead = self._foreseen(divergence(grid, flux) + self.growth, coefficient)
        begun = Projected(predicted, pressure, source, jnp.zeros((), jnp.int32))
        if slope is not None and ahead is not None:
            velocity = tuple(u - c * s for u, c, s in zip(predicted, push, slope, strict=True))
            begun = begun._replace(velocity=velocity, pressure=pressure + ahead)

        inverse = multigrid(grid, self.boundary, coefficient, closed=True) if self.jumps else None

        def solved(now: Projected) -> Projected:
            if inverse is None:
                correction, report = solve_pressure(
                    grid, self.boundary, coefficient, now.source, tolerance * scale, self._fluid
                )
            else:
                problem = PressureProblem(grid, self.boundary, coefficient, self._fluid)
                correction, report = solve_preconditioned(problem, now.source, tolerance * scale, inverse)
            slope = pressure_gradient(grid, self.boundary, correction)
            velocity = agreed(grid, tuple(u - c * s for u, c, s in zip(now.velocity, push, slope, strict=True)))
            flux = tuple(g * u for g, u in zip(void_fraction, velocity, strict=True))
            left = divergence(grid, flux) + self.growth
            return Projected(velocity, now.pressure + correction, left, now.iterations + report.iterations)

        found = solved(begun)
        if dtype == jnp.float32:
            # A pressure of many cells' worth of head hides its own differences in float32. The second pass solves for
            # the divergence that the first has left, whose pressure is small and well resolved.
            more = box_largest(grid, jnp.abs(found.source)) > tolerance * scale
            found = cond_in_batch(more, solved, found)
        remaining = box_largest(grid, jnp.abs(found.source)) / scale
        report = SolverReport(found.iterations, remaining * scale, remaining <= 5.0 * tolerance)
        return found.velocity, found.pressure, report, remaining

    def _rate(self, flux: FaceField) -> Array:
        """() U/h: largest flux over cell size, of all axes [1/s]."""
        largest = (box_largest(self.grid, jnp.abs(f)) / h for f, h in zip(flux, self.grid.spacing, strict=True))
        found: Array = sum_of(largest)
        return found

    @property
    def _fluid(self) -> Array:
        return self.cut.open_cells > 0.0

    def _foreseen(
        self, source: Array, coefficient: tuple[Array | float, ...]
    ) -> tuple[FaceField | None, Array, Array | None]:
        """Gradient of what the trend foresees, the source that this leaves, and the pressure itself; None without.

        Args:
            source: on the cells [1/s].
            coefficient: of the gradient, on the faces.
        """
        if self.trend is None:
            return None, source, None
        trend = lax.stop_gradient(self.trend)
        slope = pressure_gradient(self.grid, self.boundary, trend)
        taken = divergence(self.grid, tuple(c * s for c, s in zip(coefficient, slope, strict=True)))
        size, both = jnp.vdot(taken, taken, precision=PRECISION), jnp.vdot(source, taken, precision=PRECISION)
        size, both = total(self.grid.blocks, (size, both))
        share = lax.stop_gradient(both / jnp.where(size > 0.0, size, 1.0))
        return tuple(share * s for s in slope), source - share * taken, share * trend
