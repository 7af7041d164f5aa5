"""The fluid steps of one coupling interval: how many there are, and their loop."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple, Self, TypeVar

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxdem.errors import required
from jaxdem.fluid.boundary import coverage, largest_inflow
from jaxdem.fluid.carried_heat import CarriedHeat
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.cut_liquid import surface_courant_beside
from jaxdem.fluid.dissolved import CarriedScalar
from jaxdem.fluid.fluid_state import FluidProperties, FluidState, FluidStep
from jaxdem.fluid.grid import FaceField, Grid, along, face_average
from jaxdem.fluid.mesh import at_side, of_slab
from jaxdem.fluid.momentum import FluidSolver
from jaxdem.fluid.momentum_step import or_one
from jaxdem.fluid.openings import Openings
from jaxdem.fluid.surface_response import SurfaceResponse
from jaxdem.fluid.volume_of_fluid import surface_courant
from jaxdem.numerics.batches import cond_in_batch
from jaxdem.numerics.blocks import Blocks, any_of, largest, total
from jaxdem.numerics.static import static

SUBSTEPS = (1, 2, 4, 8)
"""Numbers of fluid steps that a coupling interval may be cut into."""

VISCOUS_STABLE = 0.375
"""Viscosity number nu t sum(1/h^2) up to which a fluid step is stable.

Velocities would be up to 0.5, by Heun's method. But a pressure p left over from the last step enters the trial
velocity, whose stress changes the prediction by -t^2/2 (4/3) nu lap(grad p): the projection leaves a pressure of (8/3)
nu t sum(1/h^2) times the old one in its shortest waves. 4/3 is of the deviatoric stress. Derived here."""

VISCOUS_LIMIT = 0.3
"""Viscosity number that fluid steps are chosen for: a fifth under `VISCOUS_STABLE`."""

Carry = TypeVar("Carry")


class FluidDiagnostics(NamedTuple):
    """What happened to the fluid in an interval; all ().

    Attributes:
        substeps: number of fluid steps taken.
        courant: largest sum over the axes of |u| t / h of a fluid step.
        viscous: viscosity number nu t sum(1/h^2) of a fluid step with the largest nu, molecular and subgrid;
            see `VISCOUS_STABLE`.
        iterations: of the pressure solver, most of any step.
        divergence: largest after projection, in units of U/h.
        converged: bool, every pressure solve reached its tolerance.
        finite: bool, no velocity and no pressure is NaN or infinite.
        side_load: (2 D, D, 1 + D) mean load on every side of the box, lower before upper, axis by axis; see
            `fluid.side_forces`; None where nothing asks for it [N], [N m].
        pressure_gradient: (D,) mean gradient of the pressure along periodic axes, without a meaning along others; None
            where nothing drives the fluid [Pa/m].
        surface_load: (S, D, 1 + D) mean load on the surfaces within the mesh; None without [N], [N m].
        flux: mean volume flux on the faces; None unless the solver keeps it [m/s].
        heat: that two fluids have carried; None without.
        dissolved: scalars that they have carried; None without.
        response: of the loads to the speeds of pistons, mean over the steps; None without pistons in the fluid.
        cut: the mesh of the interval, for scalars between walls that change their place; None without these.
        passed: (B, 2) or (B, 4) mean volume per time that comes in and that leaves, see `passages`; None where nothing
            may pass [m3/s].
    """

    substeps: Array
    courant: Array
    viscous: Array
    iterations: Array
    divergence: Array
    converged: Array
    finite: Array
    side_load: Array | None = None
    pressure_gradient: Array | None = None
    surface_load: Array | None = None
    flux: FaceField | None = None
    heat: CarriedHeat | None = None
    dissolved: tuple[CarriedScalar, ...] | None = None
    response: SurfaceResponse | None = None
    cut: CutCells | None = None
    passed: Array | None = None


class Substeps(NamedTuple):
    """How an interval is cut into fluid steps; all ().

    Attributes:
        number: int32, one of `SUBSTEPS`.
        step: length of a fluid step [s].
        courant, viscous: Courant and viscosity number of one of these steps.
    """

    number: Array
    step: Array
    courant: Array
    viscous: Array

    def properties(self, of_interval: FluidProperties, k: Array) -> FluidProperties:
        """Numbers of a fluid in step number k; the same of one fluid."""
        second = of_interval.second
        return of_interval if second is None else of_interval._replace(second=second.in_step(k, self.number))


class SolverRecord(NamedTuple):
    """The worst of the pressure solves of an interval; all (). See `FluidDiagnostics`."""

    iterations: Array
    divergence: Array
    converged: Array


class StepSums(NamedTuple):
    """Sums over the fluid steps of an interval.

    Attributes:
        side_load: see `FluidStep`; None where it is not measured.
        mean_gradient: see `FluidState`; None where nothing drives the fluid.
        surface_load: see `FluidStep`; None without surfaces.
        flux: see `FluidStep`; None where it is not kept.
        response: see `FluidStep`; None without pistons in the fluid.
        passed: see `FluidStep`; None where nothing may pass.
    """

    side_load: Array | None
    mean_gradient: Array | None
    surface_load: Array | None = None
    flux: FaceField | None = None
    response: SurfaceResponse | None = None
    passed: Array | None = None

    def plus(self, result: FluidStep) -> StepSums:
        """With one step more."""
        load, gradient, on_surfaces, flux, response, passed = self
        load = None if load is None or result.side_load is None else load + result.side_load
        added = result.state.mean_gradient
        if on_surfaces is not None and result.surface_load is not None:
            on_surfaces = on_surfaces + result.surface_load
        if flux is not None and result.flux is not None:
            flux = tuple(f + x for f, x in zip(flux, result.flux, strict=True))
        if response is not None and result.response is not None:
            response = jax.tree.map(jnp.add, response, result.response)
        gradient = None if gradient is None or added is None else gradient + added
        passed = None if passed is None or result.passed is None else passed + result.passed
        return StepSums(load, gradient, on_surfaces, flux, response, passed)


@static
class FluidInterval:
    """A coupling interval seen by the fluid; static.

    Attributes:
        solver: of the fluid.
        duration: of the interval [s].
        substeps: smallest number of fluid steps.
        courant_limit: a fluid step is cut until its Courant number is under this.
        reversible: loops that reverse-mode differentiation can run backwards.
    """

    solver: FluidSolver
    duration: float
    substeps: int
    courant_limit: float
    reversible: bool = False

    def in_blocks(self, blocks: Blocks, drift: float = 0.0) -> Self:
        """The interval of the fluid in one slab of the box; see `Grid`."""
        solver = dataclasses.replace(self.solver, grid=self.solver.grid.in_blocks(blocks, drift))
        return dataclasses.replace(self, solver=solver)

    def advance(
        self, properties: FluidProperties, state: FluidState, time: Array
    ) -> tuple[FluidState, FluidDiagnostics]:
        """A fluid without particles after the interval that begins at `time` [s]."""
        substeps = self.choose(properties, state, time)

        def step(carry: tuple[FluidState, StepSums], k: Array) -> tuple[Any, SolverRecord]:
            state, sums = carry
            own = substeps.properties(properties, k)
            result = self.solver.step(own, state, time + k * substeps.step, substeps.step)
            return (result.state, sums.plus(result)), solver_record(result)

        (state, sums), record = self.loop(substeps.number, step, (state, self.no_sums(state, properties)))
        return state, diagnostics(self.solver.grid, substeps, record, state, sums, properties)

    def no_sums(self, state: FluidState, properties: FluidProperties) -> StepSums:
        """Zeros to add up over the fluid steps."""
        size, dtype = self.solver.grid.dimension, state.pressure.dtype
        load = jnp.zeros((2 * size, size, 1 + size), dtype) if self.solver.measured_sides else None
        count = self.solver.surfaces
        on_surfaces = jnp.zeros((count, size, 1 + size), dtype) if count else None
        gradient = None if state.mean_gradient is None else jnp.zeros_like(state.mean_gradient)
        flux = tuple(map(jnp.zeros_like, state.face_velocity)) if self.solver.keeps_flux else None
        pistons = None if properties.cut is None else properties.cut.unit_swept
        response = None
        if pistons is not None:
            blank, gap = jnp.zeros((count, size), dtype), jnp.zeros((len(pistons), count), dtype)
            response = SurfaceResponse(jnp.stack([blank] * len(pistons)), blank, blank, gap)
        kinds = 2 if state.liquid_fraction is None else 4
        passed = jnp.zeros((self.solver.passable, kinds), dtype) if self.solver.passable else None
        return StepSums(load, gradient, on_surfaces, flux, response, passed)

    def choose(self, properties: FluidProperties, state: FluidState, time: Array) -> Substeps:
        """The fluid steps that Courant and viscosity number ask for, at least `substeps` of them."""
        courant = self.duration * self._rate(properties, state, time)
        viscous = self._viscous_rate(properties, state, time)
        needed = jnp.maximum(courant / self.courant_limit, viscous / VISCOUS_LIMIT)
        needed = lax.stop_gradient(jnp.maximum(needed, self.substeps))
        choices = jnp.asarray(SUBSTEPS)
        count = choices[jnp.minimum(jnp.searchsorted(choices.astype(needed.dtype), needed), len(SUBSTEPS) - 1)]
        step = jnp.asarray(self.duration, state.pressure.dtype) / count
        courant, viscous = lax.stop_gradient(courant), lax.stop_gradient(viscous)
        return Substeps(count, step, courant / count, viscous / count)

    def loop(
        self, count: Array, step: Callable[[Carry, Array], tuple[Carry, SolverRecord]], carry: Carry
    ) -> tuple[Carry, SolverRecord]:
        """`step` done `count` times with the step's number, and the worst of the solver's records."""
        dtype = next(leaf.dtype for leaf in jax.tree.leaves(carry) if jnp.issubdtype(leaf.dtype, jnp.floating))
        worst = SolverRecord(jnp.zeros((), jnp.int32), jnp.zeros((), dtype), jnp.ones((), bool))

        def advance(both: tuple[Carry, SolverRecord], k: Array) -> tuple[Carry, SolverRecord]:
            carry, (iterations, divergence, converged) = both
            carry, record = step(carry, k)
            return carry, SolverRecord(
                jnp.maximum(iterations, record.iterations),
                jnp.maximum(divergence, record.divergence),
                converged & record.converged,
            )

        if not self.reversible:
            return lax.fori_loop(0, count, lambda k, both: advance(both, k), (carry, worst))

        @jax.checkpoint
        def body(both: tuple[Carry, SolverRecord], k: Array) -> tuple[tuple[Carry, SolverRecord], None]:
            return cond_in_batch(k < count, lambda b: advance(b, k), both), None

        return lax.scan(body, (carry, worst), jnp.arange(SUBSTEPS[-1]))[0]

    def _rate(self, properties: FluidProperties, state: FluidState, time: Array) -> Array:
        """Largest sum over the axes of |u| / h, inlets that are switched on within the interval included [1/s]."""
        grid = self.solver.grid
        speeds = [jnp.max(jnp.abs(u)) / h for u, h in zip(state.face_velocity, grid.spacing, strict=True)]
        for side in self.solver.boundary.sides:
            if side.kind != "inlet":
                continue
            velocity = properties.side_velocity[2 * side.axis + side.upper]
            inflow = largest_inflow(side, velocity, time, time + self.duration)
            if state.void_fraction is not None:
                # An inlet's velocity is superficial: between particles it is higher.
                beside = along(state.void_fraction, side.axis, *((-1, None) if side.upper else (0, 1)))
                beside = jnp.where(of_slab(grid, coverage(grid, side) > 0.0), beside, 1.0)
                inflow = inflow / jnp.min(at_side(grid, side.axis, side.upper, beside, 1.0))
            speeds[side.axis] = jnp.maximum(speeds[side.axis], inflow / grid.spacing[side.axis])
        if properties.cut is not None and self.solver.openings:
            openings = Openings(grid, self.solver.boundary, self.solver.openings)
            times = time, time + self.duration
            through = openings.rates(properties.cut, properties.openings, times, or_one(state.void_fraction))
            speeds = [jnp.maximum(a, b) for a, b in zip(speeds, through, strict=True)]
        rate = jnp.sum(largest(grid.blocks, jnp.stack(speeds)))
        cut = properties.cut
        if state.liquid_fraction is None:
            return rate
        if cut is not None:
            return jnp.maximum(rate, surface_courant_beside(grid, cut, state.face_velocity, state.void_fraction))
        if state.void_fraction is None:
            return rate
        # The surface moves by the volumes that pass a cell, over what its grains leave of it.
        gaps = face_average(grid, state.void_fraction)
        flux = tuple(g * u for g, u in zip(gaps, state.face_velocity, strict=True))
        return jnp.maximum(rate, surface_courant(grid, flux, jnp.ones_like(rate), state.void_fraction))

    def _viscous_rate(self, properties: FluidProperties, state: FluidState, time: Array) -> Array:
        """Viscosity number of the whole interval [-]."""
        dtype = state.pressure.dtype
        if not self.solver.viscous:
            return jnp.zeros((), dtype)
        largest = self.solver.largest_viscosity(properties, state, time)
        return jnp.asarray(self.duration * largest * sum(1.0 / h**2 for h in self.solver.grid.spacing), dtype)


def solver_record(result: FluidStep) -> SolverRecord:
    """What is kept of the pressure solve of one fluid step."""
    return SolverRecord(result.solver.iterations, result.divergence, result.solver.converged)


def diagnostics(
    grid: Grid,
    substeps: Substeps,
    record: SolverRecord,
    state: FluidState,
    sums: StepSums,
    properties: FluidProperties,
) -> FluidDiagnostics:
    """Figures of an interval that ends with `state`."""
    finite = [jnp.all(jnp.isfinite(field)) for field in (*state.face_velocity, state.pressure)]
    means = jax.tree.map(lambda sum_: sum_ / substeps.number, sums)
    load, gradient, on_surfaces, flux, response, passed = means
    if gradient is not None:  # of the pressure itself, with the weight that the reduced one leaves out
        gradient = gradient + properties.density * required(properties.gravity, "gravity of the fluid")
    sound = jnp.all(jnp.asarray(finite))
    if grid.blocks is not None:
        sound = ~any_of(grid.blocks, ~sound)
    courant, viscous = substeps.courant, substeps.viscous
    return FluidDiagnostics(
        substeps.number, courant, viscous, *record, sound, load, gradient, on_surfaces, flux, response=response,
        passed=None if passed is None else total(grid.blocks, passed),
    )  # fmt: skip
