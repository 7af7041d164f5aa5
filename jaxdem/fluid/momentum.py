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

from typing import Literal

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.fluid.advection import AdvectionScheme
from jaxdem.fluid.boundary import Boundary, Sides
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.cut_projection import CutContinuity
from jaxdem.fluid.cut_stress import CutViscosity, seen_stress
from jaxdem.fluid.diffusion import strain_rates
from jaxdem.fluid.drive import Drive, given_gradient, held
from jaxdem.fluid.fluid_state import FaceExchange, FluidProperties, FluidState, FluidStep, ParticleFields
from jaxdem.fluid.grid import (
    CellOrOne,
    FaceField,
    Grid,
    box_largest,
    box_mean,
    box_smallest,
    face_average,
    face_control_volume,
    sum_of_fields,
)
from jaxdem.fluid.momentum_rates import MomentumRates, Rates
from jaxdem.fluid.momentum_step import MomentumStep, or_one
from jaxdem.fluid.openings import Opening, Openings
from jaxdem.fluid.passages import passages
from jaxdem.fluid.projection import Continuity, open_section, pressure_slope, product
from jaxdem.fluid.side_forces import pressure_on_sides
from jaxdem.fluid.step_loads import StepLoads
from jaxdem.fluid.subgrid import eddy_viscosity
from jaxdem.fluid.subgrid_stress import subgrid_diffusivity
from jaxdem.numerics.static import static
from jaxdem.numerics.tables import at_time


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
        keeps_flux: whether the volume flux of every step is told, for the scalars that it carries.
        openings: inlets and outlets on these surfaces.

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
    keeps_flux: bool = False
    openings: tuple[Opening, ...] = ()

    @property
    def passable(self) -> int:
        """Number of boundaries that fluid may pass, see `passages`."""
        return len(self.boundary.passable) + len(self.openings)

    @property
    def shares_stress(self) -> bool:
        """Whether particles take their volume's share of pressure gradient and stress (model A)."""
        return self.model == "A"

    def step(
        self,
        properties: FluidProperties,
        state: FluidState,
        time: Array,
        time_step: Array,
        particles: ParticleFields | None = None,
    ) -> FluidStep:
        """Fluid advanced from `time` by `time_step`.

        Args:
            properties: density, viscosity, boundary velocities.
            state: at `time`, with the void fraction that its velocity was projected with.
            time: [s].
            time_step: [s].
            particles: what they are to the fluid; None without.
        """
        begun = self._begun(properties, state, (time, time_step), particles)
        mean, predicted = begun.predicted()
        properties, state = begun.properties, begun.state
        grid, cut = self.grid, properties.cut
        push = tuple(
            (time_step / properties.density) * w * m for w, m in zip(begun.weight, begun.mobility, strict=True)
        )
        if cut is not None:
            push = cut.pushed(push)
        predicted, mean_gradient = self._held(properties, begun, predicted, push)
        velocity, pressure, report, remaining = begun.continuity.projected(
            state.pressure, predicted, begun.open_new, push
        )
        fluid = FluidState(velocity, pressure, begun.void_fraction, mean_gradient)
        if state.pressure_change is not None:
            fluid = fluid._replace(pressure_change=pressure - state.pressure)
        result = FluidStep(fluid, mean.stress, report, remaining)
        if self.keeps_flux or self.passable:
            flux = product(begun.open_new, velocity)
            passed = passages(grid, self.boundary, flux, cut)
            result = result._replace(flux=flux if self.keeps_flux else None, passed=passed)
        exchange = None if particles is None else particles.exchange
        loads = StepLoads(
            grid, self.boundary, self.shares_stress, properties, fluid, begun.weight, exchange, time_step
        )  # fmt: skip
        if mean.on_sides is not None:
            on_sides = properties.density * mean.on_sides + pressure_on_sides(grid, self.measured_sides, pressure)
            if exchange is not None:
                on_sides = on_sides + loads.handed_to_sides(self.measured_sides, mean.stress)
            result = result._replace(side_load=on_sides)
        if cut is None:
            return result
        if cut.unit_swept is not None:
            result = result._replace(response=begun.response(self.surfaces))
        stress, load = self._at_surfaces(cut, loads, mean, particles, required(begun.at_surfaces, "viscosity"))
        return result._replace(viscous_acceleration=stress, surface_load=load)

    def _begun(
        self,
        properties: FluidProperties,
        state: FluidState,
        times: tuple[Array, Array],
        particles: ParticleFields | None,
    ) -> MomentumStep:
        """What does not change within a step of (start, length)."""
        grid, (time, time_step) = self.grid, times
        void_fraction = None if particles is None else particles.void_fraction
        exchange = None if particles is None else particles.exchange
        weighting = None if particles is None else particles.weighting
        old = face_average(grid, or_one(state.void_fraction))
        new = face_average(grid, or_one(void_fraction))
        weight = self._weight(new, weighting)
        properties, growth = self._growing(properties, state, void_fraction, times, new)
        mobility, shift = self._exchange_terms(properties, exchange, new)
        state = state._replace(mean_gradient=self._mean_gradient(properties, state, time + 0.5 * time_step))
        slope = pressure_slope(grid, self.boundary, state)
        pull = tuple(g * s / properties.density for g, s in zip(weight, slope, strict=True))
        if properties.buoyancy is not None:
            pull = tuple(p - g * a for p, g, a in zip(pull, new, properties.buoyancy, strict=True))
        cut, open_old, open_new, at_surfaces = properties.cut, old, new, None
        if cut is not None:
            open_old, open_new = cut.opened(old), cut.opened(new)
            at_surfaces = self.terms.cut_viscosity(properties, state.face_velocity, state.void_fraction, time)
            held = zip(at_surfaces.on_faces(grid), cut.friction, strict=True)
            friction = product(weight, tuple(time_step * nu * r for nu, r in held))
            mobility, shift = cut.moved(mobility, shift, new, friction)
            pull = cut.pushed(pull)
        continuity: Continuity | CutContinuity = Continuity(grid, self.boundary, growth)
        if cut is not None:
            continuity = CutContinuity(grid, self.boundary, growth, cut, state.pressure_change)
        return MomentumStep(
            self.terms, properties, state, void_fraction, time, time_step, (old, new), (open_old, open_new), weight,
            continuity, mobility, shift, pull, at_surfaces,
        )  # fmt: skip

    def _growing(
        self,
        properties: FluidProperties,
        state: FluidState,
        void_fraction: Array | None,
        times: tuple[Array, Array],
        on_faces: tuple[CellOrOne, ...],
    ) -> tuple[FluidProperties, Array | float]:
        """The properties with what passes openings at the end of a step of (start, length), and what continuity asks
        for: the rate of change of the volume of fluid in the cells less what comes in there [1/s]."""
        grid, cut, closed_box, (time, time_step) = self.grid, properties.cut, not self.boundary.has_outlet, times
        rate = None
        if void_fraction is not None:
            rate = (void_fraction - required(state.void_fraction, "void_fraction of the fluid")) / time_step
        if cut is None:
            if rate is None:
                return properties, 0.0
            # Particles keep their volume, so its mean is rounding, which no flow in a closed box can take up.
            return properties, rate - box_mean(grid, rate) if closed_box else rate
        if self.openings:
            openings, sides = Openings(grid, self.boundary, self.openings), self.sides(properties, time + time_step)
            growth = cut.growth(grid, 0.0 if rate is None else rate, False)
            cut, growth = openings.through(cut, properties.openings, sides, on_faces, growth)
            return properties._replace(cut=cut), growth
        if rate is None and cut.swept is None:
            return properties, 0.0
        return properties, cut.growth(grid, 0.0 if rate is None else rate, closed_box)

    def _held(
        self, properties: FluidProperties, begun: MomentumStep, predicted: FaceField, push: tuple[Array | float, ...]
    ) -> tuple[FaceField, Array | None]:
        """The predicted velocity with the bulk velocity that is held, and the mean gradient that it needs."""
        if self.drive is None or not any(self.drive.held):
            return predicted, begun.state.mean_gradient
        numbers = required(properties.drive, "parameters.fluid.drive")
        target = at_time(self.drive.times, required(numbers.bulk_velocity, "bulk_velocity of the drive"), begun.end)
        if properties.cut is not None:
            target = target * open_section(self.grid, properties.cut)
        predicted, change = held(self.grid, self.drive, target, predicted, begun.open_new, push)
        return predicted, required(begun.state.mean_gradient, "mean_gradient of the fluid") + change

    def _at_surfaces(
        self,
        cut: CutCells,
        loads: StepLoads,
        mean: Rates,
        particles: ParticleFields | None,
        viscosity: CutViscosity,
    ) -> tuple[FaceField, Array]:
        """Stress as particles see it [m/s2], of the fluid and of the particles' part of it; and the load on every
        surface."""
        properties, fluid = loads.properties, loads.fluid
        parts = zip(viscosity.on_faces(self.grid), cut.friction, fluid.face_velocity, cut.velocity, strict=True)
        held_back = tuple(nu * r * (u - w) for nu, r, u, w in parts)
        stress = seen_stress(self.grid, self.boundary, cut, mean.stress, held_back)
        on_faces = sum_of_fields(held_back, cut.on_closed(mean.total))
        if mean.lost is not None:
            on_faces = sum_of_fields(on_faces, mean.lost)
        on_faces = tuple(properties.density * f for f in on_faces)
        if particles is not None and particles.exchange is not None:
            solids = 1.0 - (particles.void_fraction if particles.weighting is None else particles.weighting)
            on_faces = sum_of_fields(on_faces, loads.taken_from_surfaces(stress, cut.open_cells * solids))
        return stress, loads.on_surfaces(on_faces, viscosity.in_cells, self.surfaces)

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
        length = self.terms.mixing_length(properties, state.void_fraction)
        if length is not None:
            eddy = self.terms.cut_viscosity(properties, state.face_velocity, state.void_fraction, time).eddy
            if eddy is None:
                rates = strain_rates(self.grid, self.sides(properties, time), state.face_velocity)
                eddy = eddy_viscosity(rates, length)
            largest = largest + box_largest(self.grid, eddy)
        if not self.shares_stress and state.void_fraction is not None:
            largest = largest / box_smallest(self.grid, state.void_fraction)
        flow = self.terms.subgrid_flow(properties, state.face_velocity, state.void_fraction, time)
        if flow is not None:
            # It acts on the part g of the volume too, with the g of other cells.
            lowest = 1.0 if state.void_fraction is None else box_smallest(self.grid, state.void_fraction)
            largest = largest + box_largest(self.grid, subgrid_diffusivity(self.grid, flow)) / lowest
        return largest

    def slope_at_particles(self, properties: FluidProperties, state: FluidState) -> FaceField:
        """Gradient of the reduced pressure as particles see it, on the faces: beside closed sides that of the nearest
        inner face [Pa/m]."""
        return pressure_slope(self.grid, self.boundary, state, continued=True)

    @property
    def terms(self) -> MomentumRates:
        """Advection and stress."""
        return MomentumRates(self.grid, self.boundary, self.advection, self.viscous, self.measured_sides)

    def sides(self, properties: FluidProperties, time: Array) -> Sides:
        """The sides of the box as they move at a time [s]."""
        return self.terms.sides(properties, time)

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
