"""Continuity: fluxes and velocities that keep the volume of the mixture, by a potential or a pressure."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.boundary import Boundary, with_outflow
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.fluid.grid import CellOrOne, FaceField, Grid, agreed, along, box_largest, box_mean, divergence
from jaxdem.fluid.multigrid import multigrid
from jaxdem.fluid.pressure import (
    PressureProblem,
    SolverReport,
    fast_inverse,
    pressure_gradient,
    solve_preconditioned,
    solve_pressure,
)
from jaxdem.numerics.batches import cond_in_batch


class Projected(NamedTuple):
    """A velocity on its way through the projection.

    Attributes:
        velocity: on the faces [m/s].
        pressure: that has acted on it [Pa].
        source: divergence that is left, on the cells [1/s].
        iterations: () of the solver so far.
    """

    velocity: FaceField
    pressure: Array
    source: Array
    iterations: Array


class Continuity(NamedTuple):
    """What a flux must satisfy: div(g u) = -d(g)/dt. Between surfaces within the mesh see `CutContinuity`.

    Attributes:
        grid: the mesh; static.
        boundary: its sides; static.
        growth: d(g)/dt, rate of change of the void fraction [1/s].
        jumps: whether what a pressure gradient changes jumps between cells, as the density of two fluids does.
    """

    grid: Grid
    boundary: Boundary
    growth: Array | float
    jumps: bool = False

    def corrected(self, flux: FaceField) -> FaceField:
        """The flux g u [m/s] changed so that it keeps the volume: on outlets by the speed that balances the box, within
        by a gradient.

        Momentum carried by such a flux is conserved and a uniform stream stays uniform, exactly, while
        the void fraction changes.
        """
        grid = self.grid
        excess = divergence(grid, flux) + self.growth
        if self.boundary.has_outlet:
            flux = with_outflow(grid, self.boundary, flux, -box_mean(grid, excess))
            excess = divergence(grid, flux) + self.growth
        potential = fast_inverse(grid, None)(excess)
        slope = pressure_gradient(grid, _closed(self.boundary), potential)
        return tuple(f + s for f, s in zip(flux, slope, strict=True))

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
            void_fraction: on the faces [-].
            push: change of the velocity by a pressure gradient, on the faces [m3 s/kg].
            least: () what U/h is at least, where large forces balance each other in a flow that is slow; None for
                what the flow makes of it [1/s].

        Returns:
            velocity [m/s], pressure [Pa], the report, and the largest divergence that is left in units of U/h.
        """
        grid, boundary, growth, jumps = self
        flux = product(void_fraction, predicted)
        # In units of U/h: 1e-10 is asked for in float64, 1e-5 in float32.
        scale = sum(box_largest(grid, jnp.abs(f)) / h for f, h in zip(flux, grid.spacing, strict=True))
        scale = scale + box_largest(grid, jnp.abs(jnp.asarray(growth, flux[0].dtype))) + jnp.finfo(flux[0].dtype).tiny
        if least is not None:
            scale = scale + least
        # A pressure of many cells' worth of head hides its own differences in float32. The second pass
        # solves for the divergence that the first has left, whose pressure is small and well resolved.
        passes = (1e-4, 2e-6) if flux[0].dtype == jnp.float32 else (2e-12,)
        coefficient = product(void_fraction, push)
        inverse = multigrid(grid, boundary, coefficient) if jumps else None

        def solved(now: Projected, tolerance: float) -> Projected:
            if inverse is None:
                correction, report = solve_pressure(grid, boundary, coefficient, now.source, tolerance * scale)
            else:
                problem = PressureProblem(grid, boundary, coefficient)
                correction, report = solve_preconditioned(problem, now.source, tolerance * scale, inverse)
            slope = pressure_gradient(grid, boundary, correction)
            velocity = agreed(grid, tuple(u - c * s for u, c, s in zip(now.velocity, push, slope, strict=True)))
            left = divergence(grid, product(void_fraction, velocity)) + growth
            return Projected(velocity, now.pressure + correction, left, now.iterations + report.iterations)

        source = divergence(grid, product(void_fraction, predicted)) + growth
        found = Projected(predicted, pressure, source, jnp.zeros((), jnp.int32))
        if not jumps:
            for tolerance in passes:
                found = solved(found, tolerance)
        else:
            # A pass costs as much as an iteration does: the first one goes to the end, and another one follows where
            # rounding has left too much.
            found = solved(found, passes[-1])
            if len(passes) > 1:
                more = box_largest(grid, jnp.abs(found.source)) > passes[-1] * scale
                found = cond_in_batch(more, lambda now: solved(now, passes[-1]), found)
        remaining = box_largest(grid, jnp.abs(found.source)) / scale
        report = SolverReport(found.iterations, remaining * scale, remaining <= 5.0 * passes[-1])
        return found.velocity, found.pressure, report, remaining


def pressure_slope(grid: Grid, boundary: Boundary, state: FluidState, continued: bool = False) -> FaceField:
    """Gradient of the reduced pressure on the faces, with that which drives the fluid; see `pressure_gradient`."""
    if state.pressure_slope is not None:
        return state.pressure_slope
    slope = pressure_gradient(grid, boundary, state.pressure, continued)
    if state.mean_gradient is None:
        return slope
    return tuple(s + state.mean_gradient[axis] for axis, s in enumerate(slope))


def open_section(grid: Grid, cut: CutCells) -> Array:
    """(D,) mean open fraction of the faces of every axis [-]."""
    return jnp.stack([box_mean(grid, along(a, axis, None, -1)) for axis, a in enumerate(cut.open_faces)])


def product(a, b):  # type: ignore[no-untyped-def]
    """Products of the components of two vectors."""
    return tuple(x * y for x, y in zip(a, b, strict=True))


def _closed(boundary: Boundary) -> Boundary:
    """The same box without outlets."""
    return Boundary(
        tuple(
            dataclasses.replace(s, kind="no_slip", own=None) if s.condition.sets_pressure else s for s in boundary.sides
        )
    )
