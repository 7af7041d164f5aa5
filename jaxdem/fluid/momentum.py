"""One step of the volume-averaged Navier-Stokes equations by an incremental projection.

    d(g)/dt + div(g u) = 0
    rho [ d(g u)/dt + div(g u u) ] = -g grad p + g div(tau) - f          model A
    rho [ d(g u)/dt + div(g u u) ] =   -grad p +   div(tau) - f          model B

p is the reduced pressure, so gravity does not appear. Heun's method advances advection and stress (central advection:
the third-order method of C.-W. Shu, S. Osher, J. Comput. Phys. 77 (1988) 439-471, whose first two stages are Heun's),
the drag f is implicit at the new velocity, and the projection knows it: the pressure acts on a face through
g / (g + B), in model B 1 / (g + B), where B is the resistance that the particles put on it. Hence no error
is made by splitting drag from pressure, whatever the drag's relaxation time.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.fluid.advection import AdvectionScheme, advection
from jaxdem.fluid.boundary import Boundary, Sides, set_normal_velocity, with_outflow
from jaxdem.fluid.cut_cells import (
    CutCells,
    SurfaceShares,
    continued,
    cut_stress,
    seen_stress,
    stress_on_cuts,
    surface_loads,
)
from jaxdem.fluid.diffusion import strain_rates, stress_divergence
from jaxdem.fluid.drive import Drive, given_gradient, held
from jaxdem.fluid.fluid_state import FaceExchange, FluidProperties, FluidState, FluidStep
from jaxdem.fluid.grid import (
    CellOrOne,
    FaceField,
    Grid,
    agreed,
    along,
    box_largest,
    box_mean,
    box_smallest,
    divergence,
    face_average,
    face_control_volume,
    sum_of,
)
from jaxdem.fluid.mixing_length import mixing_length_over_bed
from jaxdem.fluid.pressure import SolverReport, fast_inverse, pressure_gradient, solve_pressure
from jaxdem.fluid.side_forces import gained_at_sides, pressure_on_sides, stress_on_sides, viscous_stresses
from jaxdem.fluid.subgrid import eddy_viscosity
from jaxdem.fluid.subgrid_stress import (
    SubgridFlow,
    subgrid_acceleration,
    subgrid_diffusivity,
    subgrid_flow,
    subgrid_stress,
)
from jaxdem.numerics.static import static
from jaxdem.numerics.tables import at_time

FLUX_TOLERANCE = 1e-3
"""Largest divergence of the flux that carries momentum between surfaces within a step, in units of U/h."""


class _Rates(NamedTuple):
    """What a stage of the Runge-Kutta method gives, on the faces [m/s2].

    Attributes:
        total: rate of change of g u by advection and stress.
        stress: divergence of the stress over density.
        on_sides: load of stress and advection on the sides over density, see `side_forces`; None unless measured.
        to_closed: what faces that a surface closes would gain, on all faces [m/s2]; None without surfaces.
    """

    total: FaceField
    stress: FaceField
    on_sides: Array | None = None
    to_closed: FaceField | None = None


@static
class FluidSolver:
    """The static description of the fluid, and its step.

    Attributes:
        grid: the mesh.
        boundary: its sides.
        advection: reconstruction of advected momentum.
        viscous: whether there is a viscosity, molecular or subgrid; an inviscid scene compiles no stress.
        model: of the equations, "A" or "B".
        drive: of periodic axes; None compiles none.
        measured_sides: of the box, whose loads are found, see `side_forces`; none: no such term is compiled.
        surfaces: number of surfaces within the mesh, see `cut_cells`.

    Source of the models: Z. Y. Zhou, S. B. Kuang, K. W. Chu, A. B. Yu, J. Fluid Mech. 661 (2010) 482-510, sets II
    and III.
    """

    grid: Grid
    boundary: Boundary
    advection: AdvectionScheme
    viscous: bool
    model: Literal["A", "B"] = "A"
    drive: Drive | None = None
    measured_sides: tuple[int, ...] = ()
    surfaces: int = 0

    @property
    def shares_stress(self) -> bool:
        """Whether particles take their volume's share of pressure gradient and stress (model A)."""
        return self.model == "A"

    def step(
        self,
        properties: FluidProperties,
        state: FluidState,
        void_fraction: Array | None,
        time: Array,
        time_step: Array,
        exchange: FaceExchange | None = None,
        weighting: Array | None = None,
    ) -> FluidStep:
        """Fluid advanced from `time` by `time_step`.

        Args:
            properties: density, viscosity, boundary velocities.
            state: at `time`, with the void fraction that its velocity was projected with.
            void_fraction: on the cells at the end of the step, None without particles.
            time: [s].
            time_step: [s].
            exchange: drag on the faces, None without particles.
            weighting: void fraction that weights pressure and stress: the one whose complement the
                particles see with their interpolation weights, so that the mixture conserves momentum;
                `void_fraction` where not given. Without effect in model B, where nothing weights them.
        """
        grid, end = self.grid, time + time_step
        old = face_average(grid, _or_one(state.void_fraction))
        new = face_average(grid, _or_one(void_fraction))
        weight = self._weight(new, weighting)
        growth: Array | float = 0.0
        if void_fraction is not None:
            growth = (void_fraction - required(state.void_fraction, "void_fraction of the fluid")) / time_step
            if properties.cut is not None:
                growth = properties.cut.growth(growth, not self.boundary.has_outlet)
            elif not self.boundary.has_outlet:
                # Particles keep their volume, so its mean is rounding, which no flow in a closed box can take up.
                growth = growth - box_mean(grid, growth)
        mobility, shift = self._exchange_terms(properties, exchange, new)
        middle = time + 0.5 * time_step
        state = state._replace(mean_gradient=self._mean_gradient(properties, state, middle))
        slope = pressure_slope(grid, self.boundary, state)
        pull = tuple(g * s / properties.density for g, s in zip(weight, slope, strict=True))
        cut, open_old, open_new, friction = properties.cut, old, new, None
        if cut is not None:
            open_old, open_new = cut.opened(old), cut.opened(new)
            friction = _product(weight, tuple(time_step * properties.viscosity * r for r in cut.friction))
            mobility, shift = cut.moved(mobility, shift, new, friction)
            pull = cut.pushed(pull)

        def advance(rates: FaceField) -> FaceField:
            advanced = tuple(
                (g * u + time_step * (rate - p) + extra) * m
                for g, u, rate, p, extra, m in zip(old, state.face_velocity, rates, pull, shift, mobility, strict=True)
            )
            advanced = set_normal_velocity(grid, self._sides(properties, end), advanced, new)
            return advanced if cut is None else cut.with_walls(advanced)

        first_flux = _product(open_old, state.face_velocity)
        if void_fraction is not None:
            first_flux = self.corrected(first_flux, growth, cut)
        rates = [self._rates(properties, first_flux, state.face_velocity, weight, state.void_fraction, time)]
        trial = advance(rates[0].total)
        flux = self.corrected(_product(open_new, trial), growth, cut)
        rates.append(self._rates(properties, flux, trial, weight, void_fraction, end))
        mean = _weighted(rates, (0.5, 0.5))
        predicted = advance(mean.total)
        if self.advection.stages == 3:
            # The third stage is at the middle of the step, which Heun's result is twice as far as.
            velocity = _halfway(state.face_velocity, predicted)
            flux = _halfway(_product(open_old, state.face_velocity), _product(open_new, predicted))
            flux = self.corrected(flux, growth, cut)
            g = None if void_fraction is None else 0.5 * (_or_one(state.void_fraction) + void_fraction)
            rates.append(self._rates(properties, flux, velocity, weight, g, time + 0.5 * time_step))
            mean = _weighted(rates, (1.0 / 6.0, 1.0 / 6.0, 2.0 / 3.0))
            predicted = advance(mean.total)
        push = tuple((time_step / properties.density) * w * m for w, m in zip(weight, mobility, strict=True))
        if cut is not None:
            push = cut.pushed(push)
        mean_gradient = state.mean_gradient
        if self.drive is not None and any(self.drive.held):
            numbers = required(properties.drive, "parameters.fluid.drive")
            target = at_time(self.drive.times, required(numbers.bulk_velocity, "bulk_velocity of the drive"), end)
            if cut is not None:
                target = target * open_section(grid, cut)
            predicted, change = held(grid, self.drive, target, predicted, open_new, push)
            mean_gradient = required(mean_gradient, "mean_gradient of the fluid") + change
        velocity, pressure, report, remaining = self._project(state.pressure, predicted, open_new, push, growth, cut)
        fluid = FluidState(velocity, pressure, void_fraction, mean_gradient)
        on_sides = None
        if mean.on_sides is not None:
            on_sides = properties.density * mean.on_sides + pressure_on_sides(grid, self.measured_sides, pressure)
            if exchange is not None:
                on_sides = on_sides + self._handed_to_sides(properties, fluid, mean.stress, weight, exchange, time_step)
        if cut is None or friction is None:
            return FluidStep(fluid, mean.stress, report, remaining, on_sides)
        # Of the fluid and of the particles' part of it.
        held_back = tuple(
            properties.viscosity * r * (u - w) for r, u, w in zip(cut.friction, velocity, cut.velocity, strict=True)
        )
        stress = seen_stress(grid, self.boundary, cut, mean.stress, held_back)
        on_faces = _sum_of_fields(held_back, required(mean.to_closed, "to_closed of the rates"))
        on_faces = tuple(properties.density * f for f in on_faces)
        if exchange is not None:
            solids = 1.0 - required(void_fraction if weighting is None else weighting, "void fraction")
            shares = self._taken_from_surfaces(properties, fluid, stress, weight, cut.open_cells * solids)
            on_faces = _sum_of_fields(on_faces, shares)
        load = self._load_of_surfaces(properties, fluid, on_faces, exchange, time_step)
        return FluidStep(fluid, stress, report, remaining, on_sides, load)

    def _taken_from_surfaces(
        self,
        properties: FluidProperties,
        fluid: FluidState,
        stress: FaceField,
        weight: tuple[CellOrOne, ...],
        solids: Array,
    ) -> FaceField:
        """What particles take of pressure gradient and stress beyond what the fluid leaves them on cut and closed
        faces, over the volume of whole control volumes [N/m3]: the surfaces take the opposite.

        Args:
            properties: of the fluid.
            fluid: at the end of the step.
            stress: as particles see it [m/s2].
            weight: part of both that acts on the fluid.
            solids: volume of the particles over that of whole cells [-].
        """
        grid, cut = self.grid, required(properties.cut, "cut cells")
        if not self.shares_stress:
            return tuple(jnp.zeros_like(u) for u in fluid.face_velocity)
        slope = continued(cut, pressure_slope(grid, self.boundary, fluid, continued=True))
        seen = face_average(grid, solids)
        parts = zip(seen, cut.open_faces, weight, slope, stress, strict=True)
        return tuple((s - a * (1.0 - w)) * (p - properties.density * t) for s, a, w, p, t in parts)

    def _load_of_surfaces(
        self,
        properties: FluidProperties,
        fluid: FluidState,
        on_faces: FaceField,
        exchange: FaceExchange | None,
        time_step: Array,
    ) -> Array:
        """Load on every surface: what acts on its faces [N/m3], what particles hand to closed faces, the pressure."""
        grid, cut, forces = self.grid, required(properties.cut, "cut cells"), []
        for axis, density in enumerate(on_faces):
            force = face_control_volume(grid, axis).astype(density.dtype) * density
            if exchange is not None:
                handed = exchange.forcing[axis] - exchange.resistance[axis] * cut.velocity[axis]
                force = force + jnp.where(cut.open_faces[axis] > 0.0, 0.0, handed / time_step)
            forces.append(force)
        viscosity = properties.density * properties.viscosity
        shares = SurfaceShares(tuple(forces), stress_on_cuts(grid, cut, fluid.pressure, viscosity))
        return surface_loads(grid, cut, shares, self.surfaces)

    def _handed_to_sides(
        self,
        properties: FluidProperties,
        fluid: FluidState,
        stress: FaceField,
        weight: tuple[CellOrOne, ...],
        exchange: FaceExchange,
        time_step: Array,
    ) -> Array:
        """Load on the sides of what particles hand to the boundary faces: what these lose, and the part of pressure
        gradient and stress that the particles take there."""
        grid, force = self.grid, []
        for axis, u in enumerate(fluid.face_velocity):
            volume = face_control_volume(grid, axis).astype(u.dtype)
            given = (exchange.forcing[axis] - exchange.resistance[axis] * u) / (time_step * volume)
            if self.shares_stress:
                slope = pressure_slope(grid, self.boundary, fluid, continued=True)[axis]
                given = given + (1.0 - weight[axis]) * (slope - properties.density * stress[axis])
            force.append(given)
        return gained_at_sides(grid, self.measured_sides, tuple(force))

    def first_gradient(self, properties: FluidProperties) -> Array | None:
        """(D,) mean gradient of the reduced pressure that the scene gives at its start [Pa/m]; None without a drive."""
        if self.drive is None:
            return None
        return self._given_gradient(self.drive, properties, jnp.zeros_like(properties.density))

    def _given_gradient(self, drive: Drive, properties: FluidProperties, time: Array) -> Array:
        numbers = required(properties.drive, "parameters.fluid.drive")
        weight = properties.density * required(properties.gravity, "gravity of the fluid")
        return given_gradient(drive, numbers, weight, time)

    def _mean_gradient(self, properties: FluidProperties, state: FluidState, time: Array) -> Array | None:
        """What the scene gives at this time; along an axis that is held what the last step needed."""
        if self.drive is None:
            return None
        given = self._given_gradient(self.drive, properties, time)
        last = required(state.mean_gradient, "mean_gradient of the fluid")
        return jnp.where(jnp.asarray(self.drive.held), last, given)

    def largest_viscosity(self, properties: FluidProperties, state: FluidState, time: Array) -> Array:
        """() largest kinematic viscosity, molecular and subgrid, for the limit of the explicit stress [m2/s].

        In model B the whole stress acts on the part g of the volume: it is over the smallest void fraction.

        Args:
            properties: viscosity, subgrid viscosity or stress, boundary velocities.
            state: of the fluid at `time`.
            time: [s].
        """
        largest = properties.viscosity
        length = self._mixing_length(properties, state.void_fraction)
        if length is not None:
            rates = strain_rates(self.grid, self._sides(properties, time), state.face_velocity)
            largest = largest + box_largest(self.grid, eddy_viscosity(rates, length))
        if not self.shares_stress and state.void_fraction is not None:
            largest = largest / box_smallest(self.grid, state.void_fraction)
        flow = self._subgrid_flow(properties, state.face_velocity, state.void_fraction, time)
        if flow is not None:
            # It acts on the part g of the volume too, with the g of other cells.
            lowest = 1.0 if state.void_fraction is None else box_smallest(self.grid, state.void_fraction)
            largest = largest + box_largest(self.grid, subgrid_diffusivity(self.grid, flow)) / lowest
        return largest

    def _mixing_length(self, properties: FluidProperties, void_fraction: Array | None) -> Array | None:
        """Of the eddy viscosity, () or in the cells [m]; None without one."""
        if properties.bed_mixing is not None:
            return mixing_length_over_bed(self.grid, properties.bed_mixing, void_fraction)
        return None if properties.smagorinsky is None else properties.smagorinsky * self.grid.filter_size

    def _subgrid_flow(
        self, properties: FluidProperties, velocity: FaceField, void_fraction: Array | None, time: Array
    ) -> SubgridFlow | None:
        """What the subgrid stress is made of, None without one."""
        if properties.subgrid is None:
            return None
        sides = self._sides(properties, time)
        return subgrid_flow(self.grid, sides, properties.subgrid, velocity, properties.viscosity, void_fraction)

    def _sides(self, properties: FluidProperties, time: Array) -> Sides:
        return Sides(self.boundary, properties.side_velocity, time)

    def _weight(self, void_fraction: tuple[CellOrOne, ...], weighting: Array | None) -> tuple[CellOrOne, ...]:
        """Part of pressure gradient and stress that acts on the fluid, on the faces."""
        if not self.shares_stress:
            return (1.0,) * self.grid.dimension
        return void_fraction if weighting is None else face_average(self.grid, weighting)

    def _exchange_terms(
        self,
        properties: FluidProperties,
        exchange: FaceExchange | None,
        void_fraction: tuple[CellOrOne, ...],
    ) -> tuple[tuple[Array | float, ...], tuple[Array | float, ...]]:
        """1 / (g + B) and the forcing per mass of fluid, on the faces."""
        if exchange is None:
            return tuple(1.0 / g for g in void_fraction), (0.0,) * self.grid.dimension
        mobility, shift = [], []
        for axis, g in enumerate(void_fraction):
            volume = face_control_volume(self.grid, axis).astype(exchange.forcing[axis].dtype)
            mass = properties.density * volume
            mobility.append(1.0 / (g + exchange.resistance[axis] / mass))
            shift.append(exchange.forcing[axis] / mass)
        return tuple(mobility), tuple(shift)

    def _rates(
        self,
        properties: FluidProperties,
        flux: FaceField,
        velocity: FaceField,
        weight: tuple[CellOrOne, ...],
        void_fraction: Array | None,
        time: Array,
    ) -> _Rates:
        """Rates of a stage.

        The subgrid stress belongs to the first: it moves the fluid's momentum and is no force on what is in the fluid.
        """
        grid, sides, cut = self.grid, self._sides(properties, time), properties.cut
        rates = advection(grid, sides, self.advection, flux, velocity, cut)
        on_sides = gained_at_sides(grid, self.measured_sides, rates) if self.measured_sides else None
        if cut is not None:
            return self._cut_rates(cut, rates, sides, velocity, weight, (properties.viscosity, void_fraction))
        flow = self._subgrid_flow(properties, velocity, void_fraction, time)
        if flow is not None:
            within = subgrid_stress(grid, flow, void_fraction)
            moved = subgrid_acceleration(grid, self.boundary, within)
            rates = tuple(r + m for r, m in zip(rates, moved, strict=True))
            if on_sides is not None:
                on_sides = on_sides + stress_on_sides(grid, self.measured_sides, self.boundary, within)
        if not self.viscous:
            return _Rates(rates, tuple(jnp.zeros_like(u) for u in velocity), on_sides)
        length = self._mixing_length(properties, void_fraction)
        if on_sides is not None:
            found = viscous_stresses(grid, sides, velocity, properties.viscosity, length)
            on_sides = on_sides + stress_on_sides(grid, self.measured_sides, self.boundary, found)
        stress = stress_divergence(grid, sides, velocity, properties.viscosity, length)
        total = tuple(r + g * s for r, g, s in zip(rates, weight, stress, strict=True))
        return _Rates(total, stress, on_sides)

    def _cut_rates(
        self,
        cut: CutCells,
        rates: FaceField,
        sides: Sides,
        velocity: FaceField,
        weight: tuple[CellOrOne, ...],
        fluid: tuple[Array, Array | None],
    ) -> _Rates:
        """Rates of a stage between surfaces, from those of advection; `fluid` are viscosity and void fraction."""
        viscosity, void_fraction = fluid
        stress = lost = tuple(jnp.zeros_like(u) for u in velocity)
        if self.viscous:
            stress, lost = cut_stress(self.grid, sides, cut, velocity, viscosity, void_fraction is not None)
        on_open = zip(rates, weight, stress, cut.inertia, strict=True)
        total = cut.on_open(tuple((r + g * s) / m for r, g, s, m in on_open))
        on_closed = zip(rates, lost, cut.open_faces, strict=True)
        to_closed = tuple(jnp.where(a > 0.0, 0.0, r) + s for r, s, a in on_closed)
        return _Rates(total, stress, None, to_closed)

    def corrected(self, flux: FaceField, growth: Array | float, cut: CutCells | None = None) -> FaceField:
        """The flux changed so that div(F) = -d(g)/dt: on outlets by the speed that balances the box, within by a
        gradient.

        Momentum carried by such a flux is conserved and a uniform stream stays uniform, exactly, while
        the void fraction changes.
        """
        grid = self.grid
        excess = divergence(grid, flux) + growth
        if cut is not None:
            return self._corrected_between_surfaces(flux, excess, cut)
        if self.boundary.has_outlet:
            flux = with_outflow(grid, self.boundary, flux, -box_mean(grid, excess))
            excess = divergence(grid, flux) + growth
        potential = fast_inverse(grid, None)(excess)
        slope = pressure_gradient(grid, _closed(self.boundary), potential)
        return tuple(f + s for f, s in zip(flux, slope, strict=True))

    def _corrected_between_surfaces(self, flux: FaceField, excess: Array, cut: CutCells) -> FaceField:
        """The same through open fractions, to `FLUX_TOLERANCE`: the projection after it is exact."""
        grid = self.grid
        scale = sum_of(box_largest(grid, jnp.abs(f)) / h for f, h in zip(flux, grid.spacing, strict=True))
        # Of a flow that is slower than the volumes change, what is left of that counts.
        scale = jnp.maximum(scale, box_largest(grid, jnp.abs(excess)))
        potential, _ = solve_pressure(
            grid, self.boundary, cut.open_faces, excess, FLUX_TOLERANCE * scale, cut.open_cells > 0.0
        )
        slope = pressure_gradient(grid, self.boundary, potential)
        return tuple(f - a * s for f, a, s in zip(flux, cut.open_faces, slope, strict=True))

    def _project(
        self,
        pressure: Array,
        predicted: FaceField,
        void_fraction: tuple[CellOrOne, ...],
        push: tuple[Array | float, ...],
        growth: Array | float,
        cut: CutCells | None = None,
    ) -> tuple[FaceField, Array, SolverReport, Array]:
        """Velocity made to satisfy continuity, the pressure that did it, and how well the solver has done.

        Args:
            pressure: at the start of the step [Pa].
            predicted: velocity before the projection [m/s].
            void_fraction: on the faces [-].
            push: change of the velocity by a pressure gradient, on the faces [m3 s/kg].
            growth: rate of change of the void fraction [1/s].
            cut: surfaces within the mesh; void fraction and growth are then of the open parts.
        """
        grid, boundary = self.grid, self.boundary
        fluid_cells = None if cut is None else cut.open_cells > 0.0
        flux = _product(void_fraction, predicted)
        # In units of U/h: 1e-10 is asked for in float64, 1e-5 in float32.
        scale = sum(box_largest(grid, jnp.abs(f)) / h for f, h in zip(flux, grid.spacing, strict=True))
        scale = scale + box_largest(grid, jnp.abs(jnp.asarray(growth, flux[0].dtype))) + jnp.finfo(flux[0].dtype).tiny
        velocity, iterations = predicted, jnp.zeros((), jnp.int32)
        # A pressure of many cells' worth of head hides its own differences in float32. The second pass
        # solves for the divergence that the first has left, whose pressure is small and well resolved.
        passes = (1e-4, 2e-6) if flux[0].dtype == jnp.float32 else (2e-12,)
        for tolerance in passes:
            source = divergence(grid, _product(void_fraction, velocity)) + growth
            correction, report = solve_pressure(
                grid, boundary, _product(void_fraction, push), source, tolerance * scale, fluid_cells
            )
            slope = pressure_gradient(grid, boundary, correction)
            velocity = agreed(grid, tuple(u - c * s for u, c, s in zip(velocity, push, slope, strict=True)))
            pressure = pressure + correction
            iterations = iterations + report.iterations
        left = jnp.abs(divergence(grid, _product(void_fraction, velocity)) + growth)
        remaining = box_largest(grid, left) / scale
        report = SolverReport(iterations, remaining * scale, remaining <= 5.0 * passes[-1])
        return velocity, pressure, report, remaining


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


def _or_one(void_fraction: Array | None) -> CellOrOne:
    return 1.0 if void_fraction is None else void_fraction


def _sum_of_fields(a: FaceField, b: FaceField) -> FaceField:
    return tuple(x + y for x, y in zip(a, b, strict=True))


def _product(a, b):  # type: ignore[no-untyped-def]
    return tuple(x * y for x, y in zip(a, b, strict=True))


def _weighted(stages: Sequence[_Rates], weights: tuple[float, ...]) -> _Rates:
    """Sum of the stages with weights."""
    mean: _Rates = jax.tree.map(lambda *rates: sum_of(w * r for w, r in zip(weights, rates, strict=True)), *stages)
    return mean


def _halfway(a: FaceField, b: FaceField) -> FaceField:
    return tuple(0.5 * (x + y) for x, y in zip(a, b, strict=True))


def _closed(boundary: Boundary) -> Boundary:
    """The same box without outlets."""
    return Boundary(
        tuple(
            dataclasses.replace(s, kind="no_slip", own=None) if s.condition.sets_pressure else s for s in boundary.sides
        )
    )
